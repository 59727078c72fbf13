"""Hand tracking: split a person's points into body and hand, then follow the hand (thesis, 7.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_tracking.clustering import kmeans
from radar_tracking.hand_config import HandConfig
from radar_tracking.kalman import mahalanobis2, predict, update
from radar_tracking.tracks import HandTrack, Track, TrackedCloud, TrackStatus

Float64Array = NDArray[np.float64]
MaskArray = NDArray[np.bool_]

_NANOSECOND = 1e-9
_MAX_POINTS = 500  # a hand has a handful of points; more than this of one person only cost time
_MAX_DEPTH = 1.5  # m
_TORSO_DECAY = 0.3  # m/s: the torso is where the farthest point of the person was lately; it comes nearer no faster than this
_ASSUMED_Z_STD = 0.3  # m: where no point measures the height, the hand is assumed as high as the body
_START_STD = (0.15, 1.0)  # of position [m] and velocity [m/s] when the hand is found


@dataclass(frozen=True)
class _Candidates:
    """Points that may be the hand. `axis`: from the body's axis; `depth`: range beyond the torso's; `cross`: lateral error [m]."""

    position: Float64Array
    speed: Float64Array
    weight: Float64Array
    cross: Float64Array
    axis: Float64Array
    depth: Float64Array
    owned: MaskArray


class HandTracker:
    """Follow one hand of one person and give an analogue value.

    Idle until `start` or a trigger `gesture`. Then the points of that person are split by k-means into body and hand, a Kalman filter
    follows the hand, and one `HandTrack` comes with every cloud until the hand is lost or `stop` is called; the last one says
    ``active=False``. Commands take effect by their stamps and the clouds' stamps alone.

    Parameters
    ----------
    config : HandConfig
        Knobs.
    """

    def __init__(self, config: HandConfig | None = None) -> None:
        self.config = config if config is not None else HandConfig()
        self.reset()

    def reset(self) -> None:
        """Forget everything, pending commands too. For a new recording."""
        self._pending: list[tuple[int, str, int | None]] = []
        self._parent: int | None = None
        self._body: Float64Array | None = None
        self._mean: Float64Array | None = None
        self._covariance = np.eye(6)
        self._seen_ns = 0
        self._torso_range = -math.inf
        self._stamp_ns: int | None = None

    @property
    def active(self) -> bool:
        """True while a hand is followed or looked for."""
        return self._parent is not None

    def start(self, track_id: int | None, stamp_ns: int) -> None:
        """Follow the hand of a person from the first cloud at or after ``stamp_ns`` + `trigger_delay`.

        Parameters
        ----------
        track_id : int or None
            Whose hand; None: of the confirmed track nearest to the radar.
        stamp_ns : int
            Stamp of the trigger [ns].
        """
        self._queue(stamp_ns, "start", track_id)

    def stop(self, stamp_ns: int | None = None) -> None:
        """End the hand track with the next cloud, or with the first at or after ``stamp_ns`` [ns] + `trigger_delay`."""
        if stamp_ns is None:
            self._pending.append((-1, "stop", None))
        else:
            self._queue(stamp_ns, "stop", None)

    def gesture(self, name: str, track_id: int, stamp_ns: int) -> None:
        """Tell of a recognised gesture; the trigger gesture starts (or with `toggle` also ends) the hand track.

        Parameters
        ----------
        name : str
            As in ``GESTURES``.
        track_id : int
            Who performed it.
        stamp_ns : int
            When it was decided [ns].
        """
        if name and name == self.config.trigger:
            self._queue(stamp_ns, "trigger", track_id)

    def _queue(self, stamp_ns: int, action: str, track_id: int | None) -> None:
        self._pending.append((stamp_ns + round(self.config.trigger_delay / _NANOSECOND), action, track_id))

    def process(self, tracked: TrackedCloud) -> HandTrack | None:
        """Take in one cloud with its tracks.

        Parameters
        ----------
        tracked : TrackedCloud
            In ``room``, not older than the one before.

        Returns
        -------
        HandTrack or None
            None: there is no hand (yet).

        Raises
        ------
        DataError
            When the cloud is older than the one before or not in ``room``.
        """
        stamp_ns = tracked.cloud.stamp_ns
        if tracked.cloud.frame_id != "room":
            raise DataError(f"hand tracking needs clouds in 'room', this one is in {tracked.cloud.frame_id!r}")
        if self._stamp_ns is not None and stamp_ns < self._stamp_ns:
            raise DataError(
                f"cloud {tracked.cloud.sequence} is older than the one before; reset() the hand tracker before another recording"
            )
        dt = 0.0 if self._stamp_ns is None else (stamp_ns - self._stamp_ns) * _NANOSECOND
        self._stamp_ns = stamp_ns
        ended = self._apply_commands(tracked)
        if self._parent is None:
            return ended
        parent = tracked.tracks.find(self._parent)
        if parent is not None:
            self._body = parent.position
        n_points = self._follow(tracked, dt)
        if stamp_ns - self._seen_ns > round(self.config.lost_after / _NANOSECOND):
            return self._end(tracked)
        return ended if self._mean is None else self._publish(tracked, n_points, active=True)

    def _apply_commands(self, tracked: TrackedCloud) -> HandTrack | None:
        """Carry out the commands that are due, in the order of their stamps; return the last message of a hand track they end."""
        due = sorted((c for c in self._pending if c[0] <= tracked.cloud.stamp_ns), key=lambda c: c[0])
        self._pending = [c for c in self._pending if c[0] > tracked.cloud.stamp_ns]
        ended = None
        for _, action, track_id in due:
            if action == "stop" or (action == "trigger" and self.active and self.config.toggle and track_id == self._parent):
                ended = self._end(tracked) or ended
            elif action == "start" or not self.active:
                ended = self._end(tracked) or ended
                self._begin(track_id, tracked)
        return ended

    def _begin(self, track_id: int | None, tracked: TrackedCloud) -> None:
        """Choose the person; the hand itself is found by `_follow`."""
        people = [t for t in tracked.tracks.tracks if t.status is not TrackStatus.TENTATIVE]
        if track_id is None and people:
            track_id = min(people, key=lambda t: _distance(t, tracked)).id
        parent = None if track_id is None else tracked.tracks.find(track_id)
        if parent is not None:
            self._parent, self._body, self._seen_ns = parent.id, parent.position, tracked.cloud.stamp_ns
            self._torso_range = -math.inf

    def _end(self, tracked: TrackedCloud) -> HandTrack | None:
        """Become idle; return the closing message if a hand was ever found."""
        last = None if self._mean is None else self._publish(tracked, 0, active=False)
        self._parent, self._body, self._mean = None, None, None
        return last

    def _follow(self, tracked: TrackedCloud, dt: float) -> int:
        """Predict, then update with the points of the hand; return how many there are."""
        config, stamp_ns = self.config, tracked.cloud.stamp_ns
        unseen = (stamp_ns - self._seen_ns) * _NANOSECOND
        points = self._candidates(tracked, dt)
        if self._mean is not None and dt > 0:
            step = min(dt, 1.0 + config.lost_after)
            self._mean, self._covariance = predict(self._mean, self._covariance, step, config.process_noise)
            if unseen > dt:
                self._mean[3:] *= math.exp(-step / config.damping)
        own = np.zeros(len(points.axis), bool)
        if self._mean is not None:
            own = self._gate(points)
        if not own.any() and (self._mean is None or unseen > config.reacquire_after):
            own = self._split(points)
            if own.any():
                self._restart(points.position[own], points.weight[own])
        if own.any():
            self._correct(points.position[own], points.weight[own], points.cross[own])
            self._seen_ns = stamp_ns
        self._hold_within_reach()
        return int(np.count_nonzero(own))

    def _candidates(self, tracked: TrackedCloud, dt: float) -> _Candidates:
        """Points that may be the hand: the person's own and nobody's, within reach."""
        cloud, body, owner = tracked.cloud, self._body, tracked.tracks.point_track_id
        assert body is not None
        position = cloud.position.astype(np.float64)
        axis = np.hypot(position[:, 0] - body[0], position[:, 1] - body[1])
        usable = ((owner == self._parent) | (owner == -1)) & (axis <= self.config.reach)  # NaN compares False
        index = np.flatnonzero(usable)[:_MAX_POINTS]
        speed = np.abs(cloud.radial_speed[index].astype(np.float64))
        snr = cloud.snr[index].astype(np.float64)
        known = np.isfinite(snr)
        level = float(np.median(snr[known])) if known.any() else 0.0
        weight = 10 ** (np.clip(np.where(known, snr, level) - level, -10.0, 10.0) / 20)
        angle = cloud.azimuth_std[index].astype(np.float64)
        angle = np.clip(np.where(np.isfinite(angle), angle, self.config.angle_std), 0.0, 1.0)
        distance = cloud.range[index].astype(np.float64)
        distance = np.where(np.isfinite(distance), distance, np.hypot(position[index, 0], position[index, 1]))
        owned = owner[index] == self._parent
        self._torso_range = max(self._torso_range - _TORSO_DECAY * dt, float(np.max(distance[owned], initial=-np.inf)))
        depth = np.maximum(distance - self._torso_range, -_MAX_DEPTH)
        return _Candidates(
            position[index], np.where(np.isfinite(speed), speed, np.inf), weight, angle * distance, axis[index], depth, owned
        )

    def _gate(self, points: _Candidates) -> MaskArray:
        """Points near the predicted hand that are not body; without z on the floor plane."""
        assert self._mean is not None
        own = np.zeros(len(points.axis), bool)
        if not len(own):
            return own
        position = points.position
        measured = np.isfinite(position[:, 2])
        spread = self.config.position_std**2 + float(np.median(points.cross)) ** 2
        for mask, d in ((measured, 3), (~measured, 2)):
            if mask.any():
                offset = position[mask, :d] - self._mean[:d]
                far2 = mahalanobis2(self._mean[None, :d], self._covariance[None, :d, :d], position[mask, :d], np.eye(d) * spread)[0]
                own[mask] = (np.sqrt((offset**2).sum(axis=1)) <= self.config.gate) & (far2 <= self.config.gate_sigmas**2)
        offset = position[:, :2] - self._mean[:2]
        nearer = np.hypot(*offset.T) / self.config.hand_radius <= points.axis / self.config.body_radius
        return np.asarray(own & nearer & ~self._is_body(points))

    def _is_body(self, points: _Candidates) -> MaskArray:
        """Slow points near the body's axis or behind it: the guard against a hand that falls into the body."""
        inside = (points.axis < self.config.body_radius) | (points.depth > -self.config.torso_depth)
        return np.asarray(inside & (points.speed < self.config.body_speed))

    def _split(self, points: _Candidates) -> MaskArray:
        """Split a person's points by 2-means of position and radial speed; the hand is farther out, nearer to the radar or faster."""
        assert self._body is not None
        if not len(points.axis):
            return np.zeros(0, bool)
        position, speed = points.position, self.config.speed_scale * np.minimum(points.speed, 5.0)
        z = np.where(np.isfinite(position[:, 2]), position[:, 2], self._body[2])
        feature = np.column_stack([position[:, :2], z, speed])
        seed = int((points.axis - points.depth + speed).argmax())
        labels, _ = kmeans(feature, np.stack([np.append(self._body, 0.0), feature[seed]]))
        found = (labels == 1) & points.owned & ~self._is_body(points)
        return found if np.count_nonzero(found) >= self.config.find_points else np.zeros(len(found), bool)

    def _restart(self, position: Float64Array, weight: Float64Array) -> None:
        """Set the filter on newly found points, at rest."""
        assert self._body is not None
        z = position[:, 2]
        known = np.isfinite(z)
        height = float(np.average(z[known], weights=weight[known])) if known.any() else float(self._body[2])
        start = np.average(position[:, :2], axis=0, weights=weight)
        self._mean = np.array([start[0], start[1], height, 0.0, 0.0, 0.0])
        self._covariance = np.diag(np.repeat(np.square(_START_STD), 3))

    def _correct(self, position: Float64Array, weight: Float64Array, noise: Float64Array) -> None:
        """Kalman update with the weighted centroid; points farther out count more, for the hand is the arm's end."""
        assert self._mean is not None
        assert self._body is not None
        outward = self._mean[:2] - self._body[:2]
        along = (position[:, :2] - self._body[:2]) @ outward / max(float(np.hypot(*outward)), 1e-3)
        share = weight * np.exp((along - along.max()) / self.config.hand_length)
        share = share / share.sum()
        effective = 1.0 / float((share**2).sum())
        centroid, variance = np.empty(3), np.empty(3)
        for axis in range(3):
            known = np.isfinite(position[:, axis])
            total = float(share[known].sum())
            if total <= 0:
                centroid[axis], variance[axis] = self._body[2], _ASSUMED_Z_STD**2
                continue
            part, value = share[known] / total, position[known, axis]
            centroid[axis] = part @ value
            spread = float(part @ (value - centroid[axis]) ** 2) + float(part @ noise[known] ** 2)
            variance[axis] = self.config.position_std**2 + spread / effective
        self._mean, self._covariance = update(self._mean, self._covariance, centroid, np.diag(variance))

    def _hold_within_reach(self) -> None:
        """Keep the estimate within an arm's length of the body's axis: beyond, it loses its outward speed."""
        if self._mean is None or self._body is None:
            return
        offset = self._mean[:2] - self._body[:2]
        distance = math.hypot(*offset)
        if distance > self.config.reach:
            out = offset / distance
            self._mean[:2] = self._body[:2] + out * self.config.reach
            self._mean[3:5] -= out * max(0.0, float(out @ self._mean[3:5]))

    def _publish(self, tracked: TrackedCloud, n_points: int, *, active: bool) -> HandTrack:
        """Make the result."""
        assert self._mean is not None
        assert self._parent is not None
        return HandTrack(
            stamp_ns=tracked.cloud.stamp_ns,
            sequence=tracked.cloud.sequence,
            frame_id=tracked.cloud.frame_id,
            parent_id=self._parent,
            active=active,
            n_points=n_points,
            unseen=(tracked.cloud.stamp_ns - self._seen_ns) * _NANOSECOND,
            position=self._mean[:3].copy(),
            velocity=self._mean[3:].copy(),
            covariance=self._covariance.copy(),
            value=self._value(),
        )

    def _value(self) -> float:
        """Map the hand's offset from the body to 0..1."""
        assert self._mean is not None
        body = self._mean[:3] if self._body is None else self._body
        offset = self._mean[:3] - body
        length = {"height": offset[2], "lateral": offset[1], "reach": math.hypot(offset[0], offset[1])}[self.config.value_axis]
        return float(np.clip((length - self.config.value_low) / (self.config.value_high - self.config.value_low), 0.0, 1.0))


def _distance(track: Track, tracked: TrackedCloud) -> float:
    """Distance of a track from the radar: by what its points measured, else from the room's origin [m]."""
    measured = tracked.cloud.range[tracked.tracks.point_track_id == track.id]
    measured = measured[np.isfinite(measured)]
    return float(np.median(measured)) if len(measured) else float(np.hypot(*track.position[:2]))
