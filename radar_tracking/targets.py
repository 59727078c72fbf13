"""Tracks of boards that follow people themselves: a filter for those that give places only, numbers that are never used again for all."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from radar_core import DataError, Pose
from radar_core.config import config, knob
from radar_core.types import Float64Array
from radar_driver.targets import Targets
from radar_tracking.assignment import assign_tracks, mahalanobis
from radar_tracking.estimators.base import Belief, Measurement, join
from radar_tracking.estimators.config import EstimatorConfig
from radar_tracking.estimators.make import make_estimator
from radar_tracking.tracks import Deleted, Reason, Track, Tracks, TrackStatus

_LONGEST = 5.0  # s: nothing survives a longer gap, and bounded steps keep the covariance far from overflow


@config
class TargetConfig:
    """How a board's targets become tracks."""

    estimator: EstimatorConfig = EstimatorConfig(name="mm_vel_est")
    gate: float = knob(4.0, low=0.5, high=100.0, doc="a target farther from a track than so many standard deviations is not its")
    confirm: float = knob(0.5, unit="s", low=0.0, high=60.0, doc="how long a track is followed before it counts as a person")
    keep: float = knob(1.0, unit="s", low=0.0, high=60.0, doc="how long a confirmed track goes on that the board no longer gives")
    speed_std: float = knob(1.0, unit="m/s", low=1e-3, high=20.0, doc="of a new track's velocity")
    rate_std: float = knob(0.25, unit="m/s", low=1e-3, high=10.0, doc="of the radial speeds that a board gives")


@dataclass
class _Life:
    """What is known of one track beside its belief."""

    id: int
    slot: int
    born_ns: int
    seen_ns: int
    nis: float = math.nan
    dof: int = 0
    confirmed: bool = False


