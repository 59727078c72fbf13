"""Window functions by scipy's names, what a window does to noise, and frames that windows do not fit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_core.windows import window_shape

Shape = tuple[int, int, int, int]
"""Of a frame: (n_tx, n_chirp, n_rx, n_sample)."""


def make_window(name: str, n: int) -> NDArray[np.float64]:
    """Make a window of unit energy, so that the transform of white noise keeps the variance of its samples.

    Parameters
    ----------
    name : str
        A name of `scipy.signal.get_window`; parameters follow after colons, e.g. ``"kaiser:8.6"``. A `ConfigError` says that scipy does not
        know it.
    n : int
        Length.

    Returns
    -------
    ndarray of float64, shape (n,)
        Window with a sum of squares of one.
    """
    shape = window_shape(name, n)
    return np.asarray(shape / np.sqrt(float(np.sum(shape**2))), np.float64)


def noise_correlation(window: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Correlation coefficient between cells of noise behind a window of unit energy, over their distance in bins (circular).

    The noise is white; ``window`` and the result, E[V(m) V*(m - lag)] / E[|V|^2], have the shape (n,).
    """
    return np.asarray(np.fft.fft(window**2), np.complex128)


def response(window: NDArray[np.float64], offset: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Transform of the windowed unit tone, seen ``offset`` bins (bin minus tone, any shape) beside it; the result has that shape."""
    n = len(window)
    result: NDArray[np.complex128] = np.exp(-2j * np.pi / n * offset[..., None] * np.arange(n)) @ window
    return result


def wrong_shape(given: Shape, wanted: Shape) -> DataError:
    """Make the error for a frame of another shape than the transform was planned for."""
    return DataError(f"the frame has shape {given} (tx, chirp, rx, sample), but its radar gives {wanted}; check the radar's info")
