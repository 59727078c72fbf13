"""Compiled search for the best pair of directions on a grid.

The likelihood of two sources is the power of the snapshot in the span of both steering vectors: with the beams b_k = a_k^H v, n channels
and g = a_1^H a_2 it is (n |b_1|^2 + n |b_2|^2 - 2 Re(b_1* g b_2)) / (n^2 - |g|^2).
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from radar_dsp.doa_kernels import beam_derivatives, first_maximum

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]

ALIKE = 0.98
"""Largest |a_1^H a_2|^2 / n^2: beyond it (0.08 beam widths apart) the two are one echo to any array, and amplitudes grow without end."""


@numba.njit(forceinline=True, cache=True, fastmath={"contract", "nnan", "nsz"})
def _pair_row(
    p: float,
    real: float,
    imag: float,
    power: Floats32,
    beam_real: Floats32,
    beam_imag: Floats32,
    gain: Floats32,
    cross_real: Floats32,
    cross_imag: Floats32,
    row: Floats32,
) -> Any:
    """Likelihoods of one grid point with all later ones, and the largest; counting from zero lets the loop become vector code."""
    top = np.float32(0.0)
    for j in range(power.shape[0]):
        along = real * beam_real[j] + imag * beam_imag[j]
        across = real * beam_imag[j] - imag * beam_real[j]
        value = gain[j] * (p + power[j]) - along * cross_real[j] + across * cross_imag[j]
        row[j] = value
        top = max(top, value)
    return top


@numba.njit(forceinline=True, cache=True, fastmath={"contract"})
def best_pair(beam: Floats32, power: Floats32, gain: Floats32, cross: Floats32, row: Floats32) -> tuple[int, int]:
    """Pair of grid points with the largest likelihood; (0, 0): there is none.

    Parameters
    ----------
    beam : ndarray of float32, shape (2, n_grid)
        Real and imaginary parts of b.
    power : ndarray of float32, shape (n_grid,)
        |b|^2.
    gain : ndarray of float32, shape (n_grid, n_grid)
        n / (n^2 - |g|^2); 0 where the two are alike.
    cross : ndarray of float32, shape (2, n_grid, n_grid)
        2 g / (n^2 - |g|^2), real and imaginary; 0 where the two are alike.
    row : ndarray of float32, shape (n_grid,)
        Scratch.
    """
    n = power.shape[0]
    best: Any = np.float32(0.0)
    first, second = 0, 0
    for i in range(n - 1):
        k = i + 1
        top = _pair_row(
            power[i], beam[0, i], beam[1, i], power[k:], beam[0, k:], beam[1, k:], gain[i, k:], cross[0, i, k:], cross[1, i, k:], row
        )
        if top > best:
            best, first, second = top, i, k + first_maximum(row[: n - k])
    return first, second


@numba.njit(forceinline=True, cache=True)
def pair_power(b1: complex, b2: complex, g: complex, n: float) -> float:
    """Likelihood of two sources."""
    along: float = (np.conj(b1) * g * b2).real
    return (n * (abs(b1) ** 2 + abs(b2) ** 2) - 2.0 * along) / (n * n - abs(g) ** 2)


@numba.njit(forceinline=True, cache=True)
def best_partner(b1: complex, uy: float, uz: float, beam: Floats32, weight: Floats, nothing: Floats, phase: Floats, grid: Floats) -> int:
    """Grid point that has the largest likelihood together with the direction (uy, uz), whose beam is ``b1``."""
    n = np.float64(weight.shape[0])
    best, partner = -1.0, 0
    for j in range(grid.shape[1]):
        gr, gi, _, _, _, _, _, _, _, _, _, _ = beam_derivatives(weight, nothing, phase, uy - grid[0, j], uz - grid[1, j])
        g = complex(gr, gi)
        if n * n - abs(g) ** 2 < (1.0 - ALIKE) * n * n:
            continue
        power = pair_power(b1, complex(beam[0, j], beam[1, j]), g, n)
        if power > best:
            best, partner = power, j
    return partner
