"""Walking and turning on the spot: feet that stand on the floor while the body passes over them, arms, pelvis and trunk.

A walk of length D is n steps of length d = D / n and one more that brings the feet side by side. Everything is a smooth function of the
way s that the body has gone, so it starts and stops with the body. The ankle of a step stands while the body goes from 0.36 d before it to
0.46 d after it (41 % of a stride of two steps), then lifts, heel first, and swings; feet overlap in that as they do in walking
(Murray 1967: double support of a fifth to a quarter of the cycle, in which the rear heel is already up).
"""

from __future__ import annotations

import bisect
import math

from radar_sim.bodies.base import LEG
from radar_sim.motions.carriage import ZERO, Carriage, turned
from radar_sim.motions.curves import Vector, cruise, minimum_jerk, window, wrap
from radar_sim.motions.strokes import REST

RAMP = 0.4
"""A walk starts and stops within that time [s]."""
STRIDE = 0.8
"""Length of two steps at 1 m/s over the stature: 1.4 m for 1.75 m."""
EASE = (0.0065, 0.065)
"""Ankle from the origin when standing at ease, forward and aside, over the stature."""
_TURN, _TURN_RATE = 0.8, 2.2  # s, rad/s: from standing to walking direction and back, at least that long and not faster
_FRONT, _REAR = 0.36, 0.46  # of a step: how far the body is before and after a standing ankle
_LIFT = 0.14  # of the leg: how high an ankle rises at a full step
_BENT = 0.008  # of the leg: nobody walks with straight knees
_DIP = 0.033  # of the leg per rad: turning while one foot still stands as it stood
_EVEN = 0.25  # of a step's time: the foot starts, and stops; in between it goes evenly, so that the leg never has to be longer than it is
_LEG, _ASIDE = 0.9, 0.48  # hip to ankle over the hip's height; how many steps beside the body a foot can be at the pelvis's lowest
_SWING = 0.34  # rad: arms at 1 m/s
_SHIFT = 0.022  # of the leg: pelvis over the standing foot
_TURN_SPEED = 1.6  # rad/s: mean, turning on the spot
_TURN_STEP = 0.6  # rad


def stride(speed: float, height: float) -> float:
    """Length of two steps [m]; it grows with the speed, as the cadence does."""
    return STRIDE * height * math.pow(speed, 0.4)


class Footsteps:
    """Where one foot is, in the room, over the progress of a way.

    Parameters
    ----------
    place : tuple of float
        (x, y) of its ankle before the first step [m].
    """

    def __init__(self, place: tuple[float, float]) -> None:
        self._place = self._last = place
        self._starts: list[float] = []
        self._steps: list[tuple[float, tuple[float, float], tuple[float, float], float]] = []

    def add(self, start: float, end: float, place: tuple[float, float], lift: float) -> None:
        """Step to a place while the progress goes from ``start`` to ``end``; ``lift`` is in legs."""
        self._starts.append(start)
        self._steps.append((end, self._last, place, lift))
        self._last = place

    def at(self, progress: float) -> Vector:
        """(x, y) in the room [m] and height over the floor [leg]."""
        row = bisect.bisect_right(self._starts, progress) - 1
        if row < 0:
            return (*self._place, 0.0)
        end, a, b, lift = self._steps[row]
        if progress >= end:
            return (*b, 0.0)
        u = (progress - self._starts[row]) / (end - self._starts[row])
        way, v = cruise(u, _EVEN)[0], 1.0 - u
        # Highest soon after the toes have left the floor; 198.9 makes that 1.
        return (a[0] + way * (b[0] - a[0]), a[1] + way * (b[1] - a[1]), lift * 198.9 * u**3 * v**5)


