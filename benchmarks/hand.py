"""Following a hand with two radars, and with one: slow and fast, against the centroid of what is seen of it (thesis, 7.3 and 7.4.2)."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks import hand_gain, hand_losses, hand_runs
from benchmarks.hand_runs import DISTANCES, SCRIPTS, TUNING, HandStore, Script, Tracked, counts, fast, follow, residual, rms, scene, track
from benchmarks.hand_search import Searched, configured, tune
from benchmarks.hand_snapshots import judge, nees, scene_figures, tables
from benchmarks.report import Found, Panel, against_first, of_rms, timed, varied
from benchmarks.stores import kept, once, sources
from benchmarks.tradeoff.people import short
from benchmarks.tradeoff.stages import StudyConfig
from radar_core import ConfigError, RadarFrame, RadarInfo, merge
from radar_core.config import load, nest
from radar_dsp import Baseband, BasebandConfig
from radar_sim import Scene, Simulator
from radar_tracking import HandConfig, TrackedCloud, make_tracker
from radar_tracking.fusion.clouds import fused_info

FILTERS: Final = ("linear", "extended", "imm", "mm_vel_est")  # estimators that are compared; all take the same points
CLOCKS: Final = (0.0, 1.0, 5.0, 20.0)  # how much the second radar's clock is ahead [ms]
SURE: Final = 0.4  # the fast parts that are judged: the snapshot's velocity across is known to this [m/s]
SMOOTH: Final = (0.04, 0.08, 0.16, 0.32, 0.64)  # errors of positions that filters are told where they are tuned for slow hands [m]
_TUNING_SEEDS: Final = ((11, 1.0), (12, 1.4), (13, 2.2))
_FIRST: Final = 3001  # seed of the first scene that is measured; those below were looked at before
_SCENES: Final = 50
_SHORT: Final = 3.6  # s: more scenes tell more than longer ones
_QUICK: Final = 2.8
_KNOBS_FROM: Final = 5  # knobs are varied on every so many scenes
_CLOCK_SCENES: Final = 4

_CODE: Final = ("radar_core", "radar_dsp", "radar_sim", "radar_tracking", "benchmarks/hand_runs.py", "benchmarks/hand_search.py")

Runs = hand_gain.Runs


def plan(quick: bool) -> list[tuple[Script, int, float]]:
    """Give script, seed and distance [m] of the scenes that are measured: fifty people, every script at every distance twice."""
    if quick:
        return [(dataclasses.replace(SCRIPTS[1], duration=_QUICK), 1, DISTANCES[0])]
    short = [dataclasses.replace(script, duration=_SHORT) for script in SCRIPTS]
    return [(short[k % len(short)], _FIRST + k, DISTANCES[k // len(short) % len(DISTANCES)]) for k in range(_SCENES)]


def scenes(quick: bool) -> list[Scene]:
    """Scenes that are measured."""
    return [scene(*one, "ellipsoids" if quick else "mesh") for one in plan(quick)]


def tuning_scenes(quick: bool) -> list[Scene]:
    """Scenes that filters are tuned on: other scripts, other people, other distances."""
    chosen, body = ([dataclasses.replace(TUNING[0], duration=_QUICK)], "ellipsoids") if quick else (TUNING, "mesh")
    return [scene(script, seed, far, body) for seed, far in _TUNING_SEEDS[: 1 if quick else None] for script in chosen]


def runs(tracked: Sequence[Tracked], config: HandConfig) -> Runs:
    """Follow the hand through every scene."""
    return [(one, follow(one, config)) for one in tracked]


def errors(found: Runs, masks: Sequence[Any], axes: int = 3) -> list[Any]:
    """Residuals where masks say so, scene by scene [m]."""
    return [residual(t, f, axes)[mask] for (t, f), mask in zip(found, masks, strict=True)]


def figures_of(found: Runs, sure: Sequence[Any], slow: Sequence[bool]) -> dict[str, float]:
    """Errors of one estimator where it follows the hand, and how often it does not.

    ``sure``: clouds of fast parts in which the snapshot tells the velocity across; ``slow``: slow lines.
    """
    near, quickly = [hand_gain.follows(*run) for run in found], [fast(t) for t, _ in found]
    lines = [k for k, own in enumerate(slow) if own]
    turns = [value for run in found for value in hand_runs.settling(*run)]

    def where(masks: Sequence[Any]) -> list[Any]:
        return errors(found, [mask & own for mask, own in zip(masks, near, strict=True)])

    return {
        "rmse_slow_m": rms(where(near)[k] for k in lines),
        "rmse_m": rms(where(near)),
        "rmse_floor_m": rms(errors(found, near, 2)),
        "p95_fast_m": hand_runs.percentile(where(sure)),
        "p95_fast_everywhere_m": hand_runs.percentile(where(quickly)),
        "settle_s": float(np.mean(turns)) if turns else float("nan"),
        "settle_p95_s": float(np.percentile(turns, 95)) if turns else float("nan"),
        **hand_gain.lost(found),
    }


KNOBS: Final[Mapping[str, Sequence[Any]]] = {
    "hand_length": (0.04, 0.16),
    "extent": (0.04, 0.16),
    "angle_std": (0.06,),
    "rest_speed": (0.1,),
    "snapshot.spin": (0.0, 2.5),
    "snapshot.iterations": (1,),
    "snapshot.spread": (0.035, 0.14),
    "snapshot.common": (0.0, 0.05),
    "snapshot.rest": (0.3, 10.0),
    "snapshot.max_std": (0.3, 1.2),
    "split.gate": (0.25, 0.6),
    "split.gate_sigmas": (3.0, 6.0),
    "split.torso_depth": (0.1, 0.3),
    "split.inward": (0.1, 0.9),
    "split.hand_radius": (0.15, 0.3),
}
"""Knobs of the measurement and of the split that are measured."""


def rows(stage: str, configs: Mapping[str, HandConfig], tracked: Sequence[Tracked]) -> list[dict[str, Any]]:
    """Error over all scenes at the clouds at which the hand is followed beside the time of one cloud, and the share of the others.

    The first configuration is the reference.
    """
    made, away = {}, []
    for name, config in configs.items():
        found = runs(tracked, config)
        followed = [counts(t) & hand_gain.follows(t, f) for t, f in found]
        made[name] = rms(errors(found, followed)), [value for _, f in found for value in f.times_ms]
        away.append(hand_gain.lost(found)["lost"])
    return [{**row, "lost": share} for row, share in zip(against_first(stage, "rms error where followed", made, "m"), away, strict=True)]


def slider(found: Runs) -> dict[str, float]:
    """How well the control value follows the sliders: rms error over 0.5 m without mean offset, and largest step while the hand rests."""
    wrong, steps = [], []
    for tracked, followed in found:
        own = counts(tracked) & np.isfinite(followed.value)
        if not own.any():
            continue  # the hand was never followed, which counts as lost
        config = HandConfig().value
        truth = (tracked.hand[own, 2]) / (config.high - config.low)
        off = followed.value[own] - truth
        wrong.append((off - off.mean()) * (config.high - config.low) / 0.5)
        rests = np.linalg.norm(tracked.velocity[own], axis=1) < 0.05
        step = np.abs(np.diff(followed.value[own]))
        steps.append(step[rests[1:] & rests[:-1]])
    return {"value_rmse": rms(wrong), "value_rest_jump": float(np.max(np.concatenate(steps), initial=0.0))}


class Study:
    """The scenes of a run, simulated where they are missing, and what every filter makes of them, each tuned by the same search."""

    def __init__(self, folder: Path, quick: bool, n_jobs: int) -> None:
        self.store, self.quick, self.n_jobs = HandStore(folder), quick, n_jobs
        self.made, other = scenes(quick), tuning_scenes(quick)
        self.store.fill([*self.made, *other], n_jobs=n_jobs, progress=not quick)
        self.both, self.scripts = [track(self.store, one) for one in self.made], [script.name for script, _, _ in plan(quick)]
        name = f"hand_tuned_{sources(_CODE)}{'_quick' if quick else ''}.joblib"
        self.tuned: dict[str, Searched] = once(folder / name, lambda: self._tune(other))
        self.configs = {name: one.config for name, one in self.tuned.items()}

    def _tune(self, other: Sequence[Scene]) -> dict[str, Searched]:
        some = [one for k, one in enumerate(other) if (k + k // len(TUNING)) % 2 == 0]  # every script and every person
        names, tracked = ("linear", "mm_vel_est") if self.quick else FILTERS, [track(self.store, one) for one in some]
        return {name: tune(tracked, name, 1 if self.quick else 60) for name in names}

    @cached_property
    def found(self) -> dict[str, Runs]:
        """Every filter's hands."""
        return {name: runs(self.both, config) for name, config in self.configs.items()}

    @cached_property
    def sure(self) -> list[Any]:
        """Clouds of fast parts in which the snapshot tells the velocity across, scene by scene."""
        return [fast(t) & (hand_runs.lateral_std(t, f) <= SURE) for t, f in self.found["mm_vel_est"]]


