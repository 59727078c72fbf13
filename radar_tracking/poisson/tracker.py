"""The Poisson multi-Bernoulli people tracker: predict, divide the points, update, start tracks, decide, learn clutter."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from radar_core import ConfigError, DataError, PointCloud, RadarInfo
from radar_core.types import Float64Array
from radar_tracking.people.config import TrackerConfig
from radar_tracking.people.points import Admission
from radar_tracking.people.zones import View, Zones
from radar_tracking.poisson import motion
from radar_tracking.poisson.birth import Birth
from radar_tracking.poisson.clutter import ClutterMap
from radar_tracking.poisson.existence import CONFIRM_ODDS, Decisions, bodies, note_motion, weigh
from radar_tracking.poisson.kernels import Shares, TrackArrays
from radar_tracking.poisson.person import note_look
from radar_tracking.poisson.points import Measure, Measured
from radar_tracking.poisson.sums import owners_of, scatter
from radar_tracking.poisson.table import Table
from radar_tracking.tracks import Deleted, Track, Tracks, TrackStatus

_OWNED: Final = 0.3  # least share of a point that makes it somebody's
_UNTOUCHED: Final = (0.6, 2.0)  # m and standard deviations about people in which no clutter is learned
_FREED: Final = 0.5  # m about somebody who is new, where what was learned is forgotten
_SHAPE_TIME: Final = 0.5  # s: heights and extents are averaged over this
_STATUS: Final = tuple(TrackStatus)
_PLANE: Final = np.array([0, 1, 3, 4])  # of (x, y, z, vx, vy, vz): x, y, vx, vy
_HEIGHT_STD, _CLIMB_STD = 0.2, 0.3  # m, m/s: of what is no state of the filter
_MOST_PERSON: Final = 30.0  # log odds of being a person, either way: beyond, a probability is 0 or 1


class PoissonTracker:
    """Follow people through point clouds of any radar, with one configuration.

    Points are a Poisson process: clutter, which a map learns, and for each track a torso and limbs at a rate of its own. Each track has
    log odds of existence, which every cloud changes by its likelihood ratio with and without the track (a multi-Bernoulli filter with
    marginal association), and log odds of being a person and not somebody's reflection.

    Parameters
    ----------
    config : TrackerConfig or None
        ``poisson``, ``zones`` and the bounds on points are used.
    info : RadarInfo or None
        The radar: where it stands and how far it sees. None: at the room's origin, and it sees everything.
    """

    def __init__(self, config: TrackerConfig | None = None, info: RadarInfo | None = None) -> None:
        self.config = config or TrackerConfig()
        self._view, self._zones = View(info), Zones(self.config.zones)
        self._decisions = Decisions(self.config.poisson, self._view, self._zones)
        self.reset()

    def change(self, config: TrackerConfig) -> None:
        """Go on with other ``zones.areas`` and keep the tracks; ConfigError when anything else differs, see `check`."""
        self.check(config)
        self.config = config
        self._zones.change(config.zones)
        self._admission.change(config)

    def check(self, config: TrackerConfig) -> None:
        """Raise `ConfigError` when a configuration differs in more than ``zones.areas`` and what is of other trackers."""
        old = self.config
        others = {name: getattr(old, name) for name in ("association", "filter", "life", "background")}
        if replace(config, zones=replace(config.zones, areas=old.zones.areas), **others) != old:
            raise ConfigError("but for zones.areas the tracker poisson_bernoulli cannot change while people are tracked; make a new one")

    def reset(self) -> None:
        """Forget everything; ids start again. For a new recording."""
        knobs = self.config.poisson
        self._admission = Admission(self.config, self._view.origin)
        self._measure = Measure(self.config, self._admission, self._view)
        self._clutter = ClutterMap(knobs)
        self._birth = Birth(knobs, self._zones, self._view)
        self._table = Table()
        self._first_ns: int | None = None
        self._last_ns = 0

    @property
    def dropped_points(self) -> int:
        """Points without position, or absurdly far away, since the last `reset`."""
        return self._admission.dropped

    @property
    def table(self) -> Table:
        """The tracks with all that is known of them, for studies."""
        return self._table

    def process(self, cloud: PointCloud) -> Tracks:
        """Take in one cloud.

        Parameters
        ----------
        cloud : PointCloud
            In ``room``, not older than the one before. NaN positions are dropped and counted; NaN radial speeds are not used.

        Returns
        -------
        Tracks
            After this cloud.

        Raises
        ------
        DataError
            When the cloud is not in ``room``, is older than the one before, or holds an infinity.
        """
        dt = self._elapsed(cloud)
        measured = self._measure.process(cloud)
        self._first_ns = cloud.stamp_ns if self._first_ns is None else self._first_ns
        self._last_ns = cloud.stamp_ns
        now = (cloud.stamp_ns - self._first_ns) * 1e-9
        table, knobs = self._table, self.config.poisson
        motion.predict(table, dt, now - table.rows["seen"] > 1.5 * dt, self._view.range_cell, knobs)
        motion.separate(table, knobs.body_width)
        clutter = self._clutter.density(measured)
        shares = self._follow(measured, clutter, dt, now) if len(table) else None
        owners = np.where(table.rows["arm_of"] != 0, table.rows["arm_of"], table.rows["id"])
        self._birth.process(table, measured, shares, clutter, now)
        deleted, confirmed = self._decisions.process(table, dt, now)
        for row in confirmed:
            x, y = table.mean[row, :2]
            self._clutter.free(float(x), float(y), _FREED, measured.points.origins)
        self._clutter.learn(measured, dt, self._people())
        return self._publish(cloud, measured, shares, owners, deleted, now)

    def _elapsed(self, cloud: PointCloud) -> float:
        """Check the cloud's stamp; return the seconds since the one before."""
        if self._first_ns is None:
            return 0.0
        dt = (cloud.stamp_ns - self._last_ns) * 1e-9
        if dt < 0:
            raise DataError(f"cloud {cloud.sequence} is {-dt:g} s older than the one before; reset() the tracker before another recording")
        return dt

    def _follow(self, measured: Measured, clutter: Float64Array, dt: float, now: float) -> Shares:
        table, knobs = self._table, self.config.poisson
        state = TrackArrays(*table.apparent(), table.rows["rate"].copy(), table.existence, bodies(table))
        shares = Shares(measured, clutter, state, knobs)
        weigh(table, shares, dt, now, knobs, self._view)
        motion.note_surge(table, shares, dt)
        update = motion.Update(table, measured, shares, knobs)
        note_motion(table, update, measured, dt, now, knobs)
        note_look(table, shares, measured.still_speed, dt, self._view.origin, CONFIRM_ODDS, knobs.body_height)
        self._shape(measured, shares, dt)
        return shares

    def _shape(self, measured: Measured, shares: Shares, dt: float) -> None:
        """Average heights and extents."""
        sums = shares.sums
        seen = np.flatnonzero(sums["torso"] > 1.0)
        if not len(seen):
            return
        rows, share = self._table.rows, 1.0 - math.exp(-dt / _SHAPE_TIME)
        total, middle, usual = sums["torso_placed"][seen], sums["torso_z"][seen], rows["height"][seen]
        usual = usual + np.where(total > 0, share * (middle / np.maximum(total, 1e-9) - usual), 0.0)
        rows["height"][seen] = usual
        centre = np.column_stack([self._table.mean[seen, :2], usual])
        square = scatter(measured.x, measured.y, measured.points.position[:, 2], shares.whole, seen, centre)
        before = rows["spread"][seen]
        rows["spread"][seen] = np.where(np.isfinite(before), before + share * (square - before), square)

    def _people(self) -> Float64Array:
        """Places of people and how far from them no clutter is learned, shape (n, 3) [m]."""
        table = self._table
        own = table.rows["confirmed"]
        std = np.sqrt(np.maximum(table.covariance[own, 0, 0], table.covariance[own, 1, 1]))
        return np.column_stack([table.mean[own, :2], _UNTOUCHED[0] + _UNTOUCHED[1] * std])

    def _publish(
        self, cloud: PointCloud, measured: Measured, shares: Shares | None, owners: np.ndarray[tuple[int], np.dtype[np.int64]],
        deleted: tuple[Deleted, ...], now: float,
    ) -> Tracks:  # fmt: skip
        """Make the frozen results."""
        point_track_id = np.full(len(cloud), -1, np.int32)
        if shares is not None:
            point_track_id[measured.points.index] = owners_of(shares.whole, owners, self._table.rows["id"].copy(), _OWNED)
        tracks = self._tracks(now, point_track_id)
        return Tracks(cloud.stamp_ns, cloud.sequence, cloud.frame_id, tracks, point_track_id, deleted, cloud.every)

    def _tracks(self, now: float, owners: np.ndarray[tuple[int], np.dtype[np.int32]]) -> tuple[Track, ...]:
        rows, mean, n = self._table.rows, self._table.mean, len(self._table)
        covariance = np.zeros((n, 6, 6))
        covariance[:, _PLANE[:, None], _PLANE] = self._table.covariance[:, :4, :4]
        covariance[:, 2, 2], covariance[:, 5, 5] = _HEIGHT_STD**2, _CLIMB_STD**2
        place, velocity = np.column_stack([mean[:, :2], rows["height"]]), np.column_stack([mean[:, 2:4], np.zeros(n)])
        unseen = now - rows["seen"]
        status = np.where(~rows["confirmed"], TrackStatus.TENTATIVE, np.where(unseen > 0, TrackStatus.COASTING, TrackStatus.CONFIRMED))
        n_points = (owners == rows["id"][:, None]).sum(axis=1)
        numbers = (column.tolist() for column in (rows["id"], status, now - rows["born"], unseen, n_points))
        others = (column.tolist() for column in (rows["nis"], rows["dof"], _probability(rows["person"])))
        return tuple(
            Track(number, _STATUS[state], *more)
            for number, state, *more in zip(*numbers, place, velocity, np.sqrt(rows["spread"]), covariance, *others, strict=True)
        )


def _probability(log_odds: Float64Array) -> Float64Array:
    """Of log odds; never 0 or 1, which no evidence allows."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.minimum(np.maximum(log_odds, -_MOST_PERSON), _MOST_PERSON))))
