"""People tracking: predict, associate, measure, update, manage (thesis, chapter 6 and figure A.23)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError, PointCloud, RadarInfo
from radar_tracking.association import Clusters, Owners, associate, make_association
from radar_tracking.background import Background
from radar_tracking.body import measure
from radar_tracking.estimators import make_estimator
from radar_tracking.estimators.base import Belief, Measurement
from radar_tracking.life import TrackManagement
from radar_tracking.people_config import TrackerConfig
from radar_tracking.points import Admission, Points
from radar_tracking.roster import RECORD, Roster
from radar_tracking.sight import Sight, look
from radar_tracking.solid import part
from radar_tracking.tracks import Deleted, Track, Tracks, TrackStatus
from radar_tracking.view import View
from radar_tracking.zones import Zones

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]

_NANOSECOND = 1e-9
_EXTENT_TIME = 0.5  # s: the extent of a person is smoothed this long; single clouds show only a part of the body
_TORSO_TIME = 0.15  # s: and the torso's range and range rate this long
_ACTIVITY_TIME = 0.5  # s
_SURFACE = (-0.4, 0.05)  # m: a torso is seen before its centre
_SLIP, _DEAD = 4.0, 0.7  # how much a torso faster than its track (beyond so many m/s) raises the pull
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
        self._estimator = make_estimator(self.config.filter.estimator, 3)
        self._association = make_association(self.config)
        self._clusters = Clusters(self.config.association)
        self._management = TrackManagement(self.config.life)
        self.reset()

    def reset(self) -> None:
        """Forget everything; ids start again. For a new recording."""
        self._admission = Admission(self.config, self._view.origin)
        self._management.reset()
        self._background = Background(self.config.background)
        self._roster = Roster()
        self._next_id = 1
        self._stamp_ns: int | None = None
        self._first_ns = 0

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
        owners, behind = self._follow(points, cloud.stamp_ns, point_track_id)
        self._learn(every, dt)
        for own in self._births(points, owners.free, behind, cloud.stamp_ns):
            point_track_id[points.index[own]] = self._start(points, own, cloud.stamp_ns)
        deleted = self._manage(cloud.stamp_ns)
        if deleted:
            point_track_id[np.isin(point_track_id, [track.id for track in deleted])] = -1
        return Tracks(cloud.stamp_ns, cloud.sequence, cloud.frame_id, self._publish(cloud.stamp_ns), point_track_id, deleted)

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
            belief, self._estimator.kinematics(belief), roster["confirmed"], self.config.association.body_width, self._estimator.dimensions
        )

    def _follow(self, points: Points, stamp_ns: int, point_track_id: NDArray[np.int32]) -> tuple[Owners, NDArray[np.bool_]]:
        """Give points to tracks and update those that got some; also says which points are behind which track."""
        roster, nobody = self._roster, np.full(len(points), -1, np.int64)
        if roster.belief is None or len(roster) == 0 or len(points) == 0:
            return Owners(nobody, nobody), np.zeros((len(roster), len(points)), bool)
        kinematics = self._estimator.kinematics(roster.belief)
        sight = look(roster, kinematics, points, self.config.association)
        owners = associate(self._association, points, sight, roster["confirmed"])
        whole = np.maximum(owners.main, owners.limb)
        owned = np.flatnonzero(whole >= 0)
        roster["n_points"][:] = np.bincount(whole[owned], minlength=len(roster))
        roster["points_sum"][:] += roster["n_points"]
        point_track_id[points.index[owned]] = roster["id"][whole[owned]]
        own = np.flatnonzero(owners.main >= 0)
        if len(own):
            self._update(points, sight, own, owners.main[own], kinematics, stamp_ns)
            self._note_extent(points, owned, whole[owned], stamp_ns)
            roster["seen_ns"][np.unique(owners.main[own])] = stamp_ns
        return owners, sight.behind

    def _update(
        self, points: Points, sight: Sight, own: IndexArray, row: IndexArray, before: tuple[Float64Array, Float64Array], stamp_ns: int
    ) -> None:
        """Update tracks with their points; the farther all points lie from the prediction, the less they are believed."""
        roster, config = self._roster, self.config.filter
        rows, group = np.unique(row, return_inverse=True)
        trust = sight.near[row, own] * sight.torso[row, own]
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
        self._note_torso(points, sight, own, row, weight, dt)

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
        variance = np.diagonal(covariance, axis1=1, axis2=2)[:, :2] / np.maximum(best, 1e-12)[:, None]
        slip = np.abs(self._roster["slip"][rows])  # who sets off, or comes to a stop
        fastest = self.config.filter.pull * (1.0 + speed + _SLIP * np.maximum(slip - _DEAD, 0.0)) * np.maximum(dt, 1e-3)
        step = measurement.position[:, :2] - before[0][rows, :2]
        pull = np.hypot(step[:, 0], step[:, 1]) / fastest
        known = np.diagonal(before[1][rows], axis1=1, axis2=2)[:, :2]
        variance = np.maximum(variance, known * (pull - 1.0)[:, None])
        covariance[:, [0, 1], [0, 1]] = variance
        return Measurement(measurement.position, covariance, measurement.rate, measurement.rate_variance, measurement.origin)

    def _note_torso(self, points: Points, sight: Sight, own: IndexArray, row: IndexArray, weight: Float64Array, dt: Float64Array) -> None:
        """Remember where the torso was seen and its range rate, smoothed, and the fastest point; ``dt`` since each track's last update."""
        roster = self._roster
        rows, group = np.unique(row, return_inverse=True)
        total = np.bincount(group, weight)
        keep = np.exp(-dt / _TORSO_TIME)
        surface = np.bincount(group, weight * sight.beyond[row, own]) / total
        roster["surface"][rows] = np.clip(keep * roster["surface"][rows] + (1 - keep) * surface, *_SURFACE)
        slip = sight.slip[row, own]
        known = np.isfinite(slip)
        for name, value in (("range", points.distance[own]), ("rate", np.where(known, points.speed[own], 0.0))):
            roster[name][rows] = keep * roster[name][rows] + (1 - keep) * np.bincount(group, weight * value) / total
        loud = np.bincount(group, np.nan_to_num(points.power[own]))
        roster["power"][rows] = keep * roster["power"][rows] + (1 - keep) * 10 * np.log10(np.maximum(loud, 1e-30))
        share = np.bincount(group, weight * known)
        mean = np.bincount(group, weight * np.where(known, slip, 0.0)) / np.maximum(share, 1e-300)
        old = roster["slip"][rows]
        roster["slip"][rows] = np.where(share > 0, keep * old + (1 - keep) * mean, old)
        moves = np.zeros(len(rows), bool)
        moves[group[~(np.abs(points.speed[own]) < self.config.life.confirm_speed)]] = True  # without Doppler nothing can be ruled out
        keep = np.exp(-dt / _ACTIVITY_TIME)
        roster["activity"][rows] = keep * roster["activity"][rows] + (1 - keep) * moves

    def _note_extent(self, points: Points, owned: IndexArray, row: IndexArray, stamp_ns: int) -> None:
        """Remember how large the tracks are, smoothed; called before `seen_ns` moves on."""
        roster, n = self._roster, len(self._roster)
        assert roster.belief is not None
        centre = self._estimator.kinematics(roster.belief)[0][:, :3]
        keep = np.exp(-(stamp_ns - roster["seen_ns"]) * _NANOSECOND / _EXTENT_TIME)
        step = points.position[owned] - centre[row]
        for axis in range(3):
            known = np.isfinite(step[:, axis])
            count = np.bincount(row[known], minlength=n)
            new = np.bincount(row[known], step[known, axis] ** 2, n) / np.maximum(count, 1)
            old = roster["spread"][:, axis]
            mixed = np.where(np.isfinite(old), keep * old + (1 - keep) * new, new)
            roster["spread"][:, axis] = np.where(count > 0, mixed, old)
        count = np.maximum(np.bincount(row, minlength=n), 1)
        seen = (roster["n_points"] > 0)[:, None, None]
        cross = np.stack([np.bincount(row, step[:, a] * step[:, b], n) / count for a, b in ((0, 0), (0, 1), (1, 0), (1, 1))], -1)
        new = keep[:, None, None] * roster["dispersion"] + (1 - keep)[:, None, None] * cross.reshape(n, 2, 2)
        roster["dispersion"][:] = np.where(seen, new, roster["dispersion"])

    def _learn(self, points: Points, dt: float) -> None:
        """Learn what stands where nobody is."""
        roster, near = self._roster, np.zeros((0, len(points)), bool)
        if roster.belief is not None and len(roster):
            centre = self._estimator.kinematics(roster.belief)[0][:, :2]
            step = points.plane[None] - centre[:, None]
            near = np.hypot(step[..., 0], step[..., 1]) < self.config.background.body
        body = near[roster["confirmed"]].any(axis=0)
        standing = near[roster["confirmed"] & roster["still"]].any(axis=0)
        self._background.learn(points, body, standing & ~self._background.still(points), dt)

    def _births(self, points: Points, free: NDArray[np.bool_], behind: NDArray[np.bool_], stamp_ns: int) -> list[IndexArray]:
        """Clusters of free points that may start tracks: enough points, enough power, far enough from every track."""
        life = self.config.life
        index = np.flatnonzero(free)
        if len(index) < life.birth_points:
            return []
        labels = self._clusters.labels(points, index)
        belief = self._roster.belief
        old = np.zeros((0, 2)) if belief is None else self._estimator.kinematics(belief)[0][:, :2]
        new: list[Float64Array] = []
        age = (stamp_ns - self._first_ns) * _NANOSECOND
        found = []
        for label in range(int(labels.max(initial=-1)) + 1):
            own = index[labels == label]
            if len(own) < life.birth_points or len(old) + len(new) >= life.max_tracks or self._weak(points.power[own]):
                continue
            centre = points.position[own, :2].mean(axis=0)
            least = np.where(behind[:, own].all(axis=1), life.birth_behind, life.birth_distance)
            apart = bool((np.hypot(*(old - centre).T) >= least).all())
            apart &= all(math.hypot(*(centre - other)) >= life.birth_behind for other in new)
            if apart and self._zones.may_enter(centre, age):
                new.append(centre)
                found.append(own)
        return found

    def _weak(self, power: Float64Array) -> bool:
        """Whether points have too little power together to start a track."""
        known = np.isfinite(power)
        return bool(known.any()) and 10 * math.log10(max(float(power[known].sum()), 1e-30)) < self.config.life.birth_snr

    def _start(self, points: Points, own: IndexArray, stamp_ns: int) -> int:
        """Start a tentative track from a cluster; returns its id."""
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

    def _manage(self, stamp_ns: int) -> tuple[Deleted, ...]:
        """Confirm and delete."""
        roster = self._roster
        if roster.belief is None or len(roster) == 0:
            return ()
        mean = self._estimator.kinematics(roster.belief)[0]
        seen = roster["seen_ns"] == stamp_ns
        roster["still"][seen] = np.hypot(mean[seen, 3], mean[seen, 4]) < self.config.life.static_speed
        away = mean[:, :2] - roster["birthplace"]
        roster["walked"][:] |= np.hypot(away[:, 0], away[:, 1]) >= self.config.life.walk_distance
        roster["stirred_ns"][roster["activity"] >= self.config.life.confirm_activity] = stamp_ns
        inside = self._view.sees(mean[:, :3]) & self._zones.inside(mean[:, :3])
        return self._management.process(roster, mean[:, :2], inside, stamp_ns)

    def _publish(self, stamp_ns: int) -> tuple[Track, ...]:
        """Make the frozen results."""
        roster = self._roster
        if roster.belief is None or len(roster) == 0:
            return ()
        mean, covariance = self._estimator.kinematics(roster.belief)
        unseen = (stamp_ns - roster["seen_ns"]) * _NANOSECOND
        age = (stamp_ns - roster["born_ns"]) * _NANOSECOND
        extent = np.sqrt(roster["spread"])
        return tuple(
            Track(
                id=int(record["id"]),
                status=_status(bool(record["confirmed"]), float(unseen[row])),
                age=float(age[row]),
                unseen=float(unseen[row]),
                n_points=int(record["n_points"]),
                position=mean[row, :3].copy(),
                velocity=mean[row, 3:].copy(),
                extent=extent[row],
                covariance=covariance[row].copy(),
                nis=float(record["nis"]),
                dof=int(record["dof"]),
            )
            for row, record in enumerate(roster.records)
        )


def _status(confirmed: bool, unseen: float) -> TrackStatus:
    if not confirmed:
        return TrackStatus.TENTATIVE
    return TrackStatus.COASTING if unseen > 0 else TrackStatus.CONFIRMED
