"""Segments that hold no gesture, in the recordings of mHomeGes and mTransSee, and what they cost a recogniser.

Each person did each gesture some 16 times at each distance, and each such recording was cut into segments. What follows the last gesture
was cut out and labelled like the rest: the person walks up to the radar to stop it, or has left. They are one segment in 17 or more. In
others, mostly the first or second last of a recording, nobody is there. No recogniser can name either; `alone` shows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_lab.training.validation import Mask, Validation, leave_subjects_out

REACH: Final = 0.8  # m: body and arms are that near the distance that the data set states
FEWEST: Final = 6  # detections of a person in a whole segment; medians are above 60 everywhere


def from_the_end(label: NDArray[np.str_], person: NDArray[np.int64], distance: NDArray[np.float64], back: int = 0) -> Mask:
    """Mark one segment of every recording: one person, one gesture, one distance.

    ``label``, ``person``, ``distance``, shape (n,): of every segment, in the order of the whole data set; ``back``: 0: the last one; 1: the
    one before; recordings with fewer segments have none.
    Raises DataError when there is no segment, or the lengths differ.
    """
    if not len(label) or not len(label) == len(person) == len(distance):
        raise DataError(f"{len(label)} labels, {len(person)} people and {len(distance)} distances; each segment needs one of each")
    change = (label[1:] != label[:-1]) | (person[1:] != person[:-1]) | (distance[1:] != distance[:-1])
    end = np.flatnonzero(np.append(change, True))
    start = np.concatenate([[0], end[:-1] + 1])
    marked = np.zeros(len(label), np.bool_)
    marked[(end - back)[end - back >= start]] = True
    return marked


def nobody_there(path: Path) -> Mask:
    """Mark the segments with hardly a detection within `REACH` of the distance at which the person is said to stand."""
    with np.load(path, allow_pickle=False) as file:
        xyz, offset, distance = file["xyz_mm"].astype(np.float32) * 1e-3, file["offset"].astype(np.int64), file["distance_m"]
    near = np.abs(np.linalg.norm(xyz, axis=1) - np.repeat(distance, np.diff(offset))) < REACH
    return np.asarray(np.diff(np.concatenate([[0], np.cumsum(near)])[offset]) < FEWEST)


def accuracy_without(validation: Validation, folds: Sequence[Mask], left_out: Mask) -> float:
    """Give the share of tested samples with the right label, those that a mask over all samples marks left out."""
    right = validation.probabilities.argmax(axis=-1) == validation.label
    return float(right[~left_out[np.any(folds, axis=0)]].mean())


def alone(vectors: NDArray[np.float32], number: NDArray[np.int64], person: NDArray[np.int64], chosen: Mask) -> float:
    """Train on some segments only, test on the same of other people: the accuracy, which is chance where they hold nothing.

    ``vectors``, shape (n, n_features): curves of all segments; ``number``, ``person``, shape (n,): index of the label, and whose;
    ``chosen``, shape (n,): the segments.
    """
    from sklearn.ensemble import ExtraTreesClassifier

    x, y = vectors[chosen], number[chosen]
    right = np.zeros(len(y), np.bool_)
    for test in leave_subjects_out(person[chosen], 2):
        trees = ExtraTreesClassifier(200, min_samples_leaf=2, max_features=0.1, random_state=1).fit(x[~test], y[~test])
        right[test] = trees.predict(x[test]) == y[test]
    return float(right.mean())


def figures(
    vectors: NDArray[np.float32], number: NDArray[np.int64], person: NDArray[np.int64], closing: Mask, nobody: Mask, others: Mask
) -> dict[str, Any]:
    """Measure what segments without a gesture hold, beside others from near the end of the same recordings.

    ``vectors``, ``number``, ``person``: as in `alone`; ``closing``, ``nobody``, ``others``, shape (n,): the last segments, those with
    nobody there, and ordinary ones.
    Returns ``closing_share``, ``nobody_share``: of all segments, where nobody is there of those that are not the last; ``without_alone``,
    ``others_alone``: see `alone`; ``chance``: one label in so many; ``ceiling``: accuracy on everything of a recogniser that names every
    other segment rightly and these as `alone` does.
    """
    without = closing | nobody
    share, accuracy = float(without.mean()), alone(vectors, number, person, without)
    return {
        "closing_share": float(closing.mean()),
        "nobody_share": float((nobody & ~closing).mean()),
        "without_alone": accuracy,
        "others_alone": alone(vectors, number, person, others & ~nobody),
        "chance": 1.0 / len(np.unique(number)),
        "ceiling": 1.0 - share * (1.0 - accuracy),
    }