class TargetTracker:
    """Gives a board's targets as tracks in ``room``.

    Places are filtered, and belong to the track that they fit best, because boards give a place in their list to somebody else without a
    word. Targets whose velocity the board follows stay as they are; only their numbers are made unique, and velocities have no covariance.
    """

    def __init__(self, settings: TargetConfig | None = None, mount: Pose | None = None) -> None:
        self._config, self._mount = settings or TargetConfig(), mount or Pose()
        self._estimator = make_estimator(self._config.estimator, 3)
        self._lives: list[_Life] = []
        self._belief: Belief | None = None
        self._stamp_ns: int | None = None
        self._next = 1

    def reset(self) -> None:
        """Forget all tracks; for stamps that went back. Numbers go on."""
        self._lives, self._belief, self._stamp_ns = [], None, None

    def process(self, targets: Targets) -> Tracks:
        """Take in one report in the sensor's frame; a `DataError` says that it is older than the one before, or not finite."""
        stamp = targets.stamp_ns
        dt = 0.0 if self._stamp_ns is None else (stamp - self._stamp_ns) * 1e-9
        if dt < 0:
            raise DataError(f"report {targets.sequence} is {-dt:g} s older than the one before; reset() the tracker first")
        if not np.isfinite(targets.position).all() or not np.isfinite(targets.covariance).all() or np.isinf(targets.radial_speed).any():
            raise DataError(f"Targets.position (covariance, radial_speed) of report {targets.sequence} is not finite")
        self._stamp_ns = stamp
        turn = self._mount.rotation
        place, covariance = self._mount.to_room(targets.position), turn @ targets.covariance @ turn.T
        followed = np.isfinite(targets.velocity).all() if len(targets) else bool(self._lives) and self._belief is None
        if followed:
            return self._as_they_are(targets, place, covariance, targets.velocity @ turn.T)
        self._follow(targets, place, covariance, dt)
        return self._publish(targets, self._end(stamp))

    def _as_they_are(self, targets: Targets, place: Float64Array, covariance: Float64Array, velocity: Float64Array) -> Tracks:
        """Give the board's own tracks new numbers: a slot that was away is somebody else."""
        old = {life.slot: life for life in self._lives}
        slots = targets.slot.tolist()
        gone = tuple(Deleted(life.id, Reason.UNSEEN, confirmed=True) for life in self._lives if life.slot not in slots)
        self._lives = [old.get(slot) or self._new(slot, targets.stamp_ns) for slot in slots]
        self._belief = None
        full = np.full((len(targets), 6, 6), np.nan)
        full[:, :3, :3] = covariance
        tracks = []
        for k, life in enumerate(self._lives):
            place_velocity_extent = place[k], velocity[k], np.full(3, np.nan)
            age = (targets.stamp_ns - life.born_ns) * 1e-9
            tracks.append(Track(life.id, TrackStatus.CONFIRMED, age, 0.0, 0, *place_velocity_extent, full[k]))
        tracks.sort(key=lambda track: track.id)
        return Tracks(targets.stamp_ns, targets.sequence, "room", tuple(tracks), np.zeros(0, np.int32), gone)

    def _new(self, slot: int, stamp_ns: int) -> _Life:
        self._next += 1
        return _Life(self._next - 1, slot, stamp_ns, stamp_ns)

    def _follow(self, targets: Targets, place: Float64Array, covariance: Float64Array, dt: float) -> None:
        """Predict, pair, update, and begin new tracks."""
        n = len(targets)
        rate = targets.radial_speed, np.full(n, self._config.rate_std**2)
        measured = Measurement(place, covariance, *rate, np.broadcast_to(self._mount.origin, (n, 3)))
        for life in self._lives:
            life.nis, life.dof = math.nan, 0
        free = np.ones(n, bool)
        if self._belief is not None and self._lives:
            self._belief = self._estimator.predict(self._belief, min(dt, _LONGEST))
            mean, spread = self._estimator.kinematics(self._belief)
            distance = mahalanobis(mean[:, :3], spread[:, :3, :3], place, covariance)
            rows, own = assign_tracks(distance, self._config.gate).T
            if len(rows):
                belief, innovation = self._estimator.update(self._belief.select(rows), measured.select(own))
                self._belief = self._belief.put(rows, belief)
                free[own] = False
                for k, row in enumerate(rows.tolist()):
                    life = self._lives[row]
                    life.seen_ns, life.slot = targets.stamp_ns, int(targets.slot[own[k]])
                    life.nis, life.dof = float(innovation.nis[k]), int(innovation.dof[k])
        new = np.flatnonzero(free)
        if len(new):
            begun = self._estimator.start(measured.select(new), self._config.speed_std)
            self._belief = begun if self._belief is None or not self._lives else join([self._belief, begun])
            self._lives += [self._new(int(targets.slot[k]), targets.stamp_ns) for k in new]

    def _end(self, stamp_ns: int) -> tuple[Deleted, ...]:
        """Confirm those that were followed for long enough, and end those that the board has not given for too long."""
        for life in self._lives:
            life.confirmed = life.confirmed or (life.seen_ns - life.born_ns) * 1e-9 >= self._config.confirm
        kept = [(stamp_ns - life.seen_ns) * 1e-9 <= (self._config.keep if life.confirmed else 0.0) for life in self._lives]
        ended = [life for life, stays in zip(self._lives, kept, strict=True) if not stays]
        if ended and self._belief is not None:
            self._belief = self._belief.select(np.array(kept))
            self._lives = [life for life, stays in zip(self._lives, kept, strict=True) if stays]
        return tuple(Deleted(one.id, Reason.UNSEEN if one.confirmed else Reason.NOT_CONFIRMED, one.confirmed) for one in ended)

    def _publish(self, targets: Targets, deleted: tuple[Deleted, ...]) -> Tracks:
        tracks = []
        if self._belief is not None and self._lives:
            mean, covariance = self._estimator.kinematics(self._belief)
            for k, life in enumerate(self._lives):
                age, unseen = ((targets.stamp_ns - since) * 1e-9 for since in (life.born_ns, life.seen_ns))
                seen = TrackStatus.COASTING if unseen > 0 else TrackStatus.CONFIRMED
                status = seen if life.confirmed else TrackStatus.TENTATIVE
                place = mean[k, :3].copy(), mean[k, 3:].copy(), np.full(3, np.nan), covariance[k].copy()
                tracks.append(Track(life.id, status, age, unseen, 0, *place, life.nis, life.dof))
        return Tracks(targets.stamp_ns, targets.sequence, "room", tuple(tracks), np.zeros(0, np.int32), deleted)
