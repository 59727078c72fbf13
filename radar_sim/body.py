"""People as articulated scatterers: torso, head, arms with two-link inverse kinematics, legs.

Proportions after Drillis and Contini (1966). A part's radar cross-section is the sum over its scatterers; at 77 GHz a person gives a few tenths of a
square metre, a hand with forearm a few hundredths.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from radar_sim.scene import Person
from radar_sim.script import Timeline

Float64Array = NDArray[np.float64]
_PARTS = {"torso": (28, 0.35), "head": (5, 0.05), "upper": (5, 0.02), "fore": (6, 0.03), "hand": (6, 0.03), "leg": (8, 0.04)}
"""Scatterers and radar cross-section [m^2] of a part; arms and legs: of each."""


class Body:
    """Scatterers of one person at any time.

    Parameters
    ----------
    person : Person
        Who, with script.
    seed : int
        Of the scene.

    Attributes
    ----------
    rcs : ndarray of float64, shape (n_scatterers,)
        Radar cross-section of each scatterer [m^2].
    """

    def __init__(self, person: Person, seed: int) -> None:
        self.timeline = Timeline(person, seed)
        self.person = person
        h = person.height
        self._sign = -1.0 if person.arm == "right" else 1.0
        rng = np.random.default_rng([seed, person.id, 0xB0D])
        n_torso, n_head = _PARTS["torso"][0], _PARTS["head"][0]
        angle = rng.uniform(-1.1, 1.1, n_torso)  # the side that faces forward; echoes come from the front of an ellipse
        self._torso = np.stack([0.10 * np.cos(angle), 0.17 * np.sin(angle), rng.uniform(0.52, 0.82, n_torso) * h], -1)
        angle = rng.uniform(-1.1, 1.1, n_head)
        self._head = np.stack([0.08 * np.cos(angle), 0.07 * np.sin(angle), rng.uniform(0.87, 0.99, n_head) * h], -1)
        self._along = {name: (np.arange(n) + 0.5) / n for name, (n, _) in _PARTS.items()}
        self._scatter = {name: rng.normal(size=(n, 3)) * 0.02 for name, (n, _) in _PARTS.items()}
        self._phases = rng.uniform(0, 2 * math.pi, 5)
        parts = ["torso", "head", *["upper", "fore", "hand"] * 2, "leg", "leg"]
        self.rcs = np.concatenate([np.full(_PARTS[p][0], _PARTS[p][1] / _PARTS[p][0]) for p in parts])

    def positions(self, time: float) -> tuple[Float64Array, Float64Array]:
        """Scatterers, shape (n_scatterers, 3), and the acting hand, shape (3,), in ``room`` [m]."""
        x, y, heading, phase = self.timeline.body(time)
        hand = self.timeline.hand(time)
        h, walking = self.person.height, phase != 0.0
        swing = 0.18 * h * math.sin(phase) if walking else 0.0
        acting = self._arm(hand * np.array([1.0, -self._sign, 1.0]), self._sign, swing)
        other = self._arm(np.array([0.03 + 0.8 * swing * 0.5, 0.0, -0.33 * h]), -self._sign, -swing)
        breath = 0.004 * math.sin(2 * math.pi * 0.27 * time + self._phases[0])
        torso = self._torso + np.array([breath, 0.0, 0.0])
        legs = [self._leg(side, swing * side) for side in (-1.0, 1.0)]
        local = np.concatenate([torso, self._head, *acting, *other, *legs])
        hand_local = self._hand_centre
        sway = 0.012 * np.array(
            [
                math.sin(2 * math.pi * 0.31 * time + self._phases[1]) + 0.6 * math.sin(2 * math.pi * 0.83 * time + self._phases[2]),
                math.sin(2 * math.pi * 0.24 * time + self._phases[3]),
            ]
        )
        c, s = math.cos(heading), math.sin(heading)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        place = np.array([x + sway[0], y + sway[1], 0.0])
        return local @ turn + place, hand_local @ turn + place

    def _arm(self, hand: Float64Array, side: float, swing: float) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Upper arm, forearm and hand from the hand's place relative to the shoulder; ``side``: +1 left, -1 right."""
        h = self.person.height
        shoulder = np.array([0.0, side * 0.115 * h, 0.818 * h])
        upper, fore = 0.186 * h, 0.20 * h  # the forearm reaches to the middle of the hand
        reach = float(np.linalg.norm(hand))
        hand = hand * min(1.0, 0.995 * (upper + fore) / max(reach, 1e-9))
        distance = max(float(np.linalg.norm(hand)), abs(upper - fore) * 1.01, 1e-6)
        cosine = np.clip((upper**2 + distance**2 - fore**2) / (2 * upper * distance), -1.0, 1.0)
        axis = hand / max(float(np.linalg.norm(hand)), 1e-9)
        down = np.array([-0.3, 0.35 * side, -1.0])  # elbows hang outwards
        across = down - (down @ axis) * axis
        across /= max(float(np.linalg.norm(across)), 1e-9)
        elbow = upper * (cosine * axis + math.sqrt(1.0 - float(cosine) ** 2) * across)
        along, scatter = self._along, self._scatter
        end = shoulder + hand
        if side == self._sign:
            self._hand_centre = end
        return (
            shoulder + along["upper"][:, None] * elbow + scatter["upper"],
            shoulder + elbow + along["fore"][:, None] * (hand - elbow) * 0.9 + scatter["fore"],
            end + scatter["hand"] * 1.5,
        )

    def _leg(self, side: float, swing: float) -> Float64Array:
        """A leg as a swinging pendulum from hip to foot."""
        h = self.person.height
        along = self._along["leg"][:, None]
        hip, foot = np.array([0.0, side * 0.05 * h, 0.53 * h]), np.array([swing * 1.3, side * 0.05 * h, 0.03 * h])
        return hip + along * (foot - hip) + self._scatter["leg"] * 0.5
