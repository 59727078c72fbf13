"""The velocity of a hand from one snapshot of two radars (thesis, 7.3.1): against its Cramer-Rao bound, all over a room."""

from __future__ import annotations

import dataclasses
import functools
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks import velocity_room
from benchmarks.hand import scenes
from benchmarks.hand_runs import DISTANCES, HandStore, Tracked, counts, follow, rms, track
from benchmarks.hand_snapshots import judge, scene_figures, tables
from benchmarks.report import against_first, timed
from benchmarks.stores import kept
from benchmarks.velocity_room import Errors, Hand, draw, draws, estimate, forearm, mounts, ratios, summary
from radar_core.config import load
from radar_tracking import HandConfig
from radar_tracking.estimators import Snapshot, SnapshotConfig

Float64Array = NDArray[np.float64]


def knobs() -> dict[str, HandConfig]:
    """Give the defaults, which stand first, and what else could be believed of the errors of range rates."""
    one = {"spread": (0.05, 0.1), "common": (0.0, 0.05), "spin": (1.0, 2.5), "rest": (0.3, 10.0), "huber": (1.5,), "iterations": (1,)}
    changes: list[dict[str, float]] = [{knob: value} for knob, values in one.items() for value in values]
    changes = [{}, *changes, {"spread": 0.08, "common": 0.05, "spin": 2.5, "rest": 1e3}]  # the last: until the noise was measured
    return {
        ", ".join(f"{knob}={value:g}" for knob, value in own.items()) or "default": load(HandConfig, {"snapshot": own}) for own in changes
    }


def measure_scenes(tracked: Sequence[Tracked], distances: Sequence[float], quick: bool) -> dict[str, Any]:
    """Follow the hand with every setting: ``scenes`` (all clouds), ``scenes_by`` (distance, speed), ``scenes_by_knob``, ``choices``."""
    made: dict[str, Any] = {"scenes_by_knob": {}}
    found = {}
    for name, config in list(knobs().items())[: 2 if quick else None]:
        runs = [(one, follow(one, config)) for one in tracked]
        judged = judge(runs)
        every = scene_figures(judged)
        own = [counts(t) & np.isfinite(f.position[:, 0]) for t, f in runs]
        off = rms(np.linalg.norm((f.velocity - t.velocity)[mask], axis=1) for (t, f), mask in zip(runs, own, strict=True))
        place = rms(np.linalg.norm((f.position - t.hand)[mask], axis=1) for (t, f), mask in zip(runs, own, strict=True))
        made["scenes_by_knob"][name] = every | {"track_velocity_rms_m_s": off, "track_rms_m": place}
        found[name] = off, [value for _, followed in runs for value in followed.times_ms]
        if name == "default":
            made |= {"scenes": every, "scenes_by": tables(judged, distances)}
    return made | {"choices": against_first("hand velocity, scenes", "rms error of the track's velocity", found, "m/s")}


BASELINES: Final = (0.3, 0.5, 0.6)  # from one radar to the other [m]; the thesis has 0.3 (section 7.3) and 0.6 (figure 7.6)
XS: Final = tuple(np.round(np.arange(0.3, 3.01, 0.3), 2).tolist())
YS: Final = tuple(np.round(np.arange(-1.2, 1.21, 0.3), 2).tolist())
HEIGHTS: Final = (0.8, 1.2, 1.6)  # places of hands in the room [m]
SPOTS: Final = ((0.8, 0.0), (1.2, 0.4), (1.6, 0.0), (1.6, -0.6))  # where hands with outliers and with errors of direction are drawn [m]
ANGLES: Final = (0.003, 0.01, 0.03)
"""Errors of directions, where they have any [rad]: about those of azimuths and of elevations in simulated clouds, and much more."""
SPOILS: Final = {"none": None, "forearm": forearm, "torso": velocity_room.torso, "false alarms": None}


def at_spots(n: int, **changes: Any) -> Errors:
    """Measure a few places with one setting, all together."""
    parts = [
        draws(np.random.default_rng([9, k]), np.array([x, y, velocity_room.HEIGHT]), mounts(0.5), n, **changes)
        for k, (x, y) in enumerate(SPOTS)
    ]
    joined = [np.concatenate([getattr(part, name) for part in parts]) for name in ("error", "std", "bound", "thesis")]
    return Errors(*joined, times_ms=[value for part in parts for value in part.times_ms])


def figures(found: Errors) -> dict[str, float]:
    """NEES and errors (rms) along the two axes of the floor plane [m/s]."""
    std, limit, thesis = ratios(found)
    made = {"nees": found.nees, "told_second": float(found.told[:, 1].mean())}
    for axis, name in enumerate(("first", "second")):
        made |= {f"rms_{name}_m_s": std[axis], f"bound_{name}_m_s": limit[axis], f"thesis_{name}_m_s": thesis[axis]}
    return {key: float(value) for key, value in made.items()}


