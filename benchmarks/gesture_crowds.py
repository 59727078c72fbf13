"""Several users who gesture at once, and bystanders: the right gesture for the right person (thesis, section 7.2)."""

from __future__ import annotations

import math
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks import gesture_rules
from benchmarks.gesture_causes import RANDOM, Judged, Outcome, Surplus, judge
from benchmarks.gesture_clouds import StreamStore, follow
from benchmarks.gesture_streams import NAMED, Random, body, effects, stroke
from benchmarks.report import choice
from radar_core import GESTURES, RadarInfo
from radar_core.config import load_file
from radar_core.paths import find_config
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.classifiers.model import load_model
from radar_gestures.classifiers.perceptron import GestureModel
from radar_lab.evaluation.scoring import RecognisedGesture, TruthSegment, score_gestures, truth_segments
from radar_sim import Action, Person, Scene, Simulator
from radar_sim.scene import SceneRadar

NEAR: Final = (0.8, 1.2)
WIDE: Final = (1.2, 2.0)
"""Distances from one user to the next [m]; sideways swipes only where they are wide."""
TOGETHER: Final = 0.3
"""Users start within this of each other [s]."""
SIDEWAYS: Final = ("swipe_left", "swipe_right")
_ROUND: Final = 6.0  # s: the slowest stroke, and bringing the arm to the next one
_LEAD: Final = 4.0  # s: until everybody has a track and an arm in place
_ROUNDS: Final = 9
_TOLERANCE: Final = 0.6  # s: as `score_gestures` has it
_TURN: Final = math.radians(15.0)  # of the row against one across the boresight


@dataclass(frozen=True)
class Crowd:
    """A kind of scene: so many users who gesture at once, so far from each other [m], and whether somebody beside them does nothing."""

    users: int
    apart: tuple[float, float]
    bystander: bool

    @property
    def name(self) -> str:
        """In words."""
        more = " and a bystander" if self.bystander else ""
        return f"{self.users} users{more}, {self.apart[0]:g} to {self.apart[1]:g} m apart"

    @property
    def gestures(self) -> tuple[str, ...]:
        """What they do."""
        return tuple(name for name in NAMED if self.apart[0] >= WIDE[0] or name not in SIDEWAYS)


_SEVERAL, _ONE = "two directions a cell (preset people)", "one direction a cell"
PEOPLE: Final = load_file(BasebandConfig, find_config("people", "baseband", ".yaml"))
BASEBANDS: Final = {_SEVERAL: PEOPLE, _ONE: BasebandConfig()}
"""What the crowds are seen through."""
CROWDS: Final = tuple(Crowd(users, apart, bystander) for users in (2, 3) for bystander in (False, True) for apart in (NEAR, WIDE))


def crowd_scene(crowd: Crowd, seed: int, rounds: int = _ROUNDS) -> Scene:
    """Draw people in a row across the boresight, 2 to 3 m away, who face the radar and gesture once a round, all different."""
    rng = np.random.default_rng([seed, 0xC0, *crowd.name.encode()])
    places = row(rng, crowd)
    scripts = iter(_scripts(rng, crowd, rounds))
    idle = int(rng.integers(len(places))) if crowd.bystander else -1
    duration = _LEAD + rounds * _ROUND
    people: list[Person] = []
    for number, place in enumerate(places):
        people.append(body(rng, number + 1, place, [Action(stand=duration)] if number == idle else next(scripts)))
    return Scene(
        duration=duration, seed=int(rng.integers(1 << 31)), radars=(SceneRadar.of(RadarInfo()),), people=tuple(people), effects=effects(rng)
    )


def row(rng: Random, crowd: Crowd) -> list[tuple[float, float]]:
    """Draw where people stand, from right to left: in a row about the boresight, whose middle is 2 to 3 m away."""
    gaps = rng.uniform(*crowd.apart, crowd.users + crowd.bystander - 1)
    along = np.concatenate([[0.0], np.cumsum(gaps)])
    turn = rng.uniform(-_TURN, _TURN)
    along -= along[-1] / 2
    middle = rng.uniform(2.0, 3.0)
    return [(float(middle + a * math.sin(turn)), float(a * math.cos(turn))) for a in along]


def _scripts(rng: Random, crowd: Crowd, rounds: int) -> list[list[Action]]:
    """Draw what each user does; every gesture comes about equally often."""
    scripts: list[list[Action]] = [[] for _ in range(crowd.users)]
    decks = [list(rng.permutation(crowd.gestures)) for _ in scripts]
    for k in range(rounds):
        taken: set[str] = set()
        for script, deck in zip(scripts, decks, strict=True):
            fresh = [name for name in deck if name not in taken]
            if not fresh:
                deck += list(rng.permutation(crowd.gestures))
                fresh = [name for name in deck if name not in taken]
            deck.remove(fresh[0])
            taken.add(str(fresh[0]))
            at = _LEAD + k * _ROUND + float(rng.uniform(0.0, TOGETHER))
            script.append(_at(stroke(rng, str(fresh[0])), at))
    return scripts


