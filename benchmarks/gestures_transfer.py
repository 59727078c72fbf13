"""Synthetic to real: trained on simulated push, pull, up, down and circle alone, tested on real people (mHomeGes, mTransSee)."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import AntennaArray, PointCloud, Pose, RadarInfo, Waveform
from radar_core.config import config, knob, plain
from radar_dsp import Baseband, BasebandConfig
from radar_dsp.config import CfarConfig, CouplingConfig, SpectrumConfig
from radar_gestures.samples import open_folder, pack_clouds, sample_path, write_chunk
from radar_gestures.workers import work_through
from radar_sim import ChannelErrors, Effects, Losses, Noise, Occlusion, Person, Scene, SceneRadar, Simulator, Variation
from radar_sim.bodies.base import Posture
from radar_sim.motions.curves import Path as HandPath, Vector, cruise, minimum_jerk, within_reach
from radar_sim.motions.script import Timeline
from radar_sim.motions.strokes import REST
from radar_sim.scatterers import Float64Array
from radar_sim.scene import Fidelity

FIVE: Final = ("circle", "down", "pull", "push", "up")
GATE: Final = 0.356  # m/s: mHomeGes's Doppler step
DEVELOPMENT: Final = (801, 804, 812, 822)
_HALF: Final = 299_792_458.0 / 78.8e9 / 2  # m


def radar(height: float) -> RadarInfo:
    n_chirp, n_tx = 32, 3
    interval = (299_792_458.0 / 78.8e9) / (2 * GATE * n_chirp * n_tx)
    waveform = Waveform(
        carrier=78.8e9, bandwidth=3.6e9, chirp_duration=interval * 0.75, chirp_pause=interval * 0.25, frame_interval=0.1,
        n_tx=n_tx, n_chirp=n_chirp, n_sample=96,
    )
    array = AntennaArray(
        tx=((0.0, 0.0), (2 * _HALF, _HALF), (4 * _HALF, 0.0)), rx=tuple((k * _HALF, 0.0) for k in range(4)),
        fov_azimuth=math.radians(120), fov_elevation=math.radians(120),
    )
    return RadarInfo(frame_id="radar", waveform=waveform, array=array, mount=Pose(z=height))


BASEBAND: Final = BasebandConfig(
    spectrum=SpectrumConfig(range_window="hann", speed_window="hann"),
    coupling=CouplingConfig(range_extent=0.0),
    cfar=CfarConfig(algorithm="ca", window="range", false_alarm=1e-4, guard_range=4, training_range=8),
    grouping="range",
    max_detections=64,
)


class Gesturing(Timeline):
    """Somebody whose hand follows a path over time."""

    def __init__(self, person: Person, seed: int, hand: Callable[[float], Vector]) -> None:
        super().__init__(person, seed)
        self._path = hand

    def posture(self, times: Float64Array) -> Posture:
        body, _ = self._after
        return self._composer.posture([self._composer.row(body, self._path(t), self._alive.at(t)) for t in times.tolist()])


def u(rng, low, high):
    return float(rng.uniform(low, high))


def arc(start: float, end: float, radius: float, side: float, bend: float) -> HandPath:
    def path(x: float) -> Vector:
        s = minimum_jerk(x)
        a = start + (end - start) * s
        r = radius * (1 - bend * math.sin(math.pi * s))
        return within_reach((r * math.cos(a), side, r * math.sin(a)))
    return path


def straight(a: Vector, b: Vector, sag: float) -> HandPath:
    def path(x: float) -> Vector:
        s = minimum_jerk(x)
        return within_reach((a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1]), a[2] + s * (b[2] - a[2]) + sag * math.sin(math.pi * s)))
    return path


def round_(centre: Vector, radius: tuple[float, float], turn: float, start: float, rounds: float, way: float, edge: float) -> HandPath:
    def path(x: float) -> Vector:
        a = start + 2 * math.pi * rounds * cruise(x, edge)[0]
        left, up = way * math.sin(a) * radius[0], -math.cos(a) * radius[1]
        return within_reach((centre[0] + math.sin(turn) * left, centre[1] + math.cos(turn) * left, centre[2] + up))
    return path


def stroke(rng, name: str) -> tuple[HandPath, float]:
    if name in ("push", "pull"):
        near = (u(rng, 0.2, 0.45), u(rng, -0.2, 0.25), u(rng, -0.4, 0.1))
        far = (u(rng, 0.8, 0.98), u(rng, -0.2, 0.3), u(rng, -0.2, 0.2))
        path = straight(near, far, u(rng, -0.1, 0.1)) if name == "push" else straight(far, near, u(rng, -0.1, 0.1))
        return path, u(rng, 0.35, 0.9)
    if name in ("up", "down"):
        low = u(rng, -1.5, -0.8)
        high = u(rng, -0.2, 0.5) if rng.random() < 0.35 else u(rng, 0.4, 1.5)
        ends = (low, high) if name == "up" else (high, low)
        span = (high - low) / 2.2
        return arc(*ends, u(rng, 0.75, 0.98), u(rng, -0.3, 0.3), u(rng, -0.1, 0.25)), u(rng, 0.45, 1.2) * max(span, 0.6)
    r = u(rng, 0.4, 0.8)
    centre = (u(rng, 0.35, 0.7), u(rng, -0.15, 0.3), u(rng, -0.2, 0.2))
    way = 1.0 if rng.random() < 0.9 else -1.0
    return round_(centre, (r * u(rng, 0.7, 1.0), r), u(rng, 0.1, 1.0), u(rng, -0.5, 0.5), u(rng, 0.85, 1.1), way, u(rng, 0.1, 0.3)), u(rng, 0.9, 2.3)


@dataclass(frozen=True)
class Drawn:
    label: str
    scene: Scene
    hand: Callable[[float], Vector]
    start: float
    end: float
    static: str


def draw(seed: int, number: int) -> Drawn:
    rng = np.random.default_rng([seed, number, 0x7A4])
    label = FIVE[number % 5]
    path, duration = stroke(rng, label)
    lead = u(rng, 0.5, 0.9)   # raise
    hold0 = u(rng, 0.0, 0.4)
    hold1 = u(rng, 0.0, 0.3)
    after = u(rng, 0.5, 1.0)
    t0 = lead + hold0
    t1 = t0 + duration
    first, last = path(0.0), path(1.0)
    end_at = REST if rng.random() < 0.75 else (first if rng.random() < 0.3 else last)
    begin_at = REST if rng.random() < 0.8 else first
    raise_, lower = straight(begin_at, first, 0.0), straight(last, end_at, 0.0)

    def hand(t: float) -> Vector:
        if t < lead:
            return raise_(t / lead)
        if t < t1:
            return path(max(t - t0, 0.0) / duration)
        return lower(max(t - t1 - hold1, 0.0) / after)

    start = max(0.0, t0 - u(rng, -0.1, 0.4))
    end = t1 + u(rng, -0.1, 0.5)
    distance, azimuth = u(rng, 1.2, 3.0), u(rng, -0.08, 0.08)
    person = Person(
        position=(distance * math.cos(azimuth), distance * math.sin(azimuth)),
        heading=math.remainder(azimuth + math.pi + u(rng, -0.15, 0.15), 2 * math.pi),
        sex="female" if rng.random() < 0.4 else "male",
        height=u(rng, 1.55, 1.88), build=u(rng, 0.1, 0.8), arm="left" if rng.random() < 0.05 else "right",
        variation=Variation(sway=u(rng, 0.5, 2.0)),
    )
    effects = Effects(
        occlusion=Occlusion(), doppler_in_chirp=True, noise=Noise(noise_figure=15.0), losses=Losses(level=u(rng, 6.0, 16.0)),
        channel_errors=ChannelErrors(gain=1.0, phase=0.2, shift=0.0, seed=int(rng.integers(1 << 62))),
    )
    scene = Scene(
        duration=end + 0.3, seed=int(rng.integers(1 << 62)), radars=(SceneRadar.of(radar(u(rng, 0.3, 1.5)), trigger_offset=u(rng, 0, 0.1)),),
        people=(person,), effects=effects, fidelity=Fidelity(model="separable"), tolerance=0.1,
    )
    return Drawn(label, scene, hand, start, end, "keep" if number % 2 else "remove")


@functools.lru_cache(maxsize=2)
def _baseband(static: str) -> Baseband:
    return Baseband(replace(BASEBAND, spectrum=replace(BASEBAND.spectrum, static=static)), radar(1.2))


def clouds_of(drawn: Drawn) -> list[PointCloud]:
    simulator = Simulator(drawn.scene)
    person = drawn.scene.people[0]
    simulator.world.timelines = (Gesturing(person, drawn.scene.seed, drawn.hand),)
    offset = simulator.radar.trigger_offset
    first, last = max(0, math.ceil((drawn.start - offset) / simulator.interval)), math.floor((drawn.end - offset) / simulator.interval)
    baseband = _baseband(drawn.static)
    return [baseband.process(simulator.process(k).frame) for k in range(first, min(last + 1, simulator.n_frames))]
