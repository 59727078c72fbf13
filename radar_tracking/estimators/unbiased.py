"""Positions from measured range and angles, with covariances that hold for large angle errors too."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from radar_core import DataError
from radar_core.linalg import symmetrise
from radar_core.types import Float64Array
from radar_tracking.estimators.base import Measurement

_WIDEST = 1.0  # rad: beyond this an angle's bias is no longer corrected in full; the correction grows without bound


def from_polar(
    range_: ArrayLike,
    azimuth: ArrayLike,
    elevation: ArrayLike | None = None,
    *,
    range_std: ArrayLike,
    azimuth_std: ArrayLike,
    elevation_std: ArrayLike | None = None,
    rate: ArrayLike = np.nan,
    rate_std: ArrayLike = 1.0,
    origin: ArrayLike | None = None,
    rotation: ArrayLike | None = None,
) -> Measurement:
    """Convert polar measurements to positions (6.5, with x forward) without bias, with the covariance of their errors.

    The plain conversion puts a target too near, because noise of an angle pulls its cosine towards zero. The bias is taken out by a factor
    and the covariance is that of the error given what was measured (Mo Longbin et al., Unbiased converted measurements for tracking, IEEE
    Trans. Aerospace and Electronic Systems 34, 1998; Lerro and Bar-Shalom 1993), here written so that nothing cancels at small errors.

    Parameters
    ----------
    range_, azimuth : array_like of float, shape (n,)
        Measured [m, rad], not negative ranges, azimuth from x towards y.
    elevation : array_like of float, shape (n,), or None
        Measured, up positive [rad]; None: positions on the floor plane, d = 2.
    range_std, azimuth_std, elevation_std : array_like of float
        Standard deviations, of all or of each [m, rad]; positive.
    rate, rate_std : array_like of float
        Range rate, receding positive, NaN where not measured, and its standard deviation [m/s].
    origin : array_like of float, shape (d,) or (n, d), or None
        Where the sensor stands [m]; None: at zero.
    rotation : array_like of float, shape (d, d), or None
        From the sensor's axes to those of the room (`Pose.rotation`); None: the same axes.

    Returns
    -------
    Measurement
        In the frame of ``origin``.

    Raises
    ------
    DataError
        When a number is not finite (a rate may be NaN), a range is negative or a standard deviation is not positive.
    """
    r = np.atleast_1d(np.asarray(range_, np.float64))
    n, d = len(r), 2 if elevation is None else 3
    if d == 3 and elevation_std is None:
        raise DataError("elevation was given without elevation_std; give both or neither")
    azimuth = _numbers("azimuth", azimuth, n)
    height = np.zeros(n) if elevation is None else _numbers("elevation", elevation, n)
    range_variance = _variance("range_std", range_std, n)
    azimuth_variance = _variance("azimuth_std", azimuth_std, n)
    height_variance = np.zeros(n) if elevation is None or elevation_std is None else _variance("elevation_std", elevation_std, n)
    if not (np.isfinite(r).all() and (r >= 0).all()):
        raise DataError("a range is negative or not finite; drop points without a range before converting them")
    position, covariance = _unbiased(r, azimuth, height, range_variance, azimuth_variance, height_variance)
    position, covariance = position[:, :d], covariance[:, :d, :d]
    if rotation is not None:
        turn = np.asarray(rotation, np.float64)
        position, covariance = position @ turn.T, turn @ covariance @ turn.T
    start = np.broadcast_to(np.zeros(d) if origin is None else np.asarray(origin, np.float64), (n, d)).copy()
    rates = np.broadcast_to(np.asarray(rate, np.float64), (n,)).copy()
    if np.isinf(rates).any() or not np.isfinite(start).all():
        raise DataError("rate is infinite or origin not finite; NaN is the mark for a rate that was not measured")
    return Measurement(position + start, symmetrise(covariance), rates, _variance("rate_std", rate_std, n), start)


def _numbers(name: str, values: ArrayLike, n: int) -> Float64Array:
    """Float64 of length ``n``, finite."""
    array = np.broadcast_to(np.asarray(values, np.float64), (n,))
    if not np.isfinite(array).all():
        raise DataError(f"{name} is not finite; drop such points before converting them")
    return array


def _variance(name: str, std: ArrayLike, n: int) -> Float64Array:
    """Squares of standard deviations, which must be positive."""
    array = _numbers(name, std, n)
    if not (array > 0).all():
        raise DataError(f"{name} has an entry that is not positive; every measurement needs an error")
    return array**2


def _unbiased(
    r: Float64Array, azimuth: Float64Array, elevation: Float64Array, var_r: Float64Array, var_a: Float64Array, var_e: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Positions, shape (n, 3), and covariances of their errors given the measurement, shape (n, 3, 3).

    First the plane through the axis z and the target (out, up), then the azimuth about it. Means under noise n of variance v:
    E cos n = exp(-v / 2), E cos^2 n = (1 + exp(-2 v)) / 2.
    """
    sin_e, cos_e = np.sin(elevation), np.cos(elevation)
    shrink_a, shrink_e = np.exp(-var_a / 2), np.exp(-var_e / 2)
    factor_a, factor_e = np.exp(np.minimum(var_a, _WIDEST) / 2), np.exp(np.minimum(var_e, _WIDEST) / 2)
    # spread of the unit vector along and across itself, then with the range's own
    along, across = 0.5 * np.expm1(-var_e) ** 2, -0.5 * np.expm1(-2 * var_e)
    far = r**2 * along + var_r * 0.5 * (1 + np.exp(-2 * var_e))
    wide = (r**2 + var_r) * across
    out, up = r * cos_e * shrink_e, r * sin_e * shrink_e
    var_out, var_up = far * cos_e**2 + wide * sin_e**2, far * sin_e**2 + wide * cos_e**2
    link = (far - wide) * sin_e * cos_e
    along, across = 0.5 * np.expm1(-var_a) ** 2, -0.5 * np.expm1(-2 * var_a)
    C = np.zeros((len(r), 3, 3))
    C[:, 0, 0] = var_out * 0.5 * (1 + np.exp(-2 * var_a)) + out**2 * along
    C[:, 1, 1] = (var_out + out**2) * across
    C[:, 2, 2] = var_up
    C[:, 0, 2] = C[:, 2, 0] = shrink_a * link
    # what the unbiased position differs from the mean given the measurement
    place = np.stack([r * cos_e * factor_e * factor_a, np.zeros(len(r)), r * sin_e * factor_e], axis=-1)
    off = place - np.stack([out * shrink_a, np.zeros(len(r)), up], axis=-1)
    C += off[:, :, None] * off[:, None, :]
    turn = np.zeros((len(r), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(azimuth)
    turn[:, 1, 0], turn[:, 2, 2] = np.sin(azimuth), 1.0
    turn[:, 0, 1] = -turn[:, 1, 0]
    return (turn @ place[..., None])[..., 0], turn @ C @ np.swapaxes(turn, -1, -2)