def _gain(study: Study) -> dict[str, Any]:
    searched = {name: {"tried": one.tried, "inside": one.inside, "rmse_m": one.error} for name, one in study.tuned.items()}
    return gained(study.found, study.sure, study.scripts) | {
        "optimum_inside": all(one.inside for one in study.tuned.values()),
        "tuned": {name: one.knobs() for name, one in study.tuned.items()},
        "searched": searched,
        "when": hand_gain.when(study.found),
    }


def _rates(study: Study) -> dict[str, Any]:
    return {"by_rate": hand_gain.by_rate(study.found, study.configs, ("50 Hz",) if study.quick else tuple(hand_gain.RATES))}


def _losses(study: Study) -> dict[str, Any]:
    found = hand_losses.followed(study.both)
    return {"hand_followed_at_5pct_lost": found["5"]["followed"], "by_loss": found}


def _single(study: Study) -> dict[str, Any]:
    alone = runs([track(study.store, one, single=True) for one in study.made], study.configs["mm_vel_est"])
    return {"single_radar": figures_of(alone, study.sure, slow(study.scripts))}


def _slider(study: Study) -> dict[str, Any]:
    sliders = [run for run, name in zip(study.found["mm_vel_est"], study.scripts, strict=True) if name == "slider"]
    return slider(sliders) if sliders else {}


