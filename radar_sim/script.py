"""Scripts to timelines: what a person does at a time, and where body and hand then are."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass

import numpy as np

from radar_core import GESTURES, ConfigError
from radar_sim.arm import REACH, bend
from radar_sim.motion import (
    CENTRE,
    DRAW_LENGTH,
    REST,
    STROKES,
    Path,
    Vector,
    cruise,
    draw_position,
    line,
    minimum_jerk,
    random_stroke,
)
from radar_sim.scene import GESTURE_DURATION, Action, Draw, Person

MOVE_SPEED = (0.55, 0.9)
"""Top speeds between gestures [m/s]: of hand and elbow forward or back, and of the hand altogether. A radar that the person faces sees
less than 0.7 m/s of it: not the 0.8 m/s that make an event (thesis, section 4.2)."""
MOVE_EDGE = 0.3
"""Share of such a move in which the hand speeds up, and again slows down."""
HURRY = 0.15
"""Share of the time of such a move that can be saved to keep a step's ``at``."""
PAUSE = 0.35
"""The hand is still that long before and after a stroke [s], so that each stroke is an event of its own."""
RAMP = 0.4
"""A walk starts and stops within that time [s]."""
_TURN = 0.8  # s: from standing to walking direction and back
_SETTLE = 0.1  # s: stillness before drawing
_STRIDE = 1.4  # m: two steps


@dataclass(frozen=True)
class Segment:
    """One thing a person does.

    Attributes
    ----------
    kind : str
        walk, stand, move (the hand, slowly), gesture or draw.
    start, end : float
        Scene time [s].
    here, there : tuple of float
        (x, y) at start and end [m].
    hand : Path
        Of the acting hand, for u = 0..1 over the segment.
    gesture : int or None
        Index into `GESTURES`.
    index : int
        Counts the gestures of this person.
    """

    kind: str
    start: float
    end: float
    here: tuple[float, float]
    there: tuple[float, float]
    hand: Path
    gesture: int | None = None
    index: int = 0


@dataclass(frozen=True)
class Stance:
    """A person at one time: (x, y) [m], heading [rad], phase of the gait [rad], its strength 0..1, acting hand in units of the reach."""

    x: float
    y: float
    heading: float
    phase: float
    gait: float
    hand: Vector


