"""People tracking: predict, associate, measure, update, manage (thesis, chapter 6 and figure A.23)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError, PointCloud, RadarInfo
from radar_tracking.estimators import make_estimator
from radar_tracking.estimators.base import Belief, Measurement
from radar_tracking.estimators.make import modes
from radar_tracking.people.association import Clusters, associate, make_association
from radar_tracking.people.background import Background
from radar_tracking.people.body import measure
from radar_tracking.people.config import TrackerConfig
from radar_tracking.people.gating import Sight, look
from radar_tracking.people.life import TrackManagement
from radar_tracking.people.pairs import BEFORE, Pairs
from radar_tracking.people.points import Admission, Points
from radar_tracking.people.reflections import Reflections
from radar_tracking.people.solid import part
from radar_tracking.people.statistics import Matched, match, note_extent, note_torso, torsos
from radar_tracking.people.track_table import RECORD, Roster
from radar_tracking.people.view import View
from radar_tracking.people.zones import Zones
from radar_tracking.tracks import Deleted, Track, Tracks, TrackStatus

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]

_NANOSECOND = 1e-9
_EXTENT_TIME = 0.5  # s: the extent of a person is smoothed this long; single clouds show only a part of the body
_TORSO_TIME = 0.15  # s: and the torso's range and range rate this long
_ACTIVITY_TIME = 0.5  # s
_SURFACE = (-0.4, 0.05)  # m: a torso is seen before its centre
_SLIP, _DEAD = 4.0, 0.7  # how much a torso faster than its track (beyond so many m/s) raises the pull
_PLANE = np.arange(2)  # axes of the floor plane
_DISPERSION = 0.15**2  # m^2: of a body of which nothing is known yet, along each axis of the floor plane


class PeopleTracker:
    """Follow people through point clouds.

    Every cloud: predict all tracks, give the points to tracks in the way that ``config.tracker`` names (thesis, 6.2.2), update with the
    weighted centroids, start new tracks from dense clusters of what is left, confirm and delete (6.2.3). Results depend on nothing but the
    clouds, bit for bit.

    Parameters
    ----------
    config : TrackerConfig
        Knobs.
    info : RadarInfo or None
        The radar: where it stands and how far it sees. None: at the room's origin, and it sees everything.

    Attributes
    ----------
    dropped_points : int
        Points without position, or absurdly far away, since the last `reset`.
    """

    def __init__(self, config: TrackerConfig | None = None, info: RadarInfo | None = None) -> None:
        self.config = config if config is not None else TrackerConfig()
        self._view = View(info)
        self._zones = Zones(self.config.zones)
        self._known: tuple[Belief, tuple[Float64Array, Float64Array]] | None = None
        self._use(self.config)
        self._pairs = Pairs(self.config.life)
        self._reflections = Reflections(self.config.life, self.config.zones.walls)
        self._management = TrackManagement(self.config.life)
        self.reset()

    def _use(self, config: TrackerConfig) -> None:
        self.config = config
        self._known = None
        self._estimator = make_estimator(config.filter.estimator, 3)
        self._association = make_association(config)
        self._clusters = Clusters(config.association)

    def change(self, config: TrackerConfig) -> None:
        """Work on with another tracker, association or estimator, and with the tracks that there are.

        Parameters
        ----------
        config : TrackerConfig
            Differs from the present one in ``tracker``, ``association`` and ``filter`` only.

        Raises
        ------
        ConfigError
            When something else differs, or the other estimator's states are others than those of the tracks; nothing is changed then.
        """
        same = replace(config, tracker=self.config.tracker, association=self.config.association, filter=self.config.filter)
        if same != self.config:
            raise ConfigError("only tracker, association and filter can be changed while people are tracked; make a new PeopleTracker")
        now, then = self.config.filter.estimator, config.filter.estimator
        if modes(now) != modes(then):
            raise ConfigError(
                f"estimator {then.name!r} with {modes(then)} cannot go on with the states of {now.name!r} with {modes(now)}; "
                "choose one with the same motion models"
            )
        self._use(config)

    def reset(self) -> None:
        """Forget everything; ids start again. For a new recording."""
        self._admission = Admission(self.config, self._view.origin)
        self._management.reset()
        self._reflections.reset()
        self._background = Background(self.config.background)
        self._roster = Roster()
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
        free, sight, second = self._follow(points, cloud.stamp_ns, point_track_id)
        self._learn(every, dt)
        for own in self._births(points, free, sight, cloud.stamp_ns):
            point_track_id[points.index[own]] = self._start(points, own, cloud.stamp_ns)
        for own in second[: max(self.config.life.max_tracks - len(self._roster), 0)]:
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
        """Move all tracks on (6.1); those that nobody sees slow down."""
        roster = self._roster
        for name, value in (("nis", np.nan), ("dof", 0), ("n_points", 0)):
            roster[name][:] = value
        roster["clouds"][:] += 1
        if roster.belief is None or len(roster) == 0 or dt == 0:
            return
        # beyond the longest life nothing survives, and bounded steps keep the covariance far from overflow
        life = self.config.life
        step = min(dt, 1.0 + max(life.delete_after, life.delete_static_after))
        belief = self._estimator.predict(roster.belief, step)
        unseen = (stamp_ns - roster["seen_ns"]) * _NANOSECOND > dt
        if unseen.any():
            mean = belief.mean.copy()
            mean[unseen, :, self._estimator.dimensions :] *= math.exp(-step / self.config.filter.damping)
            belief = Belief(mean, belief.covariance, belief.weight)
        roster.belief = part(
            belief, self._kinematics(belief), roster["confirmed"], self.config.association.body_width, self._estimator.dimensions
        )

    def _follow(
        self, points: Points, stamp_ns: int, point_track_id: NDArray[np.int32]
    ) -> tuple[NDArray[np.bool_], Sight | None, list[IndexArray]]:
        """Give points to tracks and update those that got some.

        Returns
        -------
        tuple
            Which points are nobody's; where they lie beside the tracks, None: there is no track; the points of second people in tracks.
        """
        roster, everybody = self._roster, np.ones(len(points), bool)
        if roster.belief is None or len(roster) == 0 or len(points) == 0:
            return everybody, None, []
        kinematics = self._kinematics(roster.belief)
        sight = look(roster, kinematics, points, self.config.association)
        owners = associate(self._association, points, sight, roster["confirmed"], self.config.life.birth_together)
        matched = match(owners.main, len(roster))
        second: list[IndexArray] = []
        if self.config.life.pair_distance > 0:
            beside = (owners.main < 0) & ~sight.behind.any(axis=0)  # who is behind somebody starts a track of their own
            matched, second = self._pairs.process(roster, points, matched, kinematics[0][:, :2], beside, stamp_ns)
        whole = owners.limb.copy()
        whole[matched.own] = matched.row
        owned = np.flatnonzero(whole >= 0)
        roster["n_points"][:] = np.bincount(whole[owned], minlength=len(roster))
        roster["points_sum"][:] += roster["n_points"]
        point_track_id[points.index[owned]] = roster["id"][whole[owned]]
        if len(matched.own):
            self._update(points, sight, matched, kinematics, stamp_ns)
            self._note_extent(points, owned, whole[owned], stamp_ns)
            roster["seen_ns"][matched.rows] = stamp_ns
        return owners.free, sight, second

    def _update(self, points: Points, sight: Sight, matched: Matched, before: tuple[Float64Array, Float64Array], stamp_ns: int) -> None:
        """Update tracks with their points; the farther all points lie from the prediction, the less they are believed."""
        roster, config = self._roster, self.config.filter
        rows, own, group = matched.rows, matched.own, matched.group
        trust = sight.near[matched.row, own] * sight.torso[matched.row, own]
        weight = points.weight[own] * trust
        speed = np.hypot(before[0][rows, 3], before[0][rows, 4])
        bodies = measure(points, own, group, len(rows), weight, self._offset(speed), config)
        best = np.zeros(len(rows))
        np.maximum.at(best, group, trust)
        dt = (stamp_ns - roster["seen_ns"][rows]) * _NANOSECOND
        measurement = self._believe(bodies.measurement, best, before, rows, speed, dt)
        assert roster.belief is not None
        belief, innovation = self._estimator.update(roster.belief.select(rows), measurement)
        roster.belief = roster.belief.put(rows, belief)
        roster["nis"][rows], roster["dof"][rows] = innovation.nis, innovation.dof
        roster["matches"][rows] += 1
        seen, fast = torsos(points, sight, matched, weight), self.config.life.confirm_speed
        note_torso(roster.records, matched, seen, np.exp(-dt / _TORSO_TIME), np.exp(-dt / _ACTIVITY_TIME), fast, _SURFACE)

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
        slip = np.abs(self._roster["slip"][rows])  # who sets off, or comes to a stop
        fastest = self.config.filter.pull * (1.0 + speed + _SLIP * np.maximum(slip - _DEAD, 0.0)) * np.maximum(dt, 1e-3)
        step = measurement.position[:, :2] - before[0][rows, :2]
        pull = np.hypot(step[:, 0], step[:, 1]) / fastest
        known = before[1][rows][:, _PLANE, _PLANE]
        variance = np.maximum(variance, known * (pull - 1.0)[:, None])
        covariance[:, _PLANE, _PLANE] = variance
        return Measurement(measurement.position, covariance, measurement.rate, measurement.rate_variance, measurement.origin)

    def _note_extent(self, points: Points, owned: IndexArray, row: IndexArray, stamp_ns: int) -> None:
        """Remember how large the tracks are, smoothed; called before `seen_ns` moves on."""
        roster = self._roster
        assert roster.belief is not None
        step = points.position.take(owned, axis=0) - self._kinematics(roster.belief)[0][:, :3].take(row, axis=0)
        note_extent(roster.records, row, step, np.exp(-(stamp_ns - roster["seen_ns"]) * _NANOSECOND / _EXTENT_TIME))

    def _learn(self, points: Points, dt: float) -> None:
        """Learn what stands where nobody is."""
        roster, config = self._roster, self.config.background
        rows = np.flatnonzero(roster["confirmed"])
        body: NDArray[np.bool_] = np.zeros(len(points), bool)
        standing = body
        if roster.belief is not None and len(rows):
            centre = self._kinematics(roster.belief)[0][rows]
            step_x, step_y = points.position[:, 0] - centre[:, :1], points.position[:, 1] - centre[:, 1:2]
            near = step_x * step_x + step_y * step_y < config.body**2
            body, standing = np.asarray(near.any(axis=0)), np.asarray(near[roster["still"][rows]].any(axis=0))
        self._background.learn(points, body, standing & ~self._background.still(points), dt)

    def _births(self, points: Points, free: NDArray[np.bool_], sight: Sight | None, stamp_ns: int) -> list[IndexArray]:
        """Clusters of free points that may start tracks: enough points, enough power, far enough from every track."""
        life = self.config.life
        index = np.flatnonzero(free)
        if len(index) < life.birth_points:
            return []
        labels = self._clusters.labels(points, index)
        belief = self._roster.belief
        old = np.zeros((0, 2)) if belief is None else self._kinematics(belief)[0][:, :2]
        new: list[Float64Array] = []
        age = (stamp_ns - self._first_ns) * _NANOSECOND
        found = []
        for label in range(int(labels.max(initial=-1)) + 1):
            own = index[labels == label]
            if len(own) < life.birth_points or len(old) + len(new) >= life.max_tracks or self._weak(points.power[own]):
                continue
            centre = points.position[own, :2].mean(axis=0)
            apart = sight is None or bool((np.hypot(*(old - centre).T) >= self._least_distance(sight, own)).all())
            apart &= all(math.hypot(*(centre - other)) >= life.birth_together for other in new)
            if apart and self._zones.may_enter(centre, age):
                new.append(centre)
                found.append(own)
        return found

    def _least_distance(self, sight: Sight, own: IndexArray) -> Float64Array:
        """How far a new track has to be from each old one, shape (n_tracks,) [m]."""
        life = self.config.life
        least = np.where(sight.behind[:, own].all(axis=1), life.birth_behind, life.birth_distance)
        before = sight.beyond[:, own].mean(axis=1) < -BEFORE
        return np.asarray(np.where(before, max(life.birth_before, life.birth_distance), least))

    def _weak(self, power: Float64Array) -> bool:
        """Whether points have too little power together to start a track."""
        known = np.isfinite(power)
        return bool(known.any()) and 10 * math.log10(max(float(power[known].sum()), 1e-30)) < self.config.life.birth_snr

    def _start(self, points: Points, own: IndexArray, stamp_ns: int, *, confirmed: bool = False) -> int:
        """Start a track from a cluster, tentative unless it has proved itself within another; returns its id."""
        config = self.config.filter
        group = np.zeros(len(own), np.int64)
        bodies = measure(points, own, group, 1, points.weight[own], np.array([config.surface]), config)
        belief = self._estimator.start(bodies.measurement, config.initial_speed_std)
        record = np.zeros(1, RECORD)
        rate = bodies.measurement.rate[0]
        notes = {
            "id": self._next_id,
            "born_ns": stamp_ns,
            "seen_ns": stamp_ns,
            "n_points": len(own),
            "points_sum": len(own),
            "clouds": 1,
            "matches": 1,
            "birthplace": bodies.measurement.position[0, :2],
            "stirred_ns": stamp_ns,
            "confirmed": confirmed,
            "surface": -config.surface,
            "slip": rate if math.isfinite(rate) else 0.0,
            "dispersion": np.eye(2) * _DISPERSION,
            "nis": np.nan,
            "range": float(np.mean(points.distance[own])),
            "rate": float(np.nan_to_num(rate)),
            "power": 10 * math.log10(max(float(np.nansum(points.power[own])), 1e-30)),
        }
        for name, value in notes.items():
            record[name] = value
        step = points.position[own] - bodies.measurement.position[0]
        record["spread"] = [float(np.mean(part[np.isfinite(part)] ** 2)) if np.isfinite(part).any() else np.nan for part in step.T]
        self._roster.add(record, belief)
        self._next_id += 1
        return self._next_id - 1

    def _manage(self, origins: Float64Array, stamp_ns: int) -> tuple[Deleted, ...]:
        """Confirm and delete; ``origins`` [m], shape (n_sensors, 2), are where the sensors stand."""
        roster = self._roster
        if roster.belief is None or len(roster) == 0:
            return ()
        mean = self._kinematics(roster.belief)[0]
        seen = roster["seen_ns"] == stamp_ns
        roster["still"][seen] = np.hypot(mean[seen, 3], mean[seen, 4]) < self.config.life.static_speed
        away = mean[:, :2] - roster["birthplace"]
        roster["walked"][:] |= np.hypot(away[:, 0], away[:, 1]) >= self.config.life.walk_distance
        roster["stirred_ns"][roster["activity"] >= self.config.life.confirm_activity] = stamp_ns
        if self.config.life.reflection_after > self.config.life.confirm_after:
            self._reflections.process(roster, mean[:, :2], origins, stamp_ns)
        inside = self._view.sees(mean[:, :3]) & self._zones.inside(mean[:, :3])
        return self._management.process(roster, mean[:, :2], inside, stamp_ns)

    def _publish(self, stamp_ns: int) -> tuple[Track, ...]:
        """Make the frozen results."""
        roster = self._roster
        if roster.belief is None or len(roster) == 0:
            return ()
        mean, covariance = self._kinematics(roster.belief)
        # columns as plain numbers: one by one they cost several times as much
        age, unseen = (((stamp_ns - roster[name]) * _NANOSECOND).tolist() for name in ("born_ns", "seen_ns"))
        number, confirmed, n_points, nis, dof = (roster[name].tolist() for name in ("id", "confirmed", "n_points", "nis", "dof"))
        position, velocity, covariance, extent = mean[:, :3].copy(), mean[:, 3:].copy(), covariance.copy(), np.sqrt(roster["spread"])
        return tuple(
            Track(
                id=number[row],
                status=_status(confirmed[row], unseen[row]),
                age=age[row],
                unseen=unseen[row],
                n_points=n_points[row],
                position=position[row],
                velocity=velocity[row],
                extent=extent[row],
                covariance=covariance[row],
                nis=nis[row],
                dof=dof[row],
            )
            for row in range(len(roster))
        )


def _status(confirmed: bool, unseen: float) -> TrackStatus:
    if not confirmed:
        return TrackStatus.TENTATIVE
    return TrackStatus.COASTING if unseen > 0 else TrackStatus.CONFIRMED
