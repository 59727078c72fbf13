"""Splits of a data set, and what a classifier says about the part that it has not seen (thesis, section 4.5.3)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError
from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_gestures.classifiers.rejection import RANDOM

Mask = BoolArray
Judge = Callable[[Mask, Mask], NDArray[np.floating]]
"""Trains on the samples that the first mask marks; returns the probabilities of those of the second, shape (n_test, n_labels)."""


def leave_subjects_out(person: IndexArray, n: int = 2, *, most: int = 10, seed: int = 1) -> list[Mask]:
    """Split into folds, each of which leaves ``n`` people out; everybody is left out once.

    Gives the test part of each fold, shape (n_samples,); they are disjoint and cover all samples. Raises `DataError` when there are not
    enough people to train on some and test on others.

    Parameters
    ----------
    person : ndarray of int, shape (n_samples,)
        Whose sample each is.
    n, most : int
        People left out at a time; folds at most: with more people than ``n * most``, each fold leaves more of them out.
    seed : int
        Of the order of the people.
    """
    people = np.unique(person)
    if len(people) < 2:
        raise DataError(
            f"the data set has samples of {len(people)} people; it takes at least 2 to keep one for the test: simulate more scenes"
        )
    folds = max(min(len(people) // n, most), 2)
    order = np.random.default_rng(seed).permutation(people)
    return [np.isin(person, part) for part in np.array_split(order, folds)]


def random_split(n_samples: int, fraction: float = 0.2, *, seed: int = 1) -> list[Mask]:
    """Split at random, as the thesis does, whoever the samples are of; each sample is tested once.

    Gives ``round(1 / fraction)`` disjoint test parts, shape (n_samples,). Raises `ConfigError` when the fraction is not above 0 and at most
    a half, `DataError` when there are fewer samples than folds.
    """
    if not 0 < fraction <= 0.5:
        raise ConfigError(f"random split: the test part is {fraction:g}; it must be above 0 and at most 0.5")
    folds = round(1 / fraction)
    if n_samples < folds:
        raise DataError(f"the data set has {n_samples} samples; it takes at least {folds} for a random split of {fraction:.0%}")
    number = np.empty(n_samples, np.int64)
    number[np.random.default_rng(seed).permutation(n_samples)] = np.arange(n_samples) % folds
    return [number == fold for fold in range(folds)]


@dataclass(frozen=True, eq=False)
class Validation:
    """What a classifier says about samples that were not in its training."""

    split: str  # how the samples were chosen: subjects, random or all (tested by a model trained elsewhere)
    labels: tuple[str, ...]  # names of the labels
    probabilities: Float64Array  # of every tested sample, shape (n, n_labels)
    # label, person: the true ones, and whose samples they are, shape (n,)
    label: IndexArray
    person: IndexArray
    n_folds: int = 0  # classifiers that were trained

    def __post_init__(self) -> None:
        n = len(self.label)
        if n == 0:
            raise DataError("nothing to validate: no sample is in a test part")
        if self.probabilities.shape != (n, len(self.labels)) or self.person.shape != (n,):
            raise DataError(f"validation: {n} labels, but probabilities {self.probabilities.shape} and person {self.person.shape}")

    @property
    def confusion(self) -> IndexArray:
        """True label by recognised label, shape (n_labels, n_labels)."""
        counts = np.zeros((len(self.labels), len(self.labels)), np.int64)
        np.add.at(counts, (self.label, self.probabilities.argmax(axis=-1)), 1)
        return counts

    @property
    def accuracy(self) -> float:
        """Share of samples that get the right label."""
        return float(np.mean(self.probabilities.argmax(axis=-1) == self.label))

    @property
    def gesture_accuracy(self) -> float:
        """The same over the gestures, "random" left out; NaN when there are none."""
        gesture = self.is_gesture
        return float(np.mean(self.probabilities.argmax(axis=-1)[gesture] == self.label[gesture])) if gesture.any() else float("nan")

    @property
    def is_gesture(self) -> BoolArray:
        """Samples that are a gesture, shape (n,)."""
        return np.asarray(self.label != (self.labels.index(RANDOM) if RANDOM in self.labels else -1))

    @property
    def recall(self) -> Float64Array:
        """Of each label's samples the share that gets it, shape (n_labels,); NaN where there are none."""
        return _ratio(np.diag(self.confusion), self.confusion.sum(axis=1))

    @property
    def precision(self) -> Float64Array:
        """Of the samples that get a label the share that has it, shape (n_labels,); NaN where none gets it."""
        return _ratio(np.diag(self.confusion), self.confusion.sum(axis=0))

    def figures(self) -> dict[str, Any]:
        """Flat figures: samples, people, accuracies, and recall by label; NaN becomes None."""
        gesture = self.gesture_accuracy
        return {
            "split": self.split,
            "folds": self.n_folds,
            "n_samples": len(self.label),
            "n_people": len(np.unique(self.person)),
            "accuracy": self.accuracy,
            "gesture_accuracy": None if np.isnan(gesture) else gesture,
            "recall": {name: None if np.isnan(value) else float(value) for name, value in zip(self.labels, self.recall, strict=True)},
        }


def cross_validate(
    label: IndexArray, person: IndexArray, folds: Sequence[Mask], judge: Judge, *, labels: Sequence[str], split: str
) -> Validation:
    """Train once for every fold and judge the samples it leaves out; they keep their order.

    Parameters
    ----------
    label, person : ndarray of int, shape (n,)
        What each sample is, and whose.
    folds : sequence of ndarray of bool, shape (n,)
        Test parts, disjoint; see `leave_subjects_out` and `random_split`.
    judge : callable
        See `Judge`; whatever the classifier is.
    labels, split : sequence of str, str
        Names of the labels, and of the split.
    """
    tested = np.any(folds, axis=0) if len(folds) else np.zeros(len(label), np.bool_)
    probabilities = np.zeros((len(label), len(labels)))
    for test in folds:
        probabilities[test] = judge(~test, test)
    return Validation(split, tuple(labels), probabilities[tested], label[tested], person[tested], len(folds))


def as_text(validation: Validation) -> str:
    """Write figures and confusion matrix, one line per true label with its recall and precision (as Table 5.1)."""
    width = max(len(name) for name in validation.labels) + 1
    gesture = validation.gesture_accuracy
    lines = [
        f"{len(validation.label)} samples of {len(np.unique(validation.person))} people, split {validation.split}",
        f"accuracy {validation.accuracy:.1%}" + (f", of the gestures alone {gesture:.1%}" if not np.isnan(gesture) else ""),
        " " * width + " ".join(f"{name[:6]:>6}" for name in validation.labels) + "  recall precision",
    ]
    rows = zip(validation.labels, validation.confusion, validation.recall, validation.precision, strict=True)
    for name, counts, recall, precision in rows:
        lines.append(f"{name:{width}}" + " ".join(f"{count:6d}" for count in counts) + f"  {recall:6.3f} {precision:9.3f}")
    return "\n".join(lines)


def _ratio(part: IndexArray, whole: IndexArray) -> Float64Array:
    return np.asarray(np.divide(part, whole, out=np.full(len(part), np.nan), where=whole > 0))
