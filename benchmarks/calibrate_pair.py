"""The second radar's mount from one person who walks for a minute: errors over many people and ways, and whether its uncertainty is honest.

Raw frames through the real baseband and tracker. Four radars look at each person: pairs 0.3, 0.6 and 1.6 m apart share the left one. The
clocks of the second radars are behind by 0 to 20 ms, drawn for each.
"""

from __future__ import annotations

import dataclasses
import math
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.pair_clouds import APART, FRAME, SECONDS, PairStore, Stream, scene
from benchmarks.report import choice
from radar_core import Pose
from radar_tracking.alignment.pair import PairCalibration, PairConfig, Walker, calibrate_pair

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

    @property
    def honest(self) -> NDArray[np.bool_]:
        """Which calibrations are within three of their standard deviations in everything, shape (n,)."""
        return np.asarray((np.abs(self.error) <= 3.0 * self.std).all(axis=1))


def lag(seed: int, name: str) -> int:
    """How far a second radar's clock is behind [ns]."""
    return round(np.random.default_rng([seed, *name.encode()]).uniform(0.0, LATEST) * 1e9)


def walker(stream: Stream, settings: PairConfig, behind_ns: int = 0) -> Walker:
    """Follow the person in what one radar saw; of its mount only height and tilt are told."""
    info = dataclasses.replace(stream.radar.info, mount=Pose(z=stream.radar.mount.z, tilt=stream.radar.mount.tilt))
    result = Walker(settings, info)
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


def collect(store: PairStore, seeds: Sequence[int], settings: PairConfig, seconds: float) -> dict[str, Errors]:
    """Calibrate every pair of every seed."""
    rows: dict[str, list[tuple[Float64Array, Float64Array, float, float]]] = {name: [] for name in PAIRS}
    for seed in seeds:
        drawn = scene(seed, seconds)
        left = store.read(drawn, "left")
        first = walker(left, settings)
        for name in PAIRS:
            stream, behind = store.read(drawn, name), lag(seed, name)
            second = walker(stream, settings, behind)
            start = time.perf_counter_ns()
            result = calibrate_pair(first, second, settings)
            spent = (time.perf_counter_ns() - start) * 1e-6
            rows[name].append((*error_of(result, true_pose(left.radar.mount, stream.radar.mount), behind * 1e-9), spent))
    found = {}
    for name, own in rows.items():
        error, std, nees, spent = zip(*own, strict=True)
        found[name] = Errors(np.array(error), np.array(std), np.array(nees), tuple(spent))
    return found


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


def together(found: Sequence[Errors]) -> Errors:
    """Put pairs into one table."""
    times = tuple(t for one in found for t in one.times_ms)
    return Errors(
        np.concatenate([f.error for f in found]), np.concatenate([f.std for f in found]), np.concatenate([f.nees for f in found]), times
    )


def run(quick: bool, keep: Path | None = None) -> dict[str, Any]:
    """Measure; with ``keep``, clouds stay there and are not simulated again."""
    if keep is None:
        with tempfile.TemporaryDirectory() as folder:
            return run(quick, Path(folder))
    seeds, seconds = (range(2), 12.0) if quick else (range(SEEDS), SECONDS)
    store = PairStore(keep)
    store.fill([scene(seed, seconds) for seed in seeds])
    settings = PairConfig()
    chosen = collect(store, seeds, settings, seconds)
    result: dict[str, Any] = {"seeds": len(seeds), "seconds": seconds, "frame_interval_s": FRAME}
    result |= figures(together(list(chosen.values())), "all")
    for name, found in chosen.items():
        result |= figures(found, f"apart_{APART[name]:g}_m")
    result["choices"] = []
    reference = None
    for label, other in variants(settings).items():
        found = chosen if other == settings else collect(store, seeds, other, seconds)
        every = together(list(found.values()))
        rms = float(np.sqrt((every.distance**2).mean()) * 1e3)
        row = choice("calibrate_pair", label, accuracy=("position_error", rms, "mm"), times_ms=list(every.times_ms), reference_ms=reference)
        reference = reference or list(every.times_ms)
        result["choices"].append(row)
    return result


def variants(settings: PairConfig) -> dict[str, PairConfig]:
    """Name settings to compare: as shipped, and one thing changed in each."""
    own = settings.alignment

    def other(**changes: Any) -> PairConfig:
        return dataclasses.replace(settings, alignment=dataclasses.replace(own, **changes))

    return {
        "as shipped": settings,
        "loss=huber": other(loss="huber"),
        "loss=none": other(loss="none"),
        "depth=estimated": other(depth="estimated"),
        "surface=0": dataclasses.replace(settings, surface=0.0),
        "clock=false": other(clock=False),
    }
