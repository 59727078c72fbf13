"""Small aimless moves of hands, trunk and feet."""

from __future__ import annotations

import math

import numpy as np

from radar_sim.motions.carriage import SEATED, ZERO, Carriage
from radar_sim.motions.curves import Sequence3, Vector, bump, mix, window
from radar_sim.motions.pace import Pace
from radar_sim.motions.strokes import REST

_STANDING: tuple[Vector, ...] = (REST, (0.42, 0.28, -0.52), (0.1, -0.28, -0.62), (0.4, 0.22, 0.05), (0.3, 0.1, -0.7))
"""Where a right hand goes: the side of the thigh, before the belly, the hip, the chin, a pocket."""
_SITTING: tuple[Vector, ...] = (SEATED, (0.52, 0.05, -0.6), (0.45, 0.3, -0.5), (0.4, 0.22, 0.05))
_WEIGHT = 0.035  # of the leg: pelvis over one foot, and 0.4 of it down, knees bent
_SHIFT_TIME, _STEP_TIME = 0.9, 0.5  # s
_RAMP = 1.0  # s: the trunk comes and goes


class Fidgeting:
    """What a person does who waits; the acting hand ends at rest.

    Parameters
    ----------
    start : Carriage
        How the body is carried before and afterwards.
    hand : Vector
        Where the acting hand is at the start.
    duration : float
        How long [s].
    pace : Pace
        How fast hands go.
    rng : numpy.random.Generator
        Draws the movements.
    """

    def __init__(self, start: Carriage, hand: Vector, duration: float, pace: Pace, rng: np.random.Generator) -> None:
        self._start, self._duration = start, duration
        seated = start.free == 0.0
        places = _SITTING if seated else _STANDING
        self._acting = _wander(hand, places, duration, pace, rng)
        self._other = _wander(start.other, places, duration, pace, rng)
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


def _wander(hand: Vector, places: tuple[Vector, ...], duration: float, pace: Pace, rng: np.random.Generator) -> Sequence3:
    """From place to place with pauses, back at rest in the end; a hand that has no time to get to rest stays where it is."""
    path, time, home = Sequence3(hand, pace.ramp), float(rng.uniform(0.1, 0.6)), places[0]
    back = pace.with_body * pace.time(hand, home)
    while True:
        near = places[int(rng.integers(1, len(places)))]
        offset = rng.normal(size=3) * 0.03
        place = mix(near, (near[0] + float(offset[0]), near[1] + float(offset[1]), near[2] + float(offset[2])), 1.0)
        there = pace.with_body * pace.time(path.last, place)
        pace.turn()
        then = pace.with_body * pace.time(place, home)
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
