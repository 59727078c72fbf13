"""Inner loops of the baseband in plain numpy: what `radar_dsp.kernels` has to equal, function by function; it describes them too."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_dsp.kernels import LEAST_SNR, TINY, Cells, FloatMap, Mask, Offsets, Scales
from radar_dsp.windows import FLOOR

AnyArray = NDArray[Any]


def integrate(spectrum: NDArray[np.complex64]) -> FloatMap:
    """Non-coherent integration: mean power over the virtual channels, shape (n_speed, n_range)."""
    n_tx, n_speed, n_rx, n_range = spectrum.shape
    power = np.zeros((n_speed, n_range), np.float32)
    # Channel by channel: the partial results stay in the cache, and the order of the sum is fixed.
    for tx in range(n_tx):
        for rx in range(n_rx):
            channel = spectrum[tx, :, rx, :]
            power += channel.real**2 + channel.imag**2
    power *= np.float32(1.0 / (n_tx * n_rx))
    return power


def pad(values: FloatMap, usable: NDArray[np.bool_], half: tuple[int, int], fill: float) -> FloatMap:
    """Wrap along speed, put ``fill`` where a training cell does not exist; shape (n_speed + 2 half[0], n_range + 2 half[1])."""
    n_speed, n_range = values.shape
    hs, hr = half
    padded = np.full((n_speed + 2 * hs, n_range + 2 * hr), fill, np.float32)
    inner = padded[hs : hs + n_speed, hr : hr + n_range]
    np.copyto(inner, values, where=usable)
    if hs:
        padded[:hs] = padded[n_speed : n_speed + hs]
        padded[hs + n_speed :] = padded[hs : 2 * hs]
    return padded


def rank_test(padded: FloatMap, threshold: FloatMap, rank: NDArray[np.int32], offsets: Offsets, half: tuple[int, int]) -> Mask:
    """Cells with at least ``rank`` training cells below their threshold, shape (n_speed, n_range)."""
    n_speed, n_range = threshold.shape
    count = np.zeros(threshold.shape, np.int32)
    for i, j in offsets + half:
        count += padded[i : i + n_speed, j : j + n_range] < threshold
    return count >= rank


def sums(padded: FloatMap, offsets: Offsets, half: tuple[int, int]) -> FloatMap:
    """Sum of the training cells of each cell, shape (n_speed, n_range); direct sums, because running ones lose all beside a strong cell."""
    n_speed, n_range = padded.shape[0] - 2 * half[0], padded.shape[1] - 2 * half[1]
    total = np.zeros((n_speed, n_range), np.float32)
    for i, j in offsets + half:
        total += padded[i : i + n_speed, j : j + n_range]
    return total


def ordered(padded: FloatMap, cells: Cells, offsets: Offsets, half: tuple[int, int], rank: NDArray[np.int32]) -> FloatMap:
    """Order statistic of the training cells at single cells, shape (n_cells,)."""
    place = offsets + half
    training = np.sort(padded[cells[0][:, None] + place[:, 0], cells[1][:, None] + place[:, 1]], axis=1)
    result: FloatMap = training[np.arange(len(rank)), rank - 1]
    return result


def find(mask: NDArray[np.bool_], power: FloatMap, grouping: str) -> Cells:
    """Cells of a mask that become points, ordered by speed, then range."""
    if grouping != "none" and power.shape[1] > 1:
        mask = mask & (power > np.roll(power, 1, 1)) & (power >= np.roll(power, -1, 1))
    if grouping == "peak" and power.shape[0] > 1:
        # Diagonal neighbours count too: the ridges of a strong echo's window are maxima along single axes only.
        across = np.maximum(np.maximum(np.roll(power, 1, 1), np.roll(power, -1, 1)), power)
        mask = mask & (power > np.roll(across, 1, 0)) & (power >= np.roll(across, -1, 0))
    speed, distance = np.nonzero(mask)
    return speed, distance


def estimate(power: FloatMap, cells: Cells, noise: FloatMap, scales: Scales) -> NDArray[np.float64]:
    """Estimates between the cells: parabolas through three log powers, corrected for the window."""
    n_speed = power.shape[0]
    snr = np.maximum(power[cells].astype(np.float64) / np.maximum(noise, np.float32(TINY)) - 1, LEAST_SNR)
    (offset_v, std_v), (offset_r, std_r) = (interpolate(power, cells, axis, snr, scales) for axis in (0, 1))
    signed = cells[0] - n_speed * (cells[0] >= (n_speed + 1) // 2)
    speed = (signed + offset_v) * scales.speed_resolution
    speed = (speed + scales.max_speed) % (2 * scales.max_speed) - scales.max_speed if n_speed > 1 else np.full(len(snr), np.nan)
    if np.isfinite(scales.range_resolution):
        beyond = speed * scales.coupling if n_speed > 1 else 0.0
        distance = np.maximum((cells[1] + offset_r) * scales.range_resolution - beyond, 0.0)
    else:
        distance = np.full(len(snr), np.nan)
    return np.stack([distance, std_r * scales.range_resolution + 0 * distance, speed, std_v * scales.speed_resolution + 0 * speed, snr])


def interpolate(
    power: FloatMap, cells: Cells, axis: int, snr: NDArray[np.float64], scales: Scales
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Offset of each echo from its cell's centre along an axis and its standard deviation, in cells, shape (n_points,)."""
    n, table = power.shape[axis], scales.tables[axis]
    at = power[cells].astype(np.float64)
    before, after = (power[tuple((c + step) % n if a == axis else c for a, c in enumerate(cells))] for step in (-1, 1))
    # Relative to the cell itself, so that its own logarithm is zero.
    low, high = (np.log(np.maximum(p / np.maximum(at, TINY), FLOOR)) for p in (before, after))
    vertex = np.clip(0.5 * (low - high) / np.minimum(low + high, -1e-6), -1.0, 1.0)
    grid = np.linspace(-1.0, 1.0, table.shape[1])
    offset = np.interp(vertex, grid, table[0])
    # The second term is noise times noise, which matters when single channels are below the noise. A cell on the flank of its echo has a
    # vertex outside of it: how far outside is an error of its own.
    variance = np.interp(2 * offset, grid, table[1]) / (scales.n_channel * snr) * (1 + 0.5 / snr)
    excess = np.maximum(np.abs(vertex) - scales.edges[axis], 0.0)
    return offset, np.minimum(np.sqrt(variance + excess**2), 12**-0.5)


