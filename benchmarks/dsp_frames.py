"""Frames of known truth for the benchmark of the baseband, exact at every sample; no code of the simulator but for people."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from benchmarks.tradeoff.echoes import INFO, LIMITS, SNR_DB, WAVE, busy, frame, noise
from radar_core import NO_GESTURE, RadarFrame
from radar_sim import Action, CouplingConfig, Effects, NoiseConfig, Person, Scene, Simulator

__all__ = ["INFO", "LIMITS", "SNR_DB", "WAVE", "busy_frame", "frame", "noise", "person_frames", "single_frames"]


def busy_frame() -> RadarFrame:
    """Forty echoes of 10 to 35 dB in noise: about a hundred detections."""
    return busy(np.random.default_rng(0))[1]


@functools.cache
def single_frames(n: int) -> list[tuple[NDArray[np.float64], RadarFrame]]:
    """Truths and frames of single echoes."""
    rng = np.random.default_rng(1)
    return [(truth, frame(truth, SNR_DB, rng)) for truth in rng.uniform(*LIMITS, size=(n, 4))]


@functools.cache
def person_frames(step: int) -> list[tuple[NDArray[np.float64], RadarFrame]]:
    """Place and frame of a person who gestures at 2.2 m, beside coupling 60 dB below the transmitted power."""
    script = tuple(Action(gesture=name) for name in ("push", "pull", "swipe_right", "swipe_up", "rotate", "wave", "push_pull"))
    effects = Effects(noise=NoiseConfig(), coupling=CouplingConfig(level=-60.0))
    simulator = Simulator(Scene(duration=12.0, people=(Person(position=(2.2, 0.4), script=script),), effects=effects))
    made = [simulator.process(sequence) for sequence in range(0, simulator.n_frames, step)]
    return [(s.truth.position[0], s.frame) for s in made if s.truth.gesture[0] != NO_GESTURE]
