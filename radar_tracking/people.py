"""People tracking: the thesis's Group Tracker with Clustering (6.2) with a plausibility gate."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError, PointCloud
from radar_tracking.association import add_limbs, assign, gate, nearness, plane_distance
from radar_tracking.clustering import cluster
from radar_tracking.kalman import predict, update
from radar_tracking.people_config import TrackerConfig
from radar_tracking.tracks import Track, Tracks, TrackStatus

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]

_NANOSECOND = 1e-9
_EXTENT_TIME = 0.5  # s: the extent of a person is smoothed this long; single clouds show only a part of the body
_RADIAL_TIME = 0.15  # s: and the torso's range and range rate this long
_ASSUMED_Z = 1.0  # m: height of a body's centre where nothing measures it, and
_ASSUMED_Z_STD = 0.5  # how far off that is (assumed with every cloud, so that the height's covariance stays bounded); no centroid of
# the few points that a person gives is nearer to the middle between head and feet than this
_UPRIGHT = 1e-4  # process noise of the height relative to that on the floor plane: people hardly move up and down


@dataclass(frozen=True)
class _Points:
    """The usable points of a cloud in float64; `index` says where they lie in the cloud."""

    index: IndexArray
    position: Float64Array
    speed: Float64Array
    weight: Float64Array
    power: Float64Array
    range: Float64Array
    cross: Float64Array


@dataclass(eq=False)
class _Live:
    """One track between clouds."""

    id: int
    born_ns: int
    seen_ns: int
    mean: Float64Array
    covariance: Float64Array
    confirmed: bool = False
    n_points: int = 0
    points_sum: int = 0
    clouds: int = 0
    fastest: float = 0.0
    range: float = 0.0
    rate: float = 0.0
    spread: Float64Array = field(default_factory=lambda: np.full(3, np.nan))


class PeopleTracker:
    """Follow people through point clouds.

    Every cloud: predict all tracks, gate the points at a metre and more, give each to the nearest track, keep the largest dense cluster
    of every track and free the rest for the others, update with the weighted centroid, start new tracks from dense clusters of what is
    left (thesis, 6.2.2 and 6.2.3). Results depend on nothing but the clouds, bit for bit.

    Parameters
    ----------
    config : TrackerConfig
        Knobs.

    Attributes
    ----------
    dropped_points : int
        Points without position, or absurdly far away, since the last `reset`.
    """

    def __init__(self, config: TrackerConfig | None = None) -> None:
        self.config = config if config is not None else TrackerConfig()
        self.reset()

    def reset(self) -> None:
        """Forget everything; ids start again. For a new recording."""
        self._live: list[_Live] = []
        self._close_ns: dict[tuple[int, int], int] = {}
        self._next_id = 1
        self._stamp_ns: int | None = None
        self.dropped_points = 0

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
        dt = self._advance(cloud)
        points = self._usable(cloud)
        self._predict(dt, cloud.stamp_ns)
        point_track_id = np.full(len(cloud), -1, np.int32)
        owner, limb = self._associate(points)
        for row, track in enumerate(self._live):
            own = np.flatnonzero(owner == row)
            whole = np.flatnonzero((owner == row) | (limb == row))
            track.n_points = len(whole)
            point_track_id[points.index[whole]] = track.id
            track.clouds += 1
            if len(own):
                self._update(track, points, own, whole, cloud.stamp_ns)
        for own in self._births(points, (owner < 0) & (limb < 0)):
            track = self._start(points, own, cloud.stamp_ns)
            point_track_id[points.index[own]] = track.id
        gone = self._manage(cloud.stamp_ns)
        if gone:
            point_track_id[np.isin(point_track_id, gone)] = -1
        tracks = tuple(self._publish(track, cloud.stamp_ns) for track in self._live)
        return Tracks(cloud.stamp_ns, cloud.sequence, cloud.frame_id, tracks, point_track_id)

    def _advance(self, cloud: PointCloud) -> float:
        """Check the cloud's frame and stamp; return the seconds since the one before."""
        if cloud.frame_id != "room":
            raise DataError(f"tracking needs clouds in 'room', this one is in {cloud.frame_id!r}; level it with PointCloud.to_room(mount)")
        before, self._stamp_ns = self._stamp_ns, cloud.stamp_ns
        if before is None:
            return 0.0
        if cloud.stamp_ns < before:
            self._stamp_ns = before
            raise DataError(
                f"cloud {cloud.sequence} is {(before - cloud.stamp_ns) * _NANOSECOND:g} s older than the one before; reset() the tracker "
                "before another recording"
            )
        return (cloud.stamp_ns - before) * _NANOSECOND

    def _usable(self, cloud: PointCloud) -> _Points:
        """Pick the points that have a position and may move; weights are amplitudes, bounded so that no single point rules."""
        for name in ("x", "y", "z", "radial_speed", "snr", "range", "azimuth_std"):
            if np.isinf(getattr(cloud, name)).any():
                raise DataError(f"PointCloud.{name} of cloud {cloud.sequence} holds an infinity; NaN is the mark for what was not measured")
        position = cloud.position.astype(np.float64)
        limit = self.config.max_distance
        placed = (np.abs(position[:, 0]) <= limit) & (np.abs(position[:, 1]) <= limit)  # NaN compares False
        placed &= ~(np.abs(position[:, 2]) > limit)
        self.dropped_points += int(np.count_nonzero(~placed))
        if self.config.min_speed > 0:
            placed &= ~(np.abs(cloud.radial_speed) < self.config.min_speed)
        index = np.flatnonzero(placed)
        snr = np.clip(cloud.snr[index].astype(np.float64), -100.0, 200.0)
        known = np.isfinite(snr)
        level = float(np.median(snr[known])) if known.any() else 0.0
        weight = 10 ** (np.clip(np.where(known, snr, level) - level, -10.0, 10.0) / 20)
        distance = cloud.range[index].astype(np.float64)
        distance = np.where(np.isfinite(distance), distance, np.hypot(position[index, 0], position[index, 1]))
        angle = cloud.azimuth_std[index].astype(np.float64)
        angle = np.clip(np.where(np.isfinite(angle), angle, self.config.filter.angle_std), 0.0, 1.0)
        return _Points(
            index, position[index], cloud.radial_speed[index].astype(np.float64), weight, 10 ** (snr / 10), distance, distance * angle
        )

    def _predict(self, dt: float, stamp_ns: int) -> None:
        """Move all tracks on (6.1); those that nobody sees slow down."""
        if not self._live or dt == 0:
            return
        # beyond the longest life nothing survives, and bounded steps keep the covariance far from overflow
        life = self.config.life
        step = min(dt, 1.0 + max(life.delete_after, life.delete_static_after))
        noise = self.config.filter.process_noise * np.array([1.0, 1.0, _UPRIGHT])
        mean, covariance = predict(np.stack([t.mean for t in self._live]), np.stack([t.covariance for t in self._live]), step, noise)
        for row, track in enumerate(self._live):
            unseen = (stamp_ns - track.seen_ns) * _NANOSECOND
            if unseen > dt:
                slower = math.exp(-step / self.config.filter.damping)
                mean[row, 3:] *= slower
                track.rate *= slower
            track.mean, track.covariance = mean[row], covariance[row]
            track.range += step * track.rate

    def _associate(self, points: _Points) -> tuple[IndexArray, IndexArray]:
        """Owner of each point by main cluster and as a limb: rows of the tracks, confirmed ones choosing first; -1: nobody."""
        config = self.config.association
        n = len(points.index)
        owner, limb = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
        plane_points = points.position[:, :2]
        for confirmed in (True, False):
            rows = np.array([i for i, t in enumerate(self._live) if t.confirmed is confirmed], np.int64)
            free = np.flatnonzero((owner < 0) & (limb < 0))
            if len(rows) == 0 or len(free) == 0:
                continue
            mean = np.stack([self._live[i].mean for i in rows])
            covariance = np.stack([self._live[i].covariance for i in rows])
            plane = plane_distance(plane_points[free], mean[:, :2])
            torso = np.stack([self._torso(self._live[i], points, free) for i in rows])
            found = assign(plane_points[free], gate(plane_points[free], mean, covariance, config), plane, torso, config)
            owner[free] = np.where(found >= 0, rows[found], -1)
            if confirmed:
                found = add_limbs(plane_points[free], found, plane, config)
                limb[free] = np.where(found >= 0, rows[found], -1)
        return owner, limb

    def _measure(self, points: _Points, own: IndexArray, weight: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Weighted centroid of points and its variances, from their spread, their number and their distance; an unmeasured z is assumed."""
        share = weight / weight.sum()
        effective = 1.0 / float((share**2).sum())
        position = points.position[own]
        noise = self.config.filter.position_std**2 + float(share @ points.cross[own] ** 2) / effective
        centroid, variance = np.empty(3), np.empty(3)
        for axis in range(3):
            known = np.isfinite(position[:, axis])
            total = float(share[known].sum())
            if total <= 0:
                centroid[axis], variance[axis] = _ASSUMED_Z, _ASSUMED_Z_STD**2
                continue
            part, value = share[known] / total, position[known, axis]
            centroid[axis] = part @ value
            variance[axis] = noise + float(part @ (value - centroid[axis]) ** 2) / effective
        variance[2] = max(variance[2], _ASSUMED_Z_STD**2)
        return centroid, variance

    def _update(self, track: _Live, points: _Points, own: IndexArray, whole: IndexArray, stamp_ns: int) -> None:
        """Kalman update with the centroid; the farther all points lie from the prediction, the less it is believed."""
        config = self.config
        near = nearness(np.hypot(*(points.position[own, :2] - track.mean[:2]).T), config.association.body_radius)
        torso = self._torso(track, points, own)
        weight = points.weight[own] * near * torso
        centroid, variance = self._measure(points, own, weight)
        variance[:2] /= (near * torso).max()
        # an arm's points are wrong together for half a second, not each for itself: no measurement may pull a body faster than bodies start
        dt = (stamp_ns - track.seen_ns) * _NANOSECOND
        fastest = config.filter.pull * (1.0 + math.hypot(track.mean[3], track.mean[4])) * max(dt, 1e-3)
        pull = math.hypot(*(centroid[:2] - track.mean[:2])) / fastest
        variance[:2] = np.maximum(variance[:2], np.diagonal(track.covariance)[:2] * (pull - 1))
        track.mean, track.covariance = update(track.mean, track.covariance, centroid, np.diag(variance))
        track.seen_ns = stamp_ns
        track.points_sum += len(whole)
        self._note(track, points, own, weight, math.exp(-dt / _RADIAL_TIME))
        self._note_extent(track, points, whole, math.exp(-dt / _EXTENT_TIME))

    def _torso(self, track: _Live, points: _Points, own: IndexArray) -> Float64Array:
        """How much each point counts as torso, 0..1: arms reach towards the radar and move faster than the body."""
        config = self.config.association
        speed = points.speed[own]
        excess = np.where(np.isfinite(speed), speed - track.rate, 0.0) / config.arm_speed
        distance = points.range[own]
        # the torso is the far end of what belongs to a person, or where it was; what lies far behind is somebody else
        behind = distance[distance < track.range + config.reach / 2]
        torso = max(track.range, float(behind.max())) if len(behind) else track.range
        depth = np.clip(distance - torso, -5 * config.arm_depth, 0.0) / config.arm_depth
        return np.asarray(np.exp(depth) / (1 + np.minimum(excess**2, 100.0)))

    def _note(self, track: _Live, points: _Points, own: IndexArray, weight: Float64Array, keep: float) -> None:
        """Remember the torso's range and range rate, smoothed, and the fastest point."""
        speed = points.speed[own]
        known = np.isfinite(speed)
        if known.any():
            track.rate = keep * track.rate + (1 - keep) * float(np.average(speed[known], weights=weight[known]))
        track.range = keep * track.range + (1 - keep) * float(np.average(points.range[own], weights=weight))
        # without Doppler nothing can be ruled out
        track.fastest = max(track.fastest, float(np.where(known, np.abs(speed), self.config.life.confirm_speed).max()))

    def _note_extent(self, track: _Live, points: _Points, whole: IndexArray, keep: float) -> None:
        """Remember how large the track is, smoothed."""
        square = (points.position[whole] - track.mean[:3]) ** 2
        for axis in range(3):
            known = np.isfinite(square[:, axis])
            if known.any():
                new, old = float(square[known, axis].mean()), float(track.spread[axis])
                track.spread[axis] = keep * old + (1 - keep) * new if math.isfinite(old) else new

    def _births(self, points: _Points, free: NDArray[np.bool_]) -> list[IndexArray]:
        """Clusters of free points that may start tracks: enough points, enough power, far enough from every track."""
        life, association = self.config.life, self.config.association
        index = np.flatnonzero(free)
        if len(index) < life.birth_points:
            return []
        labels = cluster(
            points.position[index, :2], association.eps, min(association.min_points + 1, life.birth_points), association.max_points
        )
        taken = [t.mean[:2] for t in self._live]
        found = []
        for label in range(int(labels.max()) + 1):
            own = index[labels == label]
            power = points.power[own]
            known = np.isfinite(power)
            weak = known.any() and 10 * math.log10(max(float(power[known].sum()), 1e-30)) < life.birth_snr
            if len(own) < life.birth_points or weak or len(taken) >= life.max_tracks:
                continue
            centre = points.position[own, :2].mean(axis=0)
            if all(math.hypot(*(centre - other)) >= life.birth_distance for other in taken):
                taken.append(centre)
                found.append(own)
        return found

    def _start(self, points: _Points, own: IndexArray, stamp_ns: int) -> _Live:
        """Start a tentative track from a cluster."""
        centroid, variance = self._measure(points, own, points.weight[own])
        speed = np.full(3, self.config.filter.initial_speed_std**2)
        track = _Live(
            self._next_id, stamp_ns, stamp_ns, np.concatenate([centroid, np.zeros(3)]), np.diag(np.concatenate([variance, speed]))
        )
        self._next_id += 1
        track.n_points = track.points_sum = len(own)
        track.clouds = 1
        self._note(track, points, own, points.weight[own], 0.0)
        self._note_extent(track, points, own, 0.0)
        self._live.append(track)
        return track

    def _manage(self, stamp_ns: int) -> list[int]:
        """Confirm, delete and merge; return the ids that are gone."""
        life = self.config.life
        gone = []
        for track in self._live:
            static = math.hypot(track.mean[3], track.mean[4]) < life.static_speed
            allowed = life.tentative_after
            if track.confirmed:
                allowed = max(life.delete_after, life.delete_static_after) if static else life.delete_after
            if stamp_ns - track.seen_ns > _whole_ns(allowed):
                gone.append(track.id)
            elif not track.confirmed and track.seen_ns == stamp_ns:
                long = stamp_ns - track.born_ns >= _whole_ns(life.confirm_after)
                plausible = track.points_sum >= life.confirm_points * track.clouds and track.fastest >= life.confirm_speed
                track.confirmed = long and plausible and track.clouds > 1
        gone += self._duplicates(stamp_ns, gone)
        self._live = [track for track in self._live if track.id not in gone]
        return gone

    def _duplicates(self, stamp_ns: int, gone: list[int]) -> list[int]:
        """Younger tracks that have been on top of older ones for long; tentative ones at once."""
        life = self.config.life
        alive = [track for track in self._live if track.id not in gone]
        close: dict[tuple[int, int], int] = {}
        doubled: list[int] = []
        for i, old in enumerate(alive):
            for young in alive[i + 1 :]:
                if math.hypot(*(old.mean[:2] - young.mean[:2])) >= life.merge_distance:
                    continue
                pair = (old.id, young.id)
                close[pair] = self._close_ns.get(pair, stamp_ns)
                long = stamp_ns - close[pair] > _whole_ns(life.merge_after)
                if not young.confirmed or not old.confirmed or long:
                    doubled.append(young.id if young.confirmed <= old.confirmed else old.id)
        self._close_ns = {pair: since for pair, since in close.items() if not set(pair) & set(doubled)}
        return doubled

    def _publish(self, track: _Live, stamp_ns: int) -> Track:
        """Make the frozen result of one track."""
        unseen = (stamp_ns - track.seen_ns) * _NANOSECOND
        status = TrackStatus.TENTATIVE
        if track.confirmed:
            status = TrackStatus.COASTING if unseen > 0 else TrackStatus.CONFIRMED
        return Track(
            id=track.id,
            status=status,
            age=(stamp_ns - track.born_ns) * _NANOSECOND,
            unseen=unseen,
            n_points=track.n_points,
            position=track.mean[:3].copy(),
            velocity=track.mean[3:].copy(),
            extent=np.sqrt(track.spread),
            covariance=track.covariance.copy(),
        )


def _whole_ns(seconds: float) -> int:
    """Whole nanoseconds: durations are compared as integers, or rounding would decide at what frame a track dies."""
    return round(seconds / _NANOSECOND)