class Walking:
    """A walk in a straight line.

    Parameters
    ----------
    start : Carriage
        How the person stood before.
    to : tuple of float
        (x, y) where it goes [m].
    heading : float
        Where the person faces afterwards [rad].
    speed, duration : float
        Between the ramps [m/s], and of the whole walk [s].
    height : float
        Body height [m].
    """

    def __init__(self, start: Carriage, to: tuple[float, float], heading: float, speed: float, duration: float, height: float) -> None:
        self._start, self._duration, self._height, self._leg = start, duration, height, LEG * height
        dx, dy = to[0] - start.x, to[1] - start.y
        self._way, self._length = (dx, dy), math.hypot(dx, dy)
        # Nobody turns round fully for a short step.
        share = min(1.0, self._length / (STRIDE * height))
        self._along = start.heading + share * wrap(math.atan2(dy, dx) - start.heading)
        self._after = wrap(heading - self._along)
        turns = abs(self._along - start.heading), abs(self._after)
        self._turns = tuple(min(max(_TURN, turn / _TURN_RATE), duration / 2) for turn in turns)
        usual = 0.5 * stride(speed, height)
        self._n = max(1, round(self._length / usual))
        self._step = self._length / self._n
        self._full = min(1.0, self._step / (0.5 * STRIDE * height))  # strength of arms, bob and lift
        # The pelvis is as low as a leg that stands 0.44 steps before it needs.
        leg, aside = _LEG * self._leg, min(_ASIDE * self._step, 0.8 * self._leg)
        self._low = (leg - math.sqrt(leg * leg - aside * aside)) / self._leg + _BENT
        self._first = 0 if wrap(self._along - start.heading) >= 0 else 1  # the foot on the side of the turn
        self._feet = self._plan()

    @property
    def end(self) -> Carriage:
        """How the person stands afterwards."""
        x, y = self._start.x + self._way[0], self._start.y + self._way[1]
        return Carriage(x, y, self._along + self._after)

    def at(self, time: float) -> Carriage:
        """Body, feet and arms ``time`` seconds after the start."""
        u = time / self._duration
        done = cruise(u, RAMP / self._duration)[0]
        x, y = self._start.x + done * self._way[0], self._start.y + done * self._way[1]
        heading = self._heading(time)
        progress = done * self._length
        left, right = (_foot(f.at(progress), side, (x, y, heading), self._height) for f, side in zip(self._feet, (1.0, -1.0), strict=True))
        if self._step <= 0.0:
            return Carriage(x, y, heading, left, right)
        phase = math.pi * progress / self._step
        # Strength of all that swings: full before the first step is down, and until the last.
        on = window(progress, self._length, 0.5 * self._step) * self._full
        swing = _SWING * on * math.cos(phase - 0.55 * math.pi) * (-1.0 if self._first == 0 else 1.0)  # left arm forward: positive
        over = _SHIFT * on * math.cos(phase - math.pi) * (1.0 if self._first == 0 else -1.0)
        bob = self._dip(time) + on * self._low * (0.62 + 0.38 * math.cos(2 * phase + 0.94 * math.pi))
        trunk = (0.05 * on, 0.02 * on * math.cos(phase) * (1.0 if self._first == 0 else -1.0), -0.2 * swing)
        return Carriage(x, y, heading, left, right, (0.0, over, -bob), trunk, swings=(_swung(swing), _swung(-swing)))

    def _heading(self, time: float) -> float:
        """Turn smoothly into the walk and out of it."""
        before = self._start.heading - self._along
        into, out = minimum_jerk(time / self._turns[0]), minimum_jerk((time - self._duration) / self._turns[1] + 1.0)
        return self._along + before * (1 - into) + self._after * out

    def _dip(self, time: float) -> float:
        """How far the knees bend for turning [leg]."""
        into, out = self._turns
        before, after = min(abs(self._along - self._start.heading), 2.0), min(abs(self._after), 2.0)
        first = before * window(time, 1.25 * into, 0.5 * into)
        return _DIP * (first + after * window(self._duration - time, 1.25 * out, 0.5 * out))

    def _plan(self) -> tuple[Footsteps, Footsteps]:
        d, n = self._step, self._n
        x, y, height = self._start.x, self._start.y, self._height
        feet = tuple(Footsteps(_ankle((x, y, self._start.heading), side, height)) for side in (1.0, -1.0))
        if d > 0.0:
            for k in range(1, n + 2):
                foot = (self._first + k - 1) % 2
                begin = max((k - 2 + _REAR) * d, 0.0)
                down = min((k - _FRONT) * d, self._length)
                share = min(k / n, 1.0)
                # The foot points where the body faces when it passes over it.
                heading = self._heading(self._time(share))
                place = (x + share * self._way[0], y + share * self._way[1], heading)
                feet[foot].add(begin, down, _ankle(place, 1.0 - 2.0 * foot, height), _LIFT * self._full)
        return feet[0], feet[1]

    def _time(self, share: float) -> float:
        """When the body has done a share of the way [s]."""
        low, high = 0.0, self._duration
        for _ in range(30):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if cruise(middle / self._duration, RAMP / self._duration)[0] < share else (low, middle)
        return high


