"""Fluctuating cross-sections (Swerling, *Probability of detection for fluctuating targets*, RAND RM-1217, 1954)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from radar_sim.effects.base import Moment, Setting
from radar_sim.effects.config import SwerlingConfig
from radar_sim.scatterers import THING, Echoes

_SPREAD = {1: 5.6, 2: 5.6, 3: 3.5, 4: 3.5}  # dB: standard deviation of 10 log10 of chi-square with 2 and with 4 degrees of freedom


class Swerling:
    """Let the power of targets fluctuate with unit mean.

    The power follows chi-square with 2 degrees of freedom (cases 1 and 2: many scatterers alike) or 4 (cases 3 and 4: one larger than the
    rest), drawn anew for each frame (1 and 3) or each chirp of each transmitter (2 and 4), by `Echoes.envelope`.

    A target is a point or corner of the scene, or a person as a whole, who keeps the pattern of echoes and fluctuates altogether; both are
    known by `Echoes.owner`. Walls, furniture and clutter are steady. Each target has its own draw, whatever else is simulated or hidden.
    This comes before multipath, so all paths of a target fluctuate together.

    Parameters
    ----------
    config : SwerlingConfig
        Case, and what fluctuates.
    setting : Setting
        The scene and the radar.
    """

    def __init__(self, config: SwerlingConfig, setting: Setting) -> None:
        scene, w = setting.scene, setting.radar.waveform
        self._case = config.case
        self._n_points = len(scene.points) + len(scene.corners) if config.of in ("points", "all") else 0
        self._n_people = len(scene.people) if config.of in ("people", "all") else 0
        self._shape = (w.n_chirp, w.n_tx) if self._case in (2, 4) else ()

    def process(self, echoes: Echoes, moment: Moment) -> Echoes:
        """Multiply amplitudes by the root of each target's power."""
        if self._case == 0:
            return echoes
        owner = echoes.owner.astype(np.intp)
        for name, target, count in (("points", THING - 1 - owner, self._n_points), ("people", owner, self._n_people)):
            member = np.flatnonzero((target >= 0) & (target < count))
            if len(member):
                echoes = self._fluctuate(echoes, member, self._draw(moment, f"swerling {name}", count)[..., target[member]])
        return echoes

    def _draw(self, moment: Moment, name: str, count: int) -> NDArray[np.float64]:
        """Factors of the amplitude of each target, shape (n_target,) or (n_chirp, n_tx, n_target)."""
        freedom = 1.0 if self._case <= 2 else 2.0  # half the degrees of freedom
        return np.sqrt(moment.rng(name).gamma(freedom, 1.0 / freedom, (*self._shape, count)))

    def _fluctuate(self, echoes: Echoes, member: NDArray[np.intp], factor: NDArray[np.float64]) -> Echoes:
        if not self._shape:
            strength = echoes.strength.copy()
            strength[member] *= factor
            return replace(echoes, strength=strength)
        envelope = np.ones((*self._shape, len(echoes)), np.float32) if echoes.envelope is None else echoes.envelope.copy()
        envelope[:, :, member] *= factor.astype(np.float32)
        return replace(echoes, envelope=envelope)


def size(config: SwerlingConfig, setting: Setting, echoes: Echoes) -> str:
    """Say how large the effect is: the spread of the power of one target, and how many targets the scene has."""
    if config.case == 0:
        return "steady (case 0)"
    points, people = len(setting.scene.points) + len(setting.scene.corners), len(setting.scene.people)
    named = [f"{points} point{'s' * (points != 1)}"] if points and config.of in ("points", "all") else []
    named += [f"{people} {'person' if people == 1 else 'people'}"] if people and config.of in ("people", "all") else []
    targets = " and ".join(named)
    every = "frame" if config.case in (1, 3) else "chirp"
    return f"{_SPREAD[config.case]:.1f} dB rms from {every} to {every}: {targets}" if targets else "nothing in the scene fluctuates"
