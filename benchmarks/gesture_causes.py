"""Matches what was recognised with what was performed, and says why a gesture was missed, late, or found where there was none."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from benchmarks.gesture_clouds import Found, Run
from benchmarks.report import Tally, against_first, timed
from radar_core import GESTURES
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.features import FeatureConfig, summarise
from radar_gestures.gesture import Gesture
from radar_gestures.recognizer import GestureRecognizer
from radar_gestures.stage import GestureConfig, TrackEvent
from radar_lab.evaluation.scoring import RecognisedGesture, TruthSegment, match_spans, score_gestures
from radar_lab.evaluation.truth_events import CriterionConfig, TrueEvent, TrueEvents
from radar_sim.motions.script import Timeline
from radar_tracking import TrackedCloud

RANDOM: Final = GESTURES.index("random")
_HAND: Final = 0.6  # m: the arm's echoes are that near to the hand
_MOST: Final = 0.5  # share of the frames
_AFTER_NS: Final = 400_000_000  # ns: an event is decided by then


@dataclass(frozen=True, eq=False)
class Outcome:
    """A performed gesture, the event that was found for it (None: missed), and why it was missed or called random (else empty)."""

    true: TrueEvent
    found: Found | None
    cause: str = ""


@dataclass(frozen=True, eq=False)
class Surplus:
    """An event that no performed gesture explains, what its person was doing, and whether it is part of a gesture found otherwise."""

    found: Found
    doing: str

    @property
    def false(self) -> bool:
        """Whether it was taken for a gesture."""
        return self.found.gesture.label != RANDOM


@dataclass(frozen=True, eq=False)
class Judged:
    """A run, judged."""

    outcomes: list[Outcome]  # one for each performed gesture, random strokes too
    surplus: list[Surplus]  # all other events
    hours: float
    # track_frames, ghost_track_frames: see `Tally`
    track_frames: int = 0
    ghost_track_frames: int = 0
    times_ms: Sequence[float] = ()  # what the recogniser took for each cloud [ms]


def judge(run: Run, criterion: CriterionConfig | None = None) -> Judged:
    """Match every performed gesture with the event of the same person that overlaps its fast time most, each at most once."""
    criterion = criterion if criterion is not None else CriterionConfig()
    truths = TrueEvents(criterion, run.scene.radars[0].mount).process(run.truths)
    fast = [TruthSegment(true.person_id, true.label, true.first_ns, true.last_ns) for true in truths]
    match, pairs = match_spans(fast, [_published(found) for found in run.found])
    why = Causes(run, criterion)
    outcomes = [
        Outcome(true, run.found[match[i]], why_random(run.found[match[i]].gesture))
        if i in match
        else Outcome(true, None, why.missed(true, taken=any(k == i for k, _ in pairs)))
        for i, true in enumerate(truths)
    ]
    used = set(match.values())
    surplus = [Surplus(found, why.doing(found)) for j, found in enumerate(run.found) if j not in used]
    tracks = run.matching
    return Judged(outcomes, surplus, run.scene.duration / 3600.0, tracks.track_frames, tracks.ghost_track_frames, run.times_ms)


def _published(found: Found) -> RecognisedGesture:
    gesture = found.gesture
    return RecognisedGesture(found.person_id, gesture.label, gesture.start_ns, gesture.end_ns)


def count(judged: Judged) -> Tally:
    """Count the gestures of a run, person by person, by the one scoring of gestures (`score_gestures`)."""
    segments = [TruthSegment(o.true.person_id, o.true.label, o.true.start_ns, o.true.end_ns) for o in judged.outcomes]
    events = [o.found for o in judged.outcomes if o.found is not None] + [s.found for s in judged.surplus]
    gestures = [_published(found) for found in events]
    score = score_gestures(segments, gestures)
    named = [g for g in gestures if g.label != RANDOM]
    return Tally(
        minutes=60 * judged.hours,
        performed=score.total,
        right=score.hits,
        wrong=score.wrong,
        missed=score.misses,
        false_gestures=score.false_alarms,
        ghost_gestures=sum(g.person_id is None for g in named),
        crossed=sum(is_crossed(g, segments) for g in named),
        track_frames=judged.track_frames,
        ghost_track_frames=judged.ghost_track_frames,
    )


def is_crossed(gesture: RecognisedGesture, segments: Sequence[TruthSegment], tolerance: float = 0.6) -> bool:
    """Whether somebody gestured at that time [s], but not the person to whom this was credited."""
    then = {s.person_id for s in segments if min(s.end_ns, gesture.end_ns) - max(s.start_ns, gesture.start_ns) > -tolerance * 1e9}
    return bool(then) and gesture.person_id is not None and gesture.person_id not in then


def false_by_cause(judged: Iterable[Judged]) -> dict[str, int]:
    """Count false gestures by what they were taken for and what the person did."""
    return dict(Counter(f"{s.found.gesture.name} ({s.doing})" for one in judged for s in one.surplus if s.false).most_common())


def missed_by_cause(outcomes: Iterable[Outcome]) -> dict[str, int]:
    """Count missed gestures by cause; those whose hand was too slow for the criterion apart."""
    return dict(Counter(("" if o.true.meets else "slow: ") + o.cause for o in outcomes if o.found is None).most_common())


def why_random(gesture: Gesture) -> str:
    """Say why an event was called random; empty: it was not."""
    if gesture.label != RANDOM:
        return ""
    if not np.isfinite(gesture.features).all():
        return "too few moving samples"
    if np.count_nonzero(gesture.probabilities) == 1:  # a classifier is never that sure
        return "track moved, as if walking"
    best = int(np.argmax(gesture.probabilities))
    return "most probably random" if best == RANDOM else "rejected as unknown"


class Causes:
    """Looks into a run for reasons."""

    def __init__(self, run: Run, criterion: CriterionConfig) -> None:
        self._run, self._criterion = run, criterion
        self._stamps = np.array([tracked.cloud.stamp_ns for tracked in run.tracked], np.int64)
        scene = run.scene
        mount = scene.radars[0].mount
        self._mount = mount
        self._timelines = {person.id: Timeline(person, scene.seed, (mount.x, mount.y)) for person in scene.people}

    def doing(self, found: Found) -> str:
        """Say what a person was doing in the middle of an event: kind of the step of the script, the gesture's name, or "nobody"."""
        if found.person_id is None:
            return "nobody"
        middle = (found.gesture.start_ns + found.gesture.end_ns) * 0.5e-9
        segments = [self._timelines[found.person_id].at(middle + late) for late in (0.0, -0.25, 0.25)]
        for segment in segments:
            if segment is not None and segment.gesture is not None:
                return f"part of {GESTURES[segment.gesture]}"
        return segments[0].kind if segments[0] is not None else "stand"

    def missed(self, true: TrueEvent, taken: bool) -> str:
        """Name the first stage that half of a gesture's fast frames did not pass; ``taken``: an event overlapped it, but went elsewhere."""
        rows = np.flatnonzero((self._stamps >= true.first_ns) & (self._stamps <= true.last_ns))
        after = np.flatnonzero((self._stamps > true.last_ns) & (self._stamps <= true.last_ns + _AFTER_NS))
        if not len(rows):
            return "no frames"
        tracks = [self._track(int(k), true.person_id) for k in rows]
        stages = np.array([self._stages(int(k), true.person_id, number) for k, number in zip(rows, tracks, strict=True)])
        names = ("person has no track", "hand gives no fast points", "fast points are not the person's", "fast points are left out as weak")
        for name, share in zip(names, stages.mean(axis=0), strict=True):
            if share < _MOST:
                return name
        if taken:
            return "one event with another gesture"
        if len({number for number in (*tracks, *(self._track(int(k), true.person_id) for k in after)) if number is not None}) > 1:
            return "track changed"
        return self._detector(true)

    def _detector(self, true: TrueEvent) -> str:
        """Tell apart events that could not start, for want of rest, from those that were too short."""
        before = [f.gesture.end_ns for f in self._run.found if f.person_id == true.person_id and f.gesture.end_ns <= true.first_ns]
        late = true.first_ns - max(before, default=-(1 << 62))
        return "too soon after another event" if late < _AFTER_NS else "too short, or with breaks"

    def _track(self, k: int, person: int) -> int | None:
        """Id of the track of a person; None: there is none."""
        now, tracks = int(self._stamps[k]), self._run.tracked[k].tracks.tracks
        return next((track.id for track in tracks if self._run.matching.owner(track.id, now, now) == person), None)

    def _row(self, k: int, person: int) -> int:
        return int(np.flatnonzero(self._run.truths[k].person_id == person)[0])

    def _stages(self, k: int, person: int, number: int | None) -> tuple[bool, bool, bool, bool]:
        """Whether there is a track; fast points by the hand; such of the track's; and a fast motion sample."""
        tracked, truth = self._run.tracked[k], self._run.truths[k]
        cloud = tracked.cloud
        hand = truth.hand_position[self._row(k, person)]
        fast = np.abs(cloud.radial_speed) > self._criterion.threshold
        near = np.linalg.norm(cloud.position - hand, axis=-1) < _HAND
        seen = bool((fast & near).any())
        if number is None:
            return False, seen, False, False
        own = tracked.tracks.point_track_id == number
        return True, seen, bool((fast & own).any()), abs(self._speed(tracked, number)) > self._criterion.threshold

    def _speed(self, tracked: TrackedCloud, number: int) -> float:
        points = tracked.cloud.select(np.flatnonzero(tracked.tracks.point_track_id == number))
        return summarise(points, (0.0, 0.0, 0.0), FeatureConfig()).speed


