"""How alike are two data sets, say simulated and recorded? The statistics of the thesis's section 5.3.3."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from radar_core import DataError, vocabulary
from radar_core.config import config, knob
from radar_core.types import Float64Array, IndexArray
from radar_lab.datasets.samples import SampleSet, relabelled
from radar_lab.training.validation import Validation

_LARGEST: Final[int] = 5000  # samples of which Shapiro's p-value is known
_FEWEST: Final[int] = 3  # samples of which a test says anything


@config
class ComparisonConfig:
    """How two data sets are compared."""

    significance: float = knob(0.05, low=1e-9, high=0.5, doc="p-values below this reject that both come from one distribution")
    left_out: int = knob(2, low=0, high=100, doc="how many of the most different features are left out for the second accuracy")
    hidden: int = knob(32, low=1, high=10_000, doc="neurons of the classifier's hidden layer")
    regularisation: float = knob(1e-2, low=0.0, high=100.0, doc="L2 penalty on its weights")
    max_iterations: int = knob(600, low=1, high=100_000, doc="most passes over the training samples")
    seed: int = knob(1, low=0, high=(1 << 32) - 1, doc="of its start weights and the order of samples")


@dataclass(frozen=True, eq=False)
class Comparison:
    """What `compare` found. A p-value is NaN where a test says nothing; ``notes`` says why."""

    names: tuple[str, ...]  # features
    labels: tuple[int, ...]  # gestures that both data sets have, as indices into ``words``
    counts: IndexArray  # samples of each, of A and of B, shape (2, n_labels)
    shapiro: Float64Array  # p-values that a feature of A, of B, is normally distributed, shape (2, n_features)
    # kruskal, statistic: p-values that a feature of a gesture has one distribution in A and B (figure 5.15), and H of these tests: the
    # larger, the more different; shape (n_labels, n_features)
    kruskal: Float64Array
    statistic: Float64Array
    # P-values that the medians of all features of a gesture are alike in A and B, as pairs (table 5.3), shape (n_labels,)
    wilcoxon: Float64Array
    # How much they differ, which p-values do not tell: of many samples everything is significant. Of each feature of a gesture eta
    # squared, the share of the ranks' variance that the set explains, 0..1, shape (n_labels, n_features); of each gesture's medians the
    # matched-pairs rank-biserial correlation, -1 (all are larger in B) to 1 (all are larger in A), shape (n_labels,)
    eta_squared: Float64Array
    rank_biserial: Float64Array
    left_out: tuple[int, ...]  # the most different features: those of the largest mean H
    # transfer, reduced: trained on A, tested on B, with all features (tables 5.1 and 5.2), and without ``left_out``; None: too few gestures
    # or samples
    transfer: Validation | None
    reduced: Validation | None
    significance: float  # p-values below this count as different
    notes: tuple[str, ...]  # what could not be tested
    words: tuple[str, ...]  # names of all gestures of both, by their numbers


def compare(a: SampleSet, b: SampleSet, config: ComparisonConfig | None = None) -> Comparison:
    """Compare two data sets feature by feature, gesture by gesture, and by what a classifier learns from one about the other.

    The classifier is trained on ``a`` and tested on ``b``. Raises `DataError` when the features differ, or no gesture is in both.
    """
    config = config or ComparisonConfig()
    if a.names != b.names:
        raise DataError(f"the data sets have different features ({', '.join(a.names)}; {', '.join(b.names)}); make both with the same ones")
    words = vocabulary((*a.labels, *b.labels))
    a, b = relabelled(a, words), relabelled(b, words)
    labels = tuple(sorted({*a.label.tolist()} & {*b.label.tolist()}))
    if not labels:
        raise DataError("the data sets have no gesture in common: there is nothing to compare")
    notes: list[str] = []
    shapiro = np.array([[_shapiro(column, f"{name} of {which}", notes) for name, column in zip(a.names, one.features.T, strict=True)]
                        for which, one in (("A", a), ("B", b))])  # fmt: skip
    pairs = [(a.features[a.label == label], b.features[b.label == label]) for label in labels]
    tests = np.array([[_kruskal(x, y, f"{a.names[i]} of {words[label]}", notes) for i, (x, y) in enumerate(zip(p.T, q.T, strict=True))]
                      for label, (p, q) in zip(labels, pairs, strict=True)])  # fmt: skip
    tests = tests.reshape(len(labels), len(a.names), 2)
    left_out = most_different(tests[..., 0], min(config.left_out, len(a.names) - 1))
    rest = np.setdiff1d(np.arange(len(a.names)), left_out)
    return Comparison(
        names=a.names,
        labels=labels,
        counts=np.array([[int((one.label == label).sum()) for label in labels] for one in (a, b)], np.int64),
        shapiro=shapiro,
        kruskal=tests[..., 1],
        statistic=tests[..., 0],
        wilcoxon=np.array([_wilcoxon(np.median(p, axis=0), np.median(q, axis=0)) for p, q in pairs]),
        eta_squared=np.array([eta_squared(row, len(p) + len(q)) for row, (p, q) in zip(tests[..., 0], pairs, strict=True)]),
        rank_biserial=np.array([rank_biserial(np.median(p, axis=0), np.median(q, axis=0)) for p, q in pairs]),
        left_out=left_out,
        transfer=_transfer(a, b, labels, np.arange(len(a.names)), config, notes),
        reduced=_transfer(a, b, labels, rest, config, []) if left_out else None,
        significance=config.significance,
        notes=tuple(notes),
        words=words,
    )


def most_different(statistic: Float64Array, n: int) -> tuple[int, ...]:
    """Numbers of the ``n`` features (axis 1) with the largest mean H over the gestures (axis 0), most different first; NaN counts as 0."""
    mean = np.nan_to_num(statistic, nan=0.0).mean(axis=0)
    return tuple(int(i) for i in np.argsort(-mean, kind="stable")[:n])


def eta_squared(statistic: Float64Array, n: int) -> Float64Array:
    """Effect size of tests of Kruskal and Wallis of two groups of ``n`` samples together: share of the ranks' variance, 0..1.

    It is (H - 1) / (n - 2), at least 0 (Tomczak and Tomczak 2014); NaN stays.
    """
    return np.asarray(np.clip((statistic - 1.0) / max(n - 2, 1), 0.0, 1.0))


def rank_biserial(x: Float64Array, y: Float64Array) -> float:
    """Effect size of Wilcoxon's test of pairs: rank sums of positive less those of negative differences over all (Kerby 2014); -1..1."""
    from scipy.stats import rankdata

    different = (x - y)[x != y]
    if not len(different):
        return 0.0
    rank = rankdata(np.abs(different))
    return float((rank * np.sign(different)).sum() / rank.sum())