def _at(action: Action, at: float) -> Action:
    return Action(gesture=action.gesture, at=at, duration=action.duration, size=action.size, tilt=action.tilt, variant=action.variant)


@dataclass(frozen=True)
class Counts:
    """What became of the gestures of some scenes.

    Attributes
    ----------
    performed, right, wrong, missed : int
        Gestures, and what the person who performed them was credited with.
    crossed : int
        Gestures credited to somebody who performed none then, while others did.
    ghosts : int
        Gestures credited to a track near nobody.
    """

    performed: int = 0
    right: int = 0
    wrong: int = 0
    missed: int = 0
    crossed: int = 0
    ghosts: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(*(getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__))

    def figures(self) -> dict[str, Any]:
        """Shares of the gestures performed."""
        whole = max(self.performed, 1)
        return {
            "accuracy": self.right / whole if self.performed else None,
            "wrong": self.wrong,
            "missed": self.missed,
            "cross_talk": self.crossed / whole if self.performed else None,
            "ghosts": self.ghosts,
            "performed": self.performed,
        }


def count(segments: Sequence[TruthSegment], judged: Judged) -> Counts:
    """Count the gestures of one scene, person by person."""
    events = [o.found for o in judged.outcomes if o.found is not None] + [s.found for s in judged.surplus]
    named = [
        RecognisedGesture(f.person_id, f.gesture.label, f.gesture.start_ns, f.gesture.end_ns) for f in events if f.person_id is not None
    ]
    score = score_gestures(segments, named, tolerance=_TOLERANCE)
    crossed = sum(g.label != RANDOM and is_crossed(g, segments) for g in named)
    ghosts = sum(f.person_id is None and f.gesture.label != RANDOM for f in events)
    return Counts(score.total, score.hits, score.wrong, score.misses, crossed, ghosts)


def is_crossed(gesture: RecognisedGesture, segments: Sequence[TruthSegment]) -> bool:
    """Whether somebody else gestured at that time, but not the person to whom this was credited."""
    then = {s.person_id for s in segments if min(s.end_ns, gesture.end_ns) - max(s.start_ns, gesture.start_ns) > -_TOLERANCE * 1e9}
    return bool(then) and gesture.person_id not in then


@dataclass(frozen=True)
class Plan:
    """How many scenes of each kind, with how many rounds each."""

    seeds: int = 6
    rounds: int = _ROUNDS


FULL: Final = Plan()
QUICK: Final = Plan(seeds=1, rounds=2)


def causes(judged: Sequence[Judged]) -> dict[str, Any]:
    """Say why gestures were missed and what for others were taken."""

    def confused(outcome: Outcome) -> str:
        assert outcome.found is not None
        return f"{GESTURES[outcome.true.label]}: {outcome.cause or f'taken for {outcome.found.gesture.name}'}"

    def credited(surplus: Surplus) -> str:
        return f"{surplus.found.gesture.name} ({surplus.doing})"

    outcomes = [o for one in judged for o in one.outcomes]
    return {
        "missed": dict(Counter(("" if o.true.meets else "slow: ") + o.cause for o in outcomes if o.found is None).most_common()),
        "wrong": dict(
            Counter(confused(o) for o in outcomes if o.found is not None and o.found.gesture.label != o.true.label).most_common()
        ),
        "false": dict(Counter(credited(s) for one in judged for s in one.surplus if s.false).most_common()),
    }


def measure(
    plan: Plan, keep: Path, model: GestureModel, n_jobs: int = 1, progress: bool = True, baseband: BasebandConfig = PEOPLE
) -> dict[str, Any]:
    """Simulate what is missing in ``keep``, follow all scenes, and count."""
    store = StreamStore(keep, baseband)
    scenes = {(crowd, seed): crowd_scene(crowd, seed, plan.rounds) for crowd in CROWDS for seed in range(plan.seeds)}
    store.fill(scenes.values(), n_jobs=n_jobs, progress=progress)
    counts = dict.fromkeys(CROWDS, Counts())
    judged: dict[Crowd, list[Judged]] = {crowd: [] for crowd in CROWDS}
    times: dict[Crowd, list[float]] = {crowd: [] for crowd in CROWDS}
    performed: list[Sequence[TruthSegment]] = []
    for (crowd, _), scene in scenes.items():
        run = follow(store, scene, model)
        one = judge(run)
        performed.append(truth_segments(run.truths))
        counts[crowd] += count(performed[-1], one)
        judged[crowd].append(one)
        times[crowd] += run.times_ms
    users = {n: sum((counts[crowd] for crowd in CROWDS if crowd.users == n), Counts()) for n in (2, 3)}
    whole = users[2] + users[3]
    return {
        "two_users_accuracy": users[2].figures()["accuracy"],
        "three_users_accuracy": users[3].figures()["accuracy"],
        "cross_talk": whole.figures()["cross_talk"],
        "ghost_gestures": whole.ghosts,
        "crowds": {crowd.name: counts[crowd].figures() | {"causes": causes(judged[crowd])} for crowd in CROWDS},
        "choices": rows(counts, times) + rule_rows([one for own in judged.values() for one in own], performed, model),
    }


