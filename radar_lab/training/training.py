"""Training the perceptron on labelled samples (thesis, sections 4.5.3 and 5.3)."""

from __future__ import annotations

import dataclasses
import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from radar_core import GESTURES, ConfigError, DataError
from radar_core.config import config, knob, load
from radar_core.types import Float64Array, IndexArray
from radar_gestures.classifiers.model import save_model
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.classifiers.rejection import RANDOM, ByProbability, Rejector
from radar_gestures.stage import GestureConfig
from radar_lab.datasets.samples import MANIFEST, SampleSet, join_samples, load_samples, standing
from radar_lab.training.calibration import calibration_error, choose_reject, fit_distance, fit_temperature, soften
from radar_lab.training.validation import Mask, Validation, as_text, cross_validate, leave_subjects_out

_MOST_REPEATS: Final[int] = 8  # of a rare sample: more of the same teaches nothing


@config
class TrainingConfig:
    """How a perceptron is trained."""

    hidden: tuple[int, ...] = knob((32,), low=1, high=4096, doc="neurons of each hidden layer")
    regularisation: float = knob(0.1, low=0.0, high=1e3, doc="L2 penalty on the weights, in place of the thesis's dropout")
    learning_rate: float = knob(3e-3, low=1e-8, high=10.0, doc="of Adam, at the start")
    max_iterations: int = knob(600, low=1, high=1_000_000, doc="most passes over the samples; training ends earlier when it gains nothing")
    starts: int = knob(1, low=1, high=100, doc="start weights that are tried; of these networks the one with the least loss is kept")
    balanced: bool = knob(True, doc="repeat rare labels, at most eight times a sample, until all weigh the same")
    rejector: Literal["distance", "probability"] = knob("distance", doc="what tells gestures that the model does not know")
    shared: bool = knob(False, doc="rejector distance: one covariance for all labels, which keeps the file small with many features")
    lost: float = knob(0.05, low=0.0, high=1.0, doc="known gestures that may be lost so that unknown ones are rejected")
    folds: int = knob(10, low=2, high=1000, doc="most parts of the cross-validation; each leaves at least two people out")
    seed: int = knob(1, low=0, high=2**31 - 1, doc="of the split, the (first) start weights and the order of samples")


@dataclass(frozen=True, eq=False)
class TrainingReport:
    """What a training run found."""

    model: GestureModel  # trained on all samples, calibrated on people left out
    validation: Validation  # what models trained without them say about the people left out, calibrated
    config: TrainingConfig  # how it was trained
    calibration_error: tuple[float, float]  # expected calibration error of people left out, before and after the temperature
    # How much every sample looks like a known gesture to the model trained without it, see `GestureModel.score`, shape (n,)
    score: Float64Array
    lost: float  # known gestures of people left out that are called random or rejected, as a share


def train(
    folder: str | Path | Sequence[str | Path],
    out: str | Path | None = None,
    config: TrainingConfig | None = None,
    *,
    labels: Sequence[str] | None = None,
) -> TrainingReport:
    """Train a perceptron on the samples in one or more folders and write it to ``out``.

    The figures, the temperature and the limit for rejection come from people that the models which judged them had not seen; the model
    itself is then trained on everybody. The same samples and settings give the same file, bit for bit, on one machine.

    Parameters
    ----------
    folder : str or Path, or sequence of them
        Data sets of scenes or of single samples.
    out : str or Path or None
        Model file to write (.npz); None: write nothing.
    config : TrainingConfig or None
        None: the defaults.
    labels : sequence of str or None
        What the model shall tell apart, of those that the data sets know, else `ConfigError`; samples of others are left out. None: the
        ten; where there are samples of gestures of one's own, all of which there are samples.

    Raises
    ------
    DataError
        When the folder holds no samples, those of fewer than two people, or none of a label.
    """
    folders = [folder] if isinstance(folder, str | Path) else list(folder)
    samples = join_samples([read_folder(place) for place in folders])
    labels = usual_labels(samples) if labels is None else labels
    report = train_on(of_labels(samples, labels), config, labels=labels)
    if out is not None:
        save_model(report.model, out)
    return report


