"""Hand tracking: split a person's points into body and hand, then follow the hand (thesis, 7.3)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from radar_core import DataError, RadarInfo
from radar_core.types import BoolArray, Float64Array
from radar_tracking.estimators.base import Belief
from radar_tracking.estimators.make import make_estimator
from radar_tracking.hand.candidates import Candidates, candidates, gate, split
from radar_tracking.hand.config import HandConfig, ValueConfig
from radar_tracking.hand.measure import HandMeasurement, HandMeter
from radar_tracking.tracks import HandTrack, Track, TrackedCloud

_NANOSECOND = 1e-9
_STANDING = (2.0, 2.0, 30.0)  # s: time in which the body follows 63 % of the way to the track; its height does not change
_LEASH = 0.4  # m: no farther behind
_LATELY = 0.3  # s: time constant of the place where the hand was lately
_PATIENCE = 2.0  # s: so long somebody may still be unknown who stands there when the hand is to be followed


class ControlValue:
    """Maps the hand's place to 0..1; small movements either way change nothing (hysteresis), so that a resting hand gives a constant."""

    def __init__(self, config: ValueConfig) -> None:
        self._config = config
        self._origin: Float64Array | None = None
        self._value: float | None = None

    def process(self, hand: Float64Array, body: Float64Array) -> float:
        """Take in where the hand and the body are, shapes (3,) and (3,) in ``room`` [m]; return the value."""
        config = self._config
        if self._origin is None:
            self._origin = hand.copy()
        x, y, z = (hand - (body if config.origin == "body" else self._origin)).tolist()
        if config.axis == "reach":
            x, y, z = (hand - body).tolist()
            start = self._origin - body if config.origin == "start" else np.zeros(3)
            length = math.hypot(x, y) - float(np.hypot(start[0], start[1]))
        else:
            length = z if config.axis == "height" else y
        new = min(max((length - config.low) / (config.high - config.low), 0.0), 1.0)
        last = self._value if self._value is not None else new
        moved = last + max(0.0, new - last - config.hysteresis) - max(0.0, last - new - config.hysteresis)
        self._value = new if new in (0.0, 1.0) else moved
        return self._value


