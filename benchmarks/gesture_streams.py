"""Gestures in continuous streams: events found, named, in time; false ones while nobody gestures; strokes that are no known gesture."""

from __future__ import annotations

import functools
import math
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks import gesture_rules
from benchmarks.gesture_causes import RANDOM, Judged, Outcome, judge
from benchmarks.gesture_clouds import StreamStore, fitted, follow
from benchmarks.report import choice
from radar_core import GESTURES, RadarInfo
from radar_gestures.classifiers.model import load_model
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.recognizer import Gesture
from radar_sim import GESTURE_DURATION, VARIANTS, Action, Coupling, Draw, Effects, Losses, Noise, Occlusion, Pattern, Person, Scene
from radar_sim.people import SHAPES, Reach, Variation, Walk
from radar_sim.scene import SceneRadar

Random = np.random.Generator
LONG: Final = 600.0
"""Length of a stream [s]."""
SEEDS: Final = 3
IDLE_SEEDS: Final = 3
LOSS: Final = 0.05
"""Share of the known gestures that may be lost to what keeps unknown ones out."""
NAMED: Final = tuple(name for name in GESTURES if name != "random")
_SECTORS: Final = {1: ((-25.0, 25.0),), 2: ((-40.0, -12.0), (12.0, 40.0)), 3: ((-45.0, -25.0), (-10.0, 10.0), (25.0, 45.0))}  # deg


def stroke(rng: Random, name: str, tilt: float | None = None) -> Action:
    """Perform a gesture at a speed, in a size and tilted as people do, or tilted by much, as nobody does."""
    return Action(
        gesture=name,
        duration=GESTURE_DURATION[name] * float(np.exp(rng.uniform(math.log(0.75), math.log(1.3)))),
        size=float(rng.uniform(0.85, 1.1)),
        tilt=float(np.clip(rng.normal(0.0, 0.12), -0.3, 0.3)) if tilt is None else tilt + float(rng.uniform(-0.1, 0.1)),
        variant=int(rng.integers(VARIANTS.get(name, 1))),
    )


def body(rng: Random, number: int, place: tuple[float, float], script: Sequence[Action]) -> Person:
    """Draw somebody, who faces the radar, with a place and a script."""
    return Person(
        id=number,
        height=float(rng.uniform(1.5, 1.95)),
        sex="male" if rng.random() < 0.5 else "female",
        build=float(rng.uniform(0.1, 0.9)),
        position=place,
        arm="right" if rng.random() < 0.75 else "left",
        variation=Variation(path=float(rng.uniform(0.01, 0.05)), sway=float(rng.uniform(0.5, 1.5))),
        script=tuple(script),
    )


def effects(rng: Random) -> Effects:
    """Draw receivers and losses."""
    return Effects(
        occlusion=Occlusion(),
        doppler_in_chirp=True,
        pattern=Pattern(),
        noise=Noise(noise_figure=float(rng.uniform(12.0, 16.0))),
        losses=Losses(level=float(rng.uniform(17.0, 21.0))),
        coupling=Coupling(level=-60.0),
    )


def scene_of(rng: Random, people: Sequence[Person], duration: float, more: Sequence[Callable[[], Sequence[Action]]]) -> Scene:
    """Put people into a scene, each of whom goes on with what ``more`` gives; what they would not finish in time they do not begin."""
    seed, info = int(rng.integers(1 << 31)), RadarInfo()
    mount = (info.mount.x, info.mount.y)
    return Scene(
        duration=duration,
        seed=seed,
        radars=(SceneRadar.of(info),),
        people=tuple(fitted(person, duration, seed, own, mount) for person, own in zip(people, more, strict=True)),
        effects=effects(rng),
    )


def place_in(rng: Random, sector: tuple[float, float], near: float, far: float) -> tuple[float, float]:
    """Draw a place by azimuth [deg] and distance [m]."""
    side, distance = math.radians(rng.uniform(*sector)), rng.uniform(near, far)
    return (float(distance * math.cos(side)), float(distance * math.sin(side)))


