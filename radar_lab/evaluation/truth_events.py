"""When a performed gesture was fast enough to be found, from the true motion of the hand (thesis, section 4.2)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from radar_core import NO_GESTURE, DataError, Pose
from radar_core.config import config, knob
from radar_core.types import Float64Array, IndexArray
from radar_sim.truth import Truth


@config
class CriterionConfig:
    """When the hand of a performed gesture is fast enough for an event."""

    threshold: float = knob(0.8, unit="m/s", low=0.0, high=20.0, doc="true radial speed of the hand, either sign, above which it is fast")
    duration: float = knob(0.2, unit="s", low=0.0, high=10.0, doc="it has to be fast for so long without a break")


@dataclass(frozen=True)
class TrueEvent:
    """A performed gesture as its radial speed shows it."""

    # person_id, label: who; index into `GESTURES`
    person_id: int
    label: int
    # start_ns, end_ns: first and last moment at which it was being performed [ns]
    start_ns: int
    end_ns: int
    # first_ns, last_ns: first and last crossing of the threshold [ns]; equal to ``start_ns`` and ``end_ns`` when the hand was never fast
    first_ns: int
    last_ns: int
    # fast, fast_total: longest time without a break above the threshold, and all such times together [s]; 0: never
    fast: float
    fast_total: float
    peak: float  # largest radial speed, without its sign [m/s]
    meets: bool  # whether the hand was fast for as long as `CriterionConfig.duration` asks


def radial_speed(position: Float64Array, velocity: Float64Array, sensor: Float64Array) -> Float64Array:
    """Compute the range rate of moving points, as a radar would measure it: positive = receding, 0 for a point at the sensor itself.

    Parameters
    ----------
    position, velocity : ndarray, shape (..., 3)
        In ``room`` [m], [m/s].
    sensor : ndarray, shape (3,)
        Where the radar is, in ``room`` [m].
    """
    away = np.asarray(position, np.float64) - np.asarray(sensor, np.float64)
    distance = np.linalg.norm(away, axis=-1)
    along = (away * np.asarray(velocity, np.float64)).sum(axis=-1)
    return np.asarray(np.divide(along, distance, out=np.zeros_like(along), where=distance != 0))


def fast_times(stamp_ns: IndexArray, speed: Float64Array, threshold: float) -> list[tuple[float, float]]:
    """Find from when to when [ns] a speed, sampled and straight in between, is above a threshold, whatever its sign.

    Two neighbouring samples above count as one time also where their signs differ: an event detector sees no pause there either. What
    begins or ends with the samples does so at the first or last of them.

    Parameters
    ----------
    stamp_ns : ndarray of int64, shape (n,)
        Ascending [ns].
    speed : ndarray, shape (n,)
        [m/s], as is the threshold.
    """
    above = np.abs(speed) > threshold
    edge = np.flatnonzero(np.diff(np.concatenate([[False], above, [False]]).astype(np.int8)))
    last = len(stamp_ns) - 1

    def crossing(inside: int, outside: int) -> float:
        if not 0 <= outside <= last:
            return float(stamp_ns[inside])
        sign = np.sign(speed[inside])
        high, low = sign * speed[inside], sign * speed[outside]
        share = (high - threshold) / (high - low)
        return float(stamp_ns[inside] + share * (stamp_ns[outside] - stamp_ns[inside]))

    return [(crossing(int(a), int(a) - 1), crossing(int(b) - 1, int(b))) for a, b in zip(edge[::2], edge[1::2], strict=True)]


class TrueEvents:
    """Reads from the truth when each performed gesture was fast, as seen from where the radar stands."""

    def __init__(self, config: CriterionConfig, mount: Pose) -> None:
        self.config, self._sensor = config, np.asarray(mount.origin, np.float64)

    def process(self, truths: Iterable[Truth]) -> tuple[TrueEvent, ...]:
        """Take the truth of a stretch of time, in order, and return its gestures, ordered by start, then person.

        Only frames in which a gesture is performed count, so a gesture that reaches beyond the stretch is judged by its part in it. Raises
        `DataError` when a hand that gestures has a place or speed that is not finite, or time does not go forward within a gesture.
        """
        rows: dict[tuple[int, int], list[tuple[Truth, int]]] = {}
        for truth in truths:
            for row in np.flatnonzero(truth.gesture != NO_GESTURE).tolist():
                rows.setdefault((int(truth.person_id[row]), int(truth.gesture_index[row])), []).append((truth, row))
        events = [self._event(person, own) for (person, _), own in rows.items()]
        return tuple(sorted(events, key=lambda event: (event.start_ns, event.person_id)))

    def _event(self, person: int, own: Sequence[tuple[Truth, int]]) -> TrueEvent:
        stamps = np.array([truth.stamp_ns for truth, _ in own], np.int64)
        position = np.array([truth.hand_position[row] for truth, row in own], np.float64)
        velocity = np.array([truth.hand_velocity[row] for truth, row in own], np.float64)
        where = f"truth of person {person} at {stamps[0] * 1e-9:.2f} s"
        if not (np.isfinite(position).all() and np.isfinite(velocity).all()):
            raise DataError(f"{where}: the hand has a place or speed that is not finite; leave this person or stretch of time out")
        if (np.diff(stamps) <= 0).any():
            raise DataError(f"{where}: stamps do not ascend; give the truth of one run, in order of time")
        speed = radial_speed(position, velocity, self._sensor)
        times = fast_times(stamps, speed, self.config.threshold)
        lengths = [(end - start) * 1e-9 for start, end in times]
        longest = max(lengths, default=0.0)
        truth, row = own[0]
        return TrueEvent(
            person_id=person,
            label=int(truth.gesture[row]),
            start_ns=int(stamps[0]),
            end_ns=int(stamps[-1]),
            first_ns=round(times[0][0]) if times else int(stamps[0]),
            last_ns=round(times[-1][1]) if times else int(stamps[-1]),
            fast=longest,
            fast_total=sum(lengths),
            peak=float(np.abs(speed).max()),
            meets=bool(times) and longest >= self.config.duration,
        )
