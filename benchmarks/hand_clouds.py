"""Hands that draw, seen by two radars: scenes, their clouds simulated once and kept, and where the visible hand truly was."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.stores import Store, clouds_of, pack, room_effects, unpack
from radar_core import PointCloud, Pose
from radar_core.config import plain
from radar_dsp import BasebandConfig
from radar_sim import Scene, Truth
from radar_sim.people import Action, Draw, Person, Reach
from radar_sim.scene import SceneRadar

Float64Array = NDArray[np.float64]

BASELINE: Final = 0.5  # from one radar to the other [m]
HEIGHT: Final = 1.2  # of both radars above the floor [m]
STAND: Final = 0.8  # how long everybody stands still before the hand begins [s]
DISTANCES: Final = (0.8, 1.2, 1.6, 2.0, 2.5)  # of the hand from the middle between the radars, one for each seed [m]
_OFFSET: Final = 5e-6  # s: the second radar sends that much later, so that their chirps do not meet
_ARM: Final = 0.5  # m: the hand draws that far in front of the body
_PALM: Final = 0.12  # m: what is seen within that of the hand's joint is hand; the mesh has nothing else there


@dataclass(frozen=True)
class Script:
    """What a hand does."""

    name: str
    duration: float  # of the scene [s]
    draws: tuple[Draw, ...] = ()  # one after the other; empty: the hand goes to and fro between places and rests there

    def actions(self, at: tuple[float, float, float]) -> tuple[Action, ...]:
        """Write the script of somebody whose hand draws around a place in the room [m]."""
        start = Action(stand=STAND)
        if self.draws:
            return (start, *(Action(draw=draw) for draw in self.draws))
        x, y, z = at
        places = [(x, y + side, z + up) for side, up in ((0.22, 0.0), (-0.2, 0.1), (0.15, -0.2), (0.15, 0.2), (-0.2, -0.1))]
        return (start, *(Action(reach=Reach(to=place, hold=0.5)) for place in places))


def _drawn(name: str, shape: str, size: float, speed: float, duration: float) -> Script:
    return Script(name, duration, (Draw(shape=shape, size=size, speed=speed, duration=duration - STAND),))


SCRIPTS: Final = (
    _drawn("slow line", "line_side", 0.25, 0.25, 6.8),
    _drawn("fast line", "line_side", 0.25, 1.3, 5.8),
    _drawn("circle", "circle", 0.25, 0.9, 5.8),
    Script("stop and go", 6.8),
    _drawn("slider", "line_up", 0.25, 0.4, 7.8),
)
"""What is measured."""
TUNING: Final = (
    _drawn("eight", "eight", 0.25, 1.0, 5.8),
    _drawn("slow circle", "circle", 0.2, 0.3, 5.8),
    _drawn("fast line up", "line_up", 0.25, 1.2, 5.8),
    _drawn("slow line side", "line_side", 0.2, 0.35, 5.8),
)
"""What filters are tuned on."""


def scene(script: Script, seed: int, distance: float, body: str = "mesh", offset: float = _OFFSET, noise: float = 15.0) -> Scene:
    """Put one person before two radars.

    ``script``: what the hand does; ``seed``: of everything drawn: stature, build, arm, where the person stands; ``distance``: of the hand
    from the radars [m]; ``body``: as `Person.body`; ``offset``: how much later the second radar's frames begin [s]; ``noise``: noise figure
    of the receivers [dB].
    """
    rng = np.random.default_rng([seed, 7])
    side = float(rng.uniform(-0.15, 0.15))
    person = Person(
        height=float(rng.uniform(1.6, 1.9)),
        sex=("male", "female")[int(rng.integers(2))],
        build=float(rng.uniform(0.2, 0.8)),
        arm=("right", "left")[int(rng.integers(2))],
        body=body,
        position=(distance + _ARM, side),
        heading=float(np.pi),
    )
    arm = 0.15 if person.arm == "right" else -0.15
    person = dataclasses.replace(person, script=script.actions((distance, side + arm, 0.62 * person.height)))
    radars = tuple(
        SceneRadar(frame_id=f"{name}/radar", mount=Pose(y=y, z=HEIGHT), trigger_offset=late)
        for name, y, late in (("left", BASELINE / 2, 0.0), ("right", -BASELINE / 2, offset))
    )
    return Scene(duration=script.duration, seed=seed, radars=radars, effects=room_effects(noise), people=(person,))


@dataclass(frozen=True, eq=False)
class Stream:
    """What one radar saw of a scene, and the truth at its clouds."""

    clouds: list[PointCloud]  # in the sensor's frame
    # shape (n_clouds, 3): of what the radar sees of the hand, elements weighted by their cross-section [m]; NaN: it sees nothing of it
    centroid: Float64Array
    weight: Float64Array  # shape (n_clouds,): the sum of those cross-sections [m^2]
    # hand, velocity, body: shape (n_clouds, 3): the hand's joint [m], its velocity [m/s], and the body's centre [m]
    hand: Float64Array
    velocity: Float64Array
    body: Float64Array
    drawing: NDArray[np.bool_]  # shape (n_clouds,): whether the hand draws or reaches


class HandStore(Store):
    """Streams of scenes in a folder, one file for each radar."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, "hands", _simulate, [plain(BasebandConfig())])

    def fill(self, scenes: Sequence[Scene], *, n_jobs: int = 1, progress: bool = True) -> None:
        """Simulate what is not there yet."""
        self.make([(made, radar) for made in scenes for radar in range(len(made.radars))], n_jobs=n_jobs, progress=progress)

    def read(self, made: Scene, radar: int) -> Stream:
        """Read what one radar saw."""
        columns = self.columns(made, radar)
        truth = (columns[f"true_{name}"] for name in ("centroid", "weight", "hand", "velocity", "body", "drawing"))
        return Stream(unpack(columns, made.radars[radar].frame_id), *truth)


def visible(truth: Truth) -> tuple[Float64Array, float]:
    """Centroid of what a radar sees of the acting hand [m], and its cross-section towards the radar [m^2]; NaN and 0: nothing."""
    away = truth.scatterer_position.astype(np.float64) - truth.hand_position[0]
    own = (np.linalg.norm(away, axis=1) < _PALM) & (truth.scatterer_owner == 0)
    weight = truth.scatterer_rcs[own].astype(np.float64)
    total = float(weight.sum())
    return (truth.hand_position[0] + weight @ away[own] / total, total) if total > 0 else (np.full(3, np.nan), 0.0)


def _simulate(made: Scene, radar: int) -> dict[str, NDArray[Any]]:
    clouds, truths = clouds_of(made, radar)
    seen = [visible(truth) for truth in truths]
    return pack(clouds) | {
        "true_centroid": np.array([place for place, _ in seen]),
        "true_weight": np.array([weight for _, weight in seen]),
        "true_hand": np.array([truth.hand_position[0] for truth in truths]),
        "true_velocity": np.array([truth.hand_velocity[0] for truth in truths]),
        "true_body": np.array([truth.position[0] for truth in truths]),
        "true_drawing": np.array([truth.drawing[0] for truth in truths]),
    }
