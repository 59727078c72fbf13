"""How good were the recognised gestures? Truth segments against recognised events, person by person."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, NO_GESTURE


@dataclass(frozen=True)
class TruthSegment:
    """A gesture that a person really performed.

    Attributes
    ----------
    person_id : int
        Who.
    label : int
        Index into `GESTURES`.
    start_ns, end_ns : int
        When [ns].
    """

    person_id: int
    label: int
    start_ns: int
    end_ns: int


@dataclass(frozen=True)
class RecognisedGesture:
    """A recognised gesture whose track has been mapped to a person (see `nearest_person`); the fields are those of `TruthSegment`."""

    person_id: int
    label: int
    start_ns: int
    end_ns: int


@dataclass(frozen=True, eq=False)
class GestureScore:
    """Counts over all people.

    Attributes
    ----------
    hits : int
        Gestures recognised with the right label.
    wrong : int
        Gestures recognised as another gesture.
    misses : int
        Gestures not recognised: no event, or one called random.
    false_alarms : int
        Recognised gestures (not random) that overlap no gesture of that person, or one already recognised.
    confusion : ndarray of int, shape (10, 11)
        True label by recognised label; the last column counts gestures without any event.
    outcomes : tuple of (TruthSegment, RecognisedGesture or None)
        What was matched with every segment, in the order given.
    """

    hits: int
    wrong: int
    misses: int
    false_alarms: int
    confusion: NDArray[np.int64]
    outcomes: tuple[tuple[TruthSegment, RecognisedGesture | None], ...]

    @property
    def total(self) -> int:
        """Number of gestures that were performed."""
        return self.hits + self.wrong + self.misses

    @property
    def rate(self) -> float:
        """Hits per gesture performed, 0..1; NaN when none was performed."""
        return self.hits / self.total if self.total else float("nan")


class TruthLike(Protocol):
    """What this module reads of the simulator's truth: arrays of shape (p,), positions of shape (p, 3) [m]."""

    @property
    def stamp_ns(self) -> int:
        """Middle of the acquisition [ns]."""

    @property
    def person_id(self) -> NDArray[np.uint32]:
        """Identities, shape (p,)."""

    @property
    def position(self) -> NDArray[np.float64]:
        """Bodies in ``room``, shape (p, 3) [m]."""

    @property
    def gesture(self) -> NDArray[np.uint8]:
        """Labels, shape (p,); 255: none."""

    @property
    def gesture_index(self) -> NDArray[np.uint32]:
        """Running number of each person's gesture, shape (p,)."""


def truth_segments(truths: Iterable[TruthLike]) -> tuple[TruthSegment, ...]:
    """Collect the gestures performed, from truth frame by frame; ordered by start."""
    open_segments: dict[tuple[int, int], tuple[int, int, int]] = {}
    for truth in truths:
        for person, label, index in zip(truth.person_id, truth.gesture, truth.gesture_index, strict=True):
            if label != NO_GESTURE:
                key = (int(person), int(index))
                _, start, _ = open_segments.get(key, (0, truth.stamp_ns, 0))
                open_segments[key] = (int(label), start, truth.stamp_ns)
    segments = (TruthSegment(person, label, start, end) for (person, _), (label, start, end) in open_segments.items())
    return tuple(sorted(segments, key=lambda s: (s.start_ns, s.person_id)))


def nearest_person(truth: TruthLike, position: NDArray[np.floating], gate: float = 0.8) -> int | None:
    """Say whose track it is: the person nearest on the ground.

    Parameters
    ----------
    truth : TruthLike
        Of the same moment.
    position : ndarray, shape (3,)
        Of the track [m].
    gate : float
        Farther than this [m] it is nobody's (None).
    """
    if len(truth.person_id) == 0:
        return None
    away = np.hypot(*(np.asarray(truth.position, np.float64)[:, :2] - np.asarray(position, np.float64)[:2]).T)
    best = int(np.argmin(away))
    return int(truth.person_id[best]) if away[best] <= gate else None


def score_gestures(
    truth: Sequence[TruthSegment], gestures: Sequence[RecognisedGesture], *, tolerance: float = 0.6, count_random: bool = False
) -> GestureScore:
    """Match recognised gestures with those performed, each at most once.

    A pair belongs to one person and overlaps in time when the truth is widened by ``tolerance``. Right labels are matched first, then
    other gestures, then events called random; within these the larger overlap (or smaller distance) wins.

    Parameters
    ----------
    truth : sequence of TruthSegment
        What was performed.
    gestures : sequence of RecognisedGesture
        What was recognised.
    tolerance : float
        Widening of the truth on both sides [s].
    count_random : bool
        Whether segments with label random are gestures to be recognised; by default they are left out.

    Returns
    -------
    GestureScore
        The counts.
    """
    segments = [s for s in truth if count_random or s.label != 0]
    pairs = []
    for i, segment in enumerate(segments):
        for j, gesture in enumerate(gestures):
            overlap = min(segment.end_ns, gesture.end_ns) - max(segment.start_ns, gesture.start_ns)
            if segment.person_id == gesture.person_id and overlap > -tolerance * 1e9:
                rank = 0 if segment.label == gesture.label else 1 if gesture.label != 0 else 2
                pairs.append((rank, -overlap, i, j))
    matched: dict[int, int] = {}
    used: set[int] = set()
    for _, _, i, j in sorted(pairs):
        if i not in matched and j not in used:
            matched[i] = j
            used.add(j)
    confusion = np.zeros((len(GESTURES), len(GESTURES) + 1), np.int64)
    for i, segment in enumerate(segments):
        confusion[segment.label, gestures[matched[i]].label if i in matched else -1] += 1
    hits = int(np.trace(confusion))
    random_column = 0 if not count_random else int(confusion[0, 0])
    misses = int(confusion[:, 0].sum() + confusion[:, -1].sum()) - random_column
    false_alarms = sum(1 for j, gesture in enumerate(gestures) if j not in used and gesture.label != 0)
    outcomes = tuple((segment, gestures[matched[i]] if i in matched else None) for i, segment in enumerate(segments))
    return GestureScore(hits, int(confusion.sum()) - hits - misses, misses, false_alarms, confusion, outcomes)
