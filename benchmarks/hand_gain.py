"""What MMVelEst gains over other filters on the same clouds, and when: by speed, by distance, by rate; lost hands are counted apart."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from benchmarks.hand_runs import BASELINE, DISTANCES, Float64Array, Followed, MaskArray, Tracked, counts, follow, residual
from benchmarks.velocity_room import mounts
from radar_tracking import HandConfig

NEAR: Final = 0.25  # m: a track within that of the hand follows it
SPEEDS: Final = {"below 0.3 m/s": (0.0, 0.3), "0.3 to 1 m/s": (0.3, 1.0), "above 1 m/s": (1.0, np.inf)}  # classes of true speed [m/s]
RATES: Final = {"50 Hz": 1, "25 Hz": 2, "17 Hz": 3, "10 Hz": 5}  # every so many clouds
OURS: Final = "mm_vel_est"
_LOST: Final = 0.05  # a hand that is not followed in a larger share of a scene's clouds is lost
_DRAWS: Final = 1000

Runs = Sequence[tuple[Tracked, Followed]]


def follows(tracked: Tracked, followed: Followed) -> MaskArray:
    """Clouds that count at which the track is near the hand, shape (n,)."""
    return np.asarray(counts(tracked) & (residual(tracked, followed) < NEAR))


def lost(found: Runs) -> dict[str, float]:
    """Give the share of the clouds at which no track is near the hand, and in how many scenes that is more than one in twenty."""
    shares = [1.0 - float(follows(*run).sum() / counts(run[0]).sum()) for run in found]
    return {"lost": float(np.mean(shares)), "lost_scenes": int(np.sum(np.array(shares) > _LOST))}


def paired(by_filter: Mapping[str, Runs], masks: Sequence[MaskArray]) -> dict[str, list[Float64Array]]:
    """Residuals of each filter, scene by scene, at the clouds of masks at which every filter follows the hand [m]."""
    every = [mask.copy() for mask in masks]
    for found in by_filter.values():
        every = [own & follows(*run) for own, run in zip(every, found, strict=True)]
    return {name: [residual(*run)[own] for run, own in zip(found, every, strict=True)] for name, found in by_filter.items()}


def ratios(errors: Mapping[str, Sequence[Float64Array]]) -> dict[str, dict[str, Any]]:
    """Compare 95th percentiles: ours over that of each other filter, with the 95 % interval of scenes drawn anew.

    Returns ``p95_m`` and ``clouds`` for each filter, ``ratio`` and ``interval`` for the others; scenes without such clouds do not count.
    """
    used = [k for k, own in enumerate(errors[OURS]) if len(own)]
    if not used:
        return {}
    rng = np.random.default_rng(0)
    drawn = [rng.choice(used, len(used)) for _ in range(_DRAWS)]
    spread = {name: np.array([_p95(own, chosen) for chosen in drawn]) for name, own in errors.items()}
    found: dict[str, dict[str, Any]] = {}
    for name, own in errors.items():
        found[name] = {"p95_m": _p95(own, used), "clouds": sum(len(own[k]) for k in used), "scenes": len(used)}
        if name != OURS:
            found[name]["ratio"] = _p95(errors[OURS], used) / found[name]["p95_m"]
            found[name]["interval"] = np.percentile(spread[OURS] / spread[name], (2.5, 97.5)).tolist()
    return found


def _p95(errors: Sequence[Float64Array], chosen: Sequence[int]) -> float:
    return float(np.percentile(np.concatenate([errors[k] for k in chosen]), 95))


def when(by_filter: Mapping[str, Runs]) -> dict[str, Any]:
    """Give `ratios` by speed of the hand and by its distance from the radars."""
    tracked = [one for one, _ in by_filter[OURS]]
    speed = [np.linalg.norm(one.velocity, axis=1) for one in tracked]
    middle = mounts(BASELINE).mean(axis=0)
    distance = [np.linalg.norm(one.hand - middle, axis=1) for one in tracked]
    edges = [0.0, *((a + b) / 2 for a, b in itertools.pairwise(DISTANCES)), np.inf]
    near = {f"{far:g} m": edge for far, edge in zip(DISTANCES, itertools.pairwise(edges), strict=True)}
    found: dict[str, Any] = {}
    for title, values, classes in (("speed", speed, SPEEDS), ("distance", distance, near)):
        masks = {name: [(one >= low) & (one < high) for one in values] for name, (low, high) in classes.items()}
        found[title] = {name: ratios(paired(by_filter, own)) for name, own in masks.items()}
    return found


def by_rate(by_filter: Mapping[str, Runs], configs: Mapping[str, HandConfig], rates: Sequence[str]) -> dict[str, Any]:
    """Give `ratios` and who is lost by the rate of the clouds that the hand tracker gets; filters are those tuned at 50 Hz."""
    found: dict[str, Any] = {}
    for name in rates:
        few = [thinned(one, RATES[name]) for one, _ in by_filter[OURS]]
        runs = by_filter
        if RATES[name] > 1:
            runs = {own: [(one, follow(one, config)) for one in few] for own, config in configs.items()}
        every = [np.ones(len(one.time), np.bool_) for one in few]
        found[name] = {own: value | lost(runs[own]) for own, value in ratios(paired(runs, every)).items()}
    return found


def thinned(tracked: Tracked, every: int) -> Tracked:
    """Keep every so many clouds; the person was tracked with all of them."""
    rows = {name: getattr(tracked, name)[::every] for name in ("time", "hand", "joint", "velocity")}
    return dataclasses.replace(tracked, clouds=tracked.clouds[::every], **rows)
