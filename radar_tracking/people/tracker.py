"""People tracking: predict, associate, measure, update, manage (thesis, chapter 6 and figure A.23)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError, PointCloud, RadarInfo
from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.estimators.base import Belief, Measurement
from radar_tracking.estimators.make import make_estimator, modes
from radar_tracking.people.association import associate, make_association
from radar_tracking.people.background import Background
from radar_tracking.people.body import measure
from radar_tracking.people.config import TrackerConfig
from radar_tracking.people.gating import Gating, gate_points
from radar_tracking.people.life import Birth, TrackManagement
from radar_tracking.people.pairs import Pairs, separate_tracks
from radar_tracking.people.points import Admission, Points
from radar_tracking.people.track_table import Matched, TorsoPoints, TrackTable, match, update_extents, update_torsos
from radar_tracking.people.zones import View, Zones
from radar_tracking.tracks import Deleted, Track, Tracks, TrackStatus

if TYPE_CHECKING:
    from radar_tracking.people.reflections import Reflections


_NANOSECOND = 1e-9
_EXTENT_TIME = 0.5  # s: the extent of a person is smoothed this long; single clouds show only a part of the body
_TORSO_TIME = 0.15  # s: and the torso's range and range rate this long
_ACTIVITY_TIME = 0.5  # s
_SURFACE = (-0.4, 0.05)  # m: a torso is seen before its centre
_RESIDUAL, _DEAD = 4.0, 0.7  # how much a torso faster than its track (beyond so many m/s) raises the pull
_MOST_IDS = 2**31 - 1  # messages have no place for more; after some years they begin anew
_PLANE = np.arange(2)  # axes of the floor plane

_OTHER: Final = "PeopleTracker is for the thesis's trackers; make_tracker() makes poisson_bernoulli"


class PeopleTracker:
    """Follow people through point clouds.

    Every cloud: predict all tracks, give the points to tracks in the way that ``config.tracker`` names (thesis, 6.2.2), update with the
    weighted centroids, start new tracks from dense clusters of what is left, confirm and delete (6.2.3). Results depend on nothing but the
    clouds, bit for bit.

    Parameters
    ----------
    config : TrackerConfig or None
        Knobs, with ``tracker`` one of the thesis's; None: ``group_clustering``.
    info : RadarInfo or None
        The radar: where it stands and how far it sees. None: at the room's origin, and it sees everything.
    """

    def __init__(self, config: TrackerConfig | None = None, info: RadarInfo | None = None) -> None:
        self.config = config or TrackerConfig(tracker="group_clustering")
        self._view = View(info)
        self._zones = Zones(self.config.zones)
        self._known: tuple[Belief, tuple[Float64Array, Float64Array]] | None = None
        self._use(self.config)
        self._pairs = Pairs(self.config.life)
        self._reflections: Reflections | None = None
        if self.config.life.reflection_after > self.config.life.confirm_after:
            from radar_tracking.people.reflections import Reflections

            self._reflections = Reflections(self.config.life, self.config.zones.walls)
        self._management = TrackManagement(self.config.life)
        self.reset()

    def _use(self, config: TrackerConfig) -> None:
        if config.tracker == "poisson_bernoulli":
            raise ConfigError(_OTHER)
        self.config = config
        self._known = None
        self._estimator = make_estimator(config.filter.estimator, 3)
        self._association = make_association(config)
        self._birth = Birth(config, self._estimator)

    def change(self, config: TrackerConfig) -> None:
        """Go on with another configuration, as far as `check` allows, and keep the tracks; a `ConfigError` changes nothing."""
        self.check(config)
        self._zones.change(config.zones)
        self._admission.change(config)
        self._management.config = config.life
        self._pairs.change(config.life)
        self._use(config)

    def check(self, config: TrackerConfig) -> None:
        """See whether `change` to a configuration keeps the tracks.

        Raises
        ------
        ConfigError
            Saying what would not: the learned background, zones but for ``zones.areas``, ``life.reflection_after``, the other kind of
            tracker, or an estimator whose states are others than those of the tracks.
        """
        if config.tracker == "poisson_bernoulli":
            raise ConfigError(_OTHER)
        same = replace(config, background=self.config.background, poisson=self.config.poisson)
        same = replace(same, zones=replace(self.config.zones, areas=config.zones.areas))
        same = replace(same, life=replace(config.life, reflection_after=self.config.life.reflection_after))
        if same != config:
            raise ConfigError(
                "background, poisson, life.reflection_after, and zones but for zones.areas, cannot change while people are tracked; "
                "make a new PeopleTracker"
            )
        now, then = self.config.filter.estimator, config.filter.estimator
        if modes(now) != modes(then):
            raise ConfigError(
                f"estimator {then.name!r} with {modes(then)} cannot go on with the states of {now.name!r} with {modes(now)}; "
                "choose one with the same motion models"
            )

    def reset(self) -> None:
        """Forget everything; ids start again. For a new recording."""
        self._admission = Admission(self.config, self._view.origin)
        self._management.reset()
        if self._reflections is not None:
            self._reflections.reset()
        self._background = Background(self.config.background)
        self._table = TrackTable()
        self._next_id = 1
        self._stamp_ns: int | None = None
        self._first_ns = 0
        self._known = None

    @property
    def dropped_points(self) -> int:
        """Points without position, or absurdly far away, since the last `reset`."""
        return self._admission.dropped

    def process(self, cloud: PointCloud) -> Tracks:
        """Take in one cloud.

        Parameters
        ----------
        cloud : PointCloud
            In ``room``, not older than the one before. NaN positions are dropped and counted; NaN z is tracked on the floor plane only;
            NaN SNR weighs all points alike; NaN radial speeds cannot prove that something moves, nor that nothing does.

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
        every = self._admission.process(cloud)
        if self._stamp_ns is None:
            self._first_ns = cloud.stamp_ns
        self._stamp_ns = cloud.stamp_ns
        self._predict(dt, cloud.stamp_ns)
        point_track_id = np.full(len(cloud), -1, np.int32)
        points = every.select(~self._background.process(every))
        free, gating, second = self._follow(points, cloud.stamp_ns, point_track_id)
        self._learn(every, dt)
        old = np.zeros((0, 2)) if self._table.belief is None else self._kinematics(self._table.belief)[0][:, :2]
        for own in self._birth.process(points, free, gating, old, (cloud.stamp_ns - self._first_ns) * _NANOSECOND):
            point_track_id[points.index[own]] = self._start(points, own, cloud.stamp_ns)
        for own in second[: max(self.config.life.max_tracks - len(self._table), 0)]:
            point_track_id[points.index[own]] = self._start(points, own, cloud.stamp_ns, confirmed=True)
        deleted = self._manage(every.origins[:, :2], cloud.stamp_ns)
        if deleted:
            point_track_id[np.isin(point_track_id, [track.id for track in deleted])] = -1
        published = self._publish(cloud.stamp_ns)
        return Tracks(cloud.stamp_ns, cloud.sequence, cloud.frame_id, published, point_track_id, deleted, cloud.every)

    def _kinematics(self, belief: Belief) -> tuple[Float64Array, Float64Array]:
        """Position and velocity of all tracks, and their covariance; worked out once for each belief, not to be written to."""
        if self._known is None or self._known[0] is not belief:
            self._known = belief, self._estimator.kinematics(belief)
        return self._known[1]

    def _elapsed(self, cloud: PointCloud) -> float:
        """Check the cloud's stamp; return the seconds since the one before."""
        before = self._stamp_ns
        if before is None:
            return 0.0
        if cloud.stamp_ns < before:
            raise DataError(
                f"cloud {cloud.sequence} is {(before - cloud.stamp_ns) * _NANOSECOND:g} s older than the one before; reset() the tracker "
                "before another recording"
            )
        return (cloud.stamp_ns - before) * _NANOSECOND

    def _predict(self, dt: float, stamp_ns: int) -> None:
        """Predict all tracks (6.1); unseen ones slow down."""
        table = self._table
        table.nis, table.dof, table.n_points = np.nan, 0, 0
        table.clouds += 1
        if table.belief is None or len(table) == 0 or dt == 0:
            return
        # beyond the longest life nothing survives, and bounded steps keep the covariance far from overflow
        life = self.config.life
        step = min(dt, 1.0 + max(life.delete_after, life.delete_static_after))
        belief = self._estimator.predict(table.belief, step)
        unseen = (stamp_ns - table.seen_ns) * _NANOSECOND > dt
        if unseen.any():
            mean = belief.mean.copy()
            mean[unseen, :, self._estimator.dimensions :] *= math.exp(-step / self.config.filter.damping)
            belief = Belief(mean, belief.covariance, belief.weight)
        table.belief = separate_tracks(
            belief, self._kinematics(belief), table.confirmed, self.config.association.body_width, self._estimator.dimensions
        )

    def _follow(
        self, points: Points, stamp_ns: int, point_track_id: NDArray[np.int32]
    ) -> tuple[BoolArray, Gating | None, list[IndexArray]]:
        """Give points to tracks and update those that got some.

        Gives which points are nobody's; where they lie beside the tracks, None: there is no track; the points of second people in tracks.
        """
        table, everybody = self._table, np.ones(len(points), bool)
        if table.belief is None or len(table) == 0 or len(points) == 0:
            return everybody, None, []
        kinematics = self._kinematics(table.belief)
        gating = gate_points(table, kinematics, points, self.config.association)
        owners = associate(self._association, points, gating, table.confirmed, self.config.life.birth_together)
        matched = match(owners.main, len(table))
        second: list[IndexArray] = []
        if self.config.life.pair_distance > 0:
            beside = (owners.main < 0) & ~gating.behind.any(axis=0)  # who is behind somebody starts a track of their own
            matched, second = self._pairs.process(table, points, matched, kinematics[0][:, :2], beside, stamp_ns)
        whole = owners.limb.copy()
        whole[matched.own] = matched.row
        owned = np.flatnonzero(whole >= 0)
        table.n_points = np.bincount(whole[owned], minlength=len(table))
        table.points_sum += table.n_points
        point_track_id[points.index[owned]] = table.id[whole[owned]]
        if len(matched.own):
            self._update(points, gating, matched, kinematics, stamp_ns)
            self._update_extents(points, owned, whole[owned], stamp_ns)
            table.seen_ns[matched.rows] = stamp_ns
        return owners.free, gating, second

    def _update(self, points: Points, gating: Gating, matched: Matched, before: tuple[Float64Array, Float64Array], stamp_ns: int) -> None:
        """Update tracks with their points; the farther all points lie from the prediction, the less they are believed."""
        table, config = self._table, self.config.filter
        rows, own, group = matched.rows, matched.own, matched.group
        trust = gating.near[matched.row, own] * gating.torso[matched.row, own]
        weight = points.weight[own] * trust
        speed = np.hypot(before[0][rows, 3], before[0][rows, 4])
        bodies = measure(points, own, group, len(rows), weight, self._offset(speed), config)
        best = np.zeros(len(rows))
        np.maximum.at(best, group, trust)
        dt = np.asarray((stamp_ns - table.seen_ns[rows]) * _NANOSECOND, np.float64)
        measurement = self._believe(bodies.measurement, best, before, rows, speed, dt)
        assert table.belief is not None
        belief, innovation = self._estimator.update(table.belief.select(rows), measurement)
        table.belief = table.belief.put(rows, belief)
        table.nis[rows], table.dof[rows] = innovation.nis, innovation.dof
        table.matches[rows] += 1
        beyond, residual = (matrix[matched.row, own] for matrix in (gating.beyond, gating.doppler_residual))
        torsos = TorsoPoints(weight, beyond, residual, points.speed[own], points.distance[own], points.power[own])
        keep = np.exp(-dt / _TORSO_TIME), np.exp(-dt / _ACTIVITY_TIME)
        update_torsos(table.records, rows, group, torsos, *keep, self.config.life.confirm_speed, *_SURFACE)

    def _offset(self, speed: Float64Array) -> Float64Array:
        """How far bodies lie behind their visible surface [m], by their speeds [m/s]."""
        config = self.config.filter
        return np.asarray(config.surface + (config.surface_walking - config.surface) * np.minimum(speed, 1.0))

    def _believe(
        self,
        measurement: Measurement,
        best: Float64Array,
        before: tuple[Float64Array, Float64Array],
        rows: IndexArray,
        speed: Float64Array,
        dt: Float64Array,
    ) -> Measurement:
        """Raise the variances of measurements without a torso point, and of those that pull a body faster than bodies start.

        An arm's points are wrong together for half a second, not each for itself.
        """
        covariance = measurement.covariance.copy()
        variance = covariance[:, _PLANE, _PLANE] / np.maximum(best, 1e-12)[:, None]
        residual = np.abs(self._table.doppler_residual[rows])  # large when a person starts or stops walking
        fastest = self.config.filter.pull * (1.0 + speed + _RESIDUAL * np.maximum(residual - _DEAD, 0.0)) * np.maximum(dt, 1e-3)
        step = measurement.position[:, :2] - before[0][rows, :2]
        pull = np.hypot(step[:, 0], step[:, 1]) / fastest
        known = before[1][rows][:, _PLANE, _PLANE]
        variance = np.maximum(variance, known * (pull - 1.0)[:, None])
        covariance[:, _PLANE, _PLANE] = variance
        return Measurement(measurement.position, covariance, measurement.rate, measurement.rate_variance, measurement.origin)

    def _update_extents(self, points: Points, owned: IndexArray, row: IndexArray, stamp_ns: int) -> None:
        """Smooth the extents of the tracks; called before `seen_ns` moves on."""
        table = self._table
        assert table.belief is not None
        step = points.position.take(owned, axis=0) - self._kinematics(table.belief)[0][:, :3].take(row, axis=0)
        update_extents(table.records, row, step, np.exp(-(stamp_ns - table.seen_ns) * _NANOSECOND / _EXTENT_TIME))

    def _learn(self, points: Points, dt: float) -> None:
        """Learn the background where nobody is."""
        table, config = self._table, self.config.background
        rows = np.flatnonzero(table.confirmed)
        body: BoolArray = np.zeros(len(points), bool)
        standing = body
        if table.belief is not None and len(rows):
            centre = self._kinematics(table.belief)[0][rows]
            step_x, step_y = points.position[:, 0] - centre[:, :1], points.position[:, 1] - centre[:, 1:2]
            near = step_x * step_x + step_y * step_y < config.body**2
            body, standing = np.asarray(near.any(axis=0)), np.asarray(near[table.still[rows]].any(axis=0))
        self._background.learn(points, body, standing & ~self._background.still(points), dt)

    def _start(self, points: Points, own: IndexArray, stamp_ns: int, *, confirmed: bool = False) -> int:
        """Start a track from its points; returns its id."""
        own_id = self._next_id
        self._table.add(self._birth.row(points, own, own_id, stamp_ns, confirmed=confirmed))
        self._next_id = own_id % _MOST_IDS + 1
        return own_id

    def _manage(self, origins: Float64Array, stamp_ns: int) -> tuple[Deleted, ...]:
        """Confirm and delete; ``origins`` [m], shape (n_sensors, 2), are where the sensors stand."""
        table = self._table
        if table.belief is None or len(table) == 0:
            return ()
        mean = self._kinematics(table.belief)[0]
        seen = table.seen_ns == stamp_ns
        table.still[seen] = np.hypot(mean[seen, 3], mean[seen, 4]) < self.config.life.static_speed
        away = mean[:, :2] - table.birthplace
        table.walked |= np.hypot(away[:, 0], away[:, 1]) >= self.config.life.walk_distance
        table.stirred_ns[table.activity >= self.config.life.confirm_activity] = stamp_ns
        if self._reflections is not None:
            self._reflections.process(table, mean[:, :2], origins, stamp_ns)
        inside = self._view.sees(mean[:, :3]) & self._zones.inside(mean[:, :3])
        return self._management.process(table, mean[:, :2], inside, stamp_ns)

    def _publish(self, stamp_ns: int) -> tuple[Track, ...]:
        """Make the frozen results."""
        table = self._table
        if table.belief is None or len(table) == 0:
            return ()
        mean, covariance = self._kinematics(table.belief)
        # columns as plain numbers: one by one they cost several times as much
        columns = (table.id, table.confirmed, table.n_points, table.nis, table.dof)
        number, confirmed, n_points, nis, dof = (column.tolist() for column in columns)
        age, unseen = (((stamp_ns - column) * _NANOSECOND).tolist() for column in (table.born_ns, table.seen_ns))
        position, velocity, covariance, extent = mean[:, :3].copy(), mean[:, 3:].copy(), covariance.copy(), np.sqrt(table.spread)
        status = map(_status, confirmed, unseen)
        rows = zip(number, status, age, unseen, n_points, position, velocity, extent, covariance, nis, dof, strict=True)
        return tuple(Track(*row) for row in rows)


def _status(confirmed: bool, unseen: float) -> TrackStatus:
    return TrackStatus.TENTATIVE if not confirmed else TrackStatus.COASTING if unseen > 0 else TrackStatus.CONFIRMED
