"""Gestures in continuous streams: events found, named, in time; false ones while nobody gestures; strokes that are no known gesture."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.gesture_causes import RANDOM, Judged, Outcome, count, false_by_cause, judge, missed_by_cause, rows_of_rules
from benchmarks.gesture_clouds import Association, StreamStore, follow
from benchmarks.gesture_scenes import IDLE, LONG, gesture_stream, idle_stream, unknown
from benchmarks.report import Tally, choice, rate, share
from benchmarks.stores import kept
from radar_core import GESTURES
from radar_gestures.classifiers.model import load_model
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.gesture import Gesture
from radar_sim import Scene

SEEDS: Final = 3
IDLE_SEEDS: Final = 3
LOSS: Final = 0.05  # share of the known gestures that may be lost to what keeps unknown ones out


@dataclass(frozen=True)
class Plan:
    """Streams to make: seeds of gestures and of unknown strokes, kinds and seeds of idle time, and the length of each [s]."""

    seeds: int = SEEDS
    idle: tuple[str, ...] = tuple(IDLE)
    idle_seeds: int = IDLE_SEEDS
    duration: float = LONG


FULL: Final = Plan()
QUICK: Final = Plan(seeds=1, idle=("daily",), idle_seeds=1, duration=20.0)


def scenes(plan: Plan) -> dict[str, list[Scene]]:
    """Draw the scenes of a plan: "gestures", "unknown", and every kind of idle time."""
    made = {
        "gestures": [gesture_stream(seed, plan.duration) for seed in range(plan.seeds)],
        "unknown": [gesture_stream(seed, plan.duration, unknown) for seed in range(plan.seeds)],
    }
    return made | {kind: [idle_stream(kind, seed, plan.duration) for seed in range(plan.idle_seeds)] for kind in plan.idle}


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if len(values) else None


def timing(outcomes: Sequence[Outcome]) -> dict[str, float | None]:
    """Mean sizes of the errors of start and end, and their biases [s]; positive: the event was late."""
    start = [(o.found.gesture.start_ns - o.true.first_ns) * 1e-9 for o in outcomes if o.found is not None]
    end = [(o.found.gesture.end_ns - o.true.last_ns) * 1e-9 for o in outcomes if o.found is not None]
    return {
        "start_error_s": _mean(np.abs(start).tolist()),
        "end_error_s": _mean(np.abs(end).tolist()),
        "start_bias_s": _mean(start),
        "end_bias_s": _mean(end),
    }


def is_right(outcome: Outcome) -> bool:
    """Whether a gesture was found and named right."""
    return outcome.found is not None and outcome.found.gesture.label == outcome.true.label


def gesture_figures(judged: Sequence[Judged]) -> dict[str, Any]:
    """Figures of streams with known gestures; every share and rate with its 95 % interval."""
    outcomes = [o for one in judged for o in one.outcomes if o.true.label != RANDOM]
    met = [o for o in outcomes if o.true.meets]
    others = [o for o in outcomes if not o.true.meets]
    strokes = [o for one in judged for o in one.outcomes if o.true.label == RANDOM and o.found is not None]
    named = sum(o.found is not None and o.found.gesture.label != RANDOM for o in strokes)
    hours = math.fsum(one.hours for one in judged)
    return {
        "gestures": len(outcomes),
        "gestures_that_meet": len(met),
        **share("event_recall", sum(o.found is not None for o in met), len(met)),
        **share("event_recall_others", sum(o.found is not None for o in others), len(others)),
        **timing(met),
        **share("recognised", sum(map(is_right, met)), len(met)),
        **share("recognised_all", sum(map(is_right, outcomes)), len(outcomes)),
        **share("random_strokes_named", named, len(strokes)),
        **rate("false_per_hour_between_gestures", sum(s.false for one in judged for s in one.surplus), hours),
    }


def gesture_tables(judged: Sequence[Judged]) -> dict[str, Any]:
    """Say by gesture what was found, and why the rest was not."""
    outcomes = [o for one in judged for o in one.outcomes]
    by_name = {}
    for label, name in enumerate(GESTURES):
        own = [o for o in outcomes if o.true.label == label]
        met = [o for o in own if o.true.meets]
        if own:
            by_name[name] = {
                "performed": len(own),
                "meet": len(met),
                "found": sum(o.found is not None for o in met),
                "named": dict(Counter(o.found.gesture.name for o in own if o.found is not None)),
                "missed": missed_by_cause(own),
                **timing(met),
            }
    return {
        "by_gesture": by_name,
        "missed": missed_by_cause(o for o in outcomes if o.true.meets),
        "called_random": dict(Counter(o.cause for o in outcomes if o.found is not None and o.cause and o.true.label != RANDOM)),
        "false": false_by_cause(judged),
    }


def familiar(model: GestureModel, gesture: Gesture) -> float:
    """Return how much an event looks like a gesture that the model knows, 0 to 1; 0 for one that is random whatever the limit."""
    if int(np.argmax(gesture.probabilities)) == RANDOM or not np.isfinite(gesture.features).all():
        return 0.0
    own = [GESTURES.index(label) for label in model.labels]
    return float(model.score(gesture.features, gesture.probabilities[own]))


def rejection(model: GestureModel, gestures: Sequence[Judged], strange: Sequence[Judged]) -> dict[str, Any]:
    """Say how many unknown strokes are kept out by a limit that costs `LOSS` of the known ones named right, and by the model's own."""
    events = [o.found for one in gestures for o in one.outcomes if o.found is not None and o.true.label != RANDOM and _best_is(o)]
    right = [familiar(model, found.gesture) for found in events]
    unknown = [o.found for one in strange for o in one.outcomes if o.found is not None] + [s.found for one in strange for s in one.surplus]
    figures = {"unknown_events": len(unknown), "unknown_strokes": sum(len(one.outcomes) for one in strange)}
    if not right or not unknown:
        return figures | {"unknown_rejected": None, "unknown_rejected_as_shipped": None, "known_lost_as_shipped": None}
    limit = float(np.quantile(right, LOSS))
    return figures | {
        **share("unknown_rejected", sum(familiar(model, found.gesture) < limit for found in unknown), len(unknown)),
        "unknown_limit": limit,
        **share("unknown_rejected_as_shipped", sum(found.gesture.label == RANDOM for found in unknown), len(unknown)),
        **share("known_lost_as_shipped", sum(found.gesture.label == RANDOM for found in events), len(events)),
        "unknown_named": dict(Counter(found.gesture.name for found in unknown)),
        "unknown_by_stroke": _by_stroke(strange),
    }


