"""How slowly a hand has to be moved so that nobody takes it for a gesture."""

from __future__ import annotations

import math

import numpy as np

from radar_sim.bodies.base import REACH
from radar_sim.bodies.limbs import bend
from radar_sim.motions.curves import Path, Vector, cruise, line
from radar_sim.scatterers import Float64Array

MOVE_SPEED = (0.55, 0.9)
"""Top speeds between gestures [m/s]: of hand and elbow forward or back, and of the hand altogether. A radar that the person faces sees
less than 0.7 m/s of it: not the 0.8 m/s that make an event (thesis, section 4.2)."""
MOVE_EDGE = 0.3
"""Share of such a move in which the hand speeds up, and again slows down."""
_UPPER, _FORE = np.array([0.186 / REACH]), np.array([0.200 / REACH])
_DIRECTION = np.array([[math.sqrt(0.5), 0.0, -math.sqrt(0.5)]])
_POLE = np.array([[-0.8 * math.sqrt(0.5), -0.6, -0.8 * math.sqrt(0.5)]])
_LEAST = 0.1  # s: nobody moves a hand for shorter
_N = 32  # parts of a path that are looked at


def elbow(hand: Float64Array) -> Float64Array:
    """Where a right arm's elbow is, as the skeleton bends it.

    Parameters
    ----------
    hand : ndarray, shape (n, 3)
        Middle of the hand from the shoulder, in units of the reach.

    Returns
    -------
    ndarray, shape (n, 3)
        Likewise.
    """
    first, _, _ = bend(hand[:, None, :], _UPPER, _FORE, _DIRECTION, _POLE)
    joint: Float64Array = first[:, 0] * _UPPER
    return joint


def move_path(start: Vector, end: Vector) -> Path:
    """Straight, at an even speed between soft ends."""
    return line(start, end, move_ramp)


def move_ramp(u: float) -> float:
    """Way done, 0..1, of a slow move."""
    return cruise(u, MOVE_EDGE)[0]


def move_time(start: Vector, end: Vector, reach: float) -> float:
    """Time to bring the hand from one place to another slowly [s]: while the arm folds, the elbow may be faster than the hand.

    Parameters
    ----------
    start, end : Vector
        In units of the reach.
    reach : float
        Shoulder to the middle of the hand [m].
    """
    distance = math.dist(start, end)
    if distance < 1e-6:
        return 0.0
    path = np.linspace(start, end, _N + 1)
    forward = max(float(np.abs(np.diff(joint[:, 0])).max()) for joint in (path, elbow(path))) * _N
    slowest = max(forward / MOVE_SPEED[0], distance / MOVE_SPEED[1]) * reach / (1 - MOVE_EDGE)
    return max(slowest, _LEAST)
