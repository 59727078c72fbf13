"""The second radar's mount from one person who walks for a minute: errors over many people and ways, and whether its uncertainty is honest.

Raw frames through the real baseband and tracker. Four radars look at each person: pairs 0.3, 0.6 and 1.6 m apart share the left one. The
clocks of the second radars are behind by 0 to 20 ms, drawn for each.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.gesture_scenes import fitted
from benchmarks.report import against_first, timed
from benchmarks.scenarios import person, walk
from benchmarks.stores import Store, clouds_of, kept, pack, room_effects, unpack
from radar_core import PointCloud, Pose
from radar_lab.alignment.pair import PairCalibration, PairConfig, Walker, calibrate_pair
from radar_sim import Scene, Simulator
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
    clouds, truths = clouds_of(Simulator(drawn, drawn.radars[radar].frame_id))
    return pack(clouds) | {"truth": np.array([truth.position[0] for truth in truths])}


Float64Array = NDArray[np.float64]

SEEDS: Final = 24
LATEST: Final = 0.02  # s: how far the clocks are apart at most
PAIRS: Final = tuple(APART)[1:]
_NAMES: Final = ("x", "y", "yaw", "offset")


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors and standard deviations of calibrations, one row each: x, y [m], yaw [rad], clock offset [s]."""

    error: Float64Array
    std: Float64Array
    nees: Float64Array
    times_ms: tuple[float, ...]

    @property
    def distance(self) -> Float64Array:
        """Error of the place on the floor, shape (n,) [m]."""
        return np.asarray(np.hypot(self.error[:, 0], self.error[:, 1]))

    def select(self, mask: Sequence[bool]) -> Errors:
        """Keep some rows."""
        rows = np.flatnonzero(mask)
        return Errors(self.error[rows], self.std[rows], self.nees[rows], tuple(self.times_ms[k] for k in rows))

    @property
    def honest(self) -> NDArray[np.bool_]:
        """Which calibrations are within three of their standard deviations in everything, shape (n,)."""
        return np.asarray((np.abs(self.error) <= 3.0 * self.std).all(axis=1))


def lag(seed: int, name: str) -> int:
    """How far a second radar's clock is behind [ns]."""
    return round(np.random.default_rng([seed, *name.encode()]).uniform(0.0, LATEST) * 1e9)


def walker(stream: Stream, config: PairConfig, behind_ns: int = 0) -> Walker:
    """Follow the person in what one radar saw; of its mount only height and tilt are told."""
    info = dataclasses.replace(stream.radar.info, mount=Pose(z=stream.radar.mount.z, tilt=stream.radar.mount.tilt))
    result = Walker(config, info)
    for cloud in stream.clouds:
        result.process(dataclasses.replace(cloud, stamp_ns=cloud.stamp_ns - behind_ns))
    return result


def true_pose(first: Pose, second: Pose) -> Float64Array:
    """Where the second radar stands in the first one's frame: x, y [m], yaw [rad]."""
    return np.array([*first.from_room(second.origin)[:2], second.yaw - first.yaw])


def error_of(result: PairCalibration, truth: Float64Array, offset: float) -> tuple[Float64Array, Float64Array, float]:
    """Error and standard deviation of x, y, yaw and clock offset, and the error's normalised square."""
    mount, found = result.mount.mount, result.alignment
    error = np.array([mount.x, mount.y, mount.yaw, found.offset]) - [*truth, offset]
    error[2] = math.remainder(error[2], 2 * math.pi)
    names = [name for name in _NAMES if name in found.names]  # without a clock offset: the pose alone
    error, covariance = error[: len(names)], found.part(names)
    return error, np.sqrt(np.diagonal(covariance)), float(error @ np.linalg.solve(covariance, error)) / len(error)


@dataclass(frozen=True, eq=False)
class Case:
    """What two radars saw of one walk, and what is true: x, y [m], yaw [rad] of the second in the first one's frame, clock offset [s]."""

    pair: str
    first: Walker
    second: Walker
    truth: Float64Array
    offset: float


def cases(store: PairStore, seeds: Sequence[int], config: PairConfig, seconds: float) -> list[Case]:
    """Follow the person of every seed with every radar."""
    found = []
    for seed in seeds:
        drawn = scene(seed, seconds)
        left = store.read(drawn, "left")
        first = walker(left, config)
        for name in PAIRS:
            stream, behind = store.read(drawn, name), lag(seed, name)
            truth = true_pose(left.radar.mount, stream.radar.mount)
            found.append(Case(name, first, walker(stream, config, behind), truth, behind * 1e-9))
    return found


def calibrated(every: Sequence[Case], config: PairConfig) -> Errors:
    """Calibrate each pair."""
    rows = []
    for case in every:
        result, spent = timed(calibrate_pair, case.first, case.second, config)
        rows.append((*error_of(result, case.truth, case.offset), spent))
    error, std, nees, times = zip(*rows, strict=True)
    return Errors(np.array(error), np.array(std), np.array(nees), tuple(times))


def figures(found: Errors, label: str) -> dict[str, Any]:
    """Plain figures of one pair, or of all."""
    yaw, offset = np.degrees(np.abs(found.error[:, 2])), np.abs(found.error[:, 3]) * 1e3
    return {
        f"{label}_position_mm_rms": float(np.sqrt((found.distance**2).mean()) * 1e3),
        f"{label}_position_mm_max": float(found.distance.max() * 1e3),
        f"{label}_yaw_deg_rms": float(np.sqrt((yaw**2).mean())),
        f"{label}_yaw_deg_max": float(yaw.max()),
        f"{label}_offset_ms_rms": float(np.sqrt((offset**2).mean())),
        f"{label}_offset_ms_max": float(offset.max()),
        f"{label}_within_3_sigma": float(found.honest.mean()),
        f"{label}_nees": float(found.nees.mean()),
    }


def run(quick: bool, keep: Path | None = None) -> dict[str, Any]:
    """Measure; with ``keep``, clouds stay there and are not simulated again."""
    with kept(keep) as folder:
        return measure(PairStore(folder), quick)


def measure(store: PairStore, quick: bool) -> dict[str, Any]:
    """Simulate what is missing, and calibrate."""
    seeds, seconds = (range(1), 8.0) if quick else (range(SEEDS), SECONDS)
    store.fill([scene(seed, seconds) for seed in seeds], progress=sys.stdout.isatty())  # --json prints one object and nothing else
    config = PairConfig()
    every = cases(store, seeds, config, seconds)
    chosen = calibrated(every, config)
    result: dict[str, Any] = {"seeds": len(seeds), "seconds": seconds, "frame_interval_s": FRAME} | figures(chosen, "all")
    for name in PAIRS:
        result |= figures(chosen.select([case.pair == name for case in every]), f"apart_{APART[name]:g}_m")
    tried = {label: chosen if other == config else calibrated(every, other) for label, other in variants(config).items()}
    rows = {label: (float(np.sqrt((found.distance**2).mean()) * 1e3), found.times_ms) for label, found in tried.items()}
    return result | {"choices": against_first("calibrate_pair", "position_error", rows, "mm")}


def variants(config: PairConfig) -> dict[str, PairConfig]:
    """Name configurations to compare: as shipped, and one thing changed in each."""
    own = config.alignment

    def other(**changes: Any) -> PairConfig:
        return dataclasses.replace(config, alignment=dataclasses.replace(own, **changes))

    return {
        "as shipped": config,
        "loss=huber": other(loss="huber"),
        "loss=none": other(loss="none"),
        "depth=estimated": other(depth="estimated"),
        "surface=0": dataclasses.replace(config, surface=0.0),
        "clock=false": other(clock=False),
    }