def pause(rng: Random) -> Action:
    """Stand still between two gestures."""
    return Action(stand=float(rng.uniform(1.0, 4.0)))


def known(rng: Random) -> list[Action]:
    """Draw every gesture once, and one random stroke, in random order, with pauses; now and then a walk or some fidgeting in between."""
    script: list[Action] = []
    for name in rng.permutation(GESTURES):
        if rng.random() < 0.15:
            script.append(Action(walk=Walk(to=place_in(rng, (-20.0, 20.0), 2.0, 3.0), speed=float(rng.uniform(0.6, 1.3)))))
        if rng.random() < 0.15:
            script.append(Action(fidget=float(rng.uniform(2.0, 5.0))))
        script += [pause(rng), stroke(rng, str(name))]
    return script


def unknown(rng: Random) -> list[Action]:
    """Draw strokes that are none of the ten.

    Slashes along both diagonals, a forearm that waves up and down, a hand that stirs a pot, and an eight drawn as fast as an arm can.
    """
    slashes = [(name, side * 0.79) for name in ("swipe_up", "swipe_down") for side in (-1.0, 1.0)]
    tilted = [*slashes, ("wave", 1.5), ("rotate", 1.5)]
    actions = [stroke(rng, name, tilt) for name, tilt in tilted]
    actions.append(Action(draw=Draw(shape="eight", duration=1.5, size=0.35, speed=float(rng.uniform(1.8, 2.8)))))
    return [step for k in rng.permutation(len(actions)) for step in (pause(rng), actions[int(k)])]


def gesture_stream(seed: int, duration: float = LONG, round_of: Callable[[Random], list[Action]] = known) -> Scene:
    """One person, 2 to 3 m away, who does one round of strokes after the other."""
    rng = np.random.default_rng([seed, 0x57, *round_of.__name__.encode()])
    person = body(rng, 1, place_in(rng, (-20.0, 20.0), 2.0, 3.0), [Action(stand=2.0)])
    return scene_of(rng, [person], duration, [lambda: round_of(rng)])


def standing(rng: Random, sector: tuple[float, float]) -> list[Action]:
    """Stand still."""
    return [Action(stand=30.0)]


def sitting(rng: Random, sector: tuple[float, float]) -> list[Action]:
    """Sit down, stay, shift on the chair, and get up."""
    return [
        Action(sit=float(rng.uniform(5.0, 20.0))),
        Action(fidget=float(rng.uniform(5.0, 15.0))),
        Action(stand=float(rng.uniform(5.0, 20.0))),
        Action(rise=float(rng.uniform(1.0, 3.0))),
    ]


def walking(rng: Random, sector: tuple[float, float]) -> list[Action]:
    """Walk somewhere, and stand there for a moment or longer."""
    walk = Action(walk=Walk(to=place_in(rng, sector, 1.5, 5.0), speed=float(rng.uniform(0.5, 1.5))))
    return [walk, Action(stand=float(rng.uniform(0.2, 3.0)))]


def fidgeting(rng: Random, sector: tuple[float, float]) -> list[Action]:
    """Wait impatiently."""
    return [Action(fidget=float(rng.uniform(5.0, 20.0))), Action(stand=float(rng.uniform(0.5, 3.0)))]


def drawing(rng: Random, sector: tuple[float, float]) -> list[Action]:
    """Draw a shape, as for the analogue input."""
    shape = SHAPES[int(rng.integers(len(SHAPES)))]
    speed, size = float(rng.uniform(0.3, 1.0)), float(rng.uniform(0.15, 0.35))
    draw = Draw(shape=shape, duration=float(rng.uniform(3.0, 8.0)), size=size, speed=speed)
    return [Action(draw=draw), Action(stand=float(rng.uniform(1.0, 3.0)))]


def reaching(rng: Random, sector: tuple[float, float]) -> list[Action]:
    """Reach for something in front, at any height, and let the arm down again."""
    return [
        Action(reach=Reach(to=(0.0, 0.0, float(rng.uniform(0.6, 1.7))), hold=float(rng.uniform(0.3, 2.0)))),
        Action(stand=float(rng.uniform(2.0, 4.0))),
    ]