def read_folder(folder: str | Path) -> SampleSet:
    """Read a data set of scenes (`datasets.scenes.generate`) or one of single samples (`datasets.synthesis.synthesise`).

    Without the samples of people who walked (``GestureConfig.walk_distance``): a recogniser calls these random without asking its model.
    Raises `DataError` when it is neither, holds no samples, or one cannot be read.
    """
    folder = Path(folder)
    if (folder / MANIFEST).is_file() and any(folder.glob("sample_*.npz")):
        from radar_lab.datasets.synthesis import feature_samples  # loads the simulator, which scenes of others do not need

        return standing(feature_samples(folder), GestureConfig().walk_distance)
    return standing(load_samples(folder), GestureConfig().walk_distance)


def train_on(samples: SampleSet, config: TrainingConfig | None = None, *, labels: Sequence[str] = GESTURES) -> TrainingReport:
    """Train a perceptron on samples in memory, with whatever features; ``label`` is an index into ``labels``. See `train`."""
    config = config if config is not None else TrainingConfig()
    folds = leave_subjects_out(samples.person, most=config.folds, seed=config.seed)
    judges: list[GestureModel] = []

    def judge(known: Mask, test: Mask) -> Float64Array:
        judges.append(fit(samples, known, config, labels=labels))
        return judges[-1].probabilities(samples.features[test])

    raw = cross_validate(samples.label, samples.person, folds, judge, labels=labels, split="subjects")
    temperature = fit_temperature(raw.probabilities, raw.label)
    soft = dataclasses.replace(raw, probabilities=soften(raw.probabilities, temperature))
    score = np.empty(len(samples.label))
    for model, test in zip(judges, folds, strict=True):
        score[test] = model.score(samples.features[test], soft.probabilities[test])
    reject, lost = reject_limit(soft, score, config.lost)
    error = (calibration_error(raw.probabilities, raw.label), calibration_error(soft.probabilities, soft.label))
    figures = soft.figures() | {"calibration_error": error[1], "lost": lost, "training": json.loads(json.dumps(dataclasses.asdict(config)))}
    model = fit(samples, np.ones(len(samples.label), np.bool_), config, labels=labels)
    model = dataclasses.replace(model, temperature=temperature, reject=reject, figures=figures)
    return TrainingReport(model, soft, config, error, score, lost)


def validate(
    samples: SampleSet, folds: Sequence[Mask], config: TrainingConfig, *, labels: Sequence[str] = GESTURES, split: str = "subjects"
) -> Validation:
    """Train a perceptron without each fold in turn and judge the samples left out; see `cross_validate` and `fit`."""

    def judge(known: Mask, test: Mask) -> Float64Array:
        return fit(samples, known, config, labels=labels).probabilities(samples.features[test])

    return cross_validate(samples.label, samples.person, folds, judge, labels=labels, split=split)


def config_of(model: GestureModel) -> TrainingConfig:
    """Return how a model was trained; for one that does not say, the defaults with its layers."""
    known = {field.name for field in dataclasses.fields(TrainingConfig)}
    said = model.figures.get("training")
    told = {name: value for name, value in said.items() if name in known} if isinstance(said, Mapping) else {}
    return load(TrainingConfig, told | {"hidden": [len(bias) for bias in model.biases[:-1]]}, "gesture model")


def reject_limit(validation: Validation, score: Float64Array, lost: float) -> tuple[float, float]:
    """Limit of the score below which events are rejected, and the share of known gestures that are lost: rejected or called random.

    ``validation`` is of samples that were not in the training, ``score``, shape (n,), theirs (`GestureModel.score`), and ``lost`` the share
    that may be lost.
    """
    gesture = validation.is_gesture
    if not gesture.any():
        return 0.0, 0.0
    random = validation.labels.index(RANDOM) if RANDOM in validation.labels else -1
    kept = np.where(validation.probabilities.argmax(axis=-1) == random, -1.0, score)[gesture]
    limit = max(choose_reject(kept, lost), 0.0)
    return limit, float(np.mean(kept < limit))


