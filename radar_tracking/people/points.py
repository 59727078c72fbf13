"""Input of the trackers: the usable points of a cloud, checked, in float64, with derived quantities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError, PointCloud
from radar_core.composite import CloudComposite
from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.people.config import TrackerConfig
from radar_tracking.people.zones import Zones

_USED = ("x", "y", "z", "radial_speed", "snr", "range", "azimuth_std")  # of a cloud
_FASTEST = 100.0  # m/s: what is faster is no measurement of a person, and filters that multiply it lose their digits


@dataclass(frozen=True, eq=False)
class Points:
    """The usable points of one cloud in ``room``; every array has one entry (row) per usable point.

    Attributes
    ----------
    index : ndarray of int64, shape (n_points,)
        Where they lie in the cloud.
    position : ndarray of float64, shape (n_points, 3)
        [m]; z may be NaN.
    speed : ndarray of float64, shape (n_points,)
        Range rate [m/s]; NaN: not measured.
    weight : ndarray of float64, shape (n_points,)
        Amplitude relative to the cloud's median, within 10 dB of it.
    power : ndarray of float64, shape (n_points,)
        Signal-to-noise power ratio; NaN: not measured.
    distance : ndarray of float64, shape (n_points,)
        From its sensor, on the floor plane [m].
    cross : ndarray of float64, shape (n_points,)
        Standard deviation across the line of sight [m].
    sensor : ndarray of int64, shape (n_points,)
        Row of `origins`: which sensor saw it.
    origins : ndarray of float64, shape (n_sensors, 3)
        Where the sensors stand [m].
    """

    index: IndexArray
    position: Float64Array
    speed: Float64Array
    weight: Float64Array
    power: Float64Array
    distance: Float64Array
    cross: Float64Array
    sensor: IndexArray
    origins: Float64Array

    def select(self, index: NDArray[np.generic]) -> Points:
        """Keep the points that a mask or an index array picks, in its order."""
        per_point = ("index", "position", "speed", "weight", "power", "distance", "cross", "sensor")
        rows = np.flatnonzero(index) if index.dtype == np.bool_ else index
        return Points(**{name: getattr(self, name).take(rows, axis=0) for name in per_point}, origins=self.origins)

    def __len__(self) -> int:
        return len(self.index)

    @property
    def plane(self) -> Float64Array:
        """Positions on the floor plane, shape (n_points, 2) [m]."""
        return self.position[:, :2]


class Admission:
    """Select the points of a cloud that a tracker can use.

    ``origin``, shape (3,) [m], is where the sensor stands, for clouds that do not say it. ``dropped`` counts points without position, or
    absurdly far away.
    """

    def __init__(self, config: TrackerConfig, origin: Float64Array) -> None:
        self._config, self._origin = config, origin
        self._zones = Zones(config.zones)
        self.dropped = 0

    def change(self, config: TrackerConfig) -> None:
        """Go on with another configuration."""
        self._config = config
        self._zones.change(config.zones)

    def process(self, cloud: PointCloud) -> Points:
        """Pick points with a position in bounds that may move; `DataError` where a cloud is not in ``room`` or holds an infinity."""
        if cloud.frame_id != "room":
            raise DataError(f"tracking needs clouds in 'room', this one is in {cloud.frame_id!r}; level it with PointCloud.to_room(mount)")
        if np.isinf(np.concatenate([getattr(cloud, name) for name in _USED])).any():
            name = next(name for name in _USED if np.isinf(getattr(cloud, name)).any())
            raise DataError(f"PointCloud.{name} of cloud {cloud.sequence} holds an infinity; NaN is the mark for what was not measured")
        position = cloud.position.astype(np.float64)
        origins, sensor = sensors_of(cloud, self._origin)
        away = position[:, :2] - origins.take(sensor, axis=0)[:, :2]
        distance = np.hypot(away[:, 0], away[:, 1])
        index = np.flatnonzero(self._usable(cloud, position, distance))
        position, distance = position.take(index, axis=0), distance[index]
        weight, power = _strength(cloud.snr[index].astype(np.float64))
        angle = cloud.azimuth_std[index].astype(np.float64)
        angle = _bound(np.where(np.isfinite(angle), angle, self._config.filter.angle_std), 0.0, 1.0)
        speed = cloud.radial_speed[index].astype(np.float64)
        speed[np.abs(speed) > _FASTEST] = np.nan
        return Points(index, position, speed, weight, power, distance, distance * angle, sensor[index], origins)

    def _usable(self, cloud: PointCloud, position: Float64Array, distance: Float64Array) -> BoolArray:
        config = self._config
        placed = (np.abs(position[:, 0]) <= config.max_distance) & (np.abs(position[:, 1]) <= config.max_distance)  # NaN compares False
        placed &= ~(np.abs(position[:, 2]) > config.max_distance)
        self.dropped += int(np.count_nonzero(~placed))
        placed &= (distance >= config.min_distance) & self._zones.inside(position)
        if config.min_speed > 0:
            placed &= ~(np.abs(cloud.radial_speed) < config.min_speed)
        return np.asarray(placed)


def sensors_of(cloud: PointCloud, origin: Float64Array) -> tuple[Float64Array, IndexArray]:
    """Places of the sensors, shape (n_sensors, 3) [m], and which of them saw each point; ``origin`` where the cloud does not say it."""
    if isinstance(cloud, CloudComposite) and cloud.sources:
        return np.stack([source.mount.origin for source in cloud.sources]), cloud.sensor.astype(np.int64)
    return origin.reshape(1, 3), np.zeros(len(cloud), np.int64)


def _strength(snr: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Weights and power ratios from SNRs [dB]; weights are amplitudes, bounded so that no single point rules."""
    snr = _bound(snr, -100.0, 200.0)
    known = np.isfinite(snr)
    level = _median(snr[known]) if known.any() else 0.0
    weight = 10 ** (_bound(np.where(known, snr, level) - level, -10.0, 10.0) / 20)
    return np.asarray(weight), np.asarray(10 ** (snr / 10))


def _bound(value: Float64Array, low: float, high: float) -> Float64Array:
    """`np.clip`, which costs several times as much for a few hundred numbers, as does `np.median`."""
    return np.asarray(np.minimum(np.maximum(value, low), high))


def _median(value: Float64Array) -> float:
    """Median of finite numbers, one at least."""
    ordered, middle = np.sort(value), len(value) // 2
    return float(ordered[middle] if len(value) % 2 else 0.5 * (ordered[middle - 1] + ordered[middle]))
