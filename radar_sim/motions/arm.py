"""Moves too slow for a gesture: of a hand between gestures, and small aimless ones of hands, trunk and feet."""

from __future__ import annotations

import math

import numpy as np

from radar_sim.bodies.base import REACH
from radar_sim.bodies.skeleton import bend
from radar_sim.motions.carriage import SEATED, ZERO, Carriage
from radar_sim.motions.curves import Path, Sequence3, Vector, bump, cruise, line, mix, window
from radar_sim.motions.strokes import REST
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
_STANDING: tuple[Vector, ...] = (REST, (0.42, 0.28, -0.52), (0.1, -0.28, -0.62), (0.4, 0.22, 0.05), (0.3, 0.1, -0.7))
"""Where a right hand goes: the side of the thigh, before the belly, the hip, the chin, a pocket."""
_SITTING: tuple[Vector, ...] = (SEATED, (0.52, 0.05, -0.6), (0.45, 0.3, -0.5), (0.4, 0.22, 0.05))
_WEIGHT = 0.035  # of the leg: pelvis over one foot, and 0.4 of it down, knees bent
_SHIFT_TIME, _STEP_TIME = 0.9, 0.5  # s
_SLOWER = 1.3  # than moves before a gesture: trunk and pelvis move too
_RAMP = 1.0  # s: the trunk comes and goes


def elbow(hand: Float64Array) -> Float64Array:
    """Where a right arm's elbow is, as the skeleton bends it, shape (n, 3), from the shoulder in units of the reach.

    Parameters
    ----------
    hand : ndarray, shape (n, 3)
        Middle of the hand, likewise.
    """
    first, _, _ = bend(hand[:, None, :], _UPPER, _FORE, _DIRECTION, _POLE)
    return np.asarray(first[:, 0] * _UPPER)


def move_path(start: Vector, end: Vector) -> Path:
    """Straight, at an even speed between soft ends."""
    return line(start, end, move_ramp)


def move_ramp(u: float) -> float:
    """Way done, 0..1, of a slow move."""
    return cruise(u, MOVE_EDGE)[0]


def move_time(start: Vector, end: Vector, reach: float) -> float:
    """Time to bring the hand from one place to another slowly [s]: while the arm folds, the elbow may be faster than the hand.

    Places are in units of the reach, which is the way from the shoulder to the middle of the hand [m].
    """
    distance = math.dist(start, end)
    if distance < 1e-6:
        return 0.0
    path = np.linspace(start, end, _N + 1)
    forward = max(float(np.abs(np.diff(joint[:, 0])).max()) for joint in (path, elbow(path))) * _N
    slowest = max(forward / MOVE_SPEED[0], distance / MOVE_SPEED[1]) * reach / (1 - MOVE_EDGE)
    return max(slowest, _LEAST)


class Fidgeting:
    """What a person does who waits; the acting hand ends at rest.

    Parameters
    ----------
    start : Carriage
        How the body is carried before and afterwards.
    hand : Vector
        Where the acting hand is at the start.
    duration, reach : float
        How long [s]; shoulder to the middle of the hand [m].
    rng : numpy.random.Generator
        Draws the movements.
    """

    def __init__(self, start: Carriage, hand: Vector, duration: float, reach: float, rng: np.random.Generator) -> None:
        self._start, self._duration = start, duration
        seated = start.free == 0.0
        places = _SITTING if seated else _STANDING
        self._acting = _wander(hand, places, duration, reach, rng)
        self._other = _wander(start.other, places, duration, reach, rng)
        self._weight, self._feet = Sequence3(ZERO), (Sequence3(ZERO), Sequence3(ZERO))
        self._shift(0.0 if seated else _WEIGHT, rng)
        self._turns = [(float(f), float(p)) for f, p in zip(rng.uniform(0.12, 0.4, 3), rng.uniform(0.0, 2 * math.pi, 3), strict=True)]

    def hand(self, u: float) -> Vector:
        """Acting hand at a share of the time [reach]."""
        return self._acting(u * self._duration)

    def at(self, time: float) -> Carriage:
        """How the body is carried ``time`` seconds after the start."""
        start, on = self._start, window(time, self._duration, _RAMP)
        waves = [on * math.sin(2 * math.pi * f * time + p) for f, p in self._turns]
        pitch, roll, twist = start.trunk
        (px, py, pz), (_, aside, down) = start.pelvis, self._weight(time)
        left, right = (_stepped(foot, time) for foot in self._feet)
        return start._replace(
            left=left,
            right=right,
            pelvis=(px, py + aside, pz + down),
            trunk=(pitch + 0.03 * waves[0], roll + 0.03 * waves[1], twist + 0.1 * waves[2]),
            other=self._other(time),
        )

    def _shift(self, weight: float, rng: np.random.Generator) -> None:
        """Put the weight on one foot, shift the other one, put it back, and so on."""
        time, round_time = float(rng.uniform(0.1, 0.8)), _SHIFT_TIME + 2 * _STEP_TIME + 0.2
        while True:
            pause = float(rng.uniform(0.5, 2.0))
            if time + round_time + pause + _SHIFT_TIME + 0.1 > self._duration:
                break
            side = int(rng.integers(2))  # the foot that is shifted; the weight goes over the other
            self._weight.add(time, time + _SHIFT_TIME, (0.0, weight * (2 * side - 1), -0.4 * weight))
            time += _SHIFT_TIME + 0.1
            to = (float(rng.uniform(-0.08, 0.08)), float(rng.uniform(-0.02, 0.05)) * (1 - 2 * side), 0.0)
            self._feet[side].add(time, time + _STEP_TIME, to)
            time += _STEP_TIME + pause
            self._feet[side].add(time, time + _STEP_TIME, ZERO)
            time += _STEP_TIME + 0.1
        if self._weight.last != ZERO:
            self._weight.add(time, time + _SHIFT_TIME, ZERO)


def _wander(hand: Vector, places: tuple[Vector, ...], duration: float, reach: float, rng: np.random.Generator) -> Sequence3:
    """From place to place with pauses, back at rest in the end; a hand that has no time to get to rest stays where it is."""
    path, time, home = Sequence3(hand, move_ramp), float(rng.uniform(0.1, 0.6)), places[0]
    back = _SLOWER * move_time(hand, home, reach)
    while True:
        near = places[int(rng.integers(1, len(places)))]
        offset = rng.normal(size=3) * 0.03
        place = mix(near, (near[0] + float(offset[0]), near[1] + float(offset[1]), near[2] + float(offset[2])), 1.0)
        there, then = _SLOWER * move_time(path.last, place, reach), _SLOWER * move_time(place, home, reach)
        pause = float(rng.uniform(0.3, 2.0))
        if time + there + pause + then > duration:
            break
        path.add(time, time + there, place)
        time, back = time + there + pause, then
    if 0.0 < back <= duration - time:
        path.add(time, time + back, home)
    return path


def _stepped(foot: Sequence3, time: float) -> Vector:
    x, y, _ = foot(time)
    u = foot.progress(time)
    return (x, y, 0.0 if u is None else 0.04 * bump(u))
