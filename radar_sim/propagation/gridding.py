"""The window that spreads a frequency over a grid: a non-uniform Fourier transform whose points may move a little from lane to lane.

A tone of x cells, sampled at m = -N/2 ... N/2 - 1, is the transform of a window about x on a grid of M = 2 N cells, over the window's own
transform. If the tone moves by d cells, the window moves: w(x + d) = w + d w' + d^2 w'' / 2, with d small. So one set of window values
serves many lanes (chirps, channels) that have nearly the same frequency.

The window is Kaiser and Bessel's (J. I. Jackson et al., IEEE Trans. Medical Imaging 10, 1991), as polynomials.
"""

from __future__ import annotations

import functools
from typing import Final

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray
from scipy import special

from radar_sim.propagation.base import Float64Array

WIDTH: Final = 6
"""Cells of the grid that a tone is spread over; what folds back is then 1e-5 of it."""
_BETA = np.pi * WIDTH * 0.75
_DEGREE = 10


def window(y: Float64Array) -> Float64Array:
    """Value of the window ``y`` cells from its middle, at most half its width."""
    inside = np.sqrt(np.maximum(1 - (2 * y / WIDTH) ** 2, 0.0))
    return np.asarray(special.i0(_BETA * inside) / special.i0(_BETA))


def _cell(u: Float64Array, i: int) -> Float64Array:
    return window(u + (i - WIDTH / 2))


@functools.cache
def polynomials() -> NDArray[np.float32]:
    """Window and its first two derivatives over the cells that it covers, shape (3, WIDTH, degree + 1), for Horner: highest power first.

    The argument is the distance of the first cell from the window's left end, 0 to 1; derivatives are with respect to the tone.
    """
    result = np.zeros((3, WIDTH, _DEGREE + 1), np.float32)
    for i in range(WIDTH):
        fit = Chebyshev.interpolate(_cell, _DEGREE, domain=[0, 1], args=(i,)).convert(kind=Polynomial)
        for k, (sign, part) in enumerate(((1, fit), (-1, fit.deriv()), (1, fit.deriv(2)))):
            result[k, i, k:] = sign * part.coef[::-1]
    return result


def grid_cells(n_sample: int) -> int:
    """Cells of the grid: twice the samples, and no fewer than the window's two ends need."""
    return max(2 * n_sample, 2 * WIDTH)


def undo(n_sample: int) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Where samples -n_sample // 2 ... are in the transform of the grid, and what takes the window off them."""
    m, cells = np.arange(n_sample) - n_sample // 2, grid_cells(n_sample)
    root = np.sqrt(_BETA**2 - (np.pi * WIDTH * m / cells) ** 2)
    return m % cells, (root * special.i0(_BETA) / (WIDTH * np.sinh(root))).astype(np.float32)
