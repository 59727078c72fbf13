"""The velocity of one snapshot in simulated scenes: whether it is as wrong as it says, near and far, slow and fast."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from benchmarks.hand_clouds import BASELINE
from benchmarks.hand_runs import Followed, Tracked, counts, follow, rms
from benchmarks.report import choice
from benchmarks.velocity_draws import in_view, mounts
from radar_core.config import load
from radar_tracking import HandConfig

Float64Array = NDArray[np.float64]

SPEEDS: Final = {"below 0.3 m/s": (0.0, 0.3), "0.3 to 1 m/s": (0.3, 1.0), "above 1 m/s": (1.0, np.inf)}  # classes of true speed [m/s]
_WINDOW: Final = 5  # clouds over which the place of the visible hand is differentiated


@dataclass(frozen=True, eq=False)
class Judged:
    """Snapshots of clouds that count, against the truth."""

    # error, visible: shape (n, 3): along the snapshot's own axes, the best known first: estimate minus the velocity of the hand's joint,
    # and minus that of the centroid of what is seen of the hand [m/s]; NaN: not told
    error: Float64Array
    visible: Float64Array
    std: Float64Array  # shape (n, 3): what the snapshot says of the error [m/s]
    # speed, distance: shape (n,): of the hand [m/s], and from the middle between the radars [m]
    speed: Float64Array
    distance: Float64Array
    alone: NDArray[np.bool_]  # shape (n,): whether there was one point only, which nothing can test

    def select(self, mask: NDArray[np.bool_]) -> Judged:
        """Keep some clouds."""
        return Judged(*(getattr(self, field.name)[mask] for field in dataclasses.fields(self)))


def judge(runs: Sequence[tuple[Tracked, Followed]]) -> Judged:
    """Compare all snapshots of hands within the common field of view."""
    return _join([_judge(tracked, followed) for tracked, followed in runs])


def _judge(tracked: Tracked, followed: Followed) -> Judged:
    sensors = mounts(BASELINE)
    step = float(np.median(np.diff(tracked.time)))
    visible = savgol_filter(tracked.hand, _WINDOW, 2, deriv=1, delta=step, axis=0)
    use = counts(tracked) & in_view(tracked.hand, sensors) & np.array([found is not None for found in followed.snapshots])
    index = np.flatnonzero(use)
    rows = []
    for k in index:
        found = followed.snapshots[k]
        assert found is not None
        alone = np.count_nonzero(np.isfinite(found.weight)) < 2
        rows.append((found.along - found.axes @ tracked.velocity[k], found.along - found.axes @ visible[k], found.std, alone))
    error, seen, std = (np.array([row[part] for row in rows]).reshape(-1, 3) for part in range(3))
    speed = np.linalg.norm(tracked.velocity[index], axis=1)
    distance = np.linalg.norm(tracked.hand[index] - sensors.mean(axis=0), axis=1)
    return Judged(error, seen, std, speed, distance, np.array([row[3] for row in rows], np.bool_))


def _join(parts: Sequence[Judged]) -> Judged:
    return Judged(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in dataclasses.fields(Judged)))


def figures(found: Judged) -> dict[str, float]:
    """NEES along the two best axes, errors (rms), and how often each axis is told; ``several``: of snapshots of more than one point."""
    made: dict[str, float] = {"clouds": len(found.speed), "alone": int(found.alone.sum())}
    for axis, name in enumerate(("first", "second")):
        told = np.isfinite(found.error[:, axis])
        made[f"told_{name}"] = float(told.mean()) if len(told) else float("nan")
        if not told.any():
            continue
        error, std = found.error[told, axis], found.std[told, axis]
        made[f"nees_{name}"] = float(np.mean((error / std) ** 2))
        made[f"nees_{name}_several"] = float(np.mean(((error / std) ** 2)[~found.alone[told]]))
        made[f"nees_{name}_visible"] = float(np.mean((found.visible[told, axis] / std) ** 2))
        made[f"largest_{name}"] = float(np.max(np.abs(error / std)))
        made[f"rms_{name}_m_s"] = float(np.sqrt(np.mean(error**2)))
    return made


def tables(found: Judged, distances: Sequence[float]) -> dict[str, dict[str, dict[str, float]]]:
    """Give the figures over distance and over speed."""
    edges = [0.0, *((a + b) / 2 for a, b in itertools.pairwise(distances)), np.inf]
    near = {f"{far:g} m": edge for far, edge in zip(distances, itertools.pairwise(edges), strict=True)}
    made: dict[str, dict[str, dict[str, float]]] = {}
    for title, value, classes in (("distance", found.distance, near), ("speed", found.speed, SPEEDS)):
        made[title] = {}
        for name, (low, high) in classes.items():
            if (own := (value >= low) & (value < high)).any():
                made[title][name] = figures(found.select(own))
    return made


def knobs() -> dict[str, HandConfig]:
    """Give the defaults, which stand first, and what else could be believed of the errors of range rates."""
    one = {"spread": (0.12, 0.06), "common": (0.03, 0.1), "spin": (1.5, 5.0), "huber": (1.5,), "iterations": (1,)}
    changes: list[dict[str, float]] = [{knob: value} for knob, values in one.items() for value in values]
    changes = [{}, *changes, {"common": 0.03, "spin": 1.5}]
    return {
        ", ".join(f"{knob}={value:g}" for knob, value in own.items()) or "default": load(HandConfig, {"snapshot": own}) for own in changes
    }


def measure(tracked: Sequence[Tracked], distances: Sequence[float], quick: bool) -> dict[str, Any]:
    """Follow the hand with every setting.

    Returns ``scenes`` (all clouds), ``scenes_by`` (distance, speed), ``scenes_by_knob``, and ``choices``.
    """
    made: dict[str, Any] = {"scenes_by_knob": {}, "choices": []}
    reference = None
    for name, config in list(knobs().items())[: 2 if quick else None]:
        runs = [(one, follow(one, config)) for one in tracked]
        judged = judge(runs)
        every = figures(judged)
        off = [np.linalg.norm((f.velocity - t.velocity)[counts(t) & np.isfinite(f.position[:, 0])], axis=1) for t, f in runs]
        place = [np.linalg.norm((f.position - t.hand)[counts(t) & np.isfinite(f.position[:, 0])], axis=1) for t, f in runs]
        times = [value for _, followed in runs for value in followed.times_ms]
        made["scenes_by_knob"][name] = every | {"track_velocity_rms_m_s": rms(off), "track_rms_m": rms(place)}
        accuracy = ("rms error of the track's velocity", rms(off), "m/s")
        made["choices"].append(choice("hand velocity, scenes", name, accuracy=accuracy, times_ms=times, reference_ms=reference))
        reference = reference or times
        if name == "default":
            made |= {"scenes": every, "scenes_by": tables(judged, distances)}
    return made
