"""From a person's points to where the body is: weighted centroid, surface offset, covariance; compiled, with an oracle in the tests."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numba
import numpy as np

from radar_core.types import Float64Array, IndexArray
from radar_tracking.estimators.base import Measurement
from radar_tracking.people.config import FilterConfig
from radar_tracking.people.points import Points

ASSUMED_Z = 1.0  # m: height of a body's centre where nothing measures it, and
ASSUMED_Z_STD = 0.5  # how far off that is (assumed with every cloud, so that the height's covariance stays bounded); no centroid of
# the few points that a person gives is nearer to the middle between head and feet than this
_RATE_STD = 0.2  # m/s: trunks and legs of one person differ by so much in range rate
_AXES = np.arange(3)
_jit = numba.njit(cache=True, nogil=True)
_SHORT = 1e-9  # m


@dataclass(frozen=True, eq=False)
class Bodies:
    """Measured bodies: their centres, and unit vectors on the floor plane from the sensor to them, shape (n_tracks, 2)."""

    measurement: Measurement
    away: Float64Array


def measure(
    points: Points, own: IndexArray, group: IndexArray, n: int, weight: Float64Array, offset: Float64Array, config: FilterConfig
) -> Bodies:
    """Measure ``n`` bodies by the weighted centroids of their points.

    A radar sees the surface that is turned to it: the centre lies behind the centroid by ``offset``. The covariance comes from the points'
    spread, number and distance. An unmeasured height is assumed.

    Parameters
    ----------
    points : Points
        Of the cloud.
    own, group : ndarray of int64, shape (n_own,)
        Which of them to use, and the row of the track each belongs to, 0 to n - 1; every track has one at least.
    n : int
        Number of tracks.
    weight : ndarray of float64, shape (n_own,)
        Of each point, positive.
    offset : ndarray of float64, shape (n,)
        Of each track's centre behind its surface [m].
    config : FilterConfig
        How accurate centroids are.
    """
    columns = (points.position.take(own, axis=0), points.cross[own], points.speed[own], points.sensor[own])
    found = Centres(*centre(*columns, points.origins, group, weight, n))
    position, variance = found.place, config.position_std**2 + found.variance
    position[np.isnan(position[:, 2]), 2] = ASSUMED_Z
    variance[:, 2] = np.fmax(variance[:, 2], ASSUMED_Z_STD**2)  # which an unmeasured height has alone
    # Every point lies before the centre as its own sensor sees it: from opposite sides the offsets cancel.
    position[:, :2] += offset[:, None] * found.away
    covariance = np.zeros((n, 3, 3))
    covariance[:, _AXES, _AXES] = variance
    # A mean over sensors is the range rate of none: the one that sees most of the body is asked.
    rate_variance = _RATE_STD**2 + np.fmax(found.rate_variance, 0.0)
    return Bodies(Measurement(position, covariance, found.rate, rate_variance, points.origins[found.best]), found.away)


class Centres(NamedTuple):
    """Weighted means of points, one row per track.

    Attributes
    ----------
    place, variance : ndarray of float64, shape (n_tracks, 3)
        Of the visible surface [m], and how sure that is along each axis [m^2]; NaN heights where none is measured.
    away : ndarray of float64, shape (n_tracks, 2)
        Mean of the unit vectors on the floor plane from the sensors to the points.
    best : ndarray of int64, shape (n_tracks,)
        The sensor that sees most of the body.
    rate, rate_variance : ndarray of float64, shape (n_tracks,)
        Mean of the range rates that it measures, and of that their spread alone says [m/s, m^2/s^2]; NaN where none is measured.
    """

    place: Float64Array
    variance: Float64Array
    away: Float64Array
    best: IndexArray
    rate: Float64Array
    rate_variance: Float64Array


@_jit
def centre(position: Any, cross: Any, speed: Any, sensor: Any, origins: Any, group: Any, weight: Any, n: int) -> Any:
    """Average the points of each of ``n`` groups: the fields of `Centres`, from columns of `Points`, each point's group and weight."""
    # written out in loops: expressions of whole arrays take seconds to compile
    m, n_sensors = len(group), len(origins)
    share, column = np.empty(m), np.empty(m)
    total, effective, noise = np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(m):
        total[group[i]] += weight[i]
    for i in range(m):
        share[i] = weight[i] / total[group[i]]
        effective[group[i]] += share[i] * share[i]
        noise[group[i]] += share[i] * cross[i] ** 2
    place, variance = np.empty((n, 3)), np.empty((n, 3))
    for axis in range(3):
        for i in range(m):
            column[i] = position[i, axis]
        mean, square = _moments(group, share, column, n)
        for k in range(n):
            place[k, axis] = mean[k]
            variance[k, axis] = (noise[k] + square[k]) * effective[k]
    away, seen = np.zeros((n, 2)), np.zeros((n, n_sensors))
    for i in range(m):
        x, y = position[i, 0] - origins[sensor[i], 0], position[i, 1] - origins[sensor[i], 1]
        length = max(math.hypot(x, y), _SHORT)
        away[group[i], 0] += share[i] * (x / length)
        away[group[i], 1] += share[i] * (y / length)
        seen[group[i], sensor[i]] += share[i]
    best = _largest(seen)
    fewer = np.zeros(n)
    for i in range(m):
        same = sensor[i] == best[group[i]]
        column[i] = speed[i] if same else math.nan
        fewer[group[i]] += share[i] ** 2 if same else 0.0
    rate, square = _moments(group, share, column, n)
    for k in range(n):
        square[k] *= fewer[k] / seen[k, best[k]] ** 2
    return place, variance, away, best, rate, square


@_jit
def _largest(seen: Any) -> Any:
    """Column of the largest entry of each row, the first of equal ones."""
    best = np.zeros(len(seen), np.int64)
    for k in range(len(seen)):
        for s in range(1, seen.shape[1]):
            if seen[k, s] > seen[k, best[k]]:
                best[k] = s
    return best


@_jit
def _moments(group: Any, share: Any, value: Any, n: int) -> Any:
    """Weighted mean, and mean square about it, of the finite values of each group; NaN where there is none."""
    total, mean, square = np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(len(group)):
        if math.isfinite(value[i]):
            total[group[i]] += share[i]
            mean[group[i]] += share[i] * value[i]
    for k in range(n):
        mean[k] = mean[k] / total[k] if total[k] > 0.0 else math.nan
    for i in range(len(group)):
        if math.isfinite(value[i]):
            square[group[i]] += share[i] * (value[i] - mean[group[i]]) ** 2
    for k in range(n):
        square[k] = square[k] / total[k] if total[k] > 0.0 else math.nan
    return mean, square
