"""People tracking on simulated scenes with truth: every tracker of the thesis and Stone Soup, every knob, clustering, and the hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.clustering_parts import figures as clustering
from benchmarks.report import against_first, timed
from benchmarks.scenarios import HIGH_MOUNT, MATCHING, MOUNT, SCENARIOS
from benchmarks.tracking_choices import rows, speed, titled, variants
from benchmarks.tracking_score import Score
from benchmarks.tracking_suite import PEER, PROCESSES, THESIS, TRACKERS, Done, Job, figures, peer_installed, pooled, run_all
from radar_core import ConfigError
from radar_dsp import Baseband, BasebandConfig
from radar_sim import Simulator, load_scene
from radar_tracking import HandTracker, TrackedCloud, Tracks, make_tracker


def hand(quick: bool) -> dict[str, float]:
    """Follow the first hand that draws on the demo scene, started by the truth: rms [m], share of the drawing, median per cloud."""
    simulator = Simulator(load_scene("demo"))
    baseband = Baseband(BasebandConfig(), simulator.info)
    people, tracker, person = make_tracker(info=simulator.info), HandTracker(), None
    errors: list[float] = []
    times: list[float] = []
    drawing = 0
    for k in range(simulator.n_frames)[1000:1130] if quick else range(simulator.n_frames):
        made = simulator.process(k)
        truth, cloud = made.truth, baseband.process(made.frame).to_room(simulator.info.mount)
        tracks = people.process(cloud)
        draws = np.flatnonzero(truth.drawing)
        if person is None and len(draws) and tracks.people_count:
            person = int(draws[0])
            tracker.start(_nearest(tracks, truth.position[person]), cloud.stamp_ns)
        found, spent = timed(tracker.process, TrackedCloud(cloud, tracks))
        if person is not None and truth.drawing[person]:
            drawing += 1
            if found is not None and found.active:
                times.append(spent)
                errors.append(float(((found.position - truth.hand_position[person]) ** 2).sum()))
    if not errors:
        return {}
    return {"hand_rms_m": float(np.sqrt(np.mean(errors))), "hand_active": len(errors) / drawing, "hand_ms": float(np.median(times))}


def _nearest(tracks: Tracks, position: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> int:
    """Id of the person nearest to a place."""
    live = list(tracks.people)
    return min(live, key=lambda t: float(np.hypot(*(t.position - position)[:2]))).id


PRODUCT: Final = "poisson_bernoulli"
NO_SWITCHES: Final = ("crossing", "approach", "handshake")
ONE_DIRECTION: Final = ("approach", "side_by_side", "parallel", "handshake")
TILTED: Final = ("approach", "crossing")
INF: Final = float("inf")


@dataclass(frozen=True)
class Plan:
    """How much is run."""

    names: tuple[str, ...] = tuple(SCENARIOS)
    # seeds, peer_seeds, choice_seeds: of each scene: for our trackers, for Stone Soup, for the knobs
    seeds: int = 4
    peer_seeds: int = 2
    choice_names: tuple[str, ...] = ("approach", "side_by_side", "five_people", "clutter")  # scenes in which every knob is tried
    choice_seeds: int = 1
    choice_every: int = 1  # only each so many'th knob, the default first
    seconds: float = INF  # only the scenes' first so many
    processes: int = PROCESSES  # at the same time


FULL: Final = Plan()
QUICK: Final = Plan(
    ("approach", "side_by_side"), seeds=1, peer_seeds=1, choice_names=("approach",), choice_every=20, seconds=0.8, processes=1
)


def jobs(plan: Plan) -> list[Job]:
    """Every scene once with all trackers, some again with one direction in each cell, and two with the radar high and tilted."""
    tried, peer = dict(list(variants().items())[:: plan.choice_every]), peer_installed()
    found = []
    for name in plan.names:
        for seed in range(plan.seeds):
            choices = tried if name in plan.choice_names and seed < plan.choice_seeds else {}
            found.append(Job(name, seed, TRACKERS, choices, peer=peer and seed < plan.peer_seeds, seconds=plan.seconds))
    product = {PRODUCT: TRACKERS[PRODUCT]}
    high = [Job(name, seed, product, mount=HIGH_MOUNT, seconds=plan.seconds) for name in TILTED for seed in range(plan.seeds)]
    plain = [
        Job(name, seed, {PRODUCT: TRACKERS[PRODUCT], **THESIS}, seconds=plan.seconds, plain=True)
        for name in ONE_DIRECTION
        for seed in range(plan.seeds)
    ]
    return found + [job for job in high + plain if job.name in plan.names]


def by_tracker(done: Sequence[Done], plan: Plan, *, plain: bool = False) -> dict[str, dict[str, dict[str, float]]]:
    """Figures of every tracker on every kind of scene, and on all of them together (``all``)."""
    found: dict[str, dict[str, dict[str, float]]] = {}
    names = [name for name in plan.names if not plain or name in ONE_DIRECTION]
    for tracker in (*TRACKERS, *THESIS, PEER):
        scores = {name: pooled(done, tracker, (name,), plain=plain) for name in names} | {"all": pooled(done, tracker, plain=plain)}
        if scores["all"].clouds:
            found[tracker] = {name: figures(score, name) for name, score in scores.items()}
    return found


def summary(done: Sequence[Done], plan: Plan) -> dict[str, float]:
    """Sum up the product's tracker over the suite.

    Returns ``id_switches``, ``mota`` (pooled), ``torso_error_m``, ``frame_ms``: of all scenes. ``mota_mean``: mean over the kinds of
    scenes. ``id_switches_resolvable``: those in crossing, approach and handshake around which the two differed by more than a range bin, a
    beamwidth or a Doppler bin for half a second before and after; ``id_switches_unresolvable``: the others there. ``ghosts_per_minute``: of
    the furnished room, tracks that were never on anybody. ``ghost_track_frames``: of all scenes, and ``ghost_track_frames_per_minute``, of
    the furnished room: confirmed track-frames without a person within ``gate_m``. ``tilt_cost_m``: torso error with the radar 2 m high and
    15 degrees down less that at 1.2 m, on the same scenes. ``sitting_lost``: scenes in which the sitting person's identity did not last.
    """
    everything = pooled(done, PRODUCT)
    close, room = pooled(done, PRODUCT, NO_SWITCHES), pooled(done, PRODUCT, ("clutter",))
    level, tilted = pooled(done, PRODUCT, TILTED), pooled(done, PRODUCT, TILTED, HIGH_MOUNT)
    return {
        "id_switches": everything.switches,
        "id_switches_resolvable": close.resolvable,
        "id_switches_unresolvable": close.switches - close.resolvable,
        "mota": everything.mota,
        "mota_mean": float(np.mean([pooled(done, PRODUCT, (name,)).mota for name in plan.names])),
        "torso_error_m": everything.torso_error,
        "tilt_cost_m": tilted.torso_error - level.torso_error,
        "frame_ms": float(np.median(everything.times)),
        "ghosts_per_minute": room.ghosts_per_minute,
        "ghost_track_frames": everything.false,
        "ghost_track_frames_per_minute": room.ghost_track_frames_per_minute,
        "gate_m": MATCHING.gate,
        "sitting_lost": pooled(done, PRODUCT, ("sitting",)).lost,
    }


def why(done: Sequence[Done], plan: Plan) -> dict[str, float]:
    """Say where the product's tracker loses accuracy.

    Returns ``misses_start``: in the first second that a person is visible; ``misses_return``: in the first second after being hidden;
    ``misses_parallel``: of two who walk 0.5 m apart, all of them; ``misses_other``. ``false_near``: tracks that are on nobody but within 1
    m of somebody, ``false_far``: from nothing. ``mota_without_parallel``: without that scene; ``mota_without_start``: if nobody were missed
    in the first second. By scene: see ``trackers`` of `run`.
    """
    everything, parallel = pooled(done, PRODUCT), pooled(done, PRODUCT, ("parallel",))
    others = pooled(done, PRODUCT, [name for name in plan.names if name != "parallel"])
    return {
        "misses_start": others.misses_start,
        "misses_return": others.misses_return,
        "misses_parallel": parallel.misses,
        "misses_other": others.misses - others.misses_start - others.misses_return,
        "false_near": everything.false_near,
        "false_far": everything.false - everything.false_near,
        "mota_without_parallel": others.mota,
        "mota_without_start": everything.mota + everything.misses_start / max(everything.truths, 1),
    }


def findings(done: Sequence[Done], *, plain: bool = False) -> dict[str, dict[str, float]]:
    """Compare the trackers as the thesis does (6.3): identities lost in the approach (Fig. 6.2), wrong points side by side (Fig. 6.3)."""
    approach: dict[str, Score] = {name: pooled(done, name, ("approach",), plain=plain) for name in (*TRACKERS, *THESIS, PEER)}
    approach = {name: score for name, score in approach.items() if score.clouds}
    return {
        "approach_lost": {name: score.lost for name, score in approach.items()},
        "approach_scenes": {name: score.scenes for name, score in approach.items()},
        "wrong_point_fraction": {name: pooled(done, name, ("side_by_side",), plain=plain).wrong_fraction for name in approach},
    }


def directions(done: Sequence[Done]) -> list[dict[str, Any]]:
    """Compare one and two directions in a cell: GOSPA of the product's tracker beside the time of the baseband."""
    scenes = {(d.job.name, d.job.seed) for d in done if d.job.plain}
    pairs = {
        plain: [d for d in done if d.job.plain == plain and d.job.mount == MOUNT and (d.job.name, d.job.seed) in scenes]
        for plain in (True, False)
    }
    times = {plain: [ms for d in own for ms in d.baseband_ms] for plain, own in pairs.items()}
    found = {}
    for plain, label in ((True, "doa.method=dml"), (False, "doa.method=dml2 (preset people)")):
        if times[plain]:
            score = pooled(pairs[plain], PRODUCT, plain=plain)
            found[titled(label, score)] = score.mean_gospa, times[plain]
    return against_first("directions in a cell", "mean GOSPA", found, "m")


