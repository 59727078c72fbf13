"""Gestures in random rooms, where people also walk, sit, fidget and pass each other: the default graph and the shipped model.

The rooms are those of `benchmarks.rooms` (generator: `benchmarks.room_scenes`), with the same three kinds of seeds. Of each gesture
performed, the benchmark says whether physics allows to see it (`benchmarks.hand_limit`), what became of it, and where and how it was done.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, get_args

from benchmarks.hand_limit import HAND, LEVEL, SHARE, detectable_level
from benchmarks.report import Panel, rate_interval, share, timed
from benchmarks.room_scenes import DEVELOP, NAMED, room
from benchmarks.room_score import MATCHING, KeptRoom
from benchmarks.rooms import PART, PROCESSES, RoomStore
from benchmarks.stores import PACKAGES, digest, kept, once, sources
from radar_core import GESTURES, RadarInfo
from radar_core.config import plain
from radar_gestures.classifiers.model import AUTO, load_model
from radar_gestures.gesture import Gesture
from radar_gestures.make import Recognizer, make_recognizer
from radar_gestures.stage import GestureConfig, config_for
from radar_lab.evaluation.bootstrap import ratio_interval
from radar_lab.evaluation.matching import Matching
from radar_lab.evaluation.scoring import RecognisedGesture, TruthSegment, score_gestures, truth_segments
from radar_sim import Person, Simulator
from radar_tracking import TrackedCloud, TrackerConfig, make_tracker

PANEL: Final = Panel("gestures in random rooms", "right of all", "", "higher", "default", "default")
NEAR: Final = (0.8, 1.7)  # m
TURNED: Final = (math.radians(30.0), math.radians(45.0))
TI: Final = ("xwr18xx", "xwr68xx")
_RANDOM: Final = GESTURES.index("random")
Fate = Literal["right", "other name", "called random", "no event", "no track"]
Recogniser = Callable[[RadarInfo], Recognizer]


@dataclass(frozen=True)
class Stroke:
    """A performed gesture: who, where, how, and what became of it."""

    name: str
    fate: Fate
    level: float  # of the hand's echo above noise that enough frames reach [dB], see `benchmarks.hand_limit`
    distance: float  # of the body from the radar, on the floor [m]
    azimuth: float  # from the boresight, positive on the side of the acting arm, as the radar sees it [rad]
    turn: float  # between where the person looks and the radar [rad]
    signal: float  # of the room [dB]
    people: int
    mount: float  # height of the radar [m]
    radar: str
    sits: bool
    arm: str

    @property
    def detectable(self) -> bool:
        """Whether physics allows to see it."""
        return self.level >= LEVEL


@dataclass(frozen=True, eq=False)
class Scored:
    """A room: its strokes, false gestures, length [min], and what each cloud took, from baseband to gestures [ms]."""

    strokes: tuple[Stroke, ...]
    false_gestures: int
    minutes: float
    times_ms: tuple[float, ...] = ()


def shipped(info: RadarInfo, model: str = AUTO) -> Recognizer:
    """Make a recogniser with a model of ours, by its name; as it is by default."""
    chosen = load_model(model)
    return make_recognizer(config_for(chosen.settings, GestureConfig()), chosen, info)


def judge(own: KeptRoom, levels: Mapping[str, float], make: Recogniser = shipped, tracking: TrackerConfig | None = None) -> Scored:
    """Run a tracker (None: the default) and a recogniser through a room. ``levels``: of its strokes, see `limits`."""
    tracker, recogniser, matching = make_tracker(tracking, own.info), make(own.info), Matching(MATCHING)
    found: list[Gesture] = []
    times: list[float] = []
    followed: list[set[int]] = []
    for cloud, truth, visible, spent in zip(own.clouds, own.truths, own.visible, own.baseband_ms.tolist(), strict=True):
        tracks, took = timed(tracker.process, cloud)
        followed.append(set(matching.process(tracks, truth, visible).step.truth_id.tolist()))
        gestures, more = timed(recogniser.process, TrackedCloud(cloud, tracks))
        found += gestures
        times.append(spent + took + more)
    published = [RecognisedGesture(matching.owner(g.track_id, g.start_ns, g.stamp_ns), g.label, g.start_ns, g.end_ns) for g in found]
    score = score_gestures(truth_segments(own.truths), published)
    strokes = []
    for segment, event in score.outcomes:
        during = [k for k, truth in enumerate(own.truths) if segment.start_ns <= truth.stamp_ns <= segment.end_ns]
        tracked = sum(segment.person_id in followed[k] for k in during) >= len(during) / 2
        strokes.append(_stroke(own, segment, fate(segment, event, tracked), levels[_key(segment)], during[len(during) // 2]))
    return Scored(tuple(strokes), score.false_alarms, matching.minutes, tuple(times))


def fate(segment: TruthSegment, event: RecognisedGesture | None, tracked: bool) -> Fate:
    """Say what became of a gesture whose person was followed, or not, for half of it."""
    if event is not None and event.label == segment.label:
        return "right"
    if event is not None and event.label != _RANDOM:
        return "other name"
    return "no track" if not tracked else "called random" if event is not None else "no event"


def _key(segment: TruthSegment) -> str:
    return f"{segment.person_id} {segment.start_ns}"


def _stroke(own: KeptRoom, segment: TruthSegment, what: Fate, level: float, middle: int) -> Stroke:
    """Describe a stroke; ``middle``: index of its middle moment."""
    scene = room(own.seed).scene
    row = [person.id for person in scene.people].index(segment.person_id)
    person, truth = scene.people[row], own.truths[middle]
    away = truth.position[row] - own.info.mount.origin
    azimuth = math.remainder(math.atan2(away[1], away[0]) - own.info.mount.yaw, 2 * math.pi)
    facing = math.remainder(math.atan2(-away[1], -away[0]), 2 * math.pi) if person.heading is None else person.heading
    return Stroke(
        name=segment.name,
        fate=what,
        level=level,
        distance=math.hypot(away[0], away[1]),
        azimuth=azimuth if person.arm == "left" else -azimuth,  # who faces the radar has the right arm on its negative side
        turn=abs(math.remainder(facing - math.atan2(-away[1], -away[0]), 2 * math.pi)),
        signal=own.tags.signal,
        people=own.tags.people,
        mount=own.tags.mount,
        radar=own.tags.radar,
        sits=_sits(person, int(truth.gesture_index[row])),
        arm=person.arm,
    )


def _sits(person: Person, index: int) -> bool:
    """Whether the person sits at their gesture number ``index``."""
    sits, count = False, 0
    for action in person.script:
        sits = (sits or action.sit is not None) and action.rise is None
        if action.gesture is not None:
            if count == index:
                return sits
            count += 1
    return False


def limits(own: KeptRoom) -> dict[str, float]:
    """Levels [dB] of the hand in every stroke of a room, by person and start, see `benchmarks.hand_limit`."""
    simulator = Simulator(room(own.seed).scene)
    people = [person.id for person in simulator.scene.people]
    return {
        _key(segment): detectable_level(
            simulator,
            people.index(segment.person_id),
            [truth for truth in own.truths if segment.start_ns <= truth.stamp_ns <= segment.end_ns],
        )
        for segment in truth_segments(own.truths)
    }


def bands(stroke: Stroke) -> dict[str, str]:
    """Name what kind of stroke it was, for breakdowns."""

    def band(value: float, edges: Sequence[float], unit: str) -> str:
        low = max((edge for edge in edges[:-1] if value >= edge), default=edges[0])
        return f"{low:g} to {edges[list(edges).index(low) + 1]:g} {unit}"

    return {
        "gesture": stroke.name,
        "distance": band(stroke.distance, (0.8, 1.2, 1.7, 2.5, 3.5, 4.5, 6.0), "m"),
        "turn": band(math.degrees(stroke.turn), (0, 15, 30, 45, 60, 90, 180), "deg"),
        "azimuth": band(math.degrees(stroke.azimuth), (-60, -40, -20, 0, 20, 40, 60), "deg"),
        "signal": band(stroke.signal, (-12, -6, 0, 6, 12), "dB"),
        "mount": band(stroke.mount, (1.0, 1.4, 1.8, 2.2), "m"),
        "people": str(stroke.people),
        "radar": stroke.radar,
        "body": "sits" if stroke.sits else "stands",
        "arm": stroke.arm,
        "physics": "detectable" if stroke.detectable else "too weak",
    }


def breakdown(strokes: Iterable[Stroke]) -> dict[str, dict[str, dict[str, Any]]]:
    """Count by kind of stroke: kind, value, then how many, the share named rightly, and what became of the others."""
    groups: dict[str, dict[str, list[Stroke]]] = {}
    for stroke in strokes:
        for kind, value in bands(stroke).items():
            groups.setdefault(kind, {}).setdefault(value, []).append(stroke)
    return {kind: {value: _counted(own) for value, own in values.items()} for kind, values in groups.items()}


def _counted(strokes: Sequence[Stroke]) -> dict[str, Any]:
    fates = [stroke.fate for stroke in strokes]
    return {"strokes": len(fates), **share("right", fates.count("right"), len(fates))} | {
        name: fates.count(name) for name in get_args(Fate) if name != "right"
    }


def summary(rooms: Sequence[Scored]) -> dict[str, Any]:
    """Put the figures together: shares of strokes with intervals by rooms, false gestures with a Poisson interval."""
    strokes, minutes = [stroke for one in rooms for stroke in one.strokes], sum(one.minutes for one in rooms)
    false = sum(one.false_gestures for one in rooms)
    some: dict[str, Callable[[Stroke], bool]] = {
        "right_of_all": lambda stroke: True,
        "right_of_detectable": lambda stroke: stroke.detectable,
        "right_near": lambda stroke: stroke.detectable and NEAR[0] <= stroke.distance < NEAR[1],
        "right_turned_30_45": lambda stroke: stroke.detectable and TURNED[0] <= stroke.turn < TURNED[1],
        "right_ti": lambda stroke: stroke.detectable and stroke.radar in TI,
    }
    found: dict[str, Any] = {"rooms": len(rooms), "strokes": len(strokes), "minutes": minutes}
    found |= {"limit_level_db": LEVEL, "limit_share": SHARE, "limit_hand_m": HAND}
    found |= share("detectable", sum(stroke.detectable for stroke in strokes), len(strokes))
    for name, wanted in some.items():
        own = [[stroke.fate == "right" for stroke in one.strokes if wanted(stroke)] for one in rooms]
        n = sum(map(len, own))
        found |= {name: sum(map(sum, own)) / n if n else None, f"{name}_interval": by_rooms(own), f"{name}_strokes": n}
    found |= {"false_per_minute": false / minutes, "false_per_minute_interval": list(rate_interval(false, minutes))}
    return found | {"by": breakdown(strokes)}


def by_rooms(right: Sequence[Sequence[bool]]) -> list[float] | None:
    """95 % interval of a pooled share, by drawing as many rooms anew; None without strokes."""
    ends = ratio_interval([sum(own) for own in right], [len(own) for own in right])
    return None if ends is None else list(ends)


@dataclass(frozen=True)
class Graph:
    """What stands before and in the gesture stage; each has the default graph's."""

    baseband: str = "default"  # one of `benchmarks.rooms.basebands`
    tracking: TrackerConfig | None = None  # None: the default
    make: Recogniser = shipped


