"""A map of clutter: how many false points a cloud has on a square metre, still and moving ones apart, learned where nobody is."""

from __future__ import annotations

import math
from typing import Any, Final

import numba
import numpy as np

from radar_core.types import Float64Array
from radar_tracking.poisson.config import PoissonConfig
from radar_tracking.poisson.points import Measured

_RANGE_CELL: Final = 0.2  # m
_AZIMUTH_CELL: Final = 0.1  # rad
_REACH: Final = 20.0  # m: farther points fall into the last cells
_LEAST_AREA: Final = 0.02  # m^2: of the cells next to the sensor
_FIRST: Final = 0.5  # s: so long a cell's first clouds count as one
_FREED: Final = 0.3  # what is left of the map about somebody who turns out to be a person
_STILL, _MOVING = 0, 1
_jit = numba.njit(cache=True, nogil=True)


class ClutterMap:
    """Clutter by cells of range and azimuth, for each sensor; nothing is learned near people, so who sits never becomes furniture."""

    def __init__(self, config: PoissonConfig) -> None:
        self._config = config
        n_range, n_azimuth = int(_REACH / _RANGE_CELL), math.ceil(2 * math.pi / _AZIMUTH_CELL)
        distance = (np.arange(n_range) + 0.5) * _RANGE_CELL
        self._area = np.maximum(distance * _RANGE_CELL * _AZIMUTH_CELL, _LEAST_AREA)
        azimuth = (np.arange(n_azimuth) + 0.5) * _AZIMUTH_CELL - math.pi
        self._x, self._y = np.outer(distance, np.cos(azimuth)), np.outer(distance, np.sin(azimuth))
        self._counts: Float64Array = np.zeros((0, 2, n_range, n_azimuth))
        self._age: Float64Array = np.zeros((0, n_range, n_azimuth))

    def density(self, measured: Measured) -> Float64Array:
        """Clutter at each point, of its kind, shape (n_points,) [1/m^2]."""
        self._grow(len(measured.points.origins))
        row, column = self._cells(measured)
        kind = np.where(measured.still, _STILL, _MOVING)
        learned: Float64Array = _smooth(self._counts, self._area, measured.points.sensor, kind, row, column)
        return self._config.clutter_density + learned

    def learn(self, measured: Measured, dt: float, people: Float64Array) -> None:
        """Take in a cloud ``dt`` [s] after the last; ``people``, shape (n, 3), are x, y and the radius about them that is left out [m]."""
        self._grow(len(measured.points.origins))
        row, column = self._cells(measured)
        kind = np.where(measured.still, _STILL, _MOVING)
        for sensor, origin in enumerate(measured.points.origins):
            own = measured.points.sensor == sensor
            near = people - np.array([origin[0], origin[1], 0.0])
            _learn(
                self._counts[sensor], self._age[sensor], self._x, self._y, near, row[own], column[own], kind[own], dt,
                self._config.clutter_time,
            )  # fmt: skip

    def free(self, x: float, y: float, radius: float, origins: Float64Array) -> None:
        """Forget most of what was learned about somebody's place before they moved."""
        for sensor, origin in enumerate(origins):
            near = (self._x - (x - origin[0])) ** 2 + (self._y - (y - origin[1])) ** 2 < radius**2
            self._counts[sensor][:, near] *= _FREED

    def _grow(self, n_sensors: int) -> None:
        more = n_sensors - len(self._counts)
        if more > 0:
            self._counts = np.concatenate([self._counts, np.zeros((more, *self._counts.shape[1:]))])
            self._age = np.concatenate([self._age, np.zeros((more, *self._age.shape[1:]))])

    def _cells(self, measured: Measured) -> tuple[Any, Any]:
        n_range, n_azimuth = self._age.shape[1:]
        row = np.minimum(measured.distance / _RANGE_CELL, n_range - 1).astype(np.int64)
        column = ((measured.azimuth + math.pi) / _AZIMUTH_CELL).astype(np.int64) % n_azimuth
        return row, column


@_jit
def _smooth(counts: Any, area: Any, sensor: Any, kind: Any, row: Any, column: Any) -> Any:
    """Weighted mean of the nine cells about each point, as counts by area [1/m^2]."""
    n_range, n_azimuth = counts.shape[2], counts.shape[3]
    result = np.empty(len(row))
    for j in range(len(row)):
        total, weight = 0.0, 0.0
        for a in range(max(row[j] - 1, 0), min(row[j] + 2, n_range)):
            for b in range(-1, 2):
                w = (2.0 if a == row[j] else 1.0) * (2.0 if b == 0 else 1.0)
                total += w * counts[sensor[j], kind[j], a, (column[j] + b) % n_azimuth]
                weight += w * area[a]
        result[j] = total / weight
    return result


@_jit
def _learn(counts: Any, age: Any, x: Any, y: Any, near: Any, row: Any, column: Any, kind: Any, dt: float, time: float) -> None:
    """Move the mean counts of the cells away from people towards this cloud's: fast at first, then within ``time``."""
    n_range, n_azimuth = age.shape
    fresh = np.zeros(counts.shape)
    for j in range(len(row)):
        fresh[kind[j], row[j], column[j]] += 1.0
    for a in range(n_range):
        for b in range(n_azimuth):
            free = True
            for k in range(len(near)):
                dx, dy = x[a, b] - near[k, 0], y[a, b] - near[k, 1]
                if dx * dx + dy * dy < near[k, 2] * near[k, 2]:
                    free = False
            if not free:
                continue
            age[a, b] += dt
            share = min(dt / min(age[a, b] + _FIRST, time), 1.0)
            counts[0, a, b] += share * (fresh[0, a, b] - counts[0, a, b])
            counts[1, a, b] += share * (fresh[1, a, b] - counts[1, a, b])
