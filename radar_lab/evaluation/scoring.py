"""How good were the recognised gestures? Gestures performed against gestures published, person by person."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from radar_core import GESTURES, NO_GESTURE, vocabulary
from radar_core.types import IndexArray
from radar_sim.truth import Truth

_RANDOM = GESTURES.index("random")


@dataclass(frozen=True)
class TruthSegment:
    """A gesture that a person really performed: who, its number, and when [ns].

    ``own`` is the name of a gesture of one's own; empty: ``label`` is an index into `GESTURES`. Other lists may number it otherwise.
    """

    person_id: int
    label: int
    start_ns: int
    end_ns: int
    own: str = ""

    @property
    def name(self) -> str:
        """Of the gesture."""
        return self.own or GESTURES[self.label]


@dataclass(frozen=True)
class RecognisedGesture:
    """A published gesture whose track has been mapped to a person (see `Matching.owner`); None: the track was on nobody.

    The other fields are those of `TruthSegment`.
    """

    person_id: int | None
    label: int
    start_ns: int
    end_ns: int
    own: str = ""

    @property
    def name(self) -> str:
        """Of the gesture."""
        return self.own or GESTURES[self.label]


def own_name(label: int, labels: Sequence[str]) -> str:
    """Name of a gesture if it is one of one's own, else empty: see `TruthSegment`."""
    return labels[label] if label >= len(GESTURES) else ""


@dataclass(frozen=True, eq=False)
class GestureScore:
    """Counts over all people."""

    hits: int  # gestures recognised with the right label
    wrong: int  # gestures recognised as another gesture
    misses: int  # gestures not recognised: no event, or one called random
    # Published gestures (not random) that overlap no gesture of that person, or one already recognised; those of tracks on nobody too
    false_alarms: int
    confusion: IndexArray  # true label by recognised label; the last column counts gestures without any event; shape (n, n + 1)
    outcomes: tuple[tuple[TruthSegment, RecognisedGesture | None], ...]  # what was matched with every segment, in the order given
    labels: tuple[str, ...] = GESTURES  # of the rows of ``confusion``: the ten, then those of one's own that occurred

    @property
    def total(self) -> int:
        """Number of gestures that were performed."""
        return self.hits + self.wrong + self.misses

    @property
    def rate(self) -> float:
        """Hits per gesture performed, 0..1; NaN when none was performed."""
        return self.hits / self.total if self.total else float("nan")


def truth_segments(truths: Iterable[Truth]) -> tuple[TruthSegment, ...]:
    """Collect the gestures performed, from truth frame by frame; ordered by start."""
    segments: dict[tuple[int, int], TruthSegment] = {}
    for truth in truths:
        note_gestures(truth, segments)
    return in_order(segments)


def note_gestures(truth: Truth, segments: dict[tuple[int, int], TruthSegment]) -> None:
    """Open or prolong the gestures that are being performed; the keys are person and running number of the gesture."""
    for person, label, index in zip(truth.person_id, truth.gesture, truth.gesture_index, strict=True):
        if label != NO_GESTURE:
            key = (int(person), int(index))
            start = segments[key].start_ns if key in segments else truth.stamp_ns
            segments[key] = TruthSegment(int(person), int(label), start, truth.stamp_ns, own_name(int(label), truth.labels))


def in_order(segments: dict[tuple[int, int], TruthSegment]) -> tuple[TruthSegment, ...]:
    """Order gestures by start, then person."""
    return tuple(sorted(segments.values(), key=lambda s: (s.start_ns, s.person_id)))


def match_spans(
    performed: Sequence[TruthSegment],
    found: Sequence[RecognisedGesture],
    tolerance: float = 0.0,
    rank: Callable[[int, int], int] = lambda i, j: 0,
) -> tuple[dict[int, int], list[tuple[int, int]]]:
    """Match what was performed with what was found, each at most once.

    A pair belongs to one person and overlaps in time when what was performed is widened by ``tolerance``. Pairs of a lower rank go first,
    within a rank those of the larger overlap (or smaller distance in time).

    ``rank`` is asked for pairs of indices. Gives the index into ``found`` by index into ``performed``, and all pairs that were possible,
    best first.
    """
    possible = []
    for (i, one), (j, other) in product(enumerate(performed), enumerate(found)):
        overlap = min(one.end_ns, other.end_ns) - max(one.start_ns, other.start_ns)
        if one.person_id == other.person_id and overlap > -tolerance * 1e9:
            possible.append((rank(i, j), -overlap, i, j))
    partner: dict[int, int] = {}
    used: set[int] = set()
    for _, _, i, j in sorted(possible):
        if i not in partner and j not in used:
            partner[i] = j
            used.add(j)
    return partner, [(i, j) for _, _, i, j in sorted(possible)]


def score_gestures(
    truth: Sequence[TruthSegment], gestures: Sequence[RecognisedGesture], *, tolerance: float = 0.6, count_random: bool = False
) -> GestureScore:
    """Match published gestures with those performed, see `match_spans`: right labels first, then other gestures, then events called random.

    Published gestures of tracks on nobody count too. The truth is widened by ``tolerance`` [s] on both sides. Segments with label random
    are gestures to be recognised only with ``count_random``.
    """
    segments = [s for s in truth if count_random or s.label != _RANDOM]

    def rank(i: int, j: int) -> int:
        return 0 if segments[i].name == gestures[j].name else 1 if gestures[j].label != _RANDOM else 2

    partner, _ = match_spans(segments, gestures, tolerance, rank)
    labels = vocabulary(sorted({s.own for s in segments if s.own} | {g.own for g in gestures if g.own}))
    confusion = np.zeros((len(labels), len(labels) + 1), np.int64)
    for i, segment in enumerate(segments):
        confusion[labels.index(segment.name), labels.index(gestures[partner[i]].name) if i in partner else -1] += 1
    hits = int(np.trace(confusion))
    random_column = 0 if not count_random else int(confusion[0, 0])
    misses = int(confusion[:, 0].sum() + confusion[:, -1].sum()) - random_column
    used = set(partner.values())
    false_alarms = sum(1 for j, gesture in enumerate(gestures) if j not in used and gesture.label != _RANDOM)
    outcomes = tuple((segment, gestures[partner[i]] if i in partner else None) for i, segment in enumerate(segments))
    return GestureScore(hits, int(confusion.sum()) - hits - misses, misses, false_alarms, confusion, outcomes, labels)