def _shapiro(values: Float64Array, what: str, notes: list[str]) -> float:
    """P-value of Shapiro and Wilk's test; of many samples, 5,000 spread evenly."""
    from scipy.stats import shapiro

    if len(values) < _FEWEST:
        notes.append(f"Shapiro: {what} has {len(values)} samples, too few")
        return float("nan")
    if np.ptp(values) == 0.0:
        notes.append(f"Shapiro: {what} is constant, which no normal distribution is")
        return float("nan")
    if len(values) > _LARGEST:
        values = values[np.linspace(0, len(values) - 1, _LARGEST).astype(np.int64)]
    # Centred and scaled, which changes nothing, so that features of any unit keep their digits.
    return float(shapiro((values - np.median(values)) / np.ptp(values)).pvalue)


def _kruskal(x: Float64Array, y: Float64Array, what: str, notes: list[str]) -> tuple[float, float]:
    """H and p-value of Kruskal and Wallis's test of two groups."""
    from scipy.stats import kruskal

    if min(len(x), len(y)) < _FEWEST:
        notes.append(f"Kruskal-Wallis: {what} has {len(x)} and {len(y)} samples, too few")
        return float("nan"), float("nan")
    if np.ptp(np.concatenate([x, y])) == 0.0:
        notes.append(f"Kruskal-Wallis: {what} is one constant in both")
        return 0.0, 1.0
    found = kruskal(x, y)
    return float(found.statistic), float(found.pvalue)