def daily(rng: Random, sector: tuple[float, float]) -> list[Action]:
    """Do any of it."""
    kinds = (standing, sitting, walking, walking, fidgeting, fidgeting, drawing, reaching)
    return kinds[int(rng.integers(len(kinds)))](rng, sector)


IDLE: Final[Mapping[str, Callable[[Random, tuple[float, float]], list[Action]]]] = {
    "standing": standing,
    "sitting": sitting,
    "walking": walking,
    "fidgeting": fidgeting,
    "drawing": drawing,
    "daily": daily,
}
"""Ways of spending time without a gesture."""


def idle_stream(kind: str, seed: int, duration: float = LONG, people: int | None = None) -> Scene:
    """One to three people (the seed says how many unless told) who do not gesture, each in a sector of their own."""
    rng = np.random.default_rng([seed, 0x1D, *kind.encode()])
    sectors = _SECTORS[people if people is not None else 1 + seed % 3]
    drawn = [
        body(rng, number, place_in(rng, sector, 2.0, 3.5), [Action(stand=float(rng.uniform(0.5, 2.0)))])
        for number, sector in enumerate(sectors, 1)
    ]
    return scene_of(rng, drawn, duration, [functools.partial(IDLE[kind], rng, sector) for sector in sectors])


@dataclass(frozen=True)
class Plan:
    """Streams to make: seeds of gestures and of unknown strokes, kinds and seeds of idle time, and the length of each [s]."""

    seeds: int = SEEDS
    idle: tuple[str, ...] = tuple(IDLE)
    idle_seeds: int = IDLE_SEEDS
    duration: float = LONG


FULL: Final = Plan()
QUICK: Final = Plan(seeds=1, idle=("daily",), idle_seeds=1, duration=60.0)


def scenes(plan: Plan) -> dict[str, list[Scene]]:
    """Draw the scenes of a plan: "gestures", "unknown", and every kind of idle time."""
    made = {
        "gestures": [gesture_stream(seed, plan.duration) for seed in range(plan.seeds)],
        "unknown": [gesture_stream(seed, plan.duration, unknown) for seed in range(plan.seeds)],
    }
    return made | {kind: [idle_stream(kind, seed, plan.duration) for seed in range(plan.idle_seeds)] for kind in plan.idle}


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if len(values) else None


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None


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


def gesture_figures(judged: Sequence[Judged]) -> dict[str, Any]:
    """Figures of streams with known gestures."""
    outcomes = [o for one in judged for o in one.outcomes if o.true.label != RANDOM]
    met = [o for o in outcomes if o.true.meets]
    others = [o for o in outcomes if not o.true.meets]
    right = sum(o.found is not None and o.found.gesture.label == o.true.label for o in met)
    strokes = [o for one in judged for o in one.outcomes if o.true.label == RANDOM and o.found is not None]
    hours = math.fsum(one.hours for one in judged)
    return {
        "gestures": len(outcomes),
        "gestures_that_meet": len(met),
        "event_recall": _share(sum(o.found is not None for o in met), len(met)),
        "event_recall_others": _share(sum(o.found is not None for o in others), len(others)),
        **timing(met),
        "recognised": _share(right, len(met)),
        "recognised_all": _share(sum(o.found is not None and o.found.gesture.label == o.true.label for o in outcomes), len(outcomes)),
        "random_strokes_named": _share(sum(o.found is not None and o.found.gesture.label != RANDOM for o in strokes), len(strokes)),
        "false_per_hour_between_gestures": sum(s.false for one in judged for s in one.surplus) / hours if hours else None,
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
                "missed": dict(Counter(("" if o.true.meets else "slow: ") + o.cause for o in own if o.found is None)),
                **timing(met),
            }
    return {
        "by_gesture": by_name,
        "missed": dict(Counter(o.cause for o in outcomes if o.found is None and o.true.meets)),
        "called_random": dict(Counter(o.cause for o in outcomes if o.found is not None and o.cause and o.true.label != RANDOM)),
        "false": dict(Counter(f"{s.found.gesture.name} ({s.doing})" for one in judged for s in one.surplus if s.false)),
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
        "unknown_rejected": _share(sum(familiar(model, found.gesture) < limit for found in unknown), len(unknown)),
        "unknown_limit": limit,
        "unknown_rejected_as_shipped": _share(sum(found.gesture.label == RANDOM for found in unknown), len(unknown)),
        "known_lost_as_shipped": _share(sum(found.gesture.label == RANDOM for found in events), len(events)),
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
        "false_per_hour": sum(s.false for s in events) / hours if hours else None,
        "idle_events_per_hour": len(events) / hours if hours else None,
        "false_by_kind": {kind: sum(s.false for one in own for s in one.surplus) for kind, own in judged.items()},
        "false_by_cause": dict(Counter(f"{s.found.gesture.name} ({s.doing})" for s in events if s.false)),
        "events_by_cause": dict(Counter(s.doing for s in events)),
    }


