"""From the points of a person to where the body is: weighted centroid, surface offset, covariance, extent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_tracking.estimators.base import Measurement
from radar_tracking.people_config import FilterConfig
from radar_tracking.points import Points

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]

ASSUMED_Z = 1.0  # m: height of a body's centre where nothing measures it, and
ASSUMED_Z_STD = 0.5  # how far off that is (assumed with every cloud, so that the height's covariance stays bounded); no centroid of
# the few points that a person gives is nearer to the middle between head and feet than this
_RATE_STD = 0.2  # m/s: trunks and legs of one person differ by so much in range rate
_SHORT = 1e-9  # m


@dataclass(frozen=True, eq=False)
class Bodies:
    """What a cloud says about some tracks; every array has one row per track.

    Attributes
    ----------
    measurement : Measurement
        Of the bodies' centres.
    away : ndarray of float64, shape (n_tracks, 2)
        Unit vectors on the floor plane from the sensor to the body.
    """

    measurement: Measurement
    away: Float64Array


def means(group: IndexArray, n: int, share: Float64Array, value: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Weighted mean, mean square about it, and total weight of the finite values of each group, shapes (n,); NaN where there is none."""
    known = np.isfinite(value)
    if not known.all():
        group, share, value = group[known], share[known], value[known]
    total = np.bincount(group, share, n)
    with np.errstate(invalid="ignore", divide="ignore"):  # groups without a value give 0 / 0
        mean = np.bincount(group, share * value, n) / total
        square = np.bincount(group, share * (value - mean[group]) ** 2, n) / total
    return mean, square, np.asarray(total, np.float64)


def measure(
    points: Points, own: IndexArray, group: IndexArray, n: int, weight: Float64Array, offset: Float64Array, config: FilterConfig
) -> Bodies:
    """Measure bodies by the weighted centroids of their points.

    A radar sees the surface that is turned to it: the centre lies behind the centroid by ``offset``. The covariance comes from the points'
    spread, number and distance. An unmeasured height is assumed.

    Parameters
    ----------
    points : Points
        Of the cloud.
    own : ndarray of int64, shape (n_own,)
        Which of them to use.
    group : ndarray of int64, shape (n_own,)
        Row of the track each belongs to, 0 to n - 1; every track has one at least.
    n : int
        Number of tracks.
    weight : ndarray of float64, shape (n_own,)
        Of each point, positive.
    offset : ndarray of float64, shape (n,)
        Of each track's centre behind its surface [m].
    config : FilterConfig
        How accurate centroids are.
    """
    share = weight / np.bincount(group, weight, n)[group]
    effective = 1.0 / np.bincount(group, share * share, n)
    noise = config.position_std**2 + np.bincount(group, share * points.cross[own] ** 2, n) / effective
    position, covariance = np.empty((n, 3)), np.zeros((n, 3, 3))
    for axis in range(2):
        position[:, axis], square, _ = means(group, n, share, points.position[own, axis])
        covariance[:, axis, axis] = noise + square / effective
    height, square, total = means(group, n, share, points.position[own, 2])
    measured = total > 0
    position[:, 2] = np.where(measured, height, ASSUMED_Z)
    covariance[:, 2, 2] = np.maximum(np.where(measured, noise + square / effective, 0.0), ASSUMED_Z_STD**2)
    # Every point lies before the centre as its own sensor sees it: from opposite sides the offsets cancel.
    sight = points.plane[own] - points.origins[points.sensor[own], :2]
    sight /= np.maximum(np.hypot(sight[:, 0], sight[:, 1]), _SHORT)[:, None]
    away = np.stack([np.bincount(group, share * sight[:, axis], n) for axis in range(2)], axis=-1).astype(np.float64, copy=False)
    position[:, :2] += offset[:, None] * away
    # A mean over sensors is the range rate of none: the one that sees most of the body is asked.
    best = _share(points, own, group, n, share).argmax(axis=1)
    same = points.sensor[own] == best[group]
    rate, square, _ = means(group[same], n, share[same], points.speed[own][same])
    fewer = np.bincount(group[same], share[same] ** 2, n) / np.bincount(group[same], share[same], n) ** 2
    variance = _RATE_STD**2 + np.nan_to_num(square) * fewer
    return Bodies(Measurement(position, covariance, rate, variance, points.origins[best]), away)


def _share(points: Points, own: IndexArray, group: IndexArray, n: int, share: Float64Array) -> Float64Array:
    """How much of each body each sensor sees, shape (n, n_sensors)."""
    n_sensors = len(points.origins)
    return np.asarray(np.bincount(group * n_sensors + points.sensor[own], share, n * n_sensors), np.float64).reshape(n, n_sensors)
