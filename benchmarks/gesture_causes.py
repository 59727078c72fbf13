"""Matches what was recognised with what was performed, and says why a gesture was missed, late, or found where there was none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmarks.gesture_clouds import Found, Run
from radar_core import GESTURES
from radar_gestures.features import FeatureConfig, summarise
from radar_gestures.recognizer import Gesture
from radar_lab.datasets.scenes import nearest_person
from radar_lab.evaluation.truth_events import CriterionConfig, TrueEvent, TrueEvents
from radar_sim.motions.script import Timeline
from radar_tracking import TrackedCloud, TrackStatus

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
    """A run, judged.

    Attributes
    ----------
    outcomes : list of Outcome
        One for each performed gesture, random strokes too.
    surplus : list of Surplus
        All other events.
    hours : float
        Length [h].
    """

    outcomes: list[Outcome]
    surplus: list[Surplus]
    hours: float


def judge(run: Run, criterion: CriterionConfig | None = None) -> Judged:
    """Match every performed gesture with the event of the same person that overlaps its fast time most, each at most once."""
    criterion = criterion if criterion is not None else CriterionConfig()
    truths = TrueEvents(criterion, run.scene.radars[0].mount).process(run.truths)
    pairs = sorted(
        (
            (-overlap(true, found), i, j)
            for i, true in enumerate(truths)
            for j, found in enumerate(run.found)
            if found.person_id == true.person_id and overlap(true, found) > 0
        ),
    )
    match: dict[int, int] = {}
    for _, i, j in pairs:
        if i not in match and j not in match.values():
            match[i] = j
    why = Causes(run, criterion)
    outcomes = [
        Outcome(true, run.found[match[i]], why_random(run.found[match[i]].gesture))
        if i in match
        else Outcome(true, None, why.missed(true, [(k, j) for _, k, j in pairs if k == i]))
        for i, true in enumerate(truths)
    ]
    surplus = [Surplus(found, why.doing(found)) for j, found in enumerate(run.found) if j not in match.values()]
    return Judged(outcomes, surplus, run.hours)


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


def overlap(true: TrueEvent, found: Found) -> int:
    """Return the common time of an event and of the fast part of a gesture [ns]; negative: the time between them."""
    return min(true.last_ns, found.gesture.end_ns) - max(true.first_ns, found.gesture.start_ns)


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

    def missed(self, true: TrueEvent, taken: Sequence[tuple[int, int]]) -> str:
        """Say where on its way a gesture was lost: the first stage that half of its fast frames did not pass."""
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
        tracks = self._run.tracked[k].tracks.tracks
        own = [t for t in tracks if t.status != TrackStatus.TENTATIVE and nearest_person(self._run.truths[k], t.position) == person]
        place = self._run.truths[k].position[self._row(k, person), :2]
        return min(own, key=lambda t: float(np.hypot(*(t.position[:2] - place)))).id if own else None

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
