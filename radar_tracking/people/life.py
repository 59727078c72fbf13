"""Birth of tracks from dense clusters of nobody's points, their confirmation and their deletion (thesis, 6.2.3)."""

from __future__ import annotations

import math

import numpy as np

from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.estimators.base import Estimator
from radar_tracking.people.association import Clusters
from radar_tracking.people.body import measure
from radar_tracking.people.config import LifeConfig, TrackerConfig
from radar_tracking.people.gating import Gating
from radar_tracking.people.pairs import BEFORE
from radar_tracking.people.points import Points
from radar_tracking.people.track_table import TrackTable
from radar_tracking.people.zones import Zones
from radar_tracking.tracks import Deleted, Reason

_DISPERSION = 0.15**2  # m^2: of a new track's main cluster, along each axis of the floor plane


class Birth:
    """Find where new tracks may start, and make their rows."""

    def __init__(self, config: TrackerConfig, estimator: Estimator) -> None:
        self._life, self._filter = config.life, config.filter
        self._estimator = estimator
        self._clusters = Clusters(config.association)
        self._zones = Zones(config.zones)

    def process(self, points: Points, free: BoolArray, gating: Gating | None, old: Float64Array, age: float) -> list[IndexArray]:
        """Find clusters of free points that may start tracks: enough points, enough power, far enough from every track.

        Parameters
        ----------
        points : Points
            Of the cloud.
        free : ndarray of bool, shape (n_points,)
            Points that belong to nobody.
        gating : Gating or None
            Of the same points; None: there is no track.
        old : ndarray of float64, shape (n_tracks, 2)
            Centres of all tracks on the floor plane [m].
        age : float
            Time since the first cloud [s].
        """
        life, index = self._life, np.flatnonzero(free)
        if len(index) < life.birth_points:
            return []
        labels = self._clusters.labels(points, index)
        new: list[Float64Array] = []
        found = []
        for label in range(int(labels.max(initial=-1)) + 1):
            own = index[labels == label]
            if len(own) < life.birth_points or len(old) + len(new) >= life.max_tracks or self._weak(points.power[own]):
                continue
            centre = points.position[own, :2].mean(axis=0)
            apart = gating is None or bool((np.hypot(*(old - centre).T) >= self._least_distance(gating, own)).all())
            apart &= all(math.hypot(*(centre - other)) >= life.birth_together for other in new)
            if apart and self._zones.may_enter(points.position[own].mean(axis=0), age):
                new.append(centre)
                found.append(own)
        return found

    def _least_distance(self, gating: Gating, own: IndexArray) -> Float64Array:
        """Least distance of a new track from each old one, shape (n_tracks,) [m]."""
        life = self._life
        least = np.where(gating.behind[:, own].all(axis=1), life.birth_behind, life.birth_distance)
        before = gating.beyond[:, own].mean(axis=1) < -BEFORE
        return np.asarray(np.where(before, max(life.birth_before, life.birth_distance), least))

    def _weak(self, power: Float64Array) -> bool:
        """Whether points have too little power together to start a track."""
        known = power[np.isfinite(power)]
        return len(known) > 0 and _level(known) < self._life.birth_snr

    def row(self, points: Points, own: IndexArray, track_id: int, stamp_ns: int, *, confirmed: bool) -> TrackTable:
        """Make a table of one new track from its points ``own``; ``confirmed``: it has proved itself within another track."""
        config = self._filter
        group = np.zeros(len(own), np.int64)
        measurement = measure(points, own, group, 1, points.weight[own], np.array([config.surface]), config).measurement
        track = TrackTable(1)
        track.belief = self._estimator.start(measurement, config.initial_speed_std)
        track.id, track.confirmed = track_id, confirmed
        track.born_ns = track.seen_ns = track.stirred_ns = stamp_ns
        track.n_points = track.points_sum = len(own)
        track.clouds = track.matches = 1
        track.birthplace = measurement.position[0, :2]
        track.surface = -config.surface
        track.rate = track.doppler_residual = np.nan_to_num(measurement.rate)
        track.range = np.mean(points.distance[own])
        track.power = _level(points.power[own])
        track.dispersion = np.eye(2) * _DISPERSION
        track.nis = np.nan
        steps = (points.position[own] - measurement.position[0]).T
        track.spread = [np.mean(step[np.isfinite(step)] ** 2) if np.isfinite(step).any() else np.nan for step in steps]
        return track


def _level(power: Float64Array) -> float:
    """Sum signal-to-noise ratios [dB]; unknown ones count nothing."""
    return 10 * math.log10(max(float(np.nansum(power)), 1e-30))


