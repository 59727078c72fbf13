"""Following a hand with two radars, and with one: slow and fast, against the centroid of what is seen of it (thesis, 7.3 and 7.4.2)."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks import hand_losses, hand_runs
from benchmarks.hand_runs import DISTANCES, SCRIPTS, TUNING, Followed, HandStore, Tracked, counts, fast, follow, residual, rms, scene, track
from benchmarks.report import Found, Panel, against_first, of_rms, timed, varied
from benchmarks.stores import kept
from benchmarks.tradeoff.people import short
from benchmarks.tradeoff.stages import StudyConfig
from radar_core import RadarFrame, RadarInfo, merge
from radar_core.config import load, nest
from radar_dsp import Baseband, BasebandConfig
from radar_sim import Scene, Simulator
from radar_tracking import HandConfig, PeopleTracker, TrackedCloud
from radar_tracking.fusion.clouds import fused_info

FILTERS: Final = ("linear", "extended", "imm", "mm_vel_est")  # estimators that are compared; all take the same points
GRID: Final = {"process_noise": (1.0, 2.0, 4.0, 8.0, 16.0, 32.0), "position_std": (0.02, 0.04, 0.08)}
"""What is searched for every one of them."""
CLOCKS: Final = (0.0, 1.0, 5.0, 20.0)  # how much the second radar's clock is ahead [ms]
SURE: Final = 0.4  # the fast parts that are judged: the snapshot's velocity across is known to this [m/s]
SMOOTH: Final = (0.04, 0.08, 0.16, 0.32, 0.64)  # errors of positions that filters are told where they are tuned for slow hands [m]
_TUNING_SEEDS: Final = ((11, 1.0), (12, 1.4), (13, 2.2))

Runs = Sequence[tuple[Tracked, Followed]]


def scenes(quick: bool) -> list[Scene]:
    """Scenes that are measured, seed by seed."""
    chosen = SCRIPTS[1:2] if quick else SCRIPTS
    body = "ellipsoids" if quick else "mesh"
    return [scene(script, seed, far, body) for seed, far in enumerate(DISTANCES[: 1 if quick else None], 1) for script in chosen]


def tuning_scenes(quick: bool) -> list[Scene]:
    """Scenes that filters are tuned on: other scripts, other people, other distances."""
    chosen, body = (TUNING[:1], "ellipsoids") if quick else (TUNING, "mesh")
    return [scene(script, seed, far, body) for seed, far in _TUNING_SEEDS[: 1 if quick else None] for script in chosen]


def configured(name: str, process_noise: float, position_std: float) -> HandConfig:
    """Configure another estimator."""
    knobs = {"estimator.name": name, "estimator.process_noise": process_noise, "position_std": position_std}
    return load(HandConfig, nest(knobs))


def tune(tracked: Sequence[Tracked], names: Sequence[str], quick: bool) -> dict[str, HandConfig]:
    """Search each estimator's noise for the smallest error (rms) on the tuning scenes."""
    grid = list(itertools.product(*GRID.values()))[:: 6 if quick else 1]
    found = {}
    for name in names:
        error = [rms(residual(t, follow(t, configured(name, *noise)))[counts(t)] for t in tracked) for noise in grid]
        found[name] = configured(name, *grid[int(np.argmin(error))])
    return found


def runs(tracked: Sequence[Tracked], config: HandConfig) -> Runs:
    """Follow the hand through every scene."""
    return [(one, follow(one, config)) for one in tracked]


def errors(found: Runs, masks: Sequence[Any], axes: int = 3) -> list[Any]:
    """Residuals where masks say so, scene by scene [m]."""
    return [residual(t, f, axes)[mask] for (t, f), mask in zip(found, masks, strict=True)]


