"""How fast a hand goes between gestures, and how long it waits before and after them."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from radar_sim.bodies.base import REACH
from radar_sim.bodies.skeleton import bend
from radar_sim.motions.curves import Path, Vector, cruise, line, minimum_jerk
from radar_sim.people import Moves
from radar_sim.scatterers import Float64Array

TOLD_SPEED: Final = (0.55, 0.9)
"""Top speeds of who was told to move slowly [m/s]: of hand and elbow forward or back, and of the hand altogether."""
TOLD_PAUSE: Final = 0.35
"""So long who was told to holds the hand still before and after a stroke [s]."""
TOLD_EDGE: Final = 0.3
"""Share of a slow move in which the hand speeds up, and again slows down."""
_UPPER, _FORE = np.array([0.186 / REACH]), np.array([0.200 / REACH])
_DIRECTION = np.array([[math.sqrt(0.5), 0.0, -math.sqrt(0.5)]])
_POLE = np.array([[-0.8 * math.sqrt(0.5), -0.6, -0.8 * math.sqrt(0.5)]])
_N: Final = 32  # parts of a path that are looked at
_LEAST: Final = 0.1  # s: nobody moves a hand for shorter
_PEAK: Final = 1.875  # highest speed over mean speed of a minimum-jerk move (Flash and Hogan 1985)


def elbow(hand: Float64Array) -> Float64Array:
    """Where a right arm's elbow is, as the skeleton bends it, shape (n, 3), from the shoulder in units of the reach.

    Parameters
    ----------
    hand : ndarray, shape (n, 3)
        Middle of the hand, likewise.
    """
    first, _, _ = bend(hand[:, None, :], _UPPER, _FORE, _DIRECTION, _POLE)
    return np.asarray(first[:, 0] * _UPPER)


class Told:
    """A person who was told to move slowly between gestures, and to hold the hand still around them.

    Parameters
    ----------
    reach : float
        Shoulder to the middle of the hand [m].
    """

    eager = False
    """Whether the hand goes down at once, when there is nothing to do."""
    with_body = 1.3
    """How much longer moves take while trunk and pelvis move too."""

    def __init__(self, reach: float) -> None:
        self._reach = reach

    def pause(self) -> float:
        """How long the hand is still before or after the next stroke [s]."""
        return TOLD_PAUSE

    def time(self, start: Vector, end: Vector) -> float:
        """How long the next move takes [s]; places in units of the reach. While the arm folds, the elbow may be faster than the hand."""
        distance = math.dist(start, end)
        if distance < 1e-6:
            return 0.0
        path = np.linspace(start, end, _N + 1)
        forward = max(float(np.abs(np.diff(joint[:, 0])).max()) for joint in (path, elbow(path))) * _N
        slowest = max(forward / TOLD_SPEED[0], distance / TOLD_SPEED[1]) * self._reach / (1 - TOLD_EDGE)
        return max(slowest, _LEAST)

    def ramp(self, u: float) -> float:
        """Way done, 0..1, of a move at a share of its time."""
        return cruise(u, TOLD_EDGE)[0]

    def path(self, start: Vector, end: Vector) -> Path:
        """Way of a move: straight, at an even speed between soft ends."""
        return line(start, end, self.ramp)

    def turn(self) -> None:
        """Say that a move is done with: the next one is another."""


class Free:
    """A person who moves as it comes: every move and every pause is drawn anew, between bounds.

    Hands go straight with the least jerk (Flash and Hogan 1985). The highest speed grows with the root of the way: longer moves are faster,
    and take longer all the same.

    Parameters
    ----------
    moves : Moves
        The bounds.
    reach : float
        Shoulder to the middle of the hand [m].
    rng : numpy.random.Generator
        Draws.
    """

    eager = True
    with_body = 1.0

    def __init__(self, moves: Moves, reach: float, rng: np.random.Generator) -> None:
        self._moves, self._reach, self._rng = moves, reach, rng
        self.turn()

    def pause(self) -> float:
        """How long the hand is still before or after the next stroke [s]."""
        return float(self._rng.uniform(*self._moves.pause))

    def time(self, start: Vector, end: Vector) -> float:
        """How long the next move takes [s]; places in units of the reach."""
        way = math.dist(start, end)
        if way < 1e-6:
            return 0.0
        return max(_PEAK * math.sqrt(way) * self._reach / self._speed, _LEAST)

    def ramp(self, u: float) -> float:
        """Way done, 0..1, of a move at a share of its time."""
        return minimum_jerk(u)

    def path(self, start: Vector, end: Vector) -> Path:
        """Way of a move: straight."""
        return line(start, end)

    def turn(self) -> None:
        """Say that a move is done with: the next one is another, with a speed of its own."""
        low, high = self._moves.speed
        self._speed = math.exp(self._rng.uniform(math.log(low), math.log(high)))


Pace = Told | Free
"""What a person's hands keep to."""