def _clocks(study: Study) -> dict[str, Any]:
    return {} if study.quick else {"by_clock_ms": by_clock(study.store, study.n_jobs)}


def _slow(study: Study) -> dict[str, Any]:
    return {} if study.quick else {"tuned_for_slow_hands": as_in_the_thesis(study.both)}


def _knobs(study: Study) -> dict[str, Any]:
    some = study.both[::_KNOBS_FROM]
    return {"choices": rows("hand estimator", study.configs, some) + rows("hand", varied(HandConfig, {} if study.quick else KNOBS), some)}


def measure(folder: Path, quick: bool, n_jobs: int, parts: Sequence[str]) -> dict[str, Any]:
    """Simulate what is missing, tune where no earlier run of the same code did, and measure some parts."""
    study, result = Study(folder, quick, n_jobs), dict[str, Any](choices=[])
    for part in parts:
        result |= PARTS[part](study)
    return result


def slow(scripts: Sequence[str]) -> list[bool]:
    """Whether each scene is a slow line."""
    return [name == "slow line" for name in scripts]


def gained(found: Mapping[str, Runs], sure: Sequence[Any], scripts: Sequence[str]) -> dict[str, Any]:
    """Errors of every filter, those of ours over the single filter's on the same clouds, and what the covariance of the track is worth."""
    by_filter = {name: figures_of(one, sure, slow(scripts)) for name, one in found.items()}
    best, ratios = by_filter["mm_vel_est"], hand_gain.ratios(hand_gain.paired(found, sure))
    return {
        "rmse_slow_m": best["rmse_slow_m"],
        "p95_fast_mmvelest_m": best["p95_fast_m"],
        "p95_fast_ratio": ratios["linear"]["ratio"] if ratios else None,
        "p95_fast_ratio_interval": ratios["linear"]["interval"] if ratios else None,
        "p95_fast_ratios": ratios,
        "settle_s": best["settle_s"],
        "fast_clouds": int(sum(mask.sum() for mask in sure)),
        "scenes": len(scripts),
        "by_filter": by_filter,
        "nees": hand_runs.consistency(found["mm_vel_est"]),
        "by_script": {
            kind: rms(
                errors([run], [hand_gain.follows(*run)])[0] for run, own in zip(found["mm_vel_est"], scripts, strict=True) if own == kind
            )
            for kind in dict.fromkeys(scripts)
        },
    }


