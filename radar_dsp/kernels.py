"""Inner loops of the baseband, compiled; the tests hold each of them to plain numpy."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from radar_dsp.windows import FLOOR

FloatMap = NDArray[np.float32]
Cells = tuple[NDArray[np.intp], NDArray[np.intp]]
Mask = NDArray[np.bool_]
Offsets = NDArray[np.intp]
CLOUD_ROWS = (
    *("x", "y", "z", "range", "azimuth", "elevation", "radial_speed"),
    *("snr", "noise", "range_std", "azimuth_std", "elevation_std", "radial_speed_std"),
)
"""Names of the rows that `pack` gives."""
LEAST_SNR = 1e-3
TINY = float(np.finfo(np.float32).tiny)

_jit = numba.njit(cache=True, nogil=True)
_GROUPING = {"none": 0, "range": 1, "peak": 2}


@_jit
def integrate(spectrum: Any) -> FloatMap:
    """Non-coherent integration: mean power over the virtual channels, shape (n_speed, n_range).

    The thesis sums; the mean differs by a constant and keeps the noise floor in the unit of the samples' power.
    """
    n_tx, n_speed, n_rx, n_range = spectrum.shape
    power = np.zeros((n_speed, n_range), np.float32)
    scale = np.float32(1.0 / (n_tx * n_rx))
    for s in range(n_speed):
        row = power[s]
        for tx in range(n_tx):
            for rx in range(n_rx):
                channel = spectrum[tx, s, rx]
                for r in range(n_range):
                    row[r] += channel[r].real * channel[r].real + channel[r].imag * channel[r].imag
        for r in range(n_range):
            row[r] *= scale
    return power


@_jit
def pad(values: FloatMap, usable: Mask, half: tuple[int, int], fill: float) -> FloatMap:
    """Wrap along speed, put ``fill`` where a training cell does not exist; shape (n_speed + 2 half[0], n_range + 2 half[1])."""
    hs, hr = half
    n_speed, n_range = values.shape
    padded = np.full((n_speed + 2 * hs, n_range + 2 * hr), fill, np.float32)
    for i in range(n_speed + 2 * hs):
        s = (i - hs) % n_speed
        for r in range(n_range):
            if usable[s, r]:
                padded[i, r + hr] = values[s, r]
    return padded


@_jit
def rank_test(padded: FloatMap, threshold: FloatMap, rank: Any, offsets: Offsets, half: tuple[int, int]) -> Mask:
    """Cells with at least ``rank`` training cells below their threshold, shape (n_speed, n_range)."""
    hs, hr = half
    n_speed, n_range = threshold.shape
    mask = np.empty((n_speed, n_range), np.bool_)
    count = np.empty(n_range, np.int32)
    for s in range(n_speed):
        limit = threshold[s]
        count[:] = 0
        for k in range(len(offsets)):
            start = hr + offsets[k, 1]
            training = padded[s + hs + offsets[k, 0], start : start + n_range]
            for r in range(n_range):
                count[r] += training[r] < limit[r]
        for r in range(n_range):
            mask[s, r] = count[r] >= rank[s, r]
    return mask


@_jit
def sums(padded: FloatMap, offsets: Offsets, half: tuple[int, int]) -> FloatMap:
    """Sum of the training cells of each cell, shape (n_speed, n_range)."""
    hs, hr = half
    n_speed, n_range = padded.shape[0] - 2 * hs, padded.shape[1] - 2 * hr
    total = np.zeros((n_speed, n_range), np.float32)
    for s in range(n_speed):
        row = total[s]
        for k in range(len(offsets)):
            start = hr + offsets[k, 1]
            training = padded[s + hs + offsets[k, 0], start : start + n_range]
            for r in range(n_range):
                row[r] += training[r]
    return total


@_jit
def ordered(padded: FloatMap, cells: Cells, offsets: Offsets, half: tuple[int, int], rank: Any) -> FloatMap:
    """Order statistic of the training cells at single cells, shape (n_cells,)."""
    (speed, distance), (hs, hr) = cells, half
    flat, stride = padded.ravel(), padded.shape[1]
    shift = np.empty(len(offsets), np.uint64)  # unsigned: no test for a negative index in the loop
    for k in range(len(offsets)):
        shift[k] = (offsets[k, 0] + hs) * stride + offsets[k, 1] + hr
    result = np.empty(len(speed), np.float32)
    work = np.empty(len(offsets), np.float32)
    for p in range(len(speed)):
        start = np.uint64(speed[p] * stride + distance[p])
        for k in range(len(shift)):
            work[k] = flat[start + shift[k]]
        result[p] = _select(work, rank[p])
    return result


@_jit
def _select(values: Any, rank: int) -> Any:
    """Find the ``rank``-th smallest of positive numbers by bisection on their bit patterns: counting is a loop without branches."""
    bits = values.view(np.int32)
    low, high = bits[0], bits[0]
    for k in range(len(bits)):
        low, high = min(low, bits[k]), max(high, bits[k])
    low -= 1
    n_low, n_high = 0, len(bits)
    while high - low > 1 and n_high - n_low > 1:
        middle = low + (high - low) // 2
        n = 0
        for k in range(len(bits)):
            n += bits[k] <= middle
        if n >= rank:
            high, n_high = middle, n
        else:
            low, n_low = middle, n
    best = low
    for k in range(len(bits)):
        if bits[k] <= high:
            best = max(best, bits[k])
    bits[0] = best
    return values[0]


def find(mask: Any, power: FloatMap, grouping: str) -> Cells:
    """Cells of a mask that become points, ordered by speed, then range.

    ``none``: all; ``range``: local maxima along range; ``peak``: larger than all eight neighbours; of equal neighbours the first wins. Both
    axes are circular: a transform leaks around its ends, in range too. On an axis of one cell everything is a maximum.
    """
    speed, distance = _find(mask, power, _GROUPING[grouping])
    return speed, distance


@_jit
def _find(mask: Any, power: Any, grouping: int) -> Any:
    n_speed, n_range = power.shape
    speed, distance = np.empty(power.size, np.intp), np.empty(power.size, np.intp)
    n = 0
    for s in range(n_speed):
        for r in range(n_range):
            if not mask[s, r]:
                continue
            at = power[s, r]
            left, right = (r - 1) % n_range, (r + 1) % n_range
            if grouping > 0 and n_range > 1 and not (at > power[s, left] and at >= power[s, right]):
                continue
            if grouping == 2 and n_speed > 1:
                below, above = (s - 1) % n_speed, (s + 1) % n_speed
                if not at > max(power[below, left], power[below, r], power[below, right]):
                    continue
                if not at >= max(power[above, left], power[above, r], power[above, right]):
                    continue
            speed[n], distance[n] = s, r
            n += 1
    return speed[:n].copy(), distance[:n].copy()


class Scales(NamedTuple):
    """What turns offsets in cells into estimates.

    Attributes
    ----------
    tables : ndarray of float64, shape (2, 2, n_table)
        Of the speed and of the range axis (`windows.Interpolator`): offset over the vertex of the parabola from -1 to 1, and variance of
        the offset over the offset from -0.5 to 0.5, times the cell's total signal-to-noise ratio.
    edges : ndarray of float64, shape (2,)
        Vertex beyond which an echo does not peak in the cell, per axis.
    range_resolution, speed_resolution, max_speed : float
        Of the waveform [m, m/s, m/s]; the range is not measured where its resolution is infinite, the speed where there is one chirp.
    coupling, n_channel : float, int
        By how much a range rate of 1 m/s makes an echo look farther [s]; number of integrated channels.
    """

    tables: NDArray[np.float64]
    edges: NDArray[np.float64]
    range_resolution: float
    speed_resolution: float
    max_speed: float
    coupling: float
    n_channel: int


@_jit
def estimate(power: FloatMap, cells: Cells, noise: FloatMap, scales: Scales) -> Any:
    """Estimates between the cells: parabolas through three log powers, corrected for the window.

    Parameters
    ----------
    power : ndarray of float32, shape (n_speed, n_range)
        Integrated spectrum.
    cells, noise : tuple of ndarray of intp, ndarray of float32, shape (n_points,)
        Detections and the noise power there.
    scales : Scales
        Tables and units.

    Returns
    -------
    ndarray of float64, shape (5, n_points) = (distance, distance_std, speed, speed_std, snr)
        Range [m], range rate [m/s], with standard deviations, and signal-to-noise power ratio per channel; NaN where not measured.
    """
    speed_bin, range_bin = cells
    n_speed, n_range = power.shape
    range_resolution, coupling, n_channel = scales.range_resolution, scales.coupling, scales.n_channel
    result = np.empty((5, len(speed_bin)))
    for p in range(len(speed_bin)):
        s, r = speed_bin[p], range_bin[p]
        at = float(power[s, r])
        below = max(noise[p], np.float32(TINY))
        ratio = np.float64(at / below)  # single precision: enough, and models were trained on it, bit for bit
        if math.isinf(ratio):
            ratio = np.float64(at) / np.float64(below)
        snr = max(ratio - 1, LEAST_SNR)
        offset, std = _interpolate(
            power[s - 1, r], at, power[s + 1 if s + 1 < n_speed else 0, r], snr * n_channel, snr, scales.tables[0], scales.edges[0]
        )
        signed = s - n_speed if s >= (n_speed + 1) // 2 else s
        speed = (signed + offset) * scales.speed_resolution
        speed = (speed + scales.max_speed) % (2 * scales.max_speed) - scales.max_speed
        result[2, p], result[3, p], result[4, p] = speed, std * scales.speed_resolution, snr
        if n_speed == 1:
            result[2, p] = result[3, p] = math.nan
            speed = 0.0
        offset, std = _interpolate(
            power[s, r - 1], at, power[s, r + 1 if r + 1 < n_range else 0], snr * n_channel, snr, scales.tables[1], scales.edges[1]
        )
        if math.isinf(range_resolution):
            result[0, p] = result[1, p] = math.nan
        else:
            result[0, p] = max((r + offset) * range_resolution - speed * coupling, 0.0)
            result[1, p] = std * range_resolution
    return result


@_jit
def _interpolate(before: float, at: float, after: float, total: float, snr: float, table: Any, edge: float) -> Any:
    last = table.shape[1] - 1
    scale = 1.0 / max(at, TINY)
    low, high = math.log(max(before * scale, FLOOR)), math.log(max(after * scale, FLOOR))
    vertex = min(max(0.5 * (low - high) / min(low + high, -1e-6), -1.0), 1.0)
    offset = _look_up(table[0], (vertex + 1) * 0.5 * last)
    variance = _look_up(table[1], (2 * offset + 1) * 0.5 * last) / total * (1 + 0.5 / snr)
    excess = max(abs(vertex) - edge, 0.0)
    return offset, min(math.sqrt(variance + excess * excess), 12**-0.5)


@_jit
def _look_up(table: Any, place: float) -> Any:
    i = min(int(place), len(table) - 2)
    return table[i] + (place - i) * (table[i + 1] - table[i])


@_jit
def snapshots(spectrum: Any, cells: Cells, turn: Any) -> Any:
    """Virtual channels at single cells, turned back by ``turn`` [rad] per transmitter, shape (n_points, n_tx * n_rx)."""
    speed, distance = cells
    n_tx, _, n_rx, _ = spectrum.shape
    result = np.empty((len(speed), n_tx * n_rx), np.complex64)
    for p in range(len(speed)):
        step = complex(math.cos(turn[p]), -math.sin(turn[p]))
        factor = complex(1.0, 0.0)
        for tx in range(n_tx):
            for rx in range(n_rx):
                result[p, tx * n_rx + rx] = spectrum[tx, speed[p], rx, distance[p]] * factor
            factor *= step
    return result


@_jit
def pack(estimates: Any, noise: FloatMap, angles: Any, keep: Any, flat: bool, shift: float) -> FloatMap:
    """Arrays of a point cloud, one row for each name in `CLOUD_ROWS`, shape (13, n_kept).

    Parameters
    ----------
    estimates, noise : ndarray of float64, shape (5, n_points), and of float32, shape (n_points,)
        Of `estimate`; noise power.
    angles : ndarray of float64, shape (4, n_points) = (azimuth, elevation, azimuth_std, elevation_std)
        Directions [rad].
    keep : ndarray of intp, shape (n_kept,)
        Points to keep.
    flat : bool
        Without elevation points lie at the sensor's height: the best guess there is.
    shift : float
        Added to the noise floor [dB].
    """
    result = np.empty((13, len(keep)), np.float32)
    for i in range(len(keep)):
        p = keep[i]
        distance, azimuth, elevation = estimates[0, p], angles[0, p], angles[1, p]
        level, up = (1.0, 0.0) if flat else (math.cos(elevation), math.sin(elevation))
        ground = distance * level
        result[0, i], result[1, i], result[2, i] = ground * math.cos(azimuth), ground * math.sin(azimuth), distance * up
        result[3, i], result[4, i], result[5, i], result[6, i] = distance, azimuth, elevation, estimates[2, p]
        result[7, i] = 10 * math.log10(estimates[4, p])
        result[8, i] = 10 * math.log10(max(float(noise[p]), TINY)) + shift
        result[9, i], result[10, i], result[11, i], result[12, i] = estimates[1, p], angles[2, p], angles[3, p], estimates[3, p]
    return result


@_jit
def cholesky(matrix: Any, relative: float, least: float) -> None:
    """Lower factor of a Hermitian matrix in place, the upper part left alone; no pivot below ``relative`` of its own or ``least``."""
    n = matrix.shape[0]
    for j in range(n):
        own = matrix[j, j].real
        pivot = own
        for k in range(j):
            pivot -= matrix[j, k].real ** 2 + matrix[j, k].imag ** 2
        root = math.sqrt(max(pivot, relative * own, least))
        matrix[j, j] = root
        for i in range(j + 1, n):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * np.conj(matrix[j, k])
            matrix[i, j] = total / root


@_jit
def solve(factor: Any, x: Any) -> None:
    """Solve L L^H x = b in place, by substitution; ``x`` has shape (n, n_right)."""
    n = factor.shape[0]
    for r in range(x.shape[1]):
        for i in range(n):
            total = x[i, r]
            for j in range(i):
                total -= factor[i, j] * x[j, r]
            x[i, r] = total / factor[i, i]
        for i in range(n - 1, -1, -1):
            total = x[i, r]
            for j in range(i + 1, n):
                total -= np.conj(factor[j, i]) * x[j, r]
            x[i, r] = total / factor[i, i]