CHOICES: Final[Mapping[str, Graph]] = {
    "default": Graph(),
    "people": Graph(baseband="people"),
    "group_clustering": Graph(tracking=TrackerConfig(tracker="group_clustering")),
    "gestures": Graph(make=functools.partial(shipped, model="gestures")),
    "stream": Graph(make=functools.partial(shipped, model="stream")),
}
"""By name: the default graph, the preset of the baseband, the thesis's tracker, the thirteen features and the networks on streams of slots
before every radar."""


def measure(store: RoomStore, seeds: Sequence[int], seconds: float, folder: Path, graph: Graph | None = None) -> list[Scored]:
    """Judge a graph (None: the default) in rooms of a store; levels are kept in a folder."""
    graph, scored = graph or Graph(), []
    for own in store.rooms(seeds, graph.baseband, seconds):
        place = folder / f"limits_{sources((*PACKAGES, 'benchmarks/hand_limit.py'))}"
        path = place / f"{own.seed:05d}_{digest([plain(room(own.seed).scene), seconds])}.json"
        scored.append(judge(own, once(path, functools.partial(limits, own)), graph.make, graph.tracking))
    return scored


def run(quick: bool, keep: Path | None = None, seeds: str = "figure") -> dict[str, Any]:
    """Measure; ``keep`` is a folder for simulated rooms (the same as of `rooms`); ``seeds``: a key of `NAMED`."""
    chosen, seconds, part = (DEVELOP[3:4], 12.0, 12.0) if quick else (NAMED[seeds], 60.0, PART)
    with kept(keep) as folder:
        store = RoomStore(folder, part)
        store.fill(chosen, seconds, n_jobs=1 if quick else PROCESSES)
        scored = {name: measure(store, chosen, seconds, folder, graph) for name, graph in CHOICES.items()}
    found = {name: summary(own) for name, own in scored.items()}
    times = {name: [time for one in own for time in one.times_ms] for name, own in scored.items()}
    rows = PANEL.rows({name: own["right_of_all"] or 0.0 for name, own in found.items()}, times | {"": times["default"]})
    names = [f"{name}{both}" for name in ("right_of_all", "right_of_detectable", "false_per_minute") for both in ("", "_interval")]
    beside = {f"{choice}_{name}": found[choice][name] for choice in CHOICES if choice != "default" for name in names}
    return {"seeds": "develop" if quick else seeds, **found["default"], **beside, "choices": rows}