def whole_ns(seconds: float) -> int:
    """Whole nanoseconds: durations are compared as integers, or rounding would decide at what frame a track dies."""
    return round(seconds * 1e9)


class TrackManagement:
    """Confirm and delete tracks; every duration counts by the clouds' stamps."""

    def __init__(self, config: LifeConfig) -> None:
        self.config = config
        self.reset()

    def reset(self) -> None:
        """Forget which tracks were close to each other."""
        self._close_ns: dict[tuple[int, int], int] = {}

    def process(self, table: TrackTable, centre: Float64Array, inside: BoolArray, stamp_ns: int) -> tuple[Deleted, ...]:
        """Confirm and delete tracks after the cloud at ``stamp_ns``; changes the table and returns who is gone, in the order of ids.

        ``centre``, shape (n_tracks, 2) [m], is where they are, ``inside``, shape (n_tracks,), which of them are where the radar sees and
        people can be.
        """
        self._confirm(table, stamp_ns)
        reasons = self._overdue(table, inside, stamp_ns)
        for row in self._doubles(table, centre, reasons, stamp_ns):
            reasons[row] = Reason.DUPLICATE
        gone = np.array([reason is not None for reason in reasons], np.bool_)
        if not gone.any():
            return ()
        rows = zip(table.id.tolist(), reasons, table.confirmed.tolist(), strict=True)
        deleted = tuple(Deleted(number, reason, confirmed) for number, reason, confirmed in rows if reason is not None)
        table.keep(~gone)
        return deleted

    def _confirm(self, table: TrackTable, stamp_ns: int) -> None:
        config = self.config
        wait = np.full(len(table), whole_ns(config.confirm_after))
        if config.reflection_after > config.confirm_after:
            wait[table.reflection_score > 0.5] = whole_ns(config.reflection_after)
        long = stamp_ns - table.born_ns >= wait
        plausible = (table.points_sum >= config.confirm_points * table.clouds) & (table.activity >= config.confirm_activity)
        matched = (table.seen_ns == stamp_ns) & (table.matches >= config.confirm_matches)
        table.confirmed[:] |= long & plausible & matched

    def _overdue(self, table: TrackTable, inside: BoolArray, stamp_ns: int) -> list[Reason | None]:
        """Why each track ends: unseen for too long for what it is; None: it does not."""
        config = self.config
        confirmed, still, unseen = table.confirmed, table.still, stamp_ns - table.seen_ns
        patience = np.full(len(table), whole_ns(config.tentative_after))
        patience[confirmed] = whole_ns(config.delete_after)
        patience[confirmed & still] = whole_ns(max(config.delete_after, config.delete_static_after))
        patience[confirmed & ~inside] = whole_ns(min(config.left_after, config.delete_after))
        late = unseen > patience
        reasons: list[Reason | None] = [None] * len(table)
        for row in np.flatnonzero(late):
            reasons[row] = Reason.NOT_CONFIRMED if not confirmed[row] else Reason.UNSEEN if inside[row] else Reason.LEFT
        idle = confirmed & ~table.walked & (stamp_ns - table.stirred_ns > whole_ns(config.delete_idle_after))
        for row in np.flatnonzero(idle & ~late):
            reasons[row] = Reason.IDLE
        return reasons

    def _doubles(self, table: TrackTable, centre: Float64Array, reasons: list[Reason | None], stamp_ns: int) -> list[int]:
        """Rows of younger tracks that have been on top of older ones for long; tentative ones at once."""
        if len(table) < 2:
            self._close_ns = {}
            return []
        config, ids, confirmed = self.config, table.id, table.confirmed
        step = centre[:, None] - centre[None]
        near = np.hypot(step[..., 0], step[..., 1]) < config.merge_distance
        alive = np.array([reason is None for reason in reasons])
        near &= alive[:, None] & alive[None]
        np.fill_diagonal(near, False)
        if not near.any():
            self._close_ns = {}
            return []
        close: dict[tuple[int, int], int] = {}
        doubled: set[int] = set()
        for old, young in np.argwhere(np.triu(near, 1)):
            pair = (int(ids[old]), int(ids[young]))
            close[pair] = self._close_ns.get(pair, stamp_ns)
            if not (confirmed[old] and confirmed[young]) or stamp_ns - close[pair] > whole_ns(config.merge_after):
                doubled.add(int(young if confirmed[young] <= confirmed[old] else old))
        gone = {int(ids[row]) for row in doubled}
        self._close_ns = {pair: since for pair, since in close.items() if not set(pair) & gone}
        return sorted(doubled)