class Timeline:
    """A person's script laid out in time.

    Parameters
    ----------
    person : Person
        Who.
    seed : int
        Of the scene; strokes differ by `Person.jitter`.
    radar : tuple of float
        (x, y) of what the person faces unless `Person.heading` says otherwise [m].

    Raises
    ------
    ConfigError
        When a step cannot start at its ``at``.
    """

    def __init__(self, person: Person, seed: int, radar: tuple[float, float] = (0.0, 0.0)) -> None:
        self.person = person
        self.segments: list[Segment] = []
        self._reach = REACH * person.height
        self._radar = radar
        self._rng = np.random.default_rng([seed, person.id, 0xA12])
        self._here = person.position
        self._hand: Vector = REST
        self._time = 0.0
        self._count = 0
        for number, action in enumerate(person.script):
            self._add(number, action)
        self._move(REST)
        self._starts = [s.start for s in self.segments]

    @property
    def end(self) -> float:
        """When the script is over and the arm hangs again [s]."""
        return self._time

    def at(self, time: float) -> Segment | None:
        """Return what is being done; None: the script is over or empty."""
        row = bisect.bisect_right(self._starts, time) - 1
        return self.segments[row] if row >= 0 and time < self.segments[row].end else None

    def stance(self, time: float) -> Stance:
        """Where body and hand are."""
        s = self.at(time)
        if s is None:
            return Stance(*self._here, self._facing(*self._here), 0.0, 0.0, self._hand)
        u = (time - s.start) / (s.end - s.start)
        hand = s.hand(u)
        if s.kind != "walk":
            return Stance(*s.here, self._facing(*s.here), 0.0, 0.0, hand)
        done, gait = cruise(u, RAMP / (s.end - s.start))
        dx, dy = s.there[0] - s.here[0], s.there[1] - s.here[1]
        x, y = s.here[0] + done * dx, s.here[1] + done * dy
        phase = 2 * math.pi * done * math.hypot(dx, dy) / _STRIDE
        return Stance(x, y, self._heading(time, s, math.atan2(dy, dx)), phase, gait, hand)

    def _facing(self, x: float, y: float) -> float:
        """Heading while standing."""
        return math.atan2(self._radar[1] - y, self._radar[0] - x) if self.person.heading is None else self.person.heading

    def _heading(self, time: float, s: Segment, along: float) -> float:
        """Turn smoothly into the walk and out of it."""
        turn = min(_TURN, (s.end - s.start) / 2)
        start, end = self._facing(*s.here), self._facing(*s.there)
        # Nobody turns round fully for a short step.
        along = start + min(1.0, math.dist(s.here, s.there) / _STRIDE) * _wrap(along - start)
        before, after = _wrap(start - along), _wrap(end - along)
        return along + before * (1 - minimum_jerk((time - s.start) / turn)) + after * minimum_jerk((time - s.end + turn) / turn)

    def _add(self, number: int, action: Action) -> None:
        where = f"person {self.person.id}, step {number + 1} of the script"
        if action.walk is not None:
            self._walk(action, where)
        elif action.stand is not None:
            self._wait(action.at, 0.0, where)
            lowers = action.stand >= self._move_time(REST)
            self._push("stand", action.stand, line(self._hand, REST if lowers else self._hand))
        elif action.gesture is not None:
            self._gesture(action, action.gesture, where)
        elif action.draw is not None:
            path = self._drawing(action.draw)
            self._prepare(action.at, path(0.0), _SETTLE, where)
            self._push("draw", action.draw.duration, path)
            self._push("stand", PAUSE, line(self._hand, self._hand))

    def _push(self, kind: str, duration: float, hand: Path, there: tuple[float, float] | None = None, gesture: int | None = None) -> None:
        if duration <= 0.0:
            return
        end = self._time + duration
        self.segments.append(Segment(kind, self._time, end, self._here, there or self._here, hand, gesture, self._count))
        self._here, self._hand, self._time = there or self._here, hand(1.0), end

    def _wait(self, at: float | None, lead: float, where: str) -> None:
        """Stand until ``lead`` before ``at``."""
        if at is None:
            return
        spare = at - lead - self._time
        if spare < -1e-6:
            raise ConfigError(
                f"{where} cannot start at {at:g} s: what comes before and bringing the hand into place take until {at - spare:.2f} s; "
                "start it then or later, or leave out 'at'"
            )
        self._push("stand", spare, line(self._hand, self._hand))

    def _move_time(self, to: Vector) -> float:
        """Time to bring the hand there slowly: while the arm folds, the elbow may be faster than the hand."""
        path = np.linspace(self._hand, to, 33)
        hand, elbow = bend(path, -1.0)
        forward = max(float(np.abs(np.diff(joint[:, 0])).max()) for joint in (hand, elbow)) * 32
        slowest = max(forward / MOVE_SPEED[0], math.dist(self._hand, to) / MOVE_SPEED[1])
        return slowest * self._reach / (1 - MOVE_EDGE)

    def _move(self, to: Vector, duration: float | None = None) -> None:
        straight = line(self._hand, to, lambda u: cruise(u, MOVE_EDGE)[0])
        self._push("move", self._move_time(to) if duration is None else duration, straight)

    def _prepare(self, at: float | None, first: Vector, pause: float, where: str) -> None:
        """Bring the hand slowly to where a stroke begins, in time for ``at``, and hold it still."""
        needed = self._move_time(first)
        left = math.inf if at is None else at - self._time - pause
        hurried = max(min(needed, left), (1 - HURRY) * needed)
        self._wait(at, hurried + pause, where)
        self._move(first, hurried)
        self._push("stand", pause, line(first, first))

    def _walk(self, action: Action, where: str) -> None:
        assert action.walk is not None
        self._wait(action.at, 0.0, where)
        distance = math.dist(self._here, action.walk.to)
        duration = max(distance / action.walk.speed + RAMP, 2 * RAMP)
        if self._move_time(REST) > duration:
            self._move(REST)
        self._push("walk", duration, line(self._hand, REST), action.walk.to)

    def _gesture(self, action: Action, name: str, where: str) -> None:
        path = self._stroke(action, name)
        self._prepare(action.at, path(0.0), PAUSE, where)
        self._push("gesture", action.duration or GESTURE_DURATION[name], path, gesture=GESTURES.index(name))
        self._count += 1
        self._push("stand", PAUSE, line(self._hand, self._hand))

    def _stroke(self, action: Action, name: str) -> Path:
        """One performance of a gesture: sized, tilted, and a little different every time."""
        if self.person.arm == "left":  # the path is mirrored later; left and right stay the user's own
            name = {"swipe_left": "swipe_right", "swipe_right": "swipe_left"}.get(name, name)
        rng, jitter = self._rng, self.person.jitter / self._reach
        (ox, oy, oz), (bx, by, bz) = (rng.normal(size=(2, 3)) * jitter).tolist()
        warp = float(np.clip(rng.normal() * 4 * jitter, -0.3, 0.3))
        path = random_stroke(rng) if name == "random" else STROKES[name]
        cosine, sine = action.size * math.cos(action.tilt), action.size * math.sin(action.tilt)
        cx, cy, cz = CENTRE

        def stroke(u: float) -> Vector:
            x, y, z = path(u + warp * math.sin(2 * math.pi * u) / (2 * math.pi))
            bend = math.sin(math.pi * u) ** 2
            y, z = cosine * (y - cy) - sine * (z - cz), sine * (y - cy) + cosine * (z - cz)
            return (cx + action.size * (x - cx) + ox + bend * bx, cy + y + oy + bend * by, cz + z + oz + bend * bz)

        return stroke

    def _drawing(self, draw: Draw) -> Path:
        """Path of rounds along the shape, started and stopped within half a second."""
        size, ramp = draw.size / self._reach, min(0.5 / draw.duration, 0.5)
        rounds = draw.speed * (draw.duration - ramp * draw.duration) / (draw.size * DRAW_LENGTH[draw.shape])

        def path(u: float) -> Vector:
            return draw_position(draw.shape, 2 * math.pi * rounds * cruise(u, ramp)[0], size)

        return path


def _wrap(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi
