"""Frames of known truth, exact at every sample; no code of the simulator."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from radar_core import NO_GESTURE, SPEED_OF_LIGHT, RadarFrame, RadarInfo
from radar_sim import Action, CouplingConfig, Effects, NoiseConfig, Person, Scene, Simulator

INFO = RadarInfo()
WAVE = INFO.waveform
SNR_DB = 20.0
AMPLITUDE = math.sqrt(10 ** (SNR_DB / 10) / (WAVE.n_chirp * WAVE.n_sample))
LIMITS = np.array([[1.0, -4.0, -0.9, -0.4], [5.5, 4.0, 0.9, 0.4]])
"""Least and largest range [m], range rate [m/s], azimuth and elevation [rad] of single echoes."""


def noise(rng: np.random.Generator) -> NDArray[np.complex64]:
    """White noise of unit variance, shape of the cube."""
    samples = rng.standard_normal((*INFO.cube_shape[:3], 2 * WAVE.n_sample), np.float32)
    return np.asarray(samples.view(np.complex64) * np.float32(0.5**0.5))


def echo(truth: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Make a unit echo of range [m] (middle of the acquisition), range rate [m/s], azimuth, elevation [rad]: (tx, chirp, rx, sample)."""
    distance, speed, azimuth, elevation = truth
    fast = np.arange(WAVE.n_sample) * WAVE.chirp_duration / WAVE.n_sample
    turns = np.arange(WAVE.n_chirp)[None, :] * WAVE.n_tx + np.arange(WAVE.n_tx)[:, None]
    time = turns[..., None] * WAVE.chirp_interval + fast - WAVE.acquisition_time / 2
    tau = 2 * (distance + speed * time) / SPEED_OF_LIGHT
    phase = (WAVE.carrier - WAVE.bandwidth / 2) * tau + WAVE.slope * tau * fast
    steering = INFO.array.steering(azimuth, elevation, WAVE.wavelength).reshape(WAVE.n_tx, 1, -1, 1)
    return np.asarray(np.exp(2j * np.pi * phase)[:, :, None, :] * steering)


def frame(truth: NDArray[np.float64], snr_db: float, rng: np.random.Generator) -> RadarFrame:
    """One echo, of ``truth`` as `echo` takes it, ``snr_db`` per channel behind untapered transforms, in noise drawn by ``rng``."""
    cube = AMPLITUDE * 10 ** ((snr_db - SNR_DB) / 20) * echo(truth) + noise(rng)
    return RadarFrame(cube.astype(np.complex64), 0, 0, "radar")


def busy(rng: np.random.Generator, n: int = 40) -> tuple[NDArray[np.float64], RadarFrame]:
    """Make ``n`` echoes of 10 to 35 dB in noise, of 40 about a hundred detections; truths have shape (n, 4)."""
    cube, truths = noise(rng).astype(np.complex128), []
    for _ in range(n):
        level = rng.uniform(-10, 15)
        truths.append(rng.uniform(*LIMITS))
        cube += AMPLITUDE * 10 ** (level / 20) * echo(truths[-1])
    return np.array(truths), RadarFrame(cube.astype(np.complex64), 0, 0, "radar")


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