def figures_of(found: Runs, sure: Sequence[Any], slow: Sequence[bool]) -> dict[str, float]:
    """Errors of one estimator; ``sure``: clouds of fast parts in which the snapshot tells the velocity across; ``slow``: slow lines."""
    every, quickly = [counts(t) for t, _ in found], [fast(t) for t, _ in found]
    lines = [run for run, own in zip(found, slow, strict=True) if own]
    turns = [value for run in found for value in hand_runs.settling(*run)]
    return {
        "rmse_slow_m": rms(errors(lines, [counts(t) for t, _ in lines])),
        "rmse_m": rms(errors(found, every)),
        "rmse_floor_m": rms(errors(found, every, 2)),
        "p95_fast_m": hand_runs.percentile(errors(found, sure)),
        "p95_fast_everywhere_m": hand_runs.percentile(errors(found, quickly)),
        "settle_s": float(np.mean(turns)) if turns else float("nan"),
        "settle_p95_s": float(np.percentile(turns, 95)) if turns else float("nan"),
        "active": float(np.mean(np.concatenate([np.isfinite(f.value)[mask] for (_, f), mask in zip(found, every, strict=True)]))),
    }


KNOBS: Final[Mapping[str, Sequence[Any]]] = {
    "hand_length": (0.04, 0.16),
    "extent": (0.04, 0.16),
    "angle_std": (0.06,),
    "rest_speed": (0.1,),
    "snapshot.spin": (0.0, 5.0),
    "snapshot.iterations": (1,),
    "snapshot.spread": (0.06, 0.24),
    "snapshot.common": (0.0, 0.1),
    "snapshot.max_std": (0.3, 1.2),
    "split.gate": (0.25, 0.6),
    "split.gate_sigmas": (3.0, 6.0),
    "split.torso_depth": (0.1, 0.3),
    "split.inward": (0.1, 0.9),
    "split.hand_radius": (0.15, 0.3),
}
"""Knobs of the measurement and of the split that are measured."""


def rows(stage: str, configs: Mapping[str, HandConfig], tracked: Sequence[Tracked]) -> list[dict[str, Any]]:
    """Error over all scenes beside the time of one cloud; the first configuration is the reference."""
    made = {}
    for name, config in configs.items():
        found = runs(tracked, config)
        made[name] = rms(errors(found, [counts(t) for t, _ in found])), [value for _, f in found for value in f.times_ms]
    return against_first(stage, "rms error", made, "m")


def slider(found: Runs) -> dict[str, float]:
    """How well the control value follows the sliders: rms error over 0.5 m without mean offset, and largest step while the hand rests."""
    wrong, steps = [], []
    for tracked, followed in found:
        own = counts(tracked) & np.isfinite(followed.value)
        config = HandConfig().value
        truth = (tracked.hand[own, 2]) / (config.high - config.low)
        off = followed.value[own] - truth
        wrong.append((off - off.mean()) * (config.high - config.low) / 0.5)
        rests = np.linalg.norm(tracked.velocity[own], axis=1) < 0.05
        step = np.abs(np.diff(followed.value[own]))
        steps.append(step[rests[1:] & rests[:-1]])
    return {"value_rmse": rms(wrong), "value_rest_jump": float(np.max(np.concatenate(steps), initial=0.0))}


def measure(folder: Path, quick: bool, n_jobs: int) -> dict[str, Any]:
    """Simulate what is missing, tune, and measure."""
    store, made, other = HandStore(folder), scenes(quick), tuning_scenes(quick)
    store.fill([*made, *other], n_jobs=n_jobs, progress=not quick)
    both = [track(store, one) for one in made]
    alone = [track(store, one, single=True) for one in made]
    names = ("linear", "mm_vel_est") if quick else FILTERS
    tuned = tune([track(store, one) for one in other], names, quick)
    found = {name: runs(both, config) for name, config in tuned.items()}
    scripts = [script.name for script in (SCRIPTS[1:2] if quick else SCRIPTS)]
    slow = [scripts[k % len(scripts)] == "slow line" for k in range(len(made))]
    sure = [fast(t) & (hand_runs.lateral_std(t, f) <= SURE) for t, f in found["mm_vel_est"]]
    by_filter = {name: figures_of(one, sure, slow) for name, one in found.items()}
    single = figures_of(runs(alone, tuned["mm_vel_est"]), sure, slow)
    best, plain, losses = by_filter["mm_vel_est"], by_filter["linear"], hand_losses.followed(both)
    result = {
        "rmse_slow_m": best["rmse_slow_m"],
        "p95_fast_mmvelest_m": best["p95_fast_m"],
        "p95_fast_ratio": best["p95_fast_m"] / plain["p95_fast_m"],
        "settle_s": best["settle_s"],
        "fast_clouds": int(sum(mask.sum() for mask in sure)),
        "by_filter": by_filter,
        "hand_followed_at_5pct_lost": losses["5"]["followed"],
        "by_loss": losses,
        "tuned": {name: {"process_noise": c.estimator.process_noise, "position_std": c.position_std} for name, c in tuned.items()},
        "nees": hand_runs.consistency(found["mm_vel_est"]),
        "single_radar": single,
        "by_script": {
            name: rms(errors(found["mm_vel_est"][k :: len(scripts)], [counts(t) for t in both[k :: len(scripts)]]))
            for k, name in enumerate(scripts)
        },
    }
    if not quick:
        result |= slider([run for k, run in enumerate(found["mm_vel_est"]) if scripts[k % len(scripts)] == "slider"])
        result["by_clock_ms"] = by_clock(store, n_jobs)
        result["tuned_for_slow_hands"] = as_in_the_thesis(both)
    chosen = {"linear": tuned["linear"], **{name: tuned[name] for name in names if name != "linear"}}
    return {**result, "choices": rows("hand estimator", chosen, both) + rows("hand", varied(HandConfig, {} if quick else KNOBS), both)}


