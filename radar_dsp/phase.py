"""What the phase of range cells over time tells of something that moves in them by less than a cell."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_LINE: Final = 1e-6  # of the larger moment: what bends less is a line


def circle_centre(series: NDArray[Any]) -> Complex:
    """Centres of the circles that fit best (Kasa 1976): what stands still beside an echo that moves.

    Parameters
    ----------
    series : ndarray of complex, shape (n_time, ...)
        Range cells over time.

    Returns
    -------
    ndarray of complex128, shape (...)
        On a line, where the centre could lie anywhere beside it, the mean.
    """
    z = np.asarray(series, np.complex128)
    mean = z.mean(axis=0)
    z = z - mean
    size = np.sqrt((np.abs(z) ** 2).mean(axis=0))
    z = z / np.where(size > 0, size, 1.0)
    x, y = z.real, z.imag
    xx, yy, xy = (x * x).mean(axis=0), (y * y).mean(axis=0), (x * y).mean(axis=0)
    cubic = (z * np.abs(z) ** 2).mean(axis=0) / 2
    det = xx * yy - xy * xy
    flat = det <= _LINE * np.maximum(xx + yy, 1e-300) ** 2
    det = np.where(flat, 1.0, det)
    centre = ((yy * cubic.real - xy * cubic.imag) + 1j * (xx * cubic.imag - xy * cubic.real)) / det
    return np.asarray(mean + np.where(flat, 0.0, size * centre))


def way_of(series: NDArray[Any], wavelength: float) -> Float64Array:
    """Way along the line of sight of one thing that is seen in several channels and range cells, away positive.

    Every cell's phase turns about its own circle's centre (arctangent demodulation). From one time to the next the turns of all cells are
    added, weighted by power: where one cell fades, others tell, and nothing slips.

    Parameters
    ----------
    series : ndarray of complex, shape (n_time, n_cell)
        The cells over time, finite.
    wavelength : float
        Of the carrier [m]; from one time to the next the thing may move by less than a quarter of it.

    Returns
    -------
    ndarray of float64, shape (n_time,)
        From the first time on [m].
    """
    moving = np.asarray(series, np.complex128) - circle_centre(series)
    turn = (moving[1:] * moving[:-1].conj()).sum(axis=1)
    return np.concatenate([[0.0], np.cumsum(np.angle(turn))]) * wavelength / (4 * math.pi)
