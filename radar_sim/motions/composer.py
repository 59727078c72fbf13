"""Parts of a motion put together to postures; and what is always there: nobody is ever quite still."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from radar_sim.bodies.base import LEG, REACH, Posture
from radar_sim.bodies.skeleton import Skeleton
from radar_sim.bodies.subject import Subject
from radar_sim.motions.carriage import Carriage
from radar_sim.motions.curves import Vector, within_reach
from radar_sim.motions.strokes import REST
from radar_sim.people import Person, Vital
from radar_sim.scatterers import Float64Array

_LEAN = (0.06, 0.03, 0.05)
"""How far the trunk pitches forward, rolls and twists with the acting hand [rad per reach]."""
_GAZE = 0.5
"""Share of the trunk's pitch that the head makes up for."""
_WIDTH = 24

Row = tuple[float, ...]
_BREATH = 0.003  # m
_SWAY = ((0.008, 0.31), (0.004, 0.83), (0.007, 0.24))  # m, Hz: forward twice, aside
_HEAD = ((0.10, 0.11), (0.05, 0.29), (0.05, 0.17))  # rad, Hz: turn twice, nod
_TRUNK = ((0.006, 0.21), (0.005, 0.27))  # rad, Hz: pitch, roll


class Life(NamedTuple):
    """What nobody can leave: breath, sway, and a head that looks about."""

    forward: float  # pelvis [m]
    aside: float
    breath: float  # chest out [m]
    turn: float  # head [rad]
    nod: float
    pitch: float  # trunk [rad]
    roll: float


class Alive:
    """What a person of a scene with that seed always does, as much as `Variation.sway` says; 0: a statue, unless it has a `Vital`."""

    def __init__(self, seed: int, person: Person) -> None:
        rng, amount = np.random.default_rng([seed, person.id, 0xB0D]), person.variation.sway
        waves = [(_BREATH, float(rng.uniform(0.22, 0.32))), *_SWAY, *_HEAD, *_TRUNK]
        phases = rng.uniform(0, 2 * math.pi, len(waves)).tolist()
        self._waves = [(amount * size, 2 * math.pi * rate, phase) for (size, rate), phase in zip(waves, phases, strict=True)]
        self._vital, self._begin = person.vital, phases[0]

    def at(self, time: float) -> Life:
        """Return everything at a scene time [s]."""
        breath, fast, slow, aside, turn, glance, nod, pitch, roll = (a * math.sin(w * time + p) for a, w, p in self._waves)
        if self._vital is not None:
            breath = _chest(self._vital, time, self._begin)
        return Life(fast + slow, aside, breath, turn + glance, nod, pitch, roll)


def _chest(vital: Vital, time: float, begin: float) -> float:
    """How far breath and pulse push the chest out [m]; neither is a sine, and neither is quite regular."""
    breath = 2 * math.pi * vital.breath_rate * time + 0.3 * math.sin(2 * math.pi * 0.03 * time + begin) + begin
    pulse = 2 * math.pi * vital.heart_rate * time + 0.03 * vital.heart_rate / vital.breath_rate * math.sin(breath)
    chest = math.sin(breath) + 0.15 * math.sin(2 * breath)
    return vital.breath * chest + vital.heart * (math.sin(pulse) + 0.4 * math.sin(2 * pulse + 1.0))


NO_LIFE = Life(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Composer:
    """Postures of one person.

    ``reach`` and ``leg`` are the units of `Posture` [m], ``acting`` is the index of the acting hand (0 left, 1 right), ``side`` is +1 where
    it is the left one, else -1.
    """

    def __init__(self, person: Person) -> None:
        self._person = person
        self.reach, self.leg = REACH * person.height, LEG * person.height
        self.acting, self.side = (0, 1.0) if person.arm == "left" else (1, -1.0)
        self._lean = [person.variation.sway * share for share in _LEAN]

    @cached_property
    def subject(self) -> Subject:
        """The person's shape, for what cannot be said in relative lengths."""
        return Subject.of(self._person)

    @cached_property
    def skeleton(self) -> Skeleton:
        """The person's skeleton."""
        return Skeleton(self.subject)

    def row(self, body: Carriage, hand: Vector, life: Life) -> Row:
        """Put together what a posture has at one time: 24 numbers in the order of `Posture`."""
        side, swings = self.side, body.swings
        swing, other_swing = swings[self.acting], swings[1 - self.acting]
        hx, hy, hz = within_reach((hand[0] + swing[0], hand[1] + swing[1], hand[2] + swing[2]))
        other = body.other
        ox, oy, oz = within_reach((other[0] + other_swing[0], other[1] + other_swing[1], other[2] + other_swing[2]))
        acting, passive = (hx, -side * hy, hz), (ox, side * oy, oz)
        hands = (*acting, *passive) if self.acting == 0 else (*passive, *acting)
        pitch, roll, twist = body.trunk
        nod = life.nod - _GAZE * pitch
        forward = hand[0] - REST[0]
        pitch += self._lean[0] * forward + life.pitch
        roll += self._lean[1] * -side * (hand[1] - REST[1]) + life.roll
        twist += self._lean[2] * -side * forward
        px, py, pz = body.pelvis
        free = body.free / self.leg
        pelvis = (px + free * life.forward, py + free * life.aside, pz)
        return (body.x, body.y, body.heading, *hands, *body.left, *body.right, *pelvis, pitch, roll, twist, life.turn, nod, life.breath)

    def posture(self, rows: Sequence[Row]) -> Posture:
        """Postures at the times of the rows."""
        a = np.array(rows, np.float64).reshape(-1, _WIDTH)
        n = len(a)
        return Posture(
            place=a[:, 0:2],
            heading=a[:, 2],
            hands=a[:, 3:9].reshape(n, 2, 3),
            feet=a[:, 9:15].reshape(n, 2, 3),
            pelvis=a[:, 15:18],
            trunk=a[:, 18:21],
            head=a[:, 21:23],
            breath=a[:, 23],
        )

    def reaching(self, body: Carriage, to: Vector) -> Vector:
        """Where from the shoulder the acting hand has to be so that it is at a place in the room, or as near as the arm goes [reach]."""
        hand: Vector = (0.6, 0.0, -0.1)
        c, s = np.cos(body.heading), np.sin(body.heading)
        for _ in range(8):  # the trunk goes with the arm by some percent: each round is that much nearer
            pose = self.skeleton.pose(self.posture([self.row(body, hand, NO_LIFE)]))
            x, y, z = ((np.array(to) - pose.hand[0, self.acting]) / self.reach).tolist()
            wanted = np.array([hand[0] + c * x + s * y, hand[1] - self.side * (c * y - s * x), hand[2] + z])
            wanted *= min(1.0, 1.1 / max(float(np.sqrt(wanted @ wanted)), 1e-9))
            hand = (float(wanted[0]), float(wanted[1]), float(wanted[2]))
        return hand

    def standing(self, posture: Posture) -> Float64Array:
        """Rotation of every bone from rest to the person's frame, shape (T, 22, 3, 3), by inverse kinematics."""
        n = len(posture.heading)
        upright = replace(posture, place=np.zeros((n, 2)), heading=np.zeros(n), rotation=None)
        return self.skeleton.pose(upright).rotation