def measure(plan: Plan, quick: bool, keep: Path | None = None) -> dict[str, Any]:
    """Run a plan, and what needs no scenes; ``None`` stands for what has nothing to divide by."""
    done = run_all(jobs(plan), plan.processes, keep)
    parts = [speed(quick), clustering(quick)]
    if peer_installed():
        from benchmarks.stone_soup import over_stone_soup

        parts.append(over_stone_soup(quick))
    choices = directions(done) + rows(done) + [row for part in parts for row in part.pop("choices")]
    flat = {key: value for part in parts for key, value in part.items()}
    summed = summary(done, plan) | {key: flat[key] for key in ("over_stone_soup",) if key in flat}
    plain = findings(done, plain=True) | {"trackers": by_tracker(done, plan, plain=True)}
    tables = {"summary": summed, "why": why(done, plan), **findings(done), "trackers": by_tracker(done, plan), "one_direction": plain}
    result: dict[str, Any] = finite({**flat, **hand(quick), **tables})
    return {**result, "choices": choices}


def finite(value: Any) -> Any:
    """Replace NaN by None, which JSON knows."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    return None if isinstance(value, float) and not np.isfinite(value) else value


def arms(plan: Plan, keep: Path | None) -> dict[str, Any]:
    """Say whose points arms become side by side (the thesis's Fig. 6.3): shares given to the wrong person, one direction in a cell."""
    done = run_all([job for job in jobs(plan) if job.plain and job.name == "side_by_side"], plan.processes, keep)
    scores = {name: pooled(done, name, plain=True) for name in (PRODUCT, *THESIS)}
    return {
        "wrong_point_fraction": {name: score.wrong_fraction for name, score in scores.items()},
        "points": {name: score.owned for name, score in scores.items()},
        "scenes": len(done),
        "choices": [],
    }


def run(quick: bool, keep: Path | None = None, parts: str = "") -> dict[str, Any]:
    """Measure; ``keep``: a folder for finished scenes, with which a run goes on where it stopped; ``parts``: all, or only ``arms``."""
    plan = QUICK if quick else FULL
    if parts not in ("", "arms"):
        raise ConfigError(f"{parts}: there is no such part; leave it out, or choose arms")
    return arms(plan, keep) if parts else measure(plan, quick, keep)
