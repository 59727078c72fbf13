"""Several users who gesture at once, and bystanders: the right gesture for the right person (thesis, section 7.2)."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from benchmarks.gesture_causes import Judged, Outcome, count, false_by_cause, judge, missed_by_cause, rows_of_rules
from benchmarks.gesture_clouds import Association, StreamStore, follow_all
from benchmarks.gesture_scenes import CROWDS, LEAD, ROUNDS, Crowd, crowd_scene
from benchmarks.report import Tally, against_first, timed
from benchmarks.stores import kept
from radar_core import GESTURES
from radar_core.config import load_file
from radar_core.paths import find_config
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.classifiers.loading import load_perceptron
from radar_gestures.classifiers.model import AUTO, load_model
from radar_gestures.classifiers.perceptron import GestureModel
from radar_sim import Simulator

_ACCURACY: Final = "right gesture for the right person"
_SEVERAL, _ONE = "two directions a cell (preset people)", "one direction a cell"
PEOPLE: Final = load_file(BasebandConfig, find_config("people", "baseband", ".yaml"))
BASEBANDS: Final = {_SEVERAL: PEOPLE, _ONE: BasebandConfig()}  # what the crowds are seen through


@dataclass(frozen=True)
class Plan:
    """How many scenes of each kind, with how many rounds each."""

    seeds: int = 6
    rounds: int = ROUNDS
    crowds: tuple[Crowd, ...] = CROWDS


FULL: Final = Plan()
QUICK: Final = Plan(seeds=1, rounds=1, crowds=CROWDS[::4])


def causes(judged: Sequence[Judged]) -> dict[str, Any]:
    """Say why gestures were missed and what for others were taken."""

    def confused(outcome: Outcome) -> str:
        assert outcome.found is not None
        return f"{GESTURES[outcome.true.label]}: {outcome.cause or f'taken for {outcome.found.gesture.name}'}"

    outcomes = [o for one in judged for o in one.outcomes]
    wrong = [o for o in outcomes if o.found is not None and o.found.gesture.label != o.true.label]
    return {
        "missed": missed_by_cause(outcomes),
        "wrong": dict(Counter(map(confused, wrong)).most_common()),
        "false": false_by_cause(judged),
    }


def measure(
    plan: Plan,
    keep: Path,
    n_jobs: int = 1,
    progress: bool = True,
    baseband: BasebandConfig = PEOPLE,
    association: Association = "matching",
) -> dict[str, Any]:
    """Simulate what is missing in ``keep``, follow all scenes, and count; ``association``: see `follow`.

    Names are those of both models together, the default; ``features_``: those of the thirteen features alone, for which the rules of the
    recogniser are varied, too.
    """
    store, models = StreamStore(keep, baseband), (load_model(AUTO), load_perceptron())
    scenes = {crowd: [crowd_scene(crowd, seed, plan.rounds) for seed in range(plan.seeds)] for crowd in plan.crowds}
    store.fill(itertools.chain(*scenes.values()), n_jobs=n_jobs, progress=progress)
    both: dict[Crowd, list[Judged]] = {}
    alone: dict[Crowd, list[Judged]] = {}
    for crowd, own in scenes.items():
        runs = [[judge(run) for run in follow_all(store, scene, models, association=association)] for scene in own]
        both[crowd], alone[crowd] = ([pair[number] for pair in runs] for number in range(2))
    times = {crowd: [spent for one in own for spent in one.times_ms] for crowd, own in both.items()}
    tallies, features = ({crowd: total(own) for crowd, own in judged.items()} for judged in (both, alone))
    shares = {crowd.name: (own.right / max(own.performed, 1), times[crowd]) for crowd, own in tallies.items()}
    whole = sum(tallies.values(), Tally())
    beside = sum((own for crowd, own in tallies.items() if crowd.bystander), Tally()).figures()
    return {
        **by_users(tallies),
        **{f"features_{name}": value for name, value in by_users(features).items()},
        **{name: whole.figures()[name] for name in ("cross_talk", "cross_talk_interval")},
        **{name.replace("talk", "talk_with_bystander"): beside[name] for name in ("cross_talk", "cross_talk_interval")},
        "ghost_gestures": whole.ghost_gestures,
        **{f"crowd_{name}": value for name, value in whole.false_figures().items()},
        "crowds": {crowd.name: tallies[crowd].figures() | {"causes": causes(both[crowd])} for crowd in plan.crowds},
        "choices": against_first("crowds", _ACCURACY, shares) + rule_rows([one for own in alone.values() for one in own], models[1]),
    }


def by_users(tallies: Mapping[Crowd, Tally]) -> dict[str, Any]:
    """Give the accuracy of two and of three users who gesture at once, and their intervals."""
    found: dict[str, Any] = {}
    for n, name in ((2, "two"), (3, "three")):
        figures = sum((own for crowd, own in tallies.items() if crowd.users == n), Tally()).figures()
        found |= {f"{name}_users_{key}": figures[key] for key in ("accuracy", "accuracy_interval")}
    return found


def total(judged: Sequence[Judged]) -> Tally:
    """Add up the counts of some scenes."""
    return sum(map(count, judged), Tally())


def rule_rows(judged: Sequence[Judged], model: GestureModel) -> list[dict[str, Any]]:
    """Accuracy of all crowds by other rules of the recogniser, see `rules`."""

    def figures(again: Sequence[Judged]) -> tuple[str, float]:
        shares = total(again).figures()
        return f", {shares['cross_talk'] or 0.0:.1%} cross-talk", shares["accuracy"] or 0.0

    return rows_of_rules("crowds: rules, one event", _ACCURACY, judged, model, figures)


def compare(plan: Plan, keep: Path, n_jobs: int = 1, progress: bool = True) -> dict[str, Any]:
    """Measure through the baseband for several people and through the default one, each with the time that a frame takes it."""
    found = {name: measure(plan, keep, n_jobs, progress, baseband) for name, baseband in BASEBANDS.items()}
    times = {name: frame_times(baseband) for name, baseband in BASEBANDS.items()}
    result, single = found[_SEVERAL], found[_ONE]
    shares = {name: (found[name]["two_users_accuracy"] or 0.0, times[name]) for name in BASEBANDS}
    result["choices"] += against_first("crowds: baseband", f"two users: {_ACCURACY}", shares)
    return result | {"one_direction_a_cell": {name: value for name, value in single.items() if name not in ("crowds", "choices")}}


def frame_times(baseband: BasebandConfig, n_frames: int = 60) -> list[float]:
    """Milliseconds of each frame of two users who gesture, from the raw samples to the cloud."""
    simulator = Simulator(crowd_scene(CROWDS[0], 0, rounds=1))
    frames = [simulator.process(k).frame for k in range(round(LEAD * 50), round(LEAD * 50) + n_frames)]
    processor = Baseband(baseband, simulator.info)
    return [timed(processor.process, frame)[1] for frame in frames][10:]  # the first ones compile and design


def run(quick: bool = False, keep: Path | None = None, n_jobs: int = 1) -> dict[str, Any]:
    """Measure crowds; a full run simulates 48 scenes of a minute, once for each of two basebands.

    Returns ``two_users_accuracy``, ``three_users_accuracy``: gestures credited rightly, over all performed, slow ones too; ``cross_talk``:
    gestures credited to somebody who performed none while others did, over all performed; ``cross_talk_with_bystander``: the same where
    somebody stands by; ``crowds``: the same and the causes by kind of scene; ``one_direction_a_cell``: through the default baseband in
    place of its preset ``people``, which looks for two in a cell.
    """
    with kept(keep) as folder:
        return compare(QUICK if quick else FULL, folder, n_jobs)