def by_clock(store: HandStore, n_jobs: int) -> dict[str, dict[str, float]]:
    """Error of fast lines and circles over the offset between the radars' clocks [ms].

    Returns for each offset ``rmse_m`` and ``p95_fast_m`` of radars that start their frames by their own clocks, so that clouds with the
    same stamp were measured at different times; ``rmse_stamps_m`` where both measure at the same time and only stamps are wrong.
    """
    kinds = [script for script in SCRIPTS if script.name in ("fast line", "circle")]
    drawn = [(script, seed, far) for seed, far in enumerate(DISTANCES, 1) for script in kinds]
    made, found = [scene(*one) for one in drawn], {}
    for offset in CLOCKS:
        late = [scene(*one, offset=made[0].radars[1].trigger_offset + offset * 1e-3) for one in drawn]
        store.make([(one, 1) for one in late], n_jobs=n_jobs)
        clock_ns = round(offset * 1e6)
        apart = runs([track(store, one, second=other, clock_ns=-clock_ns) for one, other in zip(made, late, strict=True)], HandConfig())
        stamped = runs([track(store, one, clock_ns=clock_ns) for one in made], HandConfig())
        found[f"{offset:g}"] = {
            "rmse_m": rms(errors(apart, [counts(t) for t, _ in apart])),
            "p95_fast_m": hand_runs.percentile(errors(apart, [fast(t) for t, _ in apart])),
            "rmse_stamps_m": rms(errors(stamped, [counts(t) for t, _ in stamped])),
        }
    return found


def as_in_the_thesis(tracked: Sequence[Tracked]) -> dict[str, dict[str, float]]:
    """Compare the filters tuned for slow hands, as the thesis's were: its single filter is up to 0.4 m off in the fast part (Fig. 7.11).

    Returns for each `SMOOTH` deviation [m] that both are told of positions, their process noise being 1: the largest residual in the fast
    parts, median of the scenes, and the 95th percentile of the single filter (``kf_...``) and of MMVelEst (``mmvelest_...``) [m]. Strokes
    here reach 0.25 m to either side: a filter that stands still is that far off.
    """
    quick = [one for one in tracked if fast(one).any()]
    found: dict[str, dict[str, float]] = {}
    for deviation in SMOOTH:
        row = found[f"{deviation:g}"] = {}
        for name, label in (("linear", "kf"), ("mm_vel_est", "mmvelest")):
            off = errors(runs(quick, configured(name, 1.0, deviation)), [fast(t) for t in quick])
            row |= {f"{label}_max_m": float(np.median([one.max() for one in off])), f"{label}_p95_m": hand_runs.percentile(off)}
    return found


