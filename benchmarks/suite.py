"""People tracking on the suite of ten kinds of scenes by the default graph: default baseband, no knowledge of the room, no preset.

``--seeds first`` are four of each kind to develop on, ``develop`` twenty; ``figure``, the default, are twenty that are for the figure
that is quoted. `tracking` compares all trackers and every knob on the same kinds of scenes, with what the room is told to them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.report import Panel
from benchmarks.scenarios import SCENARIOS
from benchmarks.tracking_score import Score
from benchmarks.tracking_score import total as pool
from benchmarks.tracking_suite import PROCESSES, TRACKERS, Done, Job, run_all
from radar_tracking import TrackerConfig

DEVELOP: Final = tuple(range(100, 120))
SEEDS: Final[Mapping[str, tuple[int, ...]]] = {"first": DEVELOP[:4], "develop": DEVELOP, "figure": tuple(range(24000, 24020))}
NAMES: Final = ("poisson_bernoulli", "group_clustering")
KEPT_APART: Final = ("crossing", "approach", "handshake")  # in these nobody's identity may change
PANEL: Final = Panel("people in the suite of scenes", "MOTA", "", "higher", "poisson_bernoulli", "poisson_bernoulli")
_DRAWS: Final = 2000  # of the bootstrap


def jobs(kinds: Sequence[str], seeds: Sequence[int], seconds: float = float("inf")) -> list[Job]:
    """Every scene once, with both trackers; one direction in a cell is what the default baseband looks for."""
    own: dict[str, TrackerConfig] = {name: TRACKERS[name] for name in NAMES}
    return [Job(kind, seed, own, seconds=seconds, plain=True, told=False) for kind in kinds for seed in seeds]


def interval(groups: Sequence[Sequence[Score]], seed: int = 1) -> list[float]:
    """MOTA's 95 % interval: scenes drawn with replacement within each kind."""
    rng = np.random.default_rng(seed)
    sums = [np.array([[s.misses + s.false + s.switches, s.truths] for s in own]) for own in groups]
    drawn = [own[rng.integers(len(own), size=(_DRAWS, len(own)))].sum(axis=1) for own in sums]
    wrong, truths = np.sum(drawn, axis=0).T
    return [float(end) for end in np.quantile(1 - wrong / truths, [0.025, 0.975])]


def figures(groups: Sequence[Sequence[Score]]) -> dict[str, Any]:
    """Figures of one tracker over kinds of scenes."""
    score = pool([one for own in groups for one in own])
    return {
        "mota": score.mota,
        "mota_interval": interval(groups),
        "id_switches": score.switches,
        "misses_share": score.misses / score.truths,
        "misses_first_second_share": score.misses_start / score.truths,
        "false_share": score.false / score.truths,
        "ghost_track_frames_per_minute": score.ghost_track_frames_per_minute,
        "gospa_m": score.mean_gospa,
        "torso_error_m": score.torso_error,
        "scenes": len([one for own in groups for one in own]),
    }


def summary(done: Sequence[Done], kinds: Sequence[str]) -> dict[str, Any]:
    """Figures of every tracker, of all scenes, by kind, and of all kinds but the furnished room; the default comes first."""
    found: dict[str, Any] = {}
    for name in NAMES:
        own = {kind: [one.trackers[name] for one in done if one.job.name == kind] for kind in kinds}
        found[name] = {"all": figures(list(own.values())), **{kind: figures([scores]) for kind, scores in own.items()}}
        found[name]["without_walls"] = figures([scores for kind, scores in own.items() if not SCENARIOS[kind].room])
        found[name]["sitting_lost"] = pool(own.get("sitting", [])).lost
        found[name]["switches_kept_apart"] = sum(pool(own.get(kind, [])).switches for kind in KEPT_APART)
    return found


def run(quick: bool, keep: Path | None = None, seeds: str = "figure") -> dict[str, Any]:
    """Measure; ``keep`` is a folder for finished scenes, with which an interrupted run goes on where it stopped."""
    kinds = ("approach", "sitting") if quick else tuple(SCENARIOS)
    chosen = jobs(kinds, DEVELOP[:1], 1.0) if quick else jobs(kinds, SEEDS[seeds])
    done = run_all(chosen, 1 if quick else PROCESSES, keep)
    trackers = summary(done, kinds)
    scores = {name: pool([one.trackers[name] for one in done]) for name in NAMES}
    times = {name: score.times.tolist() for name, score in scores.items()}
    rows = PANEL.rows({name: score.mota for name, score in scores.items()}, times | {"": times[PANEL.default]})
    return {"seeds": seeds, "trackers": trackers, "choices": rows}