def _wilcoxon(x: Float64Array, y: Float64Array) -> float:
    """P-value of Wilcoxon's signed-rank test of pairs; pairs without a difference say nothing, and without any the two are alike."""
    from scipy.stats import wilcoxon

    different = x - y
    different = different[different != 0.0]
    return float(wilcoxon(different).pvalue) if len(different) else 1.0


def _transfer(
    a: SampleSet, b: SampleSet, labels: tuple[int, ...], columns: IndexArray, config: ComparisonConfig, notes: list[str]
) -> Validation | None:
    """Train on the common gestures of A, test on those of B."""
    if len(labels) < 2:
        notes.append(f"classifier: only {a.labels[labels[0]]} is in both data sets; it takes two gestures to tell apart")
        return None
    known, own = np.isin(a.label, labels), np.isin(b.label, labels)
    model = _classifier(a.features[known][:, columns], a.label[known], config)
    number = np.searchsorted(labels, b.label[own])
    names = tuple(a.labels[label] for label in labels)
    return Validation("all", names, model(b.features[own][:, columns]), number, b.person[own], 1)


def _classifier(x: Float64Array, label: IndexArray, config: ComparisonConfig) -> Callable[[Float64Array], Float64Array]:
    """Fit the thesis's perceptron, L2 in place of dropout; gives probabilities, shape (n, n_labels)."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.neural_network import MLPClassifier
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    options = {"alpha": config.regularisation, "max_iter": config.max_iterations, "random_state": config.seed}
    network = MLPClassifier((config.hidden,), learning_rate_init=3e-3, **options)
    model = make_pipeline(StandardScaler(), network)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # max_iterations is the user's choice
        model.fit(x, label)
    return lambda rows: np.asarray(model.predict_proba(rows), np.float64)


def as_text(result: Comparison) -> str:
    """Write a comparison as plain text: tables 5.1 and 5.3, figure 5.15 in numbers, and what could not be tested."""
    blocks = [_feature_table(result), _gesture_table(result), _accuracies(result)]
    if result.notes:
        blocks.append("Not tested:\n" + "\n".join(f"  {note}" for note in result.notes))
    return "\n\n".join(blocks)


def _feature_table(result: Comparison) -> str:
    different = (result.kruskal < result.significance).sum(axis=0)
    tested = np.isfinite(result.kruskal).sum(axis=0)
    effect = result.eta_squared.mean(axis=0)
    title = f"differs in gestures (Kruskal-Wallis, p < {result.significance:g})"
    lines = [f"{'feature':24}{'Shapiro A':>11}{'Shapiro B':>11}{'eta^2':>7}   {title}"]
    lines += [
        f"{name:24}{_p(result.shapiro[0, i]):>11}{_p(result.shapiro[1, i]):>11}{_share(effect[i]):>7}   {different[i]} of {tested[i]}"
        + ("   one of the most different" if i in result.left_out else "")
        for i, name in enumerate(result.names)
    ]
    return "\n".join(lines)


def _gesture_table(result: Comparison) -> str:
    lines = [f"{'gesture':14}{'A':>6}{'B':>6}{'precision':>11}{'recall':>8}   Wilcoxon of the medians, rank-biserial"]
    for i, label in enumerate(result.labels):
        scores = (np.nan, np.nan) if result.transfer is None else (result.transfer.precision[i], result.transfer.recall[i])
        counts = f"{result.counts[0, i]:6d}{result.counts[1, i]:6d}"
        medians = f"{_p(result.wilcoxon[i])}, {result.rank_biserial[i]:.2f}"
        lines.append(f"{result.words[label]:14}{counts}{_share(scores[0]):>11}{_share(scores[1]):>8}   {medians}")
    return "\n".join(lines)


def _accuracies(result: Comparison) -> str:
    if result.transfer is None:
        return "No classifier: see below."
    text = f"Trained on A, tested on B: {result.transfer.accuracy:.1%} of {result.counts[1].sum()} samples right"
    if result.reduced is not None:
        text += f"; without {' and '.join(result.names[i] for i in result.left_out)} {result.reduced.accuracy:.1%}"
    return text


def _p(value: float) -> str:
    return "-" if np.isnan(value) else "< 0.001" if value < 1e-3 else f"{value:.3f}"


def _share(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.2f}"
