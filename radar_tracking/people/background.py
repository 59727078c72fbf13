"""Learned background: still points that belong to no track come from furniture and walls, and are left out."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.people.config import BackgroundConfig
from radar_tracking.people.points import Points

_TURN: Final = 2 * math.pi
_MAX_CELLS: Final = 400  # in range; farther points share the last one
_NEXT: Final = np.array([[-1], [0], [1]])
_STALE: Final = 1e-3  # of a cell's share: levels of cells that are nearly empty start anew


class Background:
    """A map of still echoes for each sensor, on a grid of range and azimuth.

    Every cell knows in which share of the last clouds it held a still point of nobody, and how strong. Still points in cells that are held
    often, and that are not much stronger than usual there, are background. Points of confirmed tracks are never learned, so that
    somebody who came and sat down stays; and what moves within a standing person's track is unlearned, so that people who stood there
    from the beginning appear when they stir.
    """

    def __init__(self, config: BackgroundConfig) -> None:
        self.config = config
        self._n_azimuth = max(round(_TURN / config.azimuth_cell), 4)
        self._share: dict[bytes, Float64Array] = {}  # by the place of the sensor: its number changes when another one falls silent
        self._level: dict[bytes, Float64Array] = {}
        self._last: tuple[Points, IndexArray] | None = None

    def reset(self) -> None:
        """Forget the map."""
        self._share, self._level = {}, {}

    def still(self, points: Points) -> BoolArray:
        """Which points do not move, shape (n_points,); unmeasured range rates count as moving."""
        return np.asarray(np.abs(points.speed) < self.config.still_speed)

    def process(self, points: Points) -> BoolArray:
        """Which points are background, shape (n_points,)."""
        found = np.zeros(len(points), bool)
        if not self.config.enabled:
            return found
        still = self.still(points)
        power = np.fmax(points.power, 0.0)  # what is not measured has none
        ratio = 10 ** (self.config.stronger / 10)
        for place, seen in _places(points).items():
            if place in self._share:
                own = np.flatnonzero(still & seen)
                cell = self._cells(points)[own]
                found[own] = (self._share[place][cell] > self.config.share) & (power[own] <= ratio * self._level[place][cell])
        return found

    def learn(self, points: Points, owned: BoolArray, stirring: BoolArray, dt: float) -> None:
        """Learn from a whole cloud, ``dt`` [s] after the one before, once its points have been given to tracks.

        ``owned`` are points of confirmed tracks, ``stirring`` moving points of those that stand; shape (n_points,) both.
        """
        if not self.config.enabled:
            return
        still = self.still(points) & ~owned
        for place, seen in _places(points).items():
            if place not in self._share:
                n = _MAX_CELLS * self._n_azimuth
                self._share[place], self._level[place] = np.zeros(n), np.zeros(n)
            share, level = self._share[place], self._level[place]
            keep = math.exp(-dt / self.config.learn_time)
            share *= keep
            own = np.flatnonzero(still & seen)
            cell = self._around(self._cells(points)[own])
            share[cell] += 1 - keep  # once where several points lie, and so below: what repeated indices assign does not add up
            level[cell] = np.where(share[cell] < _STALE, 0.0, keep * level[cell])
            np.maximum.at(level, cell, np.tile(np.fmax(points.power[own], 0.0), _NEXT.size**2))
            moving = np.flatnonzero(stirring & seen)
            if len(moving):
                share[self._around(self._cells(points)[moving])] *= math.exp(-dt / self.config.unlearn_time)

    def _cells(self, points: Points) -> IndexArray:
        """Cell of each point; worked out once for the two calls that a cloud makes."""
        if self._last is None or self._last[0] is not points:
            away = points.position[:, :2] - points.origins.take(points.sensor, axis=0)[:, :2]
            column = np.floor((np.arctan2(away[:, 1], away[:, 0]) + math.pi) / self.config.azimuth_cell).astype(np.int64) % self._n_azimuth
            row = np.minimum(points.distance / self.config.range_cell, _MAX_CELLS - 1).astype(np.int64)
            self._last = points, row * self._n_azimuth + column
        return self._last[1]

    def _around(self, cell: IndexArray) -> IndexArray:
        """Cells and their neighbours in range and azimuth, shape (9 n,): estimates scatter across the edges of cells."""
        row, column = np.divmod(cell, self._n_azimuth)
        rows = np.minimum(np.maximum(row + _NEXT, 0), _MAX_CELLS - 1)
        columns = (column + _NEXT) % self._n_azimuth
        return np.asarray(rows[:, None] * self._n_azimuth + columns).ravel()


def _places(points: Points) -> dict[bytes, BoolArray]:
    """Which points were seen from each place; sensors that stand at one place see one background."""
    places: dict[bytes, BoolArray] = {}
    for sensor, origin in enumerate(points.origins):
        place, seen = origin.tobytes(), points.sensor == sensor
        places[place] = places[place] | seen if place in places else seen
    return places