class Turning:
    """Turning on the spot with small steps.

    Parameters
    ----------
    start : Carriage
        How the person stood before.
    heading : float
        Where the person faces afterwards [rad].
    height : float
        Body height [m].
    """

    def __init__(self, start: Carriage, heading: float, height: float) -> None:
        self._start, self._angle, self._height = start, wrap(heading - start.heading), height
        n = 1 + max(1, math.ceil(abs(self._angle) / _TURN_STEP))
        self.duration = max(0.8, abs(self._angle) / _TURN_SPEED)
        place = start.x, start.y
        self._feet = tuple(Footsteps(_ankle((*place, start.heading), side, height)) for side in (1.0, -1.0))
        for k in range(1, n + 1):
            foot = (k - 1 + (self._angle < 0)) % 2
            goal = start.heading + self._angle * min(k / (n - 1), 1.0)
            self._feet[foot].add((k - 1) / n, k / n, _ankle((*place, goal), 1.0 - 2.0 * foot, height), 0.5 * _LIFT)

    @property
    def end(self) -> Carriage:
        """How the person stands afterwards."""
        return self._start._replace(heading=self._start.heading + self._angle)

    def at(self, time: float) -> Carriage:
        """Body and feet ``time`` seconds after the start."""
        u = time / self.duration
        heading = self._start.heading + self._angle * minimum_jerk(u)
        frame = (self._start.x, self._start.y, heading)
        left, right = (_foot(f.at(u), side, frame, self._height) for f, side in zip(self._feet, (1.0, -1.0), strict=True))
        return self._start._replace(heading=heading, left=left, right=right)


def walk_time(distance: float, speed: float) -> float:
    """How long a walk takes [s]."""
    return max(distance / speed + RAMP, 2 * RAMP)


def _ankle(frame: Vector, side: float, height: float) -> tuple[float, float]:
    """(x, y) in the room of an ankle at ease; ``frame`` is (x, y, heading)."""
    dx, dy = turned(EASE[0] * height, side * EASE[1] * height, frame[2])
    return frame[0] + dx, frame[1] + dy


def _foot(place: Vector, side: float, frame: Vector, height: float) -> Vector:
    """Foot from where it is at ease, in legs, along the person's axes."""
    leg = LEG * height
    forward, aside = turned(place[0] - frame[0], place[1] - frame[1], -frame[2])
    return ((forward - EASE[0] * height) / leg, (aside - side * EASE[1] * height) / leg, place[2])


def _swung(angle: float) -> Vector:
    """Shift of a hanging hand when the arm swings forward by an angle [reach]."""
    if angle == 0.0:
        return ZERO
    x, _, z = REST
    c, s = math.cos(angle), math.sin(angle)
    return (c * x - s * z - x, 0.0, s * x + c * z - z)