def run(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Follow hands.

    ``quick``: one scene and one to tune on, bodies of ellipsoids: to see that it runs; ``keep``: folder for the simulated clouds; None:
    they are thrown away.
    Returns ``rmse_slow_m`` (slow lines), ``p95_fast_mmvelest_m`` and ``p95_fast_ratio`` (to the single Kalman filter; fast parts in which
    the snapshot tells the velocity across to `SURE`), ``settle_s`` after a reversal; the same and more for every estimator, each tuned by
    the same search, and for one radar; ``value_rmse`` and ``value_rest_jump`` of the control value; ``by_clock_ms``;
    ``tuned_for_slow_hands``; ``choices``.
    """
    with kept(keep) as folder:
        return measure(folder, quick, 1 if quick else os.cpu_count() or 1)


_TRIGGER, _COUNTED = 0.8, 1.3  # s: the hand is followed from there on; its errors count from there on
_SAME = 0.2  # s: residuals this near tell the same, because the hand goes some 0.1 m meanwhile
RADARS = Panel("number of radars", "hand residual (rms)", "m", "lower", "1 radar", "baseband and people tracking of one radar")
FILTER = Panel("hand filter", "hand residual (rms)", "m", "lower", "mm_vel_est", "baseband and people tracking of one radar")


def chain(infos: Sequence[RadarInfo]) -> tuple[RadarInfo, Callable[[Sequence[RadarFrame]], TrackedCloud]]:
    """Baseband, fusion and tracking of some radars; their frames are the first ones that it is given."""
    info = infos[0] if len(infos) == 1 else fused_info(infos)
    people, basebands = PeopleTracker(None, info), [Baseband(BasebandConfig(), one) for one in infos]

    def process(frames: Sequence[RadarFrame]) -> TrackedCloud:
        parts = [baseband.process(frame) for baseband, frame in zip(basebands, frames, strict=False)]
        room = parts[0].to_room(info.mount) if len(parts) == 1 else merge(parts, [one.mount for one in infos], hand_runs.SLOP)
        return TrackedCloud(room, people.process(room))

    return info, process


def streams(study: StudyConfig) -> list[tuple[Tracked, list[float]]]:
    """Simulate a drawing hand, seen by one radar and by both, and time each moment [ms]; `Tracked.hand`: NaN while it does not draw."""
    scene = short(study.scene or "two_radars", study.seed, study.scene is None, radars=2)
    simulators = [Simulator(scene, radar.frame_id) for radar in scene.radars[:2]]
    infos = [simulator.info for simulator in simulators]
    both, truths = [(*chain(infos[:1]), []), (*chain(infos), [])], []
    for k in range(min(*(simulator.n_frames for simulator in simulators), round(study.pick(4.5, 8.5) / simulators[0].interval))):
        made = [simulator.process(k) for simulator in simulators]
        for _, process, found in both:
            found.append(timed(process, [one.frame for one in made]))
        truths.append(made[0].truth)
    time = np.array([truth.stamp_ns * 1e-9 for truth in truths])
    joint, velocity = (np.array([getattr(truth, name)[0] for truth in truths]) for name in ("hand_position", "hand_velocity"))
    hand = np.where(np.array([truth.drawing[0] for truth in truths])[:, None], joint, np.nan)
    return [(Tracked([c for c, _ in found], info, time, hand, joint, velocity), [ms for _, ms in found]) for info, _, found in both]


def filters(study: StudyConfig) -> Found:
    """Compare one radar with two, and the filters with each other, on the same drawing hand."""
    found, default = Found(), HandConfig()
    (one, reference), (both, spent) = streams(study)
    counted = (one.time >= _COUNTED) & np.isfinite(one.hand[:, 0])
    if not counted.any():
        found.leave_out(RADARS.name, "all", f"nobody draws with a hand after {_COUNTED:g} s; choose a scene such as two_radars")
        return found
    n = max(round((one.time[-1] - _COUNTED) / _SAME), 1)

    def add(panel: Panel, name: str, tracked: Tracked, config: HandConfig, before: Sequence[float] = (0.0,)) -> None:
        followed = follow(tracked, config, _TRIGGER)
        value = rms([residual(tracked, followed)[counted]])
        found.rows.append(panel.row(name, value, np.add(before, followed.spent_ms).tolist(), reference, margin=of_rms(value, n)))

    add(RADARS, "1 radar", one, default, reference)
    add(RADARS, "2 radars", both, default, spent)
    for name in FILTERS:
        add(FILTER, name, both, load(HandConfig, nest({"estimator.name": name})))
    return found
