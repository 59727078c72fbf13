"""From the points of a person to where the body is: weighted centroid, surface offset, covariance, extent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radar_core.types import Float64Array, IndexArray
from radar_tracking.estimators.base import Measurement
from radar_tracking.people.body_kernels import Centres, centre
from radar_tracking.people.config import FilterConfig
from radar_tracking.people.points import Points

ASSUMED_Z = 1.0  # m: height of a body's centre where nothing measures it, and
ASSUMED_Z_STD = 0.5  # how far off that is (assumed with every cloud, so that the height's covariance stays bounded); no centroid of
# the few points that a person gives is nearer to the middle between head and feet than this
_RATE_STD = 0.2  # m/s: trunks and legs of one person differ by so much in range rate
_AXES = np.arange(3)


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