def _snapshots(study: Study) -> dict[str, Any]:
    """How far velocities of snapshots are off, over what they say, in the measured scenes with the default configuration."""
    judged = judge(runs(study.both, HandConfig()))
    every = nees(judged)
    return {"nees_scenes": every["nees"], "nees_scenes_interval": every["interval"], "snapshots": scene_figures(judged)} | (
        {} if study.quick else {"snapshots_by": tables(judged, DISTANCES)}
    )


def by_clock(store: HandStore, n_jobs: int) -> dict[str, dict[str, float]]:
    """Error of fast lines and circles over the offset between the radars' clocks [ms].

    Returns for each offset ``rmse_m`` and ``p95_fast_m`` of radars that start their frames by their own clocks, so that clouds with the
    same stamp were measured at different times; ``rmse_stamps_m`` where both measure at the same time and only stamps are wrong.
    """
    drawn = [one for one in plan(quick=False) if one[0].name in ("fast line", "circle")][:_CLOCK_SCENES]
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


PARTS: Final[Mapping[str, Callable[[Study], dict[str, Any]]]] = {
    "gain": _gain, "losses": _losses, "snapshots": _snapshots, "rates": _rates, "single": _single, "slider": _slider, "clocks": _clocks,
    "slow": _slow, "knobs": _knobs,
}  # fmt: skip


def run(quick: bool = False, keep: Path | None = None, parts: str = "") -> dict[str, Any]:
    """Follow hands.

    ``quick``: one scene and one to tune on, bodies of ellipsoids: to see that it runs; ``keep``: folder for the simulated clouds; None:
    they are thrown away; ``parts``: some of `PARTS`, with commas between; empty: all.
    Returns ``rmse_slow_m`` (slow lines), ``p95_fast_mmvelest_m`` and ``p95_fast_ratio`` (to the single Kalman filter; fast parts in which
    the snapshot tells the velocity across to `SURE`, and all follow the hand) with its interval by scenes, ``optimum_inside`` of the
    search, ``settle_s`` after a reversal; the same and more for every estimator, each tuned by the same search, and for one radar; errors
    are those of clouds at which the hand is followed, ``lost`` is the share of the others; ``when`` by speed and distance; ``by_rate``;
    ``hand_followed_at_5pct_lost``; ``nees_scenes`` of single snapshots; ``value_rmse`` and ``value_rest_jump`` of the control value;
    ``by_clock_ms``; ``tuned_for_slow_hands``; ``choices``.
    """
    chosen = parts.split(",") if parts else list(PARTS)
    if unknown := set(chosen) - PARTS.keys():
        raise ConfigError(f"hand has no part {', '.join(sorted(unknown))}; parts: {', '.join(PARTS)}")
    with kept(keep) as folder:
        return measure(folder, quick, 1 if quick else os.cpu_count() or 1, chosen)


_TRIGGER, _COUNTED = 0.8, 1.3  # s: the hand is followed from there on; its errors count from there on
_SAME = 0.2  # s: residuals this near tell the same, because the hand goes some 0.1 m meanwhile
RADARS = Panel("number of radars", "hand residual (rms)", "m", "lower", "1 radar", "baseband and people tracking of one radar")
FILTER = Panel("hand filter", "hand residual (rms)", "m", "lower", "mm_vel_est", "baseband and people tracking of one radar")


def chain(infos: Sequence[RadarInfo]) -> tuple[RadarInfo, Callable[[Sequence[RadarFrame]], TrackedCloud]]:
    """Baseband, fusion and tracking of some radars; their frames are the first ones that it is given."""
    info = infos[0] if len(infos) == 1 else fused_info(infos)
    people, basebands = make_tracker(None, info), [Baseband(BasebandConfig(), one) for one in infos]

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
