"""Compiled minimum-variance search, one detection at a time; `radar_dsp.doa_numpy.capon` is the reference."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from radar_dsp.doa_kernels import first_maximum, newton_step, sine_cosine, store_direction
from radar_dsp.kernels import cholesky, solve
from radar_dsp.steering import Steering

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Complexes = NDArray[np.complex128]

_BLOCK = 256  # grid points solved together: large enough for vector code, small enough for the first cache
CANDIDATES = 4  # grid points that are refined before the highest peak is chosen
NOWHERE = 1e30  # added to the cost of what lies beyond the unit circle: aliases of directions are there, as high but for rounding
BEYOND = 1.002  # square of a length that rounding and noise do not give a direction


@numba.njit(cache=True)
def loaded_covariance(snapshot: NDArray[np.complex64], loading: float, matrix: Complexes) -> float:
    """Conjugate of the sample covariance plus loading, with a mean power of 1 per channel, into ``matrix`` (n_channel, n_channel).

    ``snapshot`` has the shape (n_snapshot, n_channel); ``loading`` is relative to the mean power of a channel. Returns the largest real or
    imaginary part of the snapshots; 0: no result.
    """
    n_snapshot, n = snapshot.shape
    peak = 0.0
    for s in range(n_snapshot):
        for c in range(n):
            peak = max(peak, abs(np.float64(snapshot[s, c].real)), abs(np.float64(snapshot[s, c].imag)))
    if peak == 0.0:
        return peak
    trace = 0.0
    for c in range(n):
        for d in range(c + 1):
            total = 0j
            for s in range(n_snapshot):
                total += np.conj(np.complex128(snapshot[s, c]) / peak) * (np.complex128(snapshot[s, d]) / peak)
            matrix[c, d] = total
        trace += matrix[c, c].real
    scale = n / trace
    for c in range(n):
        for d in range(c):
            matrix[c, d] *= scale
            matrix[d, c] = np.conj(matrix[c, d])
        matrix[c, c] = matrix[c, c] * scale + loading
    return peak


@numba.njit(cache=True, fastmath={"contract"})
def _whiten(factor: Complexes, fold: Complexes, table: Floats32, first: int, count: int, y: Floats, cost: Floats) -> None:
    """Write |L^-1 a|^2 of a block of the grid to ``cost``; ``y`` (2, n_channel, block) is scratch."""
    for g in range(count):
        cost[first + g] = 0.0
    for i in range(factor.shape[0]):
        fr, fi = fold[i].real, fold[i].imag
        for g in range(count):
            co, si = np.float64(table[0, i, first + g]), np.float64(table[1, i, first + g])
            y[0, i, g] = fr * co - fi * si
            y[1, i, g] = fr * si + fi * co
        for j in range(i):
            lr, li = factor[i, j].real, factor[i, j].imag
            for g in range(count):
                y[0, i, g] -= lr * y[0, j, g] - li * y[1, j, g]
                y[1, i, g] -= lr * y[1, j, g] + li * y[0, j, g]
        scale = 1.0 / factor[i, i].real
        for g in range(count):
            y[0, i, g] *= scale
            y[1, i, g] *= scale
            cost[first + g] -= y[0, i, g] * y[0, i, g] + y[1, i, g] * y[1, i, g]


@numba.njit(cache=True)
def _terms(
    factor: Complexes, fold: Complexes, phase: Floats, uy: float, uz: float, x: Complexes
) -> tuple[float, float, float, float, float, float]:
    """Quadratic form q = a^H R^-1 a and its derivatives q_y, q_z, q_yy, q_yz, q_zz; ``x`` (n_channel, 6) is scratch."""
    n = fold.shape[0]
    for c in range(n):
        s, k = sine_cosine(phase[0, c] * uy + phase[1, c] * uz)
        a = fold[c] * complex(k, s)
        x[c, 0], x[c, 1], x[c, 2] = a, 1j * phase[0, c] * a, 1j * phase[1, c] * a
        x[c, 3], x[c, 4], x[c, 5] = x[c, 0], x[c, 1], x[c, 2]
    solve(factor, x[:, 3:])
    q = q_y = q_z = q_yy = q_yz = q_zz = 0.0
    for c in range(n):
        py, pz = phase[0, c], phase[1, c]
        along = (np.conj(x[c, 0]) * x[c, 3]).real
        q += along
        q_y += 2 * (np.conj(x[c, 1]) * x[c, 3]).real
        q_z += 2 * (np.conj(x[c, 2]) * x[c, 3]).real
        q_yy += 2 * (np.conj(x[c, 1]) * x[c, 4]).real - 2 * py * py * along
        q_yz += 2 * (np.conj(x[c, 1]) * x[c, 5]).real - 2 * py * pz * along
        q_zz += 2 * (np.conj(x[c, 2]) * x[c, 5]).real - 2 * pz * pz * along
    return q, q_y, q_z, q_yy, q_yz, q_zz


@numba.njit(cache=True)
def _refine(
    factor: Complexes, fold: Complexes, phase: Floats, start: tuple[float, float], spacing: Floats, loading: float, steps: int, x: Complexes
) -> tuple[float, float, float]:
    """Newton's method on log(n / loading - q): q is convex only near its minimum, this is close to a parabola farther out.

    With one snapshot it is the logarithm of the beam power. Returns direction cosines and q.
    """
    two = spacing[1] > 0.0
    uy, uz = start
    q, q_y, q_z, q_yy, q_yz, q_zz = _terms(factor, fold, phase, uy, uz, x)
    for _ in range(steps):
        f = 1.0 / max(fold.shape[0] / loading - q, 1e-12)
        step_y, step_z = newton_step(
            -q_y, -q_z, -q_yy - f * q_y * q_y, -q_yz - f * q_y * q_z, -q_zz - f * q_z * q_z, two, spacing[0], spacing[1]
        )
        uy = min(max(uy + step_y, start[0] - spacing[0]), start[0] + spacing[0])
        uz = min(max(uz + step_z, start[1] - spacing[1]), start[1] + spacing[1])
        q, q_y, q_z, q_yy, q_yz, q_zz = _terms(factor, fold, phase, uy, uz, x)
    return uy, uz, q


@numba.njit(cache=True)
def _highest_peak(
    factor: Complexes, fold: Complexes, phase: Floats, grid: Floats, cost: Floats, spacing: Floats, loading: float, steps: int, x: Complexes
) -> tuple[float, float]:
    """Refine the highest grid points that are not neighbours and keep the highest peak; ``cost`` (-q on the grid) is used up.

    Peaks are narrower than the grid, so that the highest grid point need not belong to the highest peak.
    """
    lowest, best_y, best_z = np.inf, 0.0, 0.0
    for _ in range(CANDIDATES if steps > 0 else 1):
        g = first_maximum(cost)
        if cost[g] < -1e299:
            break
        y, z = grid[0, g], grid[1, g]
        uy, uz, q = _refine(factor, fold, phase, (y, z), spacing, loading, steps, x)
        if uy * uy + uz * uz > BEYOND:
            q += NOWHERE
        if q < lowest:
            lowest, best_y, best_z = q, uy, uz
        for k in range(cost.shape[0]):
            if abs(grid[0, k] - y) <= 1.5 * spacing[0] and abs(grid[1, k] - z) <= 1.5 * spacing[1]:
                cost[k] = -1e300
    return best_y, best_z


@numba.njit(cache=True)
def locate_capon(
    snapshot: NDArray[np.complex64],
    snr: Floats32,
    steering: Steering,
    steps: int,
    loading: float,
    angles: Floats,
    inside: NDArray[np.bool_],
) -> None:
    """Direction of the highest peak of 1 / (a^H R^-1 a), arguments as of `radar_dsp.doa_kernels.locate`.

    ``loading`` is relative to the mean power of a channel. The bounds are those of a single snapshot.
    """
    fold, phase, table, grid, spacing, bound, limit, axes = steering
    n_points, _, n = snapshot.shape
    n_grid = grid.shape[1]
    factor, x = np.empty((n, n), np.complex128), np.empty((n, 6), np.complex128)
    y, cost, scaled = np.empty((2, n, _BLOCK)), np.empty(n_grid), np.empty(3)
    for i in range(n_points):
        if loaded_covariance(snapshot[i], loading, factor) == 0.0:
            for k in range(4):
                angles[k, i] = math.nan
            inside[i] = False
            continue
        cholesky(factor, 0.0, 1e-9)  # rounding brings a pivot below the loading, 1e-6 at least, only when it is lost anyway
        for first in range(0, n_grid, _BLOCK):
            _whiten(factor, fold, table, first, min(_BLOCK, n_grid - first), y, cost)
        uy, uz = _highest_peak(factor, fold, phase, grid, cost, spacing, loading, steps, x)
        noise = 1.0 / max(np.float64(snr[i]), 1e-12)
        for k in range(3):
            scaled[k] = bound[k] * noise
        store_direction(uy, uz, scaled, axes, limit, angles, inside, i)