def fit(samples: SampleSet, known: Mask, config: TrainingConfig, *, labels: Sequence[str] = GESTURES) -> GestureModel:
    """Train one perceptron on the samples that ``known``, shape (n,), marks; temperature 1, nothing rejected.

    ``label`` of the samples is an index into ``labels``; `DataError` is raised when one of them has fewer than two in the training part.
    """
    features, label = samples.features[known], samples.label[known]
    missing = [name for number, name in enumerate(labels) if np.count_nonzero(label == number) < 2]
    if missing:
        raise DataError(
            f"the training part has no sample, or only one, of {', '.join(missing)}: simulate more scenes, or leave the label out"
        )
    mean, scale = features.mean(axis=0), features.std(axis=0)
    scale = np.where(scale > 1e-9, scale, 1.0)
    standard = (features - mean) / scale
    rng = np.random.default_rng(config.seed)
    order = rng.permutation(_balanced(label, rng) if config.balanced else np.arange(len(label)))
    weights, biases = _perceptron(standard[order], label[order], config)
    by_distance = config.rejector == "distance"
    rejector: Rejector = fit_distance(standard, label, len(labels), shared=config.shared) if by_distance else ByProbability()
    about: dict[str, Any] = {"labels": tuple(labels), "names": samples.names, "rejector": rejector, "settings": dict(samples.config)}
    kernels, offsets = (tuple(layer.astype(np.float32) for layer in part) for part in (weights, biases))
    return GestureModel(mean.astype(np.float32), scale.astype(np.float32), kernels, offsets, **about)


def of_labels(samples: SampleSet, labels: Sequence[str]) -> SampleSet:
    """Return the samples of some gestures; ``label`` becomes an index into ``labels``.

    Raises `ConfigError` when a label is none that the samples know, or occurs twice.
    """
    unknown = [name for name in labels if name not in samples.labels]
    if unknown or len(set(labels)) != len(labels) or len(labels) < 2:
        wrong = f"{', '.join(unknown)}: no such gesture" if unknown else f"{', '.join(labels)}: give at least two, each once"
        raise ConfigError(f"labels: {wrong}; choose of {', '.join(samples.labels)}")
    number = np.full(len(samples.labels), -1)
    number[[samples.labels.index(name) for name in labels]] = np.arange(len(labels))
    keep = number[samples.label] >= 0
    columns = {name: getattr(samples, name)[keep] for name in ("features", "person", "walked")}
    missed = samples.missed[[samples.labels.index(name) for name in labels]]
    return dataclasses.replace(samples, **columns, label=number[samples.label][keep], missed=missed, labels=tuple(labels))


def usual_labels(samples: SampleSet) -> tuple[str, ...]:
    """Return what a model learns to tell apart unless somebody says otherwise: the ten, or all that there is where some are one's own."""
    if samples.labels == GESTURES:
        return GESTURES
    return tuple(name for number, name in enumerate(samples.labels) if np.any(samples.label == number))


def _balanced(label: IndexArray, rng: np.random.Generator) -> IndexArray:
    """Return indices in which every label occurs as often as the most frequent one (at most eight times each sample)."""
    most = np.bincount(label).max()
    parts = []
    for number in np.unique(label):
        own = np.flatnonzero(label == number)
        want = min(most, _MOST_REPEATS * len(own))
        parts.append(np.concatenate([np.tile(own, want // len(own)), rng.choice(own, want % len(own), replace=False)]))
    return np.concatenate(parts)


def _perceptron(x: Float64Array, label: IndexArray, config: TrainingConfig) -> tuple[tuple[Float64Array, ...], tuple[Float64Array, ...]]:
    from sklearn.exceptions import ConvergenceWarning  # only training needs scikit-learn
    from sklearn.neural_network import MLPClassifier

    common: dict[str, Any] = {"alpha": config.regularisation, "max_iter": config.max_iterations, "learning_rate_init": config.learning_rate}
    seeds = range(config.seed, config.seed + config.starts)
    networks = [MLPClassifier(config.hidden, random_state=seed, tol=1e-5, n_iter_no_change=30, **common) for seed in seeds]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # max_iterations is the user's choice
        network = min((network.fit(x, label) for network in networks), key=lambda fitted: float(fitted.loss_))
    weights, biases = list(network.coefs_), list(network.intercepts_)
    if len(network.classes_) == 2:  # one output, the score of the second label over the first
        weights[-1], biases[-1] = weights[-1] * [[-0.5, 0.5]], biases[-1] * [-0.5, 0.5]
    return tuple(weights), tuple(biases)


def describe(report: TrainingReport) -> str:
    """Write figures and the confusion matrix of people left out as text, then what calibration and rejection found."""
    before, after = report.calibration_error
    softened = f"temperature {report.model.temperature:.2f}: calibration error {before:.1%} without, {after:.1%} with it"
    rejected = f"rejected below {report.model.reject:.3g}, which with those called random loses {report.lost:.1%} of the gestures"
    return "\n".join([as_text(report.validation), softened, rejected])
