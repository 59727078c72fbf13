"""Points of a cloud as the Poisson tracker uses them: on the floor plane, with a line of sight and the errors of one point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radar_core import PointCloud
from radar_core.types import BoolArray, Float64Array
from radar_tracking.people.config import TrackerConfig
from radar_tracking.people.points import Admission, Points
from radar_tracking.people.zones import View

LEAST_STILL = 0.1  # m/s: slower points do not move
_HALF_CELL = 0.51  # estimates are clipped to half a cell about their peak: leakage of what stands still comes out there
_UNKNOWN_SNR = 15.0  # dB: where the radar does not tell
_MOST_STD = 1.0  # m, and half of it in rad: a larger error of one point says nothing
_STEEPEST = 0.3  # least share of the slant range that lies on the floor plane
_FITS = (0.8, 2.0)  # of the distance at which the cloud puts a point: slant ranges beyond are no ranges
_ABEAM = 1.5  # rad: beyond, nothing is known of what is ahead


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
    rate : ndarray of float64, shape (n_points,)
        The same, 0 where it was not measured.
    still : ndarray of bool, shape (n_points,)
        Slower than `still_speed`.
    snr : ndarray of float64, shape (n_points,)
        Strength [dB].
    height : ndarray of float64, shape (n_points,)
        Above the floor [m]; NaN: not measured.
    range_variance, cross_variance : ndarray of float64, shape (n_points,)
        Errors of one point along and across the line of sight [m^2].
    still_speed : float
        Half of a Doppler cell, as far as one is seen, at least `LEAST_STILL` [m/s].
    range_cell : float
        Of the radar [m]; 0: not known.
    """

    points: Points
    x: Float64Array
    y: Float64Array
    ux: Float64Array
    uy: Float64Array
    distance: Float64Array
    azimuth: Float64Array
    speed: Float64Array
    rate: Float64Array
    still: BoolArray
    snr: Float64Array
    height: Float64Array
    range_variance: Float64Array
    cross_variance: Float64Array
    still_speed: float
    range_cell: float

    def __len__(self) -> int:
        return len(self.x)


class Measure:
    """Makes `Measured` of clouds, and learns how coarse the radar's range rates are: demos of boards publish whole Doppler cells."""

    def __init__(self, config: TrackerConfig, admission: Admission, view: View) -> None:
        self._config, self._admission = config.poisson, admission
        self._slowest, self._cell = max(LEAST_STILL, _HALF_CELL * view.doppler_cell), np.inf
        self.range_cell = view.range_cell

    def process(self, cloud: PointCloud) -> Measured:
        """Pick the usable points; `DataError` where a cloud is not in ``room`` or holds an infinity."""
        points = self._admission.process(cloud)
        origin = points.origins.take(points.sensor, axis=0)
        away, blur, height = self._flatten(cloud, points, origin)
        place, distance = origin[:, :2] + away, np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-6)
        rate = np.where(np.isfinite(points.speed), points.speed, 0.0)
        moving = np.abs(rate)
        self._cell = min(self._cell, float(moving.min(initial=np.inf, where=moving > 1e-3)))
        still_speed = max(self._slowest, 0.5 * self._cell if np.isfinite(self._cell) else 0.0)
        along = _known(cloud.range_std[points.index], self._config.range_std, _MOST_STD)
        turn = _known(cloud.azimuth_std[points.index], self._config.angle_std, 0.5 * _MOST_STD)
        azimuth = np.arctan2(away[:, 1], away[:, 0])
        snr = np.where(np.isfinite(points.power), 10.0 * np.log10(np.maximum(points.power, 1e-3)), _UNKNOWN_SNR)
        still = np.asarray(np.abs(points.speed) < still_speed)
        x, y = place.T.copy()  # as rows in memory, however many points there are: for one type of machine code
        return Measured(
            points, x, y, np.cos(azimuth), np.sin(azimuth), distance, azimuth, points.speed, rate, still, snr, height,
            along**2 + blur**2, (distance * turn) ** 2, still_speed, self.range_cell,
        )  # fmt: skip

    def _flatten(self, cloud: PointCloud, points: Points, origin: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Ways on the floor from the sensor to each point, shape (n_points, 2), their errors from unknown heights, and heights [m].

        Without an elevation, a point lies on a circle about the lateral axis of the array, r sin(azimuth) along that axis: the rest of the
        slant range r says how far ahead it is, once its height is known; most echoes are near `body_height`.
        """
        away = points.plane - origin[:, :2]
        slant, azimuth = (getattr(cloud, name)[points.index].astype(np.float64) for name in ("range", "azimuth"))
        unknown = ~np.isfinite(cloud.elevation[points.index]) & (np.abs(azimuth) < _ABEAM) & (slant > 0.0)
        unknown &= (slant > _FITS[0] * points.distance) & (slant < _FITS[1] * points.distance)
        if not unknown.any():
            return away, np.zeros(len(points)), points.position[:, 2]
        slant = np.where(unknown, slant, 1.0)
        lateral = slant * np.sin(np.where(unknown, azimuth, 0.0))
        before = np.sqrt(np.maximum(points.distance**2 - lateral**2, 1e-12))  # ahead of the array, where the cloud put the point
        drop = origin[:, 2] - self._config.body_height
        ahead = np.sqrt(np.maximum(slant**2 - lateral**2 - drop**2, (_STEEPEST * slant) ** 2))
        turn = (before + 1j * lateral) / np.hypot(before, lateral)
        flat = (ahead + 1j * lateral) * (away[:, 0] + 1j * away[:, 1]) / np.maximum(points.distance, 1e-6) / turn
        blur = np.where(unknown, np.minimum(np.abs(drop) / ahead, 1.0 / _STEEPEST) * self._config.height_std, 0.0)
        place = np.where(unknown[:, None], np.column_stack([flat.real, flat.imag]), away)
        return place, blur, np.where(unknown, np.nan, points.position[:, 2])


def _known(std: np.ndarray[tuple[int, ...], np.dtype[np.float32]], default: float, most: float) -> Float64Array:
    value = std.astype(np.float64)
    return np.asarray(np.where(np.isfinite(value) & (value >= 0), np.minimum(value, most), default))
