"""Scripts to timelines: what a person does at a time, and where body and hand then are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES
from radar_sim.motion import PATHS, READY, REST, Path, draw_path, minimum_jerk
from radar_sim.scene import GESTURE_DURATION, Action, Person

Float64Array = NDArray[np.float64]
_MOVE_SPEED = 0.55  # m/s: peak of the hand's slow moves between gestures, below the event threshold of 0.8 m/s
_PAUSE = 0.35  # s of stillness before and after a stroke, so that each is an event of its own
ARM = 0.345  # length of arm and half a hand over stature (Drillis-Contini)


@dataclass(frozen=True)
class Segment:
    """One thing a person does from ``start`` to ``end`` [s]."""

    kind: str
    start: float
    end: float
    here: tuple[float, float]
    there: tuple[float, float]
    hand_from: Float64Array
    hand_to: Float64Array
    action: Action | None = None
    index: int = 0
    bend: Float64Array | None = None


class Timeline:
    """A person's script laid out in time.

    Parameters
    ----------
    person : Person
        Who.
    seed : int
        Of the scene; strokes differ by `Person.jitter`.
    """

    def __init__(self, person: Person, seed: int) -> None:
        self.person = person
        self.arm = ARM * person.height
        self._rng = np.random.default_rng([seed, person.id, 0xA12])
        self.segments: list[Segment] = []
        self._here = person.position
        self._hand = REST
        self._time = 0.0
        self._count = 0
        for action in person.script:
            self._add(action)
        self._starts = np.array([s.start for s in self.segments])

    def _push(self, kind: str, duration: float, hand_to: Float64Array, there: tuple[float, float] | None = None, **more: object) -> None:
        there = there or self._here
        end = self._time + duration
        self.segments.append(Segment(kind, self._time, end, self._here, there, self._hand, hand_to, **more))  # type: ignore[arg-type]
        self._here, self._hand, self._time = there, hand_to, end

    def _move(self, to: Float64Array) -> None:
        distance = float(np.linalg.norm(to - self._hand)) * self.arm
        if distance > 1e-6:
            self._push("move", 1.875 * distance / _MOVE_SPEED, to)  # 1.875: peak over mean speed of minimum jerk

    def _add(self, action: Action) -> None:
        if action.at is not None and action.at > self._time:
            self._push("stand", action.at - self._time, self._hand)
        if action.walk is not None:
            self._move(REST)
            distance = math.dist(self._here, action.walk)
            self._push("walk", max(distance / action.speed, 1e-3) + 0.4, REST, action.walk, action=action)
        elif action.stand is not None:
            self._push("stand", action.stand, self._hand)
        elif action.gesture is not None:
            self._stroke(action, action.gesture)
        elif action.draw is not None:
            start = draw_path(action.draw, np.zeros(1), action.size)[0]
            self._move(start)
            self._push("draw", action.duration or 6.0, start, action=action)

    def _stroke(self, action: Action, name: str) -> None:
        path = self._path(name)
        first, last = (READY + action.size * (path(np.array([u]))[0] - READY) for u in (0.0, 1.0))
        self._move(first)
        self._push("pause", _PAUSE, first)
        bend = self._rng.normal(size=3) * self.person.jitter / self.arm
        duration = action.duration or GESTURE_DURATION[name]
        self._push("gesture", duration, last, action=action, index=self._count, bend=bend)
        self._count += 1
        self._push("pause", _PAUSE, last)
        self._move(READY)

    def _path(self, name: str) -> Path:
        """Stroke of a right arm; a left arm mirrors it later, so that its swipes are those of the other direction here."""
        other = {"swipe_left": "swipe_right", "swipe_right": "swipe_left"}
        return PATHS[other.get(name, name) if self.person.arm == "left" else name]

    @property
    def end(self) -> float:
        """When the script is over [s]."""
        return self._time

    def at(self, time: float) -> Segment | None:
        """What is being done; None: the script is over or empty."""
        row = int(np.searchsorted(self._starts, time, side="right")) - 1
        return self.segments[row] if row >= 0 and time < self.segments[row].end else None

    def body(self, time: float) -> tuple[float, float, float, float]:
        """Place (x, y) [m], heading [rad] and walking phase [rad; 0 while standing]."""
        s = self.at(time)
        x, y = s.here if s else self._here
        phase, facing = 0.0, None
        if s and s.kind == "walk":
            u, distance = (time - s.start) / (s.end - s.start), math.dist(s.here, s.there)
            w = _cruise(u, 0.4 / (s.end - s.start))
            x, y = x + w * (s.there[0] - x), y + w * (s.there[1] - y)
            facing = math.atan2(s.there[1] - s.here[1], s.there[0] - s.here[0])
            phase = 2 * math.pi * w * distance / 1.4  # two steps of 0.7 m
        towards = self.person.heading if self.person.heading is not None else math.atan2(-y, -x)
        return x, y, self._turn(time, s, towards if facing is None else facing, towards), phase

    def _turn(self, time: float, s: Segment | None, facing: float, towards: float) -> float:
        """Turn smoothly from the walking direction to the standing one during the last 0.5 s of a walk."""
        if s is None or s.kind != "walk":
            return facing
        w = float(minimum_jerk(np.array([(time - s.end + 0.5) / 0.5]))[0])
        difference = (towards - facing + math.pi) % (2 * math.pi) - math.pi
        return facing + w * difference

    def hand(self, time: float) -> Float64Array:
        """Acting hand relative to its shoulder, (forward, left, up) [m], as of a right arm."""
        s = self.at(time)
        if s is None:
            return self._hand * self.arm
        u = np.array([(time - s.start) / (s.end - s.start)])
        if s.kind == "gesture" and s.action and s.action.gesture:
            path = READY + s.action.size * (self._path(s.action.gesture)(u)[0] - READY)
            assert s.bend is not None
            return (path + s.bend * math.sin(math.pi * float(u[0])) ** 2) * self.arm
        if s.kind == "draw" and s.action and s.action.draw:
            speed = s.action.tempo / (0.4 * s.action.size * self.arm)
            t = time - s.start
            ramp = t - 0.5 * math.tanh(t / 0.5)  # starts from rest
            fade = 1 - float(minimum_jerk(np.array([(time - s.end + 0.5) / 0.5]))[0])
            path = draw_path(s.action.draw, np.array([speed * ramp]), s.action.size)[0]
            return (s.hand_to + fade * (path - s.hand_to)) * self.arm
        return (s.hand_from + (s.hand_to - s.hand_from) * minimum_jerk(u)[:, None])[0] * self.arm

    def label(self, time: float) -> tuple[int | None, int]:
        """Index of the gesture being performed (None: none) and its count."""
        s = self.at(time)
        if s is None or s.kind != "gesture" or s.action is None or s.action.gesture is None:
            return None, 0
        return GESTURES.index(s.action.gesture), s.index


def _cruise(u: float, edge: float) -> float:
    """Ramp 0..1 with smooth start and stop, each taking the share ``edge`` of the time."""
    edge = min(max(edge, 1e-6), 0.5)
    u = min(max(u, 0.0), 1.0)
    flat = 1.0 / (1.0 - edge)
    if u < edge:
        return flat * u * u / (2 * edge)
    if u > 1 - edge:
        return 1.0 - flat * (1 - u) ** 2 / (2 * edge)
    return flat * (u - edge / 2)
