"""Training the classifier on a simulated data set (thesis, sections 4.5.3 and 5.3)."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, DataError
from radar_gestures.features import FEATURE_NAMES
from radar_gestures.model import GestureModel, save_model
from radar_gestures.samples import SampleSet, load_samples


@dataclass(frozen=True, eq=False)
class TrainingReport:
    """What a training run found.

    Attributes
    ----------
    model : GestureModel
        Trained on the training part.
    n_train, n_test : int
        Samples in each part; no person is in both.
    accuracy : float
        Share of the test samples that get the right label.
    gesture_accuracy : float
        The same over the nine gestures only, random left out.
    confusion : ndarray of int, shape (10, 10)
        True label by recognised label, test part.
    """

    model: GestureModel
    n_train: int
    n_test: int
    accuracy: float
    gesture_accuracy: float
    confusion: NDArray[np.int64]


def train(
    folder: str | Path,
    out: str | Path | None = None,
    *,
    hidden: int = 32,
    regularisation: float = 1e-2,
    test_fraction: float = 0.2,
    max_iterations: int = 600,
    seed: int = 1,
) -> TrainingReport:
    """Train a perceptron on the samples in ``folder`` and write it to ``out``.

    People are either in the training or in the test part, never in both; rare labels are repeated until all weigh the same.

    Parameters
    ----------
    folder : str or Path
        A data set made by `radar_gestures.dataset.generate`.
    out : str or Path or None
        Model file to write (.npz); None: write nothing.
    hidden : int
        Neurons of the hidden layer.
    regularisation : float
        L2 penalty on the weights.
    test_fraction : float
        Share of the people kept for the test.
    max_iterations : int
        Most passes over the training samples.
    seed : int
        Of the split, the start weights and the order of samples.

    Returns
    -------
    TrainingReport
        Model and figures.

    Raises
    ------
    DataError
        When the folder holds no samples, or a label has none.
    """
    samples = load_samples(folder)
    test = split_by_person(samples.person, test_fraction, seed)
    report = fit(samples, test, hidden=hidden, regularisation=regularisation, max_iterations=max_iterations, seed=seed)
    if out is not None:
        save_model(report.model, out)
    return report


def split_by_person(person: NDArray[np.int64], test_fraction: float, seed: int) -> NDArray[np.bool_]:
    """Mark the samples (shape (n,)) of a random share of the people as test samples; at least one person stays on each side.

    Parameters
    ----------
    person : ndarray of int, shape (n,)
        Whose sample each is.
    test_fraction : float
        Share of the people.
    seed : int
        Of the draw.
    """
    people = np.unique(person)
    if len(people) < 2:
        raise DataError(f"the data set has samples of {len(people)} people; it takes at least 2 to keep one for the test: simulate more")
    count = min(max(round(test_fraction * len(people)), 1), len(people) - 1)
    chosen = np.random.default_rng(seed).permutation(people)[:count]
    return np.isin(person, chosen)


def fit(
    samples: SampleSet, test: NDArray[np.bool_], *, hidden: int, regularisation: float, max_iterations: int, seed: int
) -> TrainingReport:
    """Train on the samples that ``test`` (shape (n,)) does not mark and measure on those it does.

    Parameters
    ----------
    samples : SampleSet
        All samples.
    test : ndarray of bool, shape (n,)
        The test part.
    hidden, regularisation, max_iterations, seed
        See `train`.
    """
    features, label = samples.features[~test], samples.label[~test]
    missing = [name for number, name in enumerate(GESTURES) if number not in label]
    if missing:
        raise DataError(f"the training part has no sample of {', '.join(missing)}: simulate more scenes")
    mean, scale = features.mean(axis=0), features.std(axis=0)
    scale = np.where(scale > 1e-9, scale, 1.0)
    rng = np.random.default_rng(seed)
    order = rng.permutation(_balanced(label, rng))
    weights, biases = _perceptron((features[order] - mean) / scale, label[order], hidden, regularisation, max_iterations, seed)
    model = GestureModel(mean, scale, weights[0], biases[0], weights[1], biases[1], settings=samples.settings)
    confusion = _confusion(samples.label[test], model.probabilities(samples.features[test]).argmax(axis=-1))
    accuracy = float(np.trace(confusion) / max(confusion.sum(), 1))
    gestures = float(np.trace(confusion[1:, 1:]) / max(confusion[1:].sum(), 1))
    figures = {
        "n_train": int((~test).sum()),
        "n_test": int(test.sum()),
        "accuracy": accuracy,
        "gesture_accuracy": gestures,
        "hidden": hidden,
        "regularisation": regularisation,
        "seed": seed,
    }
    model = GestureModel(mean, scale, weights[0], biases[0], weights[1], biases[1], settings=samples.settings, figures=figures)
    return TrainingReport(model, int((~test).sum()), int(test.sum()), accuracy, gestures, confusion)


def _balanced(label: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.int64]:
    """Return indices in which every label occurs as often as the most frequent one (at most eight times each sample)."""
    most = np.bincount(label).max()
    parts = []
    for number in np.unique(label):
        own = np.flatnonzero(label == number)
        want = min(most, 8 * len(own))
        parts.append(np.concatenate([np.tile(own, want // len(own)), rng.choice(own, want % len(own), replace=False)]))
    return np.concatenate(parts)


def _perceptron(
    x: NDArray[np.float64], label: NDArray[np.int64], hidden: int, regularisation: float, max_iterations: int, seed: int
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    from sklearn.exceptions import ConvergenceWarning  # only training needs scikit-learn
    from sklearn.neural_network import MLPClassifier

    network = MLPClassifier(
        (hidden,), alpha=regularisation, max_iter=max_iterations, random_state=seed, learning_rate_init=3e-3, tol=1e-5, n_iter_no_change=30
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # max_iterations is the user's choice
        network.fit(x, label)
    return list(network.coefs_), list(network.intercepts_)


def _confusion(true: NDArray[np.int64], found: NDArray[np.intp]) -> NDArray[np.int64]:
    counts = np.zeros((len(GESTURES), len(GESTURES)), np.int64)
    np.add.at(counts, (true, found), 1)
    return counts


def describe(report: TrainingReport) -> str:
    """Write the figures and the confusion matrix as text, one line per true label."""
    lines = [
        f"{report.n_train} training samples, {report.n_test} test samples of other people, {len(FEATURE_NAMES)} features",
        f"accuracy {report.accuracy:.1%}, of the nine gestures {report.gesture_accuracy:.1%}",
        " " * 12 + " ".join(f"{name[:5]:>5}" for name in GESTURES),
    ]
    lines += [f"{name:12}" + " ".join(f"{count:5d}" for count in row) for name, row in zip(GESTURES, report.confusion, strict=True)]
    return "\n".join(lines)
