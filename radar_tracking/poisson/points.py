"""Points of a cloud as the Poisson tracker uses them: on the floor plane, with a line of sight and the errors of one point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radar_core import PointCloud
from radar_core.types import BoolArray, Float64Array
from radar_tracking.people.points import Admission, Points
from radar_tracking.poisson.config import PoissonConfig

LEAST_STILL = 0.1  # m/s: slower points do not move
_MOST_STD = 1.0  # m, and half of it in rad: a larger error of one point says nothing
_STEEPEST = 0.3  # least share of the slant range that lies on the floor plane


@dataclass(frozen=True, eq=False)
class Measured:
    """The usable points of one cloud; every array has one entry per point.

    Attributes
    ----------
    points : Points
        What the other trackers use, too.
    x, y : ndarray of float64, shape (n_points,)
        On the floor plane, seen from the room's origin [m]; slant ranges of radars without elevation are projected.
    ux, uy : ndarray of float64, shape (n_points,)
        Unit vector from the sensor to the point.
    distance, azimuth : ndarray of float64, shape (n_points,)
        From the sensor, on the floor plane of ``room`` [m, rad].
    speed : ndarray of float64, shape (n_points,)
        Range rate [m/s]; NaN: not measured.
    still : ndarray of bool, shape (n_points,)
        Slower than `still_speed`.
    range_variance, cross_variance : ndarray of float64, shape (n_points,)
        Errors of one point along and across the line of sight [m^2].
    still_speed : float
        Half of a Doppler cell, as far as one is seen, at least `LEAST_STILL` [m/s].
    """

    points: Points
    x: Float64Array
    y: Float64Array
    ux: Float64Array
    uy: Float64Array
    distance: Float64Array
    azimuth: Float64Array
    speed: Float64Array
    still: BoolArray
    range_variance: Float64Array
    cross_variance: Float64Array
    still_speed: float

    def __len__(self) -> int:
        return len(self.x)


class Measure:
    """Makes `Measured` of clouds, and learns how coarse the radar's range rates are: demos of boards publish whole Doppler cells."""

    def __init__(self, config: PoissonConfig, admission: Admission) -> None:
        self._config, self._admission = config, admission
        self._cell = np.inf

    def process(self, cloud: PointCloud) -> Measured:
        """Pick the usable points; `DataError` where a cloud is not in ``room`` or holds an infinity."""
        points = self._admission.process(cloud)
        origin = points.origins.take(points.sensor, axis=0)
        away = (points.plane - origin[:, :2]) * self._flatten(cloud, points, origin)[:, None]
        place, distance = origin[:, :2] + away, np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-6)
        moving = np.abs(points.speed[np.abs(points.speed) > 1e-3])
        self._cell = min(self._cell, float(moving.min(initial=np.inf)))
        still_speed = max(LEAST_STILL, 0.5 * self._cell if np.isfinite(self._cell) else 0.0)
        along = _known(cloud.range_std[points.index], self._config.range_std, _MOST_STD)
        turn = _known(cloud.azimuth_std[points.index], self._config.angle_std, 0.5 * _MOST_STD)
        azimuth = np.arctan2(away[:, 1], away[:, 0])
        return Measured(
            points, place[:, 0], place[:, 1], np.cos(azimuth), np.sin(azimuth), distance, azimuth, points.speed,
            np.asarray(np.abs(points.speed) < still_speed), along**2, (distance * turn) ** 2, still_speed,
        )  # fmt: skip

    def _flatten(self, cloud: PointCloud, points: Points, origin: Float64Array) -> Float64Array:
        """By how much to shorten the way from the sensor to each point: without an elevation, x and y hold the slant range."""
        unknown = ~np.isfinite(cloud.elevation[points.index])
        slant = cloud.range[points.index].astype(np.float64)
        unknown &= np.isfinite(slant)
        if not unknown.any():
            return np.ones(len(points))
        drop = origin[:, 2] - self._config.body_height
        flat = np.sqrt(np.maximum(slant**2 - drop**2, (_STEEPEST * slant) ** 2))
        return np.where(unknown, np.minimum(flat / np.maximum(points.distance, 1e-6), 1.0 / _STEEPEST), 1.0)


def _known(std: np.ndarray[tuple[int, ...], np.dtype[np.float32]], default: float, most: float) -> Float64Array:
    value = std.astype(np.float64)
    return np.asarray(np.where(np.isfinite(value) & (value >= 0), np.minimum(value, most), default))
