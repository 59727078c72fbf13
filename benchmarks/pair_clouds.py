"""One person who walks before several radars: scenes drawn from a seed, simulated once through the real baseband, clouds kept on disk."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.gesture_scenes import fitted
from benchmarks.scenarios import person, walk
from benchmarks.stores import Store, clouds_of, pack, room_effects, unpack
from radar_core import PointCloud, Pose
from radar_sim import Scene
from radar_sim.people import Action
from radar_sim.scene import Fidelity, SceneRadar

SECONDS: Final = 60.0
FRAME: Final = 0.04  # s: half of the default rate; a person walks 4 cm meanwhile, and simulating costs half
APART: Final = {"left": 0.0, "near": 0.3, "middle": 0.6, "wide": 1.6}
"""Radars of every scene, and how far each stands from the left one [m]."""


def scene(seed: int, seconds: float = SECONDS) -> Scene:
    """Draw a person who walks to and fro between random places, and four radars on one wall, as `APART` says, turned inwards by chance."""
    rng = np.random.default_rng([seed, 73])

    def place() -> tuple[float, float]:
        x = rng.uniform(1.3, 4.6)
        return float(x), float(rng.uniform(-1.0, 1.0) * (0.35 + 0.3 * x))

    def more() -> Sequence[Action]:
        nonlocal last
        goal = place()
        while math.dist(goal, last) < 1.0:
            goal = place()
        last = goal
        return (walk(*goal, rng.uniform(0.6, 1.3)),)

    start = last = place()
    walker = person(rng, 1, start, ())
    radars = []
    for name, apart in APART.items():
        yaw = rng.normal(0.0, 0.05) + {"left": -0.2, "near": -0.1, "middle": 0.0, "wide": 0.25}[name]
        x = rng.uniform(-0.1, 0.1)
        info = SceneRadar(frame_id=f"{name}/radar", mount=Pose(x=x, y=0.8 - apart, z=1.2, yaw=yaw))
        radars.append(replace(info, waveform=replace(info.waveform, frame_interval=FRAME)))
    return Scene(
        duration=seconds,
        seed=seed,
        radars=tuple(radars),
        people=(fitted(walker, seconds, seed, more, (0.0, 0.0)),),
        effects=room_effects(),
        fidelity=Fidelity(model="separable"),
    )


@dataclass(frozen=True, eq=False)
class Stream:
    """What one radar saw of a scene."""

    radar: SceneRadar
    clouds: tuple[PointCloud, ...]  # in the frame of the sensor, in order of time
    truth: NDArray[np.float64]  # shape (n_clouds, 3): where the centre of the body was at their stamps, in ``room`` [m]


class PairStore(Store):
    """Clouds of scenes in a folder, one file for each radar."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, "pairs", _simulate)

    def fill(self, scenes: Iterable[Scene], *, progress: bool = True) -> None:
        """Simulate what is not there yet."""
        self.make([(drawn, radar) for drawn in scenes for radar in range(len(drawn.radars))], progress=progress)

    def read(self, drawn: Scene, name: str) -> Stream:
        """Read what a radar saw."""
        number = next(i for i, radar in enumerate(drawn.radars) if radar.namespace == name)
        columns = self.columns(drawn, number)
        return Stream(drawn.radars[number], tuple(unpack(columns, drawn.radars[number].frame_id)), columns["truth"])


def _simulate(drawn: Scene, radar: int) -> dict[str, NDArray[Any]]:
    clouds, truths = clouds_of(drawn, radar)
    return pack(clouds) | {"truth": np.array([truth.position[0] for truth in truths])}