def _best_is(outcome: Outcome) -> bool:
    """Whether the most probable label is the right one, whatever was rejected."""
    return outcome.found is not None and int(np.argmax(outcome.found.gesture.probabilities)) == outcome.true.label


def _by_stroke(strange: Sequence[Judged]) -> dict[str, dict[str, int]]:
    """Say what unknown strokes were taken for; a tilted stroke goes by the name of the one that it was before."""
    table: dict[str, Counter[str]] = {}
    for outcome in (o for one in strange for o in one.outcomes):
        name = f"tilted {GESTURES[outcome.true.label]}"
        table.setdefault(name, Counter())[outcome.found.gesture.name if outcome.found is not None else "no event"] += 1
    for surplus in (s for one in strange for s in one.surplus):
        table.setdefault(surplus.doing, Counter())[surplus.found.gesture.name] += 1
    return {name: dict(counts) for name, counts in table.items()}


def idle_figures(judged: Mapping[str, Sequence[Judged]]) -> dict[str, Any]:
    """Count false gestures per hour of idle time, by kind and by what they were taken for."""
    everything = [one for own in judged.values() for one in own]
    hours = math.fsum(one.hours for one in everything)
    events = [s for one in everything for s in one.surplus]
    return {
        "idle_hours": hours,
        **rate("false_per_hour", sum(s.false for s in events), hours),
        **rate("idle_events_per_hour", len(events), hours),
        "false_by_kind": {kind: sum(s.false for one in own for s in one.surplus) for kind, own in judged.items()},
        "false_by_cause": false_by_cause(everything),
        "events_by_cause": dict(Counter(s.doing for s in events)),
    }


def measure(
    plan: Plan, keep: Path, model: GestureModel, n_jobs: int = 1, progress: bool = True, association: Association = "matching"
) -> dict[str, Any]:
    """Simulate what is missing in ``keep``, follow all streams, and count; ``association``: see `follow`."""
    store, drawn = StreamStore(keep), scenes(plan)
    pace = store.fill(itertools.chain(*drawn.values()), n_jobs=n_jobs, progress=progress)
    judged = {kind: [judge(follow(store, scene, model, association=association)) for scene in own] for kind, own in drawn.items()}
    times = [spent for own in judged.values() for one in own for spent in one.times_ms]
    idle = {kind: judged[kind] for kind in plan.idle}
    flat = gesture_figures(judged["gestures"]) | rejection(model, judged["gestures"], judged["unknown"]) | idle_figures(idle)
    flat |= sum((count(one) for kind in ("gestures", *idle) for one in judged[kind]), Tally()).false_figures()
    recall = flat["event_recall"]
    row = choice("streams", "default", accuracy=("event recall", math.nan if recall is None else recall, ""), times_ms=times)
    pace_now = None if math.isnan(pace) else pace
    rules = rule_rows(judged["gestures"], [one for own in idle.values() for one in own], model)
    return {**flat, "tables": gesture_tables(judged["gestures"]), "seconds_per_minute_of_stream": pace_now, "choices": [row, *rules]}


def rule_rows(gestures: Sequence[Judged], idle: Sequence[Judged], model: GestureModel) -> list[dict[str, Any]]:
    """Count gestures named right, and false ones an hour of idle time, by other rules of the recogniser, see `rules`."""
    hours = math.fsum(one.hours for one in idle)

    def figures(again: Sequence[Judged]) -> tuple[str, float]:
        recognised = gesture_figures(again[: len(gestures)])["recognised_all"]
        false = sum(s.false for one in again[len(gestures) :] for s in one.surplus)
        return f", {false / hours:.1f} false gestures an hour", math.nan if recognised is None else recognised

    return rows_of_rules("streams: rules, one event", "recognised", [*gestures, *idle], model, figures)


def run(quick: bool = False, keep: Path | None = None, n_jobs: int = 1) -> dict[str, Any]:
    """Measure streams; the full plan is four hours of scene time and takes hours to simulate once; quick: 20 s of each.

    Returns event recall, errors of start and end, what is recognised, false and rejected, and what explains them: ``tables``,
    ``false_by_cause``; false gestures and ghosts per minute of streams with known gestures and with none, see `Tally`; ``..._interval``: 95
    %; `None` stands for what has nothing to divide by.
    """
    with kept(keep) as folder:
        return measure(QUICK if quick else FULL, folder, load_model(), n_jobs)