class HandTracker:
    """Follow one hand of one person and give an analogue value.

    Idle until `start` or a trigger `gesture`. Then the points of that person are split by k-means into body and hand, the estimator
    follows the hand, and one `HandTrack` comes with every cloud until the hand is lost or `stop` is called; the last one says
    ``active=False``. Commands take effect by their stamps and the clouds' stamps alone.

    Parameters
    ----------
    config : HandConfig or None
        Knobs; None: all defaults.
    info : RadarInfo or None
        The radar, for clouds that do not say themselves where their sensors stand (composites do); None: it stands at the room's origin.
    """

    def __init__(self, config: HandConfig | None = None, info: RadarInfo | None = None) -> None:
        self.config = config or HandConfig()
        self._origin = np.zeros(3)
        if info is not None:
            self.seen_from(info)
        self._estimator = make_estimator(self.config.estimator, 3)
        self._meter = HandMeter(self.config)
        self._lasting = np.diag(np.repeat([self.config.bias_std**2, 0.0], 3))
        self.reset()

    def reset(self) -> None:
        """Forget everything, pending commands too. For a new recording."""
        self._pending: list[tuple[int, str, int | None]] = []
        self._waits_until: int | None = None  # a start that found nobody waits for somebody until then [ns]
        self._parent: int | None = None
        self._body = np.zeros(3)
        self._value = ControlValue(self.config.value)
        self._belief: Belief | None = None
        self._measured: HandMeasurement | None = None
        self._seen_ns = 0
        self._rests = False
        self._lately: Float64Array | None = None
        self._stamp_ns: int | None = None

    def seen_from(self, info: RadarInfo) -> None:
        """Set where the sensor stands, for clouds that do not say it."""
        self._origin = np.asarray(info.mount.origin, np.float64)

    @property
    def active(self) -> bool:
        """True while a hand is followed or looked for."""
        return self._parent is not None

    @property
    def measured(self) -> HandMeasurement | None:
        """Measurement from the last cloud; None: there was none."""
        return self._measured

    def start(self, track_id: int | None, stamp_ns: int) -> None:
        """Follow the hand of a person from the first cloud at or after ``stamp_ns`` [ns] + `trigger_delay`.

        ``track_id`` None: of the confirmed track nearest to the radar; where there is none, of the first one within two seconds.
        """
        self._queue(stamp_ns, "start", track_id)

    def stop(self, stamp_ns: int | None = None) -> None:
        """End the hand track with the next cloud, or with the first at or after ``stamp_ns`` [ns] + `trigger_delay`."""
        if stamp_ns is None:
            self._pending.append((-1, "stop", None))
        else:
            self._queue(stamp_ns, "stop", None)

    def gesture(self, name: str, track_id: int, stamp_ns: int) -> None:
        """Tell that the person of a track performed a gesture, one of `GESTURES`, decided at ``stamp_ns`` [ns].

        The trigger gesture starts (or with `toggle` also ends) the hand track.
        """
        if name and name == self.config.trigger:
            self._queue(stamp_ns, "trigger", track_id)

    def _queue(self, stamp_ns: int, action: str, track_id: int | None) -> None:
        self._pending.append((stamp_ns + round(self.config.trigger_delay / _NANOSECOND), action, track_id))

    def process(self, tracked: TrackedCloud) -> HandTrack | None:
        """Take in one cloud with its tracks; None: there is no hand (yet).

        Raises
        ------
        DataError
            When the cloud is older than the one before or not in ``room``.
        """
        stamp_ns = tracked.cloud.stamp_ns
        if tracked.cloud.frame_id != "room":
            raise DataError(f"hand tracking needs clouds in 'room', this one is in {tracked.cloud.frame_id!r}")
        if self._stamp_ns is not None and stamp_ns < self._stamp_ns:
            number = tracked.cloud.sequence
            raise DataError(f"cloud {number} is older than the one before; reset() the hand tracker before another recording")
        dt = 0.0 if self._stamp_ns is None else (stamp_ns - self._stamp_ns) * _NANOSECOND
        self._stamp_ns, self._measured = stamp_ns, None
        ended = self._apply_commands(tracked)
        if self._parent is None:
            return ended
        parent = tracked.tracks.find(self._parent)
        if parent is not None:
            self._stand(parent.position, dt)
        n_points = self._follow(tracked, dt)
        unseen = (stamp_ns - self._seen_ns) * _NANOSECOND
        waits = self._rests and parent is not None and parent.unseen < unseen  # somebody is there whose hand may rest
        if unseen > (self.config.rest_after if waits else self.config.lost_after) + 0.5 * _NANOSECOND:
            return self._end(tracked)
        return ended if self._belief is None else self._publish(tracked, n_points, active=True)

    def _apply_commands(self, tracked: TrackedCloud) -> HandTrack | None:
        """Carry out the commands that are due, in the order of their stamps; return the last message of a hand track they end."""
        due = sorted((c for c in self._pending if c[0] <= tracked.cloud.stamp_ns), key=lambda c: c[0])
        self._pending = [c for c in self._pending if c[0] > tracked.cloud.stamp_ns]
        ended = None
        for asked_ns, action, track_id in due:
            self._waits_until = None
            if action == "stop" or (action == "trigger" and self.active and self.config.toggle and track_id == self._parent):
                ended = self._end(tracked) or ended
            elif action == "start" or not self.active:
                ended = self._end(tracked) or ended
                self._begin(track_id, tracked)
                if track_id is None and not self.active:
                    self._waits_until = asked_ns + round(_PATIENCE / _NANOSECOND)
        if self._waits_until is not None and tracked.cloud.stamp_ns <= self._waits_until:
            self._begin(None, tracked)
        return ended

    def _begin(self, track_id: int | None, tracked: TrackedCloud) -> None:
        """Choose the person; the hand itself is found by `_follow`."""
        people = list(tracked.tracks.people)
        if track_id is None and people:
            track_id = min(people, key=lambda t: _distance(t, tracked)).id
        parent = None if track_id is None else tracked.tracks.find(track_id)
        if parent is not None:
            self._parent, self._body, self._seen_ns = parent.id, parent.position, tracked.cloud.stamp_ns
            self._waits_until = None
            self._value = ControlValue(self.config.value)

    def _end(self, tracked: TrackedCloud) -> HandTrack | None:
        """Become idle; return the closing message if a hand was ever found."""
        last = None if self._belief is None else self._publish(tracked, 0, active=False)
        self._parent, self._belief = None, None
        return last

    def _follow(self, tracked: TrackedCloud, dt: float) -> int:
        """Predict, then update with the points of the hand; return how many there are."""
        config, stamp_ns = self.config, tracked.cloud.stamp_ns
        assert self._parent is not None
        unseen = (stamp_ns - self._seen_ns) * _NANOSECOND
        points = candidates(tracked, self._parent, self._body, self._origin, config)
        if self._belief is not None and dt > 0:
            self._predict(min(dt, 1.0 + config.lost_after), unseen > dt)
        own = np.zeros(len(points), np.bool_) if self._belief is None else self._gate(points)
        if not own.any() and (self._belief is None or unseen > config.reacquire_after):
            own = self._find(points)
        if own.any():
            self._correct(points.select(own))
            self._seen_ns = stamp_ns
            self._settle(dt)
        self._hold_within_reach()
        return int(np.count_nonzero(own))

    def _find(self, points: Candidates) -> BoolArray:
        """Look for the hand anywhere within reach; one that was followed is elsewhere only if what is found moves: it had to get there."""
        config = self.config.split
        own = split(points, self._body, config)
        if not own.any():
            return own
        least = config.find_speed if self._rests else config.body_speed
        if self._belief is not None and float(np.median(points.speed[own])) < least:
            return np.zeros(len(points), np.bool_)
        self._belief = None
        return own

    def _stand(self, place: Float64Array, dt: float) -> None:
        """Move the body after the person's track, slowly while that is near: an arm that draws pulls the track to and fro."""
        self._body = self._body + (place - self._body) * (1.0 - np.exp(-dt / np.array(_STANDING)))
        away = place[:2] - self._body[:2]
        distance = float(np.hypot(*away))
        if distance > _LEASH:
            self._body[:2] = place[:2] - away * (_LEASH / distance)

    def _predict(self, dt: float, unseen: bool) -> None:
        """Move the hand on; one that is not seen slows down, and one that rested stays where it is, as sure as before."""
        assert self._belief is not None
        if unseen and self._rests:
            return
        belief = self._estimator.predict(self._belief, dt)
        if unseen:
            mean = belief.mean.copy()
            mean[..., 3:6] *= math.exp(-dt / self.config.damping)
            belief = replace(belief, mean=mean)
        self._belief = belief

    def _gate(self, points: Candidates) -> BoolArray:
        mean, covariance = self._kinematics()
        return gate(points, self._body, mean[:3], covariance[:3, :3], self.config.extent, self._rests, self.config.split)

    def _correct(self, points: Candidates) -> None:
        """Take in the points of the hand; begin anew with them when there is no hand yet."""
        mean = None if self._belief is None else self._kinematics()[0]
        near, speed = (_middle(points, self._body[2]), None) if mean is None else (mean[:3], float(np.linalg.norm(mean[3:])))
        self._measured = self._meter.process(points, self._body, near, speed)
        if self._belief is None:
            self._belief, self._lately = self._estimator.start(self._measured.state, self.config.start_speed), None
        self._belief, _ = self._estimator.update(self._belief, self._measured.state)

    def _settle(self, dt: float) -> None:
        """Judge whether the hand rests: it is slow, or has been near one place lately, which is surer where its velocity is not."""
        mean = self._kinematics()[0]
        if self._lately is None:
            self._lately = mean[:3].copy()
        self._lately += (mean[:3] - self._lately) * (1.0 - math.exp(-dt / _LATELY))
        lag = float(np.linalg.norm(mean[:3] - self._lately))  # of one that moves steadily: speed times the time constant
        self._rests = min(float(np.linalg.norm(mean[3:])), lag / _LATELY) < self.config.rest_speed

    def _kinematics(self) -> tuple[Float64Array, Float64Array]:
        """Mean (6,) and covariance (6, 6) of position and velocity."""
        assert self._belief is not None
        mean, covariance = self._estimator.kinematics(self._belief)
        return mean[0], covariance[0]

    def _hold_within_reach(self) -> None:
        """Keep the estimate within an arm's length of the body's axis: beyond, it loses its outward speed."""
        if self._belief is None:
            return
        mean = self._belief.mean
        offset = mean[..., :2] - self._body[:2]
        distance = np.hypot(offset[..., 0], offset[..., 1])
        if not (distance > self.config.split.reach).any():
            return
        held, out = mean.copy(), offset / np.maximum(distance, 1e-9)[..., None]
        far = distance > self.config.split.reach
        outward = np.maximum((out * mean[..., 3:5]).sum(-1), 0.0)
        held[..., :2] = np.where(far[..., None], self._body[:2] + out * self.config.split.reach, mean[..., :2])
        held[..., 3:5] -= np.where(far, outward, 0.0)[..., None] * out
        self._belief = replace(self._belief, mean=held)

    def _publish(self, tracked: TrackedCloud, n_points: int, *, active: bool) -> HandTrack:
        """Make the result."""
        assert self._parent is not None
        mean, covariance = self._kinematics()
        told = None if self._measured is None else self._measured.snapshot
        return HandTrack(
            stamp_ns=tracked.cloud.stamp_ns,
            sequence=tracked.cloud.sequence,
            frame_id=tracked.cloud.frame_id,
            parent_id=self._parent,
            active=active,
            n_points=n_points,
            unseen=(tracked.cloud.stamp_ns - self._seen_ns) * _NANOSECOND,
            position=mean[:3].copy(),
            velocity=mean[3:].copy(),
            covariance=covariance + self._lasting,
            value=self._value.process(mean[:3], self._body),
            velocity_rank=0 if told is None else told.rank,
            velocity_condition=math.inf if told is None else told.condition,
            outliers=0 if told is None else told.outliers,
        )


def _middle(points: Candidates, height: float) -> Float64Array:
    """Mean of points, weighted by amplitude, shape (3,) [m]; those without z have the given height."""
    position = np.where(np.isnan(points.position), height, points.position)
    return np.asarray(np.average(position, axis=0, weights=points.amplitude))


def _distance(track: Track, tracked: TrackedCloud) -> float:
    """Distance of a track from the radar: by what its points measured, else from the room's origin [m]."""
    measured = tracked.cloud.range[tracked.tracks.point_track_id == track.id]
    measured = measured[np.isfinite(measured)]
    return float(np.median(measured)) if len(measured) else float(np.hypot(*track.position[:2]))
