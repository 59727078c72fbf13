"""Window functions by scipy's names, what a window does to noise and to the place of an echo, and frames that windows do not fit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_core.windows import window_shape

AnyArray = NDArray[Any]
Shape = tuple[int, int, int, int]  # of a frame: (n_tx, n_chirp, n_rx, n_sample)
FLOOR = 1e-3  # neighbours weaker than this beside the peak are noise (only the boxcar window makes them): no logarithm goes below it
_TABLE = 1025
_NOTHING = 1e30  # variance of an offset that cannot be measured; estimates cap it at that of a whole cell


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


class Interpolator:
    """Tables for the position of an echo between the cells of one axis: a parabola through three log powers, corrected for the window.

    For a Gaussian window the parabola would be exact. For others its bias depends on the true offset alone, so it is tabulated and
    inverted.

    Parameters
    ----------
    window : ndarray, shape (n,)
        Window of the axis, unit energy.

    Attributes
    ----------
    table : ndarray, shape (2, n_table)
        Offset over the parabola's vertex from -1 to 1, and variance of the offset over the offset from -0.5 to 0.5, times the cell's total
        signal-to-noise ratio, both in cells. An axis of less than four cells says nothing: offset 0, variance without bound.
    edge : float
        Vertex at which the offset reaches half a cell.
    """

    def __init__(self, window: NDArray[np.float64]) -> None:
        self.table, self.edge = np.zeros((2, _TABLE)), 1.0
        if len(window) < 4:
            self.table[1] = _NOTHING
            return
        true = np.linspace(-0.5, 0.5, 129)
        bins = np.array([-1.0, 0.0, 1.0])
        h = response(window, bins - true[:, None])
        power = np.abs(h) ** 2
        power = np.maximum(power, FLOOR * power[:, 1:2])
        raw = np.maximum.accumulate(_parabola(*np.log(power).T))
        variance = _variance(h, power, noise_correlation(window), raw, true)
        vertex = np.linspace(-1.0, 1.0, _TABLE)
        self.table = np.stack([np.interp(vertex, raw, true), np.interp(0.5 * vertex, true, variance)])
        self.edge = float(raw[-1])


def _parabola(before: AnyArray, at: AnyArray, after: AnyArray) -> AnyArray:
    curvature = np.minimum(before - 2 * at + after, -1e-6)
    vertex: AnyArray = np.clip(0.5 * (before - after) / curvature, -1.0, 1.0)
    return vertex


def _variance(h: AnyArray, power: AnyArray, correlation: AnyArray, raw: AnyArray, true: AnyArray) -> NDArray[np.float64]:
    """Variance of the offset times the cell's total signal-to-noise ratio, to first order in the noise, shape (n_offsets,)."""
    log_power = np.log(power)
    gradient = np.empty_like(log_power)
    for i in range(3):  # of the parabola's vertex by each log power
        step = np.zeros(3)
        step[i] = 1e-4
        gradient[:, i] = (_parabola(*(log_power + step).T) - _parabola(*(log_power - step).T)) / 2e-4
    slope = np.maximum(np.gradient(raw, true), 0.05)
    lag = np.arange(3)[:, None] - np.arange(3)[None, :]
    phase = np.exp(1j * np.angle(h))
    magnitude = np.sqrt(power)
    cross = correlation[lag % len(correlation)] / (phase[:, :, None] * phase[:, None, :].conj())
    covariance = 2 * cross.real / (magnitude[:, :, None] * magnitude[:, None, :])
    variance = np.einsum("oi,oij,oj->o", gradient, covariance, gradient) / slope**2
    return np.asarray(np.maximum(variance * power[:, 1], 0.0), np.float64)
