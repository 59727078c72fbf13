"""CLEAR-MOT: hits, misses, false tracks and identity switches (Bernardin and Stiefelhagen 2008), and IDF1 (Ristani et al. 2016)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from radar_core.config import config, knob
from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.metrics.objects import ObjectSet, best_pairs, distances


@config
class ClearMotConfig:
    """Which tracks count as being of a person."""

    radius: float = knob(0.5, unit="m", low=1e-6, high=1e6, doc="a track this near to a person, or nearer, can be of that person")


@dataclass(frozen=True, eq=False)
class ClearMotStep:
    """CLEAR-MOT of one moment.

    Attributes
    ----------
    truth_id, estimate_id : ndarray of int64, shape (n_pairs,)
        Who is followed by which track, people who do not count included.
    distance : ndarray of float64, shape (n_pairs,)
        Between the two [m].
    visible : ndarray of bool, shape (n_pairs,)
        Whether the person counts.
    missed : ndarray of int64, shape (n_missed,)
        People who count and have no track.
    false : ndarray of int64, shape (n_false,)
        Tracks that are nobody's.
    switched : ndarray of int64, shape (n_switched,)
        People whose track is another one than when they last had one.
    """

    truth_id: IndexArray
    estimate_id: IndexArray
    distance: Float64Array
    visible: BoolArray
    missed: IndexArray
    false: IndexArray
    switched: IndexArray


@dataclass(frozen=True)
class PersonScore:
    """One person over the run.

    Attributes
    ----------
    moments, tracked : int
        In which the person counted, and had a track.
    switches : int
        Changes of the track's identity.
    square : float
        Sum of the squared distances to the track [m^2].
    """

    moments: int = 0
    tracked: int = 0
    switches: int = 0
    square: float = 0.0

    @property
    def tracked_fraction(self) -> float:
        """Part of the moments with a track; NaN for a person who never counted."""
        return self.tracked / self.moments if self.moments else math.nan

    @property
    def rms(self) -> float:
        """Distance to the track [m]; NaN for a person who was never tracked."""
        return math.sqrt(self.square / self.tracked) if self.tracked else math.nan


@dataclass(frozen=True)
class ClearMotSummary:
    """CLEAR-MOT over a run; NaN where a ratio has nothing to divide by.

    Attributes
    ----------
    moments : int
        Compared so far.
    truths : int
        People who counted, summed over the moments.
    matches, misses, false_positives, switches : int
        Summed over the moments.
    mota : float
        Accuracy, ``1 - (misses + false_positives + switches) / truths``; 1 is perfect, and there is no lower bound.
    motp : float
        Precision: mean distance of the pairs [m].
    rms : float
        Root mean square distance of the pairs [m].
    idf1 : float
        2 x moments in which a person has *the* track of their own, over people plus tracks; each person has one track in the whole run,
        chosen so that this is largest.
    people : mapping from int to PersonScore
        By identity; everybody who was ever in the truth.
    """

    moments: int
    truths: int
    matches: int
    misses: int
    false_positives: int
    switches: int
    mota: float
    motp: float
    rms: float
    idf1: float
    people: Mapping[int, PersonScore]


@dataclass(eq=False)
class _Run:
    """Counts of the run; their size grows with the number of identities, never with time."""

    moments: int = 0
    misses: int = 0
    false: int = 0
    distance: float = 0.0
    people: dict[int, PersonScore] = field(default_factory=dict)
    held: dict[int, int] = field(default_factory=dict)  # person to the track they were last paired with; each track has one person at most
    last: dict[int, int] = field(default_factory=dict)  # person to the track they had when they last counted
    overlap: dict[tuple[int, int], int] = field(default_factory=dict)  # (person, track) to the moments within the radius of each other


class ClearMot:
    """Pair people with tracks moment by moment, and count.

    A person keeps the track they were last paired with while it is within the radius (Bernardin and Stiefelhagen, section 2.1.2), also when
    another one is nearer now. Whoever is left is paired anew: as many pairs as possible, of those the set with the least total distance,
    people who count first. A switch is a pairing with another track than the person had when they last counted, however long ago.
    """

    def __init__(self, config: ClearMotConfig | None = None) -> None:
        self.config = config or ClearMotConfig()
        self.reset()

    def reset(self) -> None:
        """Forget the run."""
        self._run = _Run()

    def process(self, truth: ObjectSet, estimate: ObjectSet) -> ClearMotStep:
        """Compare one moment, truth and tracks; moments come in the order of time. Errors as in `GospaMetric.process`."""
        apart = distances(truth, estimate)
        partner = self._pair(apart, truth, estimate)
        rows = np.flatnonzero(partner >= 0)
        columns = partner[rows]
        step = ClearMotStep(
            truth.id[rows],
            estimate.id[columns],
            apart[rows, columns],
            truth.visible[rows],
            truth.id[truth.visible & (partner < 0)],
            np.delete(estimate.id, columns),
            self._switched(truth, estimate, partner),
        )
        self._count(step, truth)
        excused = columns[~truth.visible[rows]]
        self._count_overlap(np.delete(apart, excused, axis=1)[truth.visible], truth.id[truth.visible], np.delete(estimate.id, excused))
        return step

    def _pair(self, apart: Float64Array, truth: ObjectSet, estimate: ObjectSet) -> IndexArray:
        """Column of every true object's estimate, shape (n_truth,); -1: none."""
        radius, held = self.config.radius, self._run.held
        partner = np.full(len(truth), -1, np.int64)
        column = {number: j for j, number in enumerate(estimate.id.tolist())}
        for i, person in enumerate(truth.id.tolist()):
            j = column.get(held[person]) if person in held else None
            if j is not None and apart[i, j] <= radius:
                partner[i] = j
        for group in (truth.visible, ~truth.visible):
            rows = np.flatnonzero(group & (partner < 0))
            if not len(rows):
                continue
            columns = np.setdiff1d(np.arange(len(estimate)), partner)
            some = apart[np.ix_(rows, columns)]
            much = radius * (min(some.shape) + 1)  # one pair more is worth more than any distances
            chosen, found = best_pairs(np.where(some <= radius, much - some, 0.0))
            partner[rows[chosen]] = columns[found]
        return partner

    def _switched(self, truth: ObjectSet, estimate: ObjectSet, partner: IndexArray) -> IndexArray:
        """Remember who has which track; identities of those who have another one than before, shape (n_switched,)."""
        run, switched = self._run, []
        paired = np.flatnonzero(partner >= 0)
        taken = set(estimate.id[partner[paired]].tolist())
        run.held = {person: track for person, track in run.held.items() if track not in taken}
        for i in paired:
            person, track = int(truth.id[i]), int(estimate.id[partner[i]])
            run.held[person] = track
            if truth.visible[i]:
                if run.last.get(person, track) != track:
                    switched.append(person)
                run.last[person] = track
        return np.array(switched, np.int64)

    def _count(self, step: ClearMotStep, truth: ObjectSet) -> None:
        """Add a step to the run."""
        run = self._run
        run.moments += 1
        run.misses += len(step.missed)
        run.false += len(step.false)
        run.distance += float(step.distance[step.visible].sum())
        away = dict(zip(step.truth_id[step.visible].tolist(), step.distance[step.visible].tolist(), strict=True))
        switched = set(step.switched.tolist())
        for person, visible in zip(truth.id.tolist(), truth.visible.tolist(), strict=True):
            old = run.people.get(person, PersonScore())
            counts = old.moments + visible, old.tracked + (person in away), old.switches + (person in switched)
            run.people[person] = PersonScore(*counts, old.square + away.get(person, 0.0) ** 2)

    def _count_overlap(self, apart: Float64Array, persons: IndexArray, tracks: IndexArray) -> None:
        """Note which identities could belong together, for IDF1."""
        for i, j in np.argwhere(apart <= self.config.radius):
            key = (int(persons[i]), int(tracks[j]))
            self._run.overlap[key] = self._run.overlap.get(key, 0) + 1

    def summary(self) -> ClearMotSummary:
        """Sum up all moments so far."""
        run = self._run
        everybody = run.people.values()
        truths, matches = sum(p.moments for p in everybody), sum(p.tracked for p in everybody)
        switches, square = sum(p.switches for p in everybody), sum(p.square for p in everybody)
        identified = truths + matches + run.false  # people and tracks that count
        return ClearMotSummary(
            moments=run.moments,
            truths=truths,
            matches=matches,
            misses=run.misses,
            false_positives=run.false,
            switches=switches,
            mota=1.0 - (run.misses + run.false + switches) / truths if truths else math.nan,
            motp=run.distance / matches if matches else math.nan,
            rms=math.sqrt(square / matches) if matches else math.nan,
            idf1=2 * _most_overlap(run.overlap) / identified if identified else math.nan,
            people=dict(sorted(run.people.items())),
        )


def _most_overlap(overlap: Mapping[tuple[int, int], int]) -> int:
    """Sum over the best one-to-one assignment of tracks to people for the whole run."""
    people, person = np.unique([key[0] for key in overlap], return_inverse=True)
    tracks, track = np.unique([key[1] for key in overlap], return_inverse=True)
    table = np.zeros((len(people), len(tracks)), np.int64)
    table[person, track] = list(overlap.values())
    return int(table[linear_sum_assignment(table, maximize=True)].sum())
