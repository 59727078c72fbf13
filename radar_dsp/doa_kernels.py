"""Compiled loops of the direction finder for one echo per detection: no allocation inside, and library calls only for the final angles.

`radar_dsp.doa_numpy` does the same with numpy and is the reference. Directions are direction cosines u, phases are centred (see
`radar_dsp.steering.Steering`). Functions that carry ``fastmath`` flags only allow what cannot hurt: sums in any order and fused
multiplications (numpy's matrix products do both), and comparisons that need not care for NaN, as the door refuses it.

Everything that is called from within compiled code is inlined (``forceinline``). Otherwise it would be the caller's own copy or the one
compiled on its own, whichever was loaded first; fused differently, they round differently, and a run that compiles would give other last
digits than one that loads from the cache.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from radar_dsp.steering import Steering

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]

_SUM = {"reassoc", "contract"}
_ROUND = 6755399441055744.0  # 1.5 * 2^52: adding and subtracting it rounds to an integer without a call
_INVERSE_PI = 1 / math.pi
_PI_HIGH = 3.141592653589793
_PI_LOW = 1.2246467991473532e-16
_TINY = 1e-300


@numba.njit(forceinline=True, cache=True, fastmath={"contract"})
def sine_cosine(x: float) -> tuple[float, float]:
    """Sine and cosine to 1e-11 for |x| < 1e6, without branches or calls, so that loops over it become vector code.

    The argument is folded to +-pi/2, where the Taylor series of degree 15 and 16 are good to 6e-12.
    """
    k = (x * _INVERSE_PI + _ROUND) - _ROUND
    r = (x - k * _PI_HIGH) - k * _PI_LOW
    odd = k - 2.0 * ((0.5 * k + _ROUND) - _ROUND)
    sign = 1.0 - 2.0 * odd * odd
    q = r * r
    s = -1 / 1307674368000.0
    s = s * q + 1 / 6227020800.0
    s = s * q - 1 / 39916800.0
    s = s * q + 1 / 362880.0
    s = s * q - 1 / 5040.0
    s = s * q + 1 / 120.0
    s = s * q - 1 / 6.0
    s = s * q + 1.0
    c = 1 / 20922789888000.0
    c = c * q - 1 / 87178291200.0
    c = c * q + 1 / 479001600.0
    c = c * q - 1 / 3628800.0
    c = c * q + 1 / 40320.0
    c = c * q - 1 / 720.0
    c = c * q + 1 / 24.0
    c = c * q - 0.5
    c = c * q + 1.0
    return sign * s * r, sign * c


@numba.njit(forceinline=True, cache=True, fastmath={"nnan", "nsz"})
def first_maximum(values: NDArray[Any]) -> int:
    """Index of the first of the largest values; in two passes, as only the first vectorises."""
    best = values[0]
    for g in range(values.shape[0]):
        best = max(best, values[g])
    for g in range(values.shape[0]):
        if values[g] == best:
            return g
    return 0


@numba.njit(forceinline=True, cache=True)
def load_weights(snapshot: NDArray[np.complex64], fold: NDArray[np.complex128], real: Floats, imag: Floats) -> float:
    """Snapshots (n_snapshot, n_channel) times conj(response), scaled by their largest part so that no square can overflow.

    Returns that part, real or imaginary; 0: nothing was loaded.
    """
    n_snapshot, n_channel = snapshot.shape
    peak = 0.0
    for s in range(n_snapshot):
        for c in range(n_channel):
            v = snapshot[s, c]
            peak = max(peak, abs(np.float64(v.real)), abs(np.float64(v.imag)))
    if peak == 0.0:
        return peak
    scale = 1.0 / peak
    for s in range(n_snapshot):
        for c in range(n_channel):
            v = snapshot[s, c]
            re, im = v.real * scale, v.imag * scale
            real[s, c] = re * fold[c].real - im * fold[c].imag
            imag[s, c] = re * fold[c].imag + im * fold[c].real
    return peak


@numba.njit(forceinline=True, cache=True, fastmath={"contract"})
def beam_power(real: Floats, imag: Floats, table: Floats32, beam: Floats32, power: Floats32) -> None:
    """Sum over the snapshots of |sum_c w_c exp(+j phase_c . u)|^2 on the grid, into ``power`` (n_grid,).

    ``real`` and ``imag`` are the weights, shape (n_snapshot, n_channel); ``table`` is that of `Steering`; ``beam`` (2, n_grid) is left with
    the beam of the last snapshot.
    """
    n_snapshot, n_channel = real.shape
    n_grid = power.shape[0]
    for s in range(n_snapshot):
        for c in range(n_channel):
            a, b = np.float32(real[s, c]), np.float32(imag[s, c])
            if c == 0:
                for g in range(n_grid):
                    beam[0, g] = a * table[0, c, g] - b * table[1, c, g]
                    beam[1, g] = a * table[1, c, g] + b * table[0, c, g]
            else:
                for g in range(n_grid):
                    beam[0, g] += a * table[0, c, g] - b * table[1, c, g]
                    beam[1, g] += a * table[1, c, g] + b * table[0, c, g]
        if s == 0:
            for g in range(n_grid):
                power[g] = beam[0, g] * beam[0, g] + beam[1, g] * beam[1, g]
        else:
            for g in range(n_grid):
                power[g] += beam[0, g] * beam[0, g] + beam[1, g] * beam[1, g]


@numba.njit(forceinline=True, cache=True, fastmath=_SUM)
def beam_derivatives(
    real: Floats, imag: Floats, phase: Floats, uy: float, uz: float
) -> tuple[float, float, float, float, float, float, float, float, float, float, float, float]:
    """Beam b of one snapshot and its derivatives: b, b_y / j, b_z / j, -b_yy, -b_yz, -b_zz, as (real, imag) pairs."""
    br = bi = yr = yi = zr = zi = yyr = yyi = yzr = yzi = zzr = zzi = 0.0
    for c in range(real.shape[0]):
        py, pz = phase[0, c], phase[1, c]
        s, k = sine_cosine(py * uy + pz * uz)
        re, im = real[c] * k - imag[c] * s, real[c] * s + imag[c] * k
        br += re
        bi += im
        yr += py * re
        yi += py * im
        zr += pz * re
        zi += pz * im
        yyr += py * py * re
        yyi += py * py * im
        yzr += py * pz * re
        yzi += py * pz * im
        zzr += pz * pz * re
        zzi += pz * pz * im
    return br, bi, yr, yi, zr, zi, yyr, yyi, yzr, yzi, zzr, zzi


@numba.njit(forceinline=True, cache=True)
def newton_step(
    g_y: float, g_z: float, h_yy: float, h_yz: float, h_zz: float, two: bool, limit_y: float, limit_z: float
) -> tuple[float, float]:
    """Step to the maximum of a parabola with gradient g and curvature h; where it is not concave, half the limit uphill."""
    if two:
        determinant = h_yy * h_zz - h_yz * h_yz
        if h_yy < 0.0 and determinant > 0.0:
            step_y = (h_yz * g_z - h_zz * g_y) / determinant
            step_z = (h_yz * g_y - h_yy * g_z) / determinant
        else:
            step_y, step_z = math.copysign(0.5 * limit_y, g_y), math.copysign(0.5 * limit_z, g_z)
    else:
        step_y = -g_y / h_yy if h_yy < 0.0 else math.copysign(0.5 * limit_y, g_y)
        step_z = 0.0
    return min(max(step_y, -limit_y), limit_y), min(max(step_z, -limit_z), limit_z)


@numba.njit(forceinline=True, cache=True)
def refine(
    real: Floats, imag: Floats, phase: Floats, start_y: float, start_z: float, spacing: Floats, two: bool, steps: int
) -> tuple[float, float]:
    """Newton's method on the logarithm of the summed beam power, kept within one grid spacing of the start.

    The logarithm of a main lobe is closer to a parabola than the lobe itself, which saves a step.
    """
    uy, uz = start_y, start_z
    sy, sz = spacing[0], spacing[1]
    for _ in range(steps):
        power = g_y = g_z = h_yy = h_yz = h_zz = 0.0
        for s in range(real.shape[0]):
            br, bi, yr, yi, zr, zi, yyr, yyi, yzr, yzi, zzr, zzi = beam_derivatives(real[s], imag[s], phase, uy, uz)
            power += br * br + bi * bi
            g_y += bi * yr - br * yi
            g_z += bi * zr - br * zi
            h_yy += yr * yr + yi * yi - br * yyr - bi * yyi
            h_yz += yr * zr + yi * zi - br * yzr - bi * yzi
            h_zz += zr * zr + zi * zi - br * zzr - bi * zzi
        q = 2.0 / max(power, _TINY)
        step_y, step_z = newton_step(g_y, g_z, h_yy - q * g_y * g_y, h_yz - q * g_y * g_z, h_zz - q * g_z * g_z, two, sy, sz)
        uy = min(max(uy + step_y, start_y - sy), start_y + sy)
        uz = min(max(uz + step_z, start_z - sz), start_z + sz)
    return uy, uz


@numba.njit(forceinline=True, cache=True)
def store_direction(
    uy: float, uz: float, bound: Floats, axes: int, limit: Floats, angles: Floats, inside: NDArray[np.bool_], i: int
) -> None:
    """Turn direction cosines and their covariance into angles and standard deviations; of one measured axis ``uy`` holds it.

    ``bound`` (3,) has the variance of uy, the covariance, the variance of uz; ``limit`` and ``axes`` are those of `Steering`. Column i of
    ``angles`` (4, n), azimuth, elevation and their standard deviations [rad], and entry i of ``inside`` (n,) are written.
    """
    if axes == 1:
        sin_az = min(max(uy, -1.0), 1.0)
        azimuth = math.asin(sin_az)
        angles[0, i], angles[1, i], angles[3, i] = azimuth, math.nan, math.nan
        angles[2, i] = math.sqrt(bound[0]) / max(math.sqrt(1.0 - sin_az * sin_az), 1e-3)
        inside[i] = uy * uy < 1.0 and abs(azimuth) <= limit[0]
        return
    if axes == 2:
        uy, uz = 0.0, uy
    sin_el = min(max(uz, -1.0), 1.0)
    elevation = math.asin(sin_el)
    cos_el = max(math.sqrt(1.0 - sin_el * sin_el), 1e-9)
    within = uy * uy + uz * uz < 1.0 and abs(elevation) <= limit[1]
    angles[1, i] = elevation
    if axes == 2:
        angles[0, i], angles[2, i] = math.nan, math.nan
        angles[3, i] = math.sqrt(bound[0]) / cos_el
        inside[i] = within
        return
    sin_az = min(max(uy / cos_el, -1.0), 1.0)
    azimuth = math.asin(sin_az)
    tilt = sin_az * sin_el / cos_el
    spread = bound[0] + 2.0 * tilt * bound[1] + tilt * tilt * bound[2]
    angles[0, i] = azimuth
    angles[2, i] = math.sqrt(max(spread, 0.0)) / max(cos_el * math.sqrt(1.0 - sin_az * sin_az), 1e-3)
    angles[3, i] = math.sqrt(bound[2]) / cos_el
    inside[i] = within and abs(azimuth) <= limit[0]


@numba.njit(cache=True)
def locate(
    snapshot: NDArray[np.complex64], snr: Floats32, steering: Steering, steps: int, angles: Floats, inside: NDArray[np.bool_]
) -> None:
    """Maximum-likelihood direction of one echo per detection (2.16): grid, Newton's method, angles, bounds.

    Parameters
    ----------
    snapshot : ndarray of complex64, shape (n_points, n_snapshot, n_channel)
        Snapshots; their likelihoods are summed.
    snr : ndarray of float32, shape (n_points,)
        Signal-to-noise power ratio per channel.
    steering : Steering
        The array and the grid.
    steps : int
        Newton steps.
    angles : ndarray, shape (4, n_points)
        Result: azimuth, elevation, their standard deviations [rad].
    inside : ndarray of bool, shape (n_points,)
        Result: within the field of view; a snapshot of zeros has no direction: NaN, not inside.
    """
    fold, phase, table, grid, spacing, bound, limit, axes = steering
    n_points, n_snapshot, n_channel = snapshot.shape
    real, imag = np.empty((n_snapshot, n_channel)), np.empty((n_snapshot, n_channel))
    beam, power = np.empty((2, grid.shape[1]), np.float32), np.empty(grid.shape[1], np.float32)
    scaled = np.empty(3)
    for i in range(n_points):
        if load_weights(snapshot[i], fold, real, imag) == 0.0:
            for k in range(4):
                angles[k, i] = math.nan
            inside[i] = False
            continue
        beam_power(real, imag, table, beam, power)
        g = first_maximum(power)
        uy, uz = refine(real, imag, phase, grid[0, g], grid[1, g], spacing, axes == 0, steps)
        noise = 1.0 / max(np.float64(snr[i]), 1e-12)
        for k in range(3):
            scaled[k] = bound[k] * noise
        store_direction(uy, uz, scaled, axes, limit, angles, inside, i)
