"""New tracks from heaps of moving points that nobody explains."""

from __future__ import annotations

from typing import Final

import numpy as np

from radar_core.types import Float64Array
from radar_tracking.people.zones import View, Zones
from radar_tracking.poisson.config import PoissonConfig
from radar_tracking.poisson.kernels import Shares, densest
from radar_tracking.poisson.motion import swing_variance
from radar_tracking.poisson.points import Measured
from radar_tracking.poisson.table import N_STATES, RECORD, Table

LEAST_SCORE: Final = 3.0  # nat: a heap that is less of a surprise is chance
FIRST_ODDS: Final = -2.0  # log odds of a new track
MOST_TRACKS: Final = 50
_AT_ONCE: Final = 3  # new tracks of one cloud
_FIRST_HITS: Final = 0.65
_PLACE_STD: Final = 0.15  # m: of a heap's middle, beside the error of its points
_SPEED_STD, _CROSS_SPEED_STD, _LIMB_SPEED_STD = 1.0, 0.9, 0.5  # m/s: of people along and across the line of sight; of what moves first


class Birth:
    """Starts tracks; ids are never used again."""

    def __init__(self, config: PoissonConfig, zones: Zones, view: View) -> None:
        self._config, self._zones, self._view = config, zones, view
        self._next = 1

    def process(self, table: Table, measured: Measured, shares: Shares | None, clutter: Float64Array, now: float) -> None:
        """Add the tracks that a cloud starts, ``now`` [s] after the first cloud."""
        free = np.where(self._zones.excluded(measured.points.position), 0.0, 1.0 if shares is None else 1.0 - shares.torso.sum(axis=1))
        expected = clutter if shares is None else clutter + shares.limb_density
        for _ in range(_AT_ONCE):
            score, middle, members = densest(measured, free, expected)
            if score < LEAST_SCORE or len(table) >= MOST_TRACKS:
                return
            weight = free * members
            count = float(weight.sum())
            self._start(table, measured, middle, weight / count, count, now)
            free = np.where(members, 0.0, free)

    def _start(self, table: Table, measured: Measured, middle: int, weight: Float64Array, count: float, now: float) -> None:
        config, sight = self._config, np.array([measured.ux[middle], measured.uy[middle]])
        place = np.array([weight @ measured.x, weight @ measured.y]) + config.surface * sight
        height = float(np.nan_to_num(measured.points.position[middle, 2], nan=config.body_height))
        if len(table) and float(np.hypot(*(table.mean[:, :2] - place).T).min()) < config.body_width:
            return
        at = np.array([[place[0], place[1], self._view.origin[2]]])
        middle_height = float(weight @ np.nan_to_num(measured.points.position[:, 2], nan=config.body_height))
        if not bool(self._view.sees(at)[0]) or not self._zones.may_enter(np.array([*place, middle_height]), now):
            return
        speed = float(weight @ measured.rate)
        noise = config.torso_speed**2 + _LIMB_SPEED_STD**2 + measured.still_speed**2 / 3.0
        gain = _SPEED_STD**2 / (_SPEED_STD**2 + noise)
        axes = np.array([sight, [-sight[1], sight[0]]])
        covariance = np.zeros((N_STATES, N_STATES))
        along, across = (_PLACE_STD**2 + variance[middle] for variance in (measured.range_variance, measured.cross_variance))
        covariance[:2, :2] = axes.T @ np.diag([along, across]) @ axes
        covariance[2:4, 2:4] = axes.T @ np.diag([_SPEED_STD**2 * (1 - gain), _CROSS_SPEED_STD**2]) @ axes
        offset = np.array([config.position_std**2 + self._view.range_cell**2 / 12.0, config.position_std**2])
        covariance[4:6, 4:6] = axes.T @ np.diag(offset) @ axes
        covariance[6, 6] = swing_variance(self._view.range_cell, config)
        covariance = 0.5 * (covariance + covariance.T)
        row = np.zeros(1, RECORD)
        row["id"], row["odds"], row["rate"], row["hits"], row["stands"] = self._next, FIRST_ODDS, max(count, 1.0), _FIRST_HITS, True
        row["lively"] = 1.0
        for name in ("born", "seen", "counted", "stirred"):
            row[name] = now
        row["birthplace"], row["anchor"], row["haunt"], row["height"] = place, place, place, height
        row["spread"], row["nis"], row["sight"], row["offset"] = np.nan, np.nan, sight, offset
        table.add(row, np.concatenate([place, gain * speed * sight, np.zeros(3)]), covariance)
        self._next += 1
