"""Nobody is ever quite still: breath, sway, and a head that looks about."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

_BREATH = 0.003  # m
_SWAY = ((0.008, 0.31), (0.004, 0.83), (0.007, 0.24))  # m, Hz: forward twice, aside
_HEAD = ((0.10, 0.11), (0.05, 0.29), (0.05, 0.17))  # rad, Hz: turn twice, nod
_TRUNK = ((0.006, 0.21), (0.005, 0.27))  # rad, Hz: pitch, roll


class Life(NamedTuple):
    """Pelvis forward and aside [m], chest out [m], head turned and nodding [rad], trunk's pitch and roll [rad]."""

    forward: float
    aside: float
    breath: float
    turn: float
    nod: float
    pitch: float
    roll: float


class Alive:
    """What a person always does.

    Parameters
    ----------
    seed, person : int
        Of the scene; number of the person.
    amount : float
        `Variation.sway`; 0: a statue.
    """

    def __init__(self, seed: int, person: int, amount: float) -> None:
        rng = np.random.default_rng([seed, person, 0xB0D])
        waves = [(_BREATH, float(rng.uniform(0.22, 0.32))), *_SWAY, *_HEAD, *_TRUNK]
        phases = rng.uniform(0, 2 * math.pi, len(waves)).tolist()
        self._waves = [(amount * size, 2 * math.pi * rate, phase) for (size, rate), phase in zip(waves, phases, strict=True)]

    def at(self, time: float) -> Life:
        """Return everything at a scene time [s]."""
        breath, fast, slow, aside, turn, glance, nod, pitch, roll = (a * math.sin(w * time + p) for a, w, p in self._waves)
        return Life(fast + slow, aside, breath, turn + glance, nod, pitch, roll)