_OFF: Final = 100.0  # m: nobody walks that far
_OTHERS: Final[tuple[dict[str, float], ...]] = (
    {"walk_distance": 0.3},
    {"walk_distance": 0.45},
    {"walk_distance": 1.0},
    {"walk_distance": _OFF, "step_distance": _OFF},
    {"step_distance": 0.15},
    {"step_distance": _OFF},
    {"step_score": 0.3},
    {"step_score": 0.8},
    {"min_confidence": 0.5},
    {"min_confidence": 0.8},
)


def rules() -> dict[str, GestureConfig]:
    """All configurations that are measured; the default stands first."""
    default = GestureConfig()
    named = {", ".join(f"{knob}={value:g}" for knob, value in other.items()): other for other in _OTHERS}
    return {"default": default} | {name: dataclasses.replace(default, **other) for name, other in named.items()}


def rows_of_rules(
    stage: str, figure: str, judged: Sequence[Judged], model: GestureModel, figures: Callable[[Sequence[Judged]], tuple[str, float]]
) -> list[dict[str, Any]]:
    """Accuracy by every rule beside the time of naming one event; nothing when there is no event.

    ``figures`` gives of judged streams what to say behind a configuration's name, and the value of its row's figure.
    """
    if not any(one.surplus or any(o.found is not None for o in one.outcomes) for one in judged):
        return []
    made: dict[str, tuple[float, list[float]]] = {}
    for one in judged:  # the first rules would pay for cold caches
        named_again(one, GestureRecognizer(GestureConfig(), model), [])
    for name, config in rules().items():
        recogniser, times = GestureRecognizer(config, model), list[float]()
        more, accuracy = figures([named_again(one, recogniser, times) for one in judged])
        made[f"{name}{more}"] = accuracy, times
    return against_first(stage, figure, made)


def named_again(judged: Judged, recogniser: GestureRecognizer, times: list[float]) -> Judged:
    """Give every event the name that a recogniser has for it; the milliseconds that each takes are added to ``times``."""

    def again(found: Found) -> Found:
        assert isinstance(found.event, TrackEvent)  # such models name nothing else
        gesture, spent = timed(recogniser.name, found.event, found.gesture.stamp_ns)
        times.append(spent)
        return dataclasses.replace(found, gesture=gesture)

    outcomes = []
    for outcome in judged.outcomes:
        if outcome.found is not None:
            found = again(outcome.found)
            outcome = dataclasses.replace(outcome, found=found, cause=why_random(found.gesture))
        outcomes.append(outcome)
    surplus = [dataclasses.replace(one, found=again(one.found)) for one in judged.surplus]
    return Judged(outcomes, surplus, judged.hours)
