"""Compiled refinement of two echoes in one cell, and the decision for them, one detection at a time.

All that the refinement needs are moments of the beams (see `radar_dsp.pair_kernels`)
and of g with the phases, so that no steering vector is ever projected.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from radar_dsp.doa_kernels import beam_derivatives, beam_power, first_maximum, load_weights, refine, store_direction
from radar_dsp.pair_kernels import ALIKE, best_pair, best_partner, pair_power
from radar_dsp.steering import Steering

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]

ONE_STEPS = 8  # Newton steps for one echo before it is compared with two: a step short of the maximum would look like a second echo
PAIR_STEPS = 30  # most Levenberg-Marquardt steps; a dozen is usual
TOLERANCE = 1e-8  # smallest step worth another, in direction cosine


@numba.njit(forceinline=True, cache=True)
def _normal_equations(
    real: Floats, imag: Floats, weight: Floats, nothing: Floats, phase: Floats, self_moment: Floats, u: Floats, h: Floats, right: Floats
) -> float:
    """Gauss-Newton equations at u = (uy1, uz1, uy2, uz2) with both amplitudes eliminated (variable projection).

    Returns the likelihood; -1 where the two sources are alike, when nothing else is written.
    """
    n = np.float64(real.shape[0])
    gr, gi, gyr, gyi, gzr, gzi, gyyr, gyyi, gyzr, gyzi, gzzr, gzzi = beam_derivatives(weight, nothing, phase, u[0] - u[2], u[1] - u[3])
    g, g_y, g_z = complex(gr, gi), complex(gyr, gyi), complex(gzr, gzi)
    determinant = n * n - abs(g) ** 2
    if determinant < (1.0 - ALIKE) * n * n:
        return -1.0
    br, bi, yr, yi, zr, zi, _, _, _, _, _, _ = beam_derivatives(real, imag, phase, u[0], u[1])
    b1, y1, z1 = complex(br, bi), complex(yr, yi), complex(zr, zi)
    br, bi, yr, yi, zr, zi, _, _, _, _, _, _ = beam_derivatives(real, imag, phase, u[2], u[3])
    b2, y2, z2 = complex(br, bi), complex(yr, yi), complex(zr, zi)
    s1, s2 = (n * b1 - g * b2) / determinant, (n * b2 - np.conj(g) * b1) / determinant
    right[0] = (np.conj(s1) * 1j * (y1 - g_y * s2)).real
    right[1] = (np.conj(s1) * 1j * (z1 - g_z * s2)).real
    right[2] = (np.conj(s2) * 1j * (y2 - np.conj(g_y) * s1)).real
    right[3] = (np.conj(s2) * 1j * (z2 - np.conj(g_z) * s1)).real
    p1, p2, ratio = abs(s1) ** 2, abs(s2) ** 2, n / determinant
    yy, yz, zz = abs(g_y) ** 2 * ratio, (g_y * np.conj(g_z)).real * ratio, abs(g_z) ** 2 * ratio
    yy, yz, zz = self_moment[0] - yy, self_moment[1] - yz, self_moment[2] - zz
    h[0, 0], h[0, 1], h[1, 1] = p1 * yy, p1 * yz, p1 * zz
    h[2, 2], h[2, 3], h[3, 3] = p2 * yy, p2 * yz, p2 * zz
    both, back = np.conj(s1) * s2, np.conj(g) / determinant
    h[0, 2] = (both * (complex(gyyr, gyyi) + g_y * g_y * back)).real
    h[0, 3] = h[1, 2] = (both * (complex(gyzr, gyzi) + g_y * g_z * back)).real
    h[1, 3] = (both * (complex(gzzr, gzzi) + g_z * g_z * back)).real
    for i in range(4):
        for j in range(i):
            h[i, j] = h[j, i]
    return pair_power(b1, b2, g, n)


@numba.njit(forceinline=True, cache=True)
def _invert(h: Floats, damping: float, two: bool, work: Floats, out: Floats) -> None:
    """Inverse of the damped normal matrix by Cholesky, pivots kept off zero; unmeasured axes stay zero."""
    step = 1 if two else 2
    for i in range(4):
        for j in range(4):
            out[i, j] = work[i, j] = 0.0
    for j in range(0, 4, step):
        own = h[j, j] * (1.0 + damping) + 1e-300
        pivot = own
        for k in range(0, j, step):
            pivot -= work[j, k] ** 2
        work[j, j] = math.sqrt(max(pivot, 1e-12 * own))
        for i in range(j + step, 4, step):
            total = h[i, j]
            for k in range(0, j, step):
                total -= work[i, k] * work[j, k]
            work[i, j] = total / work[j, j]
    for r in range(0, 4, step):
        for i in range(0, 4, step):
            total = 1.0 if i == r else 0.0
            for k in range(0, i, step):
                total -= work[i, k] * out[k, r]
            out[i, r] = total / work[i, i]
        for i in range(4 - step, -1, -step):
            total = out[i, r]
            for k in range(i + step, 4, step):
                total -= work[k, i] * out[k, r]
            out[i, r] = total / work[i, i]


@numba.njit(forceinline=True, cache=True)
def _take_over(vector: Floats, matrix: Floats, to_vector: Floats, to_matrix: Floats) -> None:
    """Copy; written out because assigning to slices takes seconds to compile."""
    for i in range(4):
        to_vector[i] = vector[i]
        for j in range(4):
            to_matrix[i, j] = matrix[i, j]


@numba.njit(forceinline=True, cache=True)
def refine_pair(
    real: Floats,
    imag: Floats,
    weight: Floats,
    nothing: Floats,
    phase: Floats,
    self_moment: Floats,
    spacing: Floats,
    edge: Floats,
    u: Floats,
    covariance: Floats,
) -> float:
    """Levenberg-Marquardt from u = (uy1, uz1, uy2, uz2), in place, within +-edge; the likelihood, -1 when the start is two sources alike.

    Parameters
    ----------
    real, imag : ndarray, shape (n_channel,)
        Weights conj(response) v.
    weight, nothing : ndarray, shape (n_channel,)
        Power response of the channels, and zeros.
    phase : ndarray, shape (2, n_channel)
        Of `radar_dsp.steering.Steering`.
    self_moment : ndarray, shape (3,)
        Sums of weight phase phase: yy, yz, zz.
    spacing, edge : ndarray, shape (2,)
        Grid spacing, the largest step; bounds of the search.
    u, covariance : ndarray, shape (4,), (4, 4)
        Start and result; result: covariance of u per unit of noise power.
    """
    two = spacing[1] > 0.0
    h, trial_h, work = np.zeros((4, 4)), np.empty((4, 4)), np.empty((4, 4))
    right, trial_right, trial = np.zeros(4), np.empty(4), np.empty(4)
    power, damping, largest = -1.0, 1e-3, 1.0
    for i in range(4):
        trial[i] = u[i]
    for turn in range(PAIR_STEPS + 1):
        if turn > 0:
            _invert(h, damping, two, work, covariance)
            largest = 0.0
            for i in range(4):
                step = 0.0
                for j in range(4):
                    step += covariance[i, j] * right[j]
                step = min(max(step, -spacing[i % 2]), spacing[i % 2])
                trial[i] = min(max(u[i] + step, -edge[i % 2]), edge[i % 2])
                largest = max(largest, abs(trial[i] - u[i]))
        better = _normal_equations(real, imag, weight, nothing, phase, self_moment, trial, trial_h, trial_right)
        if turn > 0 and better < power:
            damping = 10.0 * damping
        elif better >= 0.0:
            power, damping = better, max(0.1 * damping, 1e-12) if turn > 0 else damping
            _take_over(trial, trial_h, u, h)
            for i in range(4):
                right[i] = trial_right[i]
        if power < 0.0 or largest < TOLERANCE or damping > 1e8:
            break
    _invert(h, 0.0, two, work, covariance)
    for i in range(4):
        for j in range(4):
            covariance[i, j] *= 0.5
    return power


@numba.njit(forceinline=True, cache=True)
def _second_is_stronger(real: Floats, imag: Floats, weight: Floats, nothing: Floats, phase: Floats, u: Floats) -> bool:
    n = np.float64(real.shape[0])
    re, im, _, _, _, _, _, _, _, _, _, _ = beam_derivatives(weight, nothing, phase, u[0] - u[2], u[1] - u[3])
    g = complex(re, im)
    re, im, _, _, _, _, _, _, _, _, _, _ = beam_derivatives(real, imag, phase, u[0], u[1])
    b1 = complex(re, im)
    re, im, _, _, _, _, _, _, _, _, _, _ = beam_derivatives(real, imag, phase, u[2], u[3])
    b2 = complex(re, im)
    return bool(abs(n * b2 - np.conj(g) * b1) > abs(n * b1 - g * b2))


@numba.njit(forceinline=True, cache=True)
def _fit_pair(
    real: Floats,
    imag: Floats,
    b1: complex,
    uy: float,
    uz: float,
    beam: Floats32,
    power: Floats32,
    weight: Floats,
    self_moment: Floats,
    phase: Floats,
    grid: Floats,
    spacing: Floats,
    gain: Floats32,
    cross: Floats32,
    row: Floats32,
    u: Floats,
    covariance: Floats,
) -> float:
    """Refine from two starts and keep the better in ``u`` and ``covariance``, the stronger echo first.

    The best pair of the grid is the right start for two strong echoes; a weak one beside a strong one shows only once the strong one,
    (uy, uz) with its beam ``b1``, is off the grid.
    """
    nothing, other_u, other_covariance, edge = np.zeros(weight.shape[0]), np.zeros(4), np.empty((4, 4)), np.empty(2)
    for k in range(2):
        edge[k] = grid[k].max() + 0.5 * spacing[k]
    best = -1.0
    for attempt in range(2):
        if attempt == 0:
            a, b = best_pair(beam, power, gain, cross, row)
            other_u[0], other_u[1] = grid[0, a], grid[1, a]
        else:
            b = best_partner(b1, uy, uz, beam, weight, nothing, phase, grid)
            other_u[0], other_u[1] = uy, uz
        other_u[2], other_u[3] = grid[0, b], grid[1, b]
        other = refine_pair(real, imag, weight, nothing, phase, self_moment, spacing, edge, other_u, other_covariance)
        if other > best:
            best = other
            _take_over(other_u, other_covariance, u, covariance)
    if _second_is_stronger(real, imag, weight, nothing, phase, u):
        _take_over(u, covariance, other_u, other_covariance)
        for i in range(4):
            u[i] = other_u[(i + 2) % 4]
            for j in range(4):
                covariance[i, j] = other_covariance[(i + 2) % 4, (j + 2) % 4]
    return best


@numba.njit(forceinline=True, cache=True)
def _channel_moments(fold: NDArray[np.complex128], phase: Floats, weight: Floats, self_moment: Floats) -> None:
    for c in range(fold.shape[0]):
        weight[c] = fold[c].real ** 2 + fold[c].imag ** 2
        self_moment[0] += weight[c] * phase[0, c] * phase[0, c]
        self_moment[1] += weight[c] * phase[0, c] * phase[1, c]
        self_moment[2] += weight[c] * phase[1, c] * phase[1, c]


@numba.njit(forceinline=True, cache=True)
def _total_power(real: Floats, imag: Floats, weight: Floats) -> float:
    """Power of a snapshot over all channels, the responses taken off."""
    total = 0.0
    for c in range(weight.shape[0]):
        total += (real[0, c] ** 2 + imag[0, c] ** 2) / weight[c]
    return total


@numba.njit(forceinline=True, cache=True)
def _store_pair(
    u: Floats, covariance: Floats, floor: float, axes: int, limit: Floats, angles: Floats, inside: NDArray[np.bool_], i: int
) -> None:
    scaled = np.empty(3)
    for k in range(2):
        v = 2 * k
        scaled[0], scaled[1], scaled[2] = covariance[v, v] * floor, covariance[v, v + 1] * floor, covariance[v + 1, v + 1] * floor
        store_direction(u[v], u[v + 1], scaled, axes, limit, angles, inside, i + k)


@numba.njit(cache=True)
def locate_pairs(
    snapshot: NDArray[np.complex64],
    snr: Floats32,
    steering: Steering,
    gain: Floats32,
    cross: Floats32,
    threshold: float,
    angles: Floats,
    inside: NDArray[np.bool_],
    second: NDArray[np.bool_],
    statistic: Floats,
) -> None:
    """Directions of one or two echoes per detection; the first arguments as of `radar_dsp.doa_kernels.locate`, one snapshot each.

    Parameters
    ----------
    snapshot : ndarray of complex64, shape (n_points, 1, n_channel)
        Snapshots.
    snr : ndarray of float32, shape (n_points,)
        Signal-to-noise power ratio per channel; with the power of the snapshot it says how strong the noise is.
    steering, gain, cross
        The array and the grid; see `radar_dsp.pair_kernels.best_pair`.
    threshold : float
        Two echoes when their likelihood exceeds that of one by more than this many noise powers.
    angles : ndarray, shape (4, 2 n_points)
        Result: azimuth, elevation, their standard deviations [rad]; columns 2 i and 2 i + 1 belong to detection i.
    inside : ndarray of bool, shape (2 n_points,)
        Result: within the field of view.
    second : ndarray of bool, shape (n_points,)
        Result: whether there is a second echo.
    statistic : ndarray, shape (n_points,)
        Result: how many noise powers the likelihood gained; an upper bound where that is below the threshold anyway.
    """
    fold, phase, table, grid, spacing, bound, limit, axes = steering
    n_points, _, n = snapshot.shape
    n_grid = grid.shape[1]
    real, imag, weight = np.empty((1, n)), np.empty((1, n)), np.empty(n)
    beam, power, row = np.empty((2, n_grid), np.float32), np.empty(n_grid, np.float32), np.empty(n_grid, np.float32)
    u, covariance, scaled, self_moment = np.zeros(4), np.zeros((4, 4)), np.empty(3), np.zeros(3)
    _channel_moments(fold, phase, weight, self_moment)
    for i in range(n_points):
        second[i], statistic[i] = False, 0.0
        if load_weights(snapshot[i], fold, real, imag) == 0.0:
            for k in range(4):
                angles[k, 2 * i] = math.nan
            inside[2 * i] = False
            continue
        total = _total_power(real, imag, weight)
        ratio = max(np.float64(snr[i]), 1e-12)
        floor = total / n / (1.0 + min(ratio, 1e12))
        beam_power(real, imag, table, beam, power)
        k = first_maximum(power)
        uy, uz = refine(real, imag, phase, grid[0, k], grid[1, k], spacing, axes == 0, ONE_STEPS)
        br, bi, _, _, _, _, _, _, _, _, _, _ = beam_derivatives(real[0], imag[0], phase, uy, uz)
        one = (br * br + bi * bi) / n
        # Two cannot gain more than one leaves over, which spares nearly all single echoes the search.
        statistic[i] = (total - one) / floor
        if statistic[i] > threshold:
            # fmt: off
            pair = _fit_pair(
                real[0], imag[0], complex(br, bi), uy, uz, beam, power, weight, self_moment, phase, grid,
                spacing, gain, cross, row, u, covariance,
            )
            # fmt: on
            statistic[i] = (pair - one) / floor
        second[i] = statistic[i] > threshold
        if not second[i]:
            for j in range(3):
                scaled[j] = bound[j] / ratio
            store_direction(uy, uz, scaled, axes, limit, angles, inside, 2 * i)
            continue
        _store_pair(u, covariance, floor, axes, limit, angles, inside, 2 * i)