def measure(plan: Plan, keep: Path, model: GestureModel, n_jobs: int = 1, progress: bool = True) -> dict[str, Any]:
    """Simulate what is missing in ``keep``, follow all streams, and count."""
    store, drawn = StreamStore(keep), scenes(plan)
    pace = store.fill([scene for own in drawn.values() for scene in own], n_jobs=n_jobs, progress=progress)
    judged: dict[str, list[Judged]] = {}
    times: list[float] = []
    for kind, own in drawn.items():
        for scene in own:
            run = follow(store, scene, model)
            judged.setdefault(kind, []).append(judge(run))
            times += run.times_ms
    idle = {kind: judged[kind] for kind in plan.idle}
    flat = gesture_figures(judged["gestures"]) | rejection(model, judged["gestures"], judged["unknown"]) | idle_figures(idle)
    recall = flat["event_recall"]
    row = choice("streams", "default", accuracy=("event recall", math.nan if recall is None else recall, ""), times_ms=times)
    pace_now = None if math.isnan(pace) else pace
    rules = rule_rows(judged["gestures"], [one for own in idle.values() for one in own], model)
    return {**flat, "tables": gesture_tables(judged["gestures"]), "seconds_per_minute_of_stream": pace_now, "choices": [row, *rules]}


def rule_rows(gestures: Sequence[Judged], idle: Sequence[Judged], model: GestureModel) -> list[dict[str, Any]]:
    """Count gestures named right, and false ones an hour of idle time, by other rules of the recogniser, see `gesture_rules`."""
    hours = math.fsum(one.hours for one in idle)

    def figures(again: Sequence[Judged]) -> tuple[str, tuple[str, float, str]]:
        recognised = gesture_figures(again[: len(gestures)])["recognised_all"]
        false = sum(s.false for one in again[len(gestures) :] for s in one.surplus)
        return f", {false / hours:.1f} false gestures an hour", ("recognised", math.nan if recognised is None else recognised, "")

    return gesture_rules.rows("streams: rules, one event", [*gestures, *idle], model, figures)


def run(quick: bool = False, keep: Path | None = None, n_jobs: int = 1) -> dict[str, Any]:
    """Measure streams; the full plan is four hours of scene time and takes hours to simulate once.

    Parameters
    ----------
    quick : bool
        One minute of each instead.
    keep : Path or None
        Folder for the clouds, with which an interrupted run goes on and a second one begins at tracking; None: they are thrown away.
    n_jobs : int
        Pieces of scenes simulated at the same time.

    Returns
    -------
    dict
        ``event_recall``, ``start_error_s``, ``end_error_s``, ``recognised``, ``false_per_hour``, ``unknown_rejected`` and what explains
        them: ``tables``, ``false_by_cause``; `None` stands for what has nothing to divide by.
    """
    plan, model = QUICK if quick else FULL, load_model()
    if keep is not None:
        return measure(plan, keep, model, n_jobs)
    with tempfile.TemporaryDirectory() as folder:
        return measure(plan, Path(folder), model, n_jobs)