def spoiled(n: int) -> dict[str, dict[str, dict[str, float]]]:
    """One point of ten is no part of the hand: with weights and without; what weights cost where all is well, and what they save."""
    made: dict[str, dict[str, dict[str, float]]] = {}
    for kind, spoil in SPOILS.items():
        made[kind] = {}
        for name, rounds in (("weights", SnapshotConfig().iterations), ("no weights", 1)):
            config = dataclasses.replace(SnapshotConfig(), iterations=rounds)
            made[kind][name] = figures(at_spots(n, config=config, spoil=spoil, share=0.0 if kind == "none" else 0.1))
    return made


def askew(n: int) -> dict[str, dict[str, dict[str, float]]]:
    """Directions have errors, which the model leaves out; the bound does not know of them either."""
    return {
        f"{angle:g} rad": {f"{speed:g} m/s": figures(at_spots(n, speed=speed, angle_std=angle)) for speed in (0.25, 1.0, 2.0)}
        for angle in ANGLES
    }


def rows(n: int) -> list[dict[str, Any]]:
    """Error along the second axis with one point of ten on the forearm, beside the time of one snapshot; the reference is equation 7.5."""
    default, hands = SnapshotConfig(), []
    for k, (x, y) in enumerate(SPOTS):
        rng = np.random.default_rng([9, k])
        hands += [draw(rng, np.array([x, y, velocity_room.HEIGHT]), mounts(0.5), default, spoil=forearm, share=0.1) for _ in range(n)]
    axes = [estimate(hand, Snapshot()).axes[1] for hand in hands]  # the same for all, told or not
    changes = [("iterations", 1), ("iterations", 10), ("huber", 1.5), ("huber", 3.0), ("spin", 0.0), ("common", 0.0)]
    configs = {"default": dataclasses.replace(default, max_std=100.0)}
    configs |= {f"{name}={value:g}": load(SnapshotConfig, {"max_std": 100.0, name: value}) for name, value in changes}
    calls: dict[str, Callable[[Hand], Float64Array]] = {"pseudo-inverse (7.5)": velocity_room.pseudo_inverse}
    calls |= {name: functools.partial(_told, Snapshot(config)) for name, config in configs.items()}
    made = {}
    for name, call in calls.items():
        found, times = zip(*(timed(call, hand) for hand in hands), strict=True)
        off = [float(axis @ (velocity - hand.velocity)) for velocity, hand, axis in zip(found, hands, axes, strict=True)]
        made[name] = float(np.sqrt(np.mean(np.square(off)))), times
    return against_first("hand velocity", "rms error across", made, "m/s")


def _told(snapshot: Snapshot, hand: Hand) -> Float64Array:
    """Velocity as far as it is told, shape (3,) [m/s]."""
    found = estimate(hand, snapshot)
    return np.asarray(np.nan_to_num(found.along) @ found.axes)


def in_scenes(folder: Path, quick: bool) -> dict[str, Any]:
    """Measure the stored scenes; those that are missing are simulated."""
    store, made = HandStore(folder), scenes(quick)
    store.fill(made, n_jobs=1 if quick else os.cpu_count() or 1, progress=not quick)
    return measure_scenes([track(store, one) for one in made], DISTANCES, quick)


def run(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Estimate velocities of hands all over a room and in simulated scenes.

    ``quick``: a few places and draws, and no scenes unless `keep` is given: to see that it runs; ``keep``: folder of the simulated clouds,
    the same as that of ``hand``; None: they are thrown away.
    Returns ``velocity_ratio_max``: largest standard deviation over Cramer-Rao bound, along any axis anywhere in the common field of view
    where it is told; ``velocity_nees`` per degree of freedom and ``velocity_nees_in_band``: share of places with it in its 99 % band;
    ``velocity_refused``: share of snapshots that tell one axis only; the same by baseline and height (``room``), ``maps`` at the radars'
    height, ``outliers``, ``directions``, ``scenes``, ``choices``.
    """
    baselines, heights, n = (BASELINES, HEIGHTS, 400) if not quick else ((0.5,), (velocity_room.HEIGHT,), 120)
    xs, ys = (XS, YS) if not quick else (XS[1::4], YS[::4])
    found = velocity_room.room(baselines, heights, xs, ys, n)
    every = summary(found)
    by = {
        f"{baseline:g} m": {
            f"z = {z:g} m": summary([row for row in found if row["baseline"] == baseline and row["place"][2] == z]) for z in heights
        }
        for baseline in baselines
    }
    figure = {
        **{f"velocity_{name}": value for name, value in every.items()},
        "room": by,
        "maps": velocity_room.maps(found, baselines, xs, ys),
        "outliers": spoiled(40 if quick else 2000),
        "directions": askew(40 if quick else 2000),
        "choices": rows(20 if quick else 500),
    }
    if quick and keep is None:
        return figure
    with kept(keep) as folder:
        other = in_scenes(folder, quick)
    return {**figure, **other, "choices": figure["choices"] + other["choices"]}
