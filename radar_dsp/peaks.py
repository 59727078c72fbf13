"""From cells above the threshold to estimates between the cells."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_dsp.windows import noise_correlation, response

FloatMap = NDArray[np.float32]
AnyArray = NDArray[Any]
_FLOOR = 1e-3
"""Neighbours weaker than this beside the peak are noise (only the boxcar window makes them): no logarithm goes below it."""


def is_maximum(power: FloatMap, axis: int) -> NDArray[np.bool_]:
    """Mask of the local maxima along one axis, shape as ``power``; of equal neighbours the first one wins.

    Both axes are circular: a transform leaks around its ends, in range too. On an axis of one cell everything is a maximum.
    """
    if power.shape[axis] == 1:
        return np.ones(power.shape, np.bool_)
    return (power > np.roll(power, 1, axis)) & (power >= np.roll(power, -1, axis))


def group(mask: NDArray[np.bool_], power: FloatMap, grouping: str) -> NDArray[np.bool_]:
    """Keep one cell per echo.

    Parameters
    ----------
    mask : ndarray of bool, shape (n_speed, n_range)
        Cells above the threshold.
    power : ndarray of float32, shape (n_speed, n_range)
        Integrated spectrum.
    grouping : str
        ``none``; ``range``: local maxima along range, at every speed; ``peak``: larger than all eight neighbours.

    Returns
    -------
    ndarray of bool, shape (n_speed, n_range)
        Cells that become points.
    """
    if grouping == "none":
        return mask
    mask = mask & is_maximum(power, 1)
    if grouping == "range" or power.shape[0] == 1:
        return mask
    # Diagonal neighbours count too: the ridges of a strong echo's window are maxima along single axes only.
    across = np.maximum(np.maximum(np.roll(power, 1, 1), np.roll(power, -1, 1)), power)
    return mask & (power > np.roll(across, 1, 0)) & (power >= np.roll(across, -1, 0))


class Interpolator:
    """Position of an echo between the cells of one axis: a parabola through three log powers, corrected for the window.

    For a Gaussian window the parabola would be exact. For others its bias depends on the true offset alone, so it is tabulated and
    inverted.

    Parameters
    ----------
    window : ndarray, shape (n,)
        Window of the axis, unit energy.
    """

    def __init__(self, window: NDArray[np.float64]) -> None:
        self._enough = len(window) >= 4
        if not self._enough:
            return
        self._true = np.linspace(-0.5, 0.5, 129)
        bins = np.array([-1.0, 0.0, 1.0])
        h = response(window, bins - self._true[:, None])
        power = np.abs(h) ** 2
        power = np.maximum(power, _FLOOR * power[:, 1:2])
        self._raw = np.maximum.accumulate(_parabola(*np.log(power).T))
        self._variance = _variance(h, power, noise_correlation(window), self._raw, self._true)

    def process(self, before: FloatMap, at: FloatMap, after: FloatMap, snr: FloatMap, n_channel: int) -> tuple[FloatMap, FloatMap]:
        """Estimate offsets.

        Parameters
        ----------
        before, at, after : ndarray of float32, shape (n_points,)
            Integrated power of the cells below, at and above each detection.
        snr : ndarray of float32, shape (n_points,)
            Signal-to-noise power ratio of the cell, per channel.
        n_channel : int
            Number of integrated channels.

        Returns
        -------
        tuple of ndarray of float32, shape (n_points,)
            Offset from the cell's centre and its standard deviation, in cells. An axis of less than four cells gives 0 and 1/sqrt(12).
        """
        if not self._enough:
            return np.zeros_like(at), np.full_like(at, 12**-0.5)
        floor = np.maximum(_FLOOR * at, np.finfo(np.float32).tiny)
        raw = _parabola(np.log(np.maximum(before, floor)), np.log(np.maximum(at, floor)), np.log(np.maximum(after, floor)))
        offset = np.interp(raw, self._raw, self._true)
        # The second term is noise times noise, which matters when single channels are below the noise.
        variance = np.interp(offset, self._true, self._variance) / (n_channel * snr) * (1 + 0.5 / snr)
        # A cell on the flank of its echo has a vertex outside of it: how far outside is an error of its own.
        excess = np.maximum(np.abs(raw) - self._raw[-1], 0.0)
        return offset.astype(np.float32), np.minimum(np.sqrt(variance + excess**2), 12**-0.5).astype(np.float32)


def _parabola(before: AnyArray, at: AnyArray, after: AnyArray) -> AnyArray:
    curvature = np.minimum(before - 2 * at + after, -1e-6)
    vertex: AnyArray = np.clip(0.5 * (before - after) / curvature, -1.0, 1.0)
    return vertex


def _variance(
    h: NDArray[np.complex128],
    power: NDArray[np.float64],
    correlation: NDArray[np.complex128],
    raw: NDArray[np.float64],
    true: NDArray[np.float64],
) -> NDArray[np.float64]:
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
