"""Walking and turning on the spot: feet that stand on the floor while the body passes over them, arms, pelvis and trunk.

A walk of length D is n steps of length d = D / n and one more that brings the feet side by side. Everything is a smooth function of the
way s that the body has gone, so it starts and stops with the body. The ankle of a step stands while the body goes from 0.36 d before it to
0.46 d after it (41 % of a stride of two steps), then lifts, heel first, and swings; feet overlap in that as they do in walking
(Murray 1967: double support of a fifth to a quarter of the cycle, in which the rear heel is already up).
"""

from __future__ import annotations

import math

from radar_sim.bodies.base import LEG
from radar_sim.motions.carriage import ZERO, Carriage, turned
from radar_sim.motions.curves import Sequence3, Vector, cruise, minimum_jerk, window, wrap
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
    """Where the feet are over the progress of a way, as carriages say it; a frame is the person's (x, y, heading) in the room.

    Parameters
    ----------
    frame : Vector
        Where the person stands at ease before the first step [m, m, rad].
    height, lift : float
        Body height [m]; how high ankles rise [leg].
    """

    def __init__(self, frame: Vector, height: float, lift: float) -> None:
        self._height, self._lift = height, lift
        self._feet = tuple(Sequence3(self._ankle(frame, side), lambda u: cruise(u, _EVEN)[0]) for side in (1.0, -1.0))

    def add(self, foot: int, start: float, end: float, frame: Vector) -> None:
        """Step, with the left foot (0) or the right one (1), to where it is in a frame, while the progress goes from start to end."""
        self._feet[foot].add(start, end, self._ankle(frame, 1.0 - 2.0 * foot))

    def at(self, progress: float, frame: Vector) -> tuple[Vector, Vector]:
        """Left and right foot from where they are at ease, along the axes of a frame [leg]."""
        left, right = (self._foot(foot, progress, side, frame) for foot, side in zip(self._feet, (1.0, -1.0), strict=True))
        return left, right

    def _ankle(self, frame: Vector, side: float) -> Vector:
        """Place of an ankle at ease on the floor of the room."""
        dx, dy = turned(EASE[0] * self._height, side * EASE[1] * self._height, frame[2])
        return (frame[0] + dx, frame[1] + dy, 0.0)

    def _foot(self, foot: Sequence3, progress: float, side: float, frame: Vector) -> Vector:
        (x, y, _), u, leg = foot(progress), foot.progress(progress), LEG * self._height
        # Highest soon after the toes have left the floor; 198.9 makes that 1.
        up = 0.0 if u is None else self._lift * 198.9 * u**3 * (1.0 - u) ** 5
        forward, aside = turned(x - frame[0], y - frame[1], -frame[2])
        return ((forward - EASE[0] * self._height) / leg, (aside - side * EASE[1] * self._height) / leg, up)


class Walking:
    """A walk in a straight line.

    Parameters
    ----------
    start : Carriage
        How the person stood before.
    to, heading : tuple of float, float
        (x, y) where it goes [m]; where the person faces afterwards [rad].
    speed, duration, height : float
        Between the ramps [m/s], of the whole walk [s]; body height [m].
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
        left, right = self._feet.at(progress, (x, y, heading))
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

    def _plan(self) -> Footsteps:
        d, n, x, y = self._step, self._n, self._start.x, self._start.y
        feet = Footsteps((x, y, self._start.heading), self._height, _LIFT * self._full)
        for k in range(1, n + 2) if d > 0.0 else ():
            begin, down = max((k - 2 + _REAR) * d, 0.0), min((k - _FRONT) * d, self._length)
            share = min(k / n, 1.0)
            # The foot points where the body faces when it passes over it.
            place = (x + share * self._way[0], y + share * self._way[1], self._heading(self._time(share)))
            feet.add((self._first + k - 1) % 2, begin, down, place)
        return feet

    def _time(self, share: float) -> float:
        """When the body has done a share of the way [s]."""
        low, high = 0.0, self._duration
        for _ in range(30):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if cruise(middle / self._duration, RAMP / self._duration)[0] < share else (low, middle)
        return high


class Turning:
    """Turning on the spot with small steps, to another heading [rad]; ``height`` is the body's [m], ``duration`` how long it takes [s]."""

    def __init__(self, start: Carriage, heading: float, height: float) -> None:
        self._start, self._angle = start, wrap(heading - start.heading)
        n = 1 + max(1, math.ceil(abs(self._angle) / _TURN_STEP))
        self.duration = max(0.8, abs(self._angle) / _TURN_SPEED)
        self._feet = Footsteps((start.x, start.y, start.heading), height, 0.5 * _LIFT)
        for k in range(1, n + 1):
            goal = start.heading + self._angle * min(k / (n - 1), 1.0)
            self._feet.add((k - 1 + (self._angle < 0)) % 2, (k - 1) / n, k / n, (start.x, start.y, goal))

    @property
    def end(self) -> Carriage:
        """How the person stands afterwards."""
        return self._start._replace(heading=self._start.heading + self._angle)

    def at(self, time: float) -> Carriage:
        """Body and feet ``time`` seconds after the start."""
        u = time / self.duration
        heading = self._start.heading + self._angle * minimum_jerk(u)
        left, right = self._feet.at(u, (self._start.x, self._start.y, heading))
        return self._start._replace(heading=heading, left=left, right=right)


def walk_time(distance: float, speed: float) -> float:
    """How long a walk takes [s]."""
    return max(distance / speed + RAMP, 2 * RAMP)


def _swung(angle: float) -> Vector:
    """Shift of a hanging hand when the arm swings forward by an angle [reach]."""
    if angle == 0.0:
        return ZERO
    x, _, z = REST
    c, s = math.cos(angle), math.sin(angle)
    return (c * x - s * z - x, 0.0, s * x + c * z - z)