def snapshots(spectrum: NDArray[np.complex64], cells: Cells, turn: NDArray[np.float64]) -> NDArray[np.complex64]:
    """Virtual channels at single cells, turned back by ``turn`` [rad] per transmitter, shape (n_points, n_tx * n_rx)."""
    n_tx, _, n_rx, _ = spectrum.shape
    taken = spectrum[:, cells[0], :, cells[1]]  # (n_points, n_tx, n_rx): numpy puts the indexed axis first
    step = np.exp(-1j * turn)[:, None] ** np.arange(n_tx)
    result: NDArray[np.complex64] = (taken * step[:, :, None]).astype(np.complex64).reshape(len(taken), n_tx * n_rx)
    return result


def pack(
    estimates: NDArray[np.float64], noise: FloatMap, angles: NDArray[np.float64], keep: NDArray[np.intp], flat: bool, shift: float
) -> FloatMap:
    """Arrays of a point cloud, one row for each name in `CLOUD_ROWS`."""
    distance, distance_std, speed, speed_std, snr = estimates[:, keep]
    azimuth, elevation, azimuth_std, elevation_std = angles[:, keep]
    up, level = (np.zeros(len(keep)), np.ones(len(keep))) if flat else (np.sin(elevation), np.cos(elevation))
    ground = distance * level
    rows = (
        *(ground * np.cos(azimuth), ground * np.sin(azimuth), distance * up),
        *(distance, azimuth, elevation, speed, 10 * np.log10(snr)),
        10 * np.log10(np.maximum(noise[keep].astype(np.float64), TINY)) + shift,
        *(distance_std, azimuth_std, elevation_std, speed_std),
    )
    return np.array(rows, np.float32).reshape(len(rows), len(keep))
