"""Echoes written from the formulas of the design page, and estimates from raw cubes; no code of the simulator or the baseband chain."""

import math

import numpy as np

from radar_core import SPEED_OF_LIGHT, RadarInfo
from radar_sim import Effects, Point, Scene, SceneRadar, Simulator
from radar_sim.effects.config import PHYSICS

ALL_PHYSICS = dict.fromkeys(PHYSICS, True)
"""Every effect on how echoes travel."""


def a_scene(radar: RadarInfo | None = None, **more) -> Scene:
    """A scene of one second with one radar."""
    return Scene(**{"duration": 1.0, "radars": (SceneRadar.of(radar or RadarInfo()),), **more})


def point_scene(position, velocity=(0.0, 0.0, 0.0), *, rcs=0.1, effects=None, radar=None, **more) -> Scene:
    """A scene with one point target."""
    return a_scene(radar, points=(Point(position=position, velocity=velocity, rcs=rcs),), effects=effects or Effects(), **more)


def first_cube(scene: Scene) -> np.ndarray:
    return Simulator(scene).process(0).frame.cube


def expected_cube(info: RadarInfo, position, velocity, amplitude: float, start: float = 0.0) -> np.ndarray:
    """One point echo in complex128: true path of every channel at every sample; ``position`` in the sensor frame when the frame starts."""
    w = info.waveform
    t, chirp, fast = np.arange(w.n_tx), np.arange(w.n_chirp), np.arange(w.n_sample) * w.chirp_duration / w.n_sample
    since = ((chirp[None, :] * w.n_tx + t[:, None]) * w.chirp_interval)[:, :, None] + fast + start
    place = np.asarray(position) + since[..., None] * np.asarray(velocity)
    cube = np.empty(info.cube_shape, np.complex128)
    for i, (ty, tz) in enumerate(info.array.tx):
        for j, (ry, rz) in enumerate(info.array.rx):
            out = np.linalg.norm(place[i] - [0.0, ty, tz], axis=-1)
            back = np.linalg.norm(place[i] - [0.0, ry, rz], axis=-1)
            tau = (out + back) / SPEED_OF_LIGHT
            turns = (w.carrier - w.bandwidth / 2) * tau + w.slope * tau * fast - w.slope * tau**2 / 2
            cube[i, :, j] = amplitude * np.exp(2j * math.pi * turns)
    return cube


def peak(cube: np.ndarray, info: RadarInfo) -> tuple[float, float]:
    """Range [m] and range rate [m/s] of the strongest echo, from a padded spectrum of the first channel (1/8 bin)."""
    w = info.waveform
    window = np.hanning(w.n_chirp)[:, None] * np.hanning(w.n_sample)
    spectrum = np.abs(np.fft.fft2(cube[0, :, 0] * window, (8 * w.n_chirp, 8 * w.n_sample)))
    d, r = np.unravel_index(np.argmax(spectrum), spectrum.shape)
    speed = ((d / 8 + w.n_chirp / 2) % w.n_chirp - w.n_chirp / 2) * w.speed_resolution
    return r / 8 * w.range_resolution, speed