def rule_rows(judged: Sequence[Judged], performed: Sequence[Sequence[TruthSegment]], model: GestureModel) -> list[dict[str, Any]]:
    """Accuracy of all crowds by other rules of the recogniser, see `gesture_rules`."""

    def figures(again: Sequence[Judged]) -> tuple[str, tuple[str, float, str]]:
        whole = sum((count(segments, one) for segments, one in zip(performed, again, strict=True)), Counts())
        shares = whole.figures()
        return f", {shares['cross_talk'] or 0.0:.1%} cross-talk", ("right gesture for the right person", shares["accuracy"] or 0.0, "")

    return gesture_rules.rows("crowds: rules, one event", judged, model, figures)


def compare(plan: Plan, keep: Path, model: GestureModel, n_jobs: int = 1, progress: bool = True) -> dict[str, Any]:
    """Measure through the baseband for several people and through the default one, each with the time that a frame takes it."""
    found = {name: measure(plan, keep, model, n_jobs, progress, baseband) for name, baseband in BASEBANDS.items()}
    times = {name: frame_times(baseband) for name, baseband in BASEBANDS.items()}
    result, single = found[_SEVERAL], found[_ONE]
    figures = ("two_users_accuracy", "three_users_accuracy", "cross_talk")
    for name in BASEBANDS:
        accuracy = ("two users: right gesture for the right person", found[name]["two_users_accuracy"] or 0.0, "")
        reference = None if name == _SEVERAL else times[_SEVERAL]
        result["choices"].append(choice("crowds: baseband", name, accuracy=accuracy, times_ms=times[name], reference_ms=reference))
    return result | {"one_direction_a_cell": {name: single[name] for name in figures}}


def frame_times(baseband: BasebandConfig, n_frames: int = 60) -> list[float]:
    """Milliseconds of each frame of two users who gesture, from the raw samples to the cloud."""
    simulator = Simulator(crowd_scene(CROWDS[0], 0, rounds=1))
    frames = [simulator.process(k).frame for k in range(round(_LEAD * 50), round(_LEAD * 50) + n_frames)]
    processor, times = Baseband(baseband, simulator.info), []
    for frame in frames:
        start = time.perf_counter_ns()
        processor.process(frame)
        times.append((time.perf_counter_ns() - start) * 1e-6)
    return times[10:]  # the first ones compile and design


def rows(counts: dict[Crowd, Counts], times: dict[Crowd, list[float]]) -> list[dict[str, Any]]:
    """Accuracy of every kind of crowd beside the recogniser's time, the first as the reference."""
    made: list[dict[str, Any]] = []
    for crowd, own in counts.items():
        accuracy = ("right gesture for the right person", own.right / max(own.performed, 1), "")
        reference = times[CROWDS[0]] if made else None
        made.append(choice("crowds", crowd.name, accuracy=accuracy, times_ms=times[crowd], reference_ms=reference))
    return made


def run(quick: bool = False, keep: Path | None = None, n_jobs: int = 1) -> dict[str, Any]:
    """Measure crowds; a full run simulates 48 scenes of a minute, once for each of two basebands.

    Parameters
    ----------
    quick : bool
        One scene of each kind, with two rounds.
    keep : Path or None
        Folder for the clouds, with which an interrupted run goes on; None: they are thrown away.
    n_jobs : int
        Scenes simulated at the same time.

    Returns
    -------
    dict
        ``two_users_accuracy``, ``three_users_accuracy``: gestures for which the person who performed them was credited with the right one,
        over all performed, slow ones too; ``cross_talk``: gestures credited to somebody who performed none while others did, over all
        performed; ``crowds``: the same and the causes by kind of scene; all this through the baseband's preset ``people``, which looks for
        two directions in a cell; ``one_direction_a_cell``: through the default one.
    """
    plan, model = QUICK if quick else FULL, load_model()
    if keep is not None:
        return compare(plan, keep, model, n_jobs)
    with tempfile.TemporaryDirectory() as folder:
        return compare(plan, Path(folder), model, n_jobs)
