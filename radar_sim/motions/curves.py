"""Smooth curves over time: ramps, lines, sequences; all of them continuous up to the acceleration."""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Sequence

Vector = tuple[float, float, float]
Path = Callable[[float], Vector]
"""From the share of the time, 0..1, to a place."""

ARM = 0.99
"""How far a hand is ever taken from its shoulder, over the arm's reach."""
_SOFT = 0.9


def minimum_jerk(u: float) -> float:
    """Smooth 0..1 ramp with zero speed and acceleration at both ends (Flash and Hogan 1985)."""
    u = min(max(u, 0.0), 1.0)
    return u * u * u * (10 - 15 * u + 6 * u * u)


def bump(u: float) -> float:
    """From 0 to 1 in the middle and back, with zero speed and acceleration at both ends."""
    u = min(max(u, 0.0), 1.0)
    return 64.0 * (u * (1.0 - u)) ** 3


def window(time: float, duration: float, ramp: float) -> float:
    """Strength 0..1 of something that comes in and goes out softly, within ``ramp`` each (at most half of the duration)."""
    ramp = min(ramp, duration / 2)
    if ramp <= 0.0:
        return 0.0
    return minimum_jerk(time / ramp) * minimum_jerk((duration - time) / ramp)


def cruise(u: float, edge: float) -> tuple[float, float]:
    """Way done, 0..1, and speed over the cruising speed, when starting and stopping each take the share ``edge`` of the time."""
    edge, u = min(max(edge, 1e-6), 0.5), min(max(u, 0.0), 1.0)
    top = 1.0 / (1.0 - edge)

    def ramp(v: float) -> tuple[float, float]:  # the speed rises as 3 v^2 - 2 v^3
        return top * edge * (v**3 - v**4 / 2), v * v * (3 - 2 * v)

    if u < edge:
        return ramp(u / edge)
    if u > 1 - edge:
        way, speed = ramp((1 - u) / edge)
        return 1.0 - way, speed
    return top * (u - edge / 2), 1.0


def mix(start: Vector, end: Vector, share: float) -> Vector:
    """Place on the line between two places."""
    x, y, z = start
    return (x + share * (end[0] - x), y + share * (end[1] - y), z + share * (end[2] - z))


def line(start: Vector, end: Vector, ramp: Callable[[float], float] = minimum_jerk) -> Path:
    """Straight move; ``ramp`` maps time 0..1 to way 0..1."""
    return lambda u: mix(start, end, ramp(u))


def through(places: Sequence[Vector], width: float) -> Path:
    """Smooth curve near places: minimum-jerk moves from each to the next that overlap (Flash and Henis 1991).

    Parameters
    ----------
    places : sequence of (float, float, float)
        The curve begins at the first and ends at the last; it never leaves their convex hull.
    width : float
        Share of the whole time that each of the moves takes.
    """
    n = len(places) - 1
    starts = [(1.0 - width) * i / max(n - 1, 1) for i in range(n)]

    def path(u: float) -> Vector:
        x, y, z = places[0]
        for i, start in enumerate(starts):
            share = minimum_jerk((u - start) / width)
            a, b = places[i], places[i + 1]
            x, y, z = x + share * (b[0] - a[0]), y + share * (b[1] - a[1]), z + share * (b[2] - a[2])
        return (x, y, z)

    return path


class Sequence3:
    """Places one after the other with stays in between: each move is (start [s], end [s], from, to).

    Parameters
    ----------
    at : Vector
        Where it is before the first move.
    ramp : callable
        Maps time 0..1 of a move to way 0..1.
    """

    def __init__(self, at: Vector, ramp: Callable[[float], float] = minimum_jerk) -> None:
        self.last = at
        self._first, self._ramp = at, ramp
        self._starts: list[float] = []
        self._moves: list[tuple[float, Vector, Vector]] = []

    def add(self, start: float, end: float, to: Vector) -> None:
        """Go from where it is to another place; moves must not overlap."""
        self._starts.append(start)
        self._moves.append((end, self.last, to))
        self.last = to

    def __call__(self, time: float) -> Vector:
        """Where it is at a time [s]."""
        row = bisect.bisect_right(self._starts, time) - 1
        if row < 0:
            return self._first
        end, a, b = self._moves[row]
        return b if time >= end else mix(a, b, self._ramp((time - self._starts[row]) / (end - self._starts[row])))

    def progress(self, time: float) -> float | None:
        """How much of the present move's time is over, 0..1; None while it stays."""
        row = bisect.bisect_right(self._starts, time) - 1
        if row < 0 or time >= self._moves[row][0]:
            return None
        return (time - self._starts[row]) / (self._moves[row][0] - self._starts[row])


def within_reach(hand: Vector) -> Vector:
    """Bring a hand that is wanted too far from its shoulder back into the arm's reach, without a kink in its path.

    Up to 0.9 of the reach nothing changes; beyond, distances are compressed so that none passes 0.99.
    """
    x, y, z = hand
    distance = math.sqrt(x * x + y * y + z * z)
    if distance <= _SOFT:
        return hand
    room = ARM - _SOFT
    factor = (_SOFT + room * math.tanh((distance - _SOFT) / room)) / distance
    return (factor * x, factor * y, factor * z)


def wrap(angle: float) -> float:
    """Angle between -pi and pi [rad]."""
    return (angle + math.pi) % (2 * math.pi) - math.pi
