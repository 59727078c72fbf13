"""Gestures of real people: mHomeGes and mTransSee, people held out, through the product's feature maps and curves."""

from __future__ import annotations

import functools
import importlib.util
import itertools
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.gestures_closing import accuracy_without, from_the_end
from benchmarks.gestures_closing import figures as closing_figures
from benchmarks.recordings import folder
from benchmarks.report import choice, measure
from radar_core import DataError, PointCloud
from radar_core.config import config, knob
from radar_gestures.classifiers.curve_net import CurveNet, save_net
from radar_gestures.classifiers.curve_training import CurveTraining, train_net
from radar_gestures.classifiers.model import GestureModel, save_model
from radar_gestures.classifiers.validation import Mask, Validation, cross_validate, leave_subjects_out, random_split
from radar_gestures.classifiers.variation import VariationConfig, copies
from radar_gestures.curves import SIGNALS, TOTALS, CurveConfig, Curves, EventMaps, curve_names, join, locate
from radar_gestures.features import FEATURE_NAMES, FeatureConfig, extract, summarise
from radar_gestures.maps import feature_maps
from radar_ros.importers import open_original

GATES: Final = {"mhomeges": 0.356, "mtranssee": 0.3347}  # m/s: the Doppler step of each set's radar
MAX_SPEED: Final = 4.2  # m/s: no arm was faster
LONGEST: Final = 4.0  # s: of a longer segment, the beginning; in the rest people often walk up to the radar
CURVES: Final = CurveConfig(nearest=1.0, farthest=5.5)
"""People stood at 1.2 to 4.8 m; what is nearer is somebody at the desk, what is farther came over a wall."""
CHOICE_FOLDS: Final = 2  # of the ten: what the choices are compared on
COPIES: Final = 8  # changed ones of every training sample
SHARED: Final = {"CR": "circle", "KO": "knock", "PL": "pull", "PS": "push", "UP": "up"}  # mTransSee's names and mHomeGes's
"""Gestures that both data sets have."""


@config
class PerceptronTraining:
    """How a perceptron is trained."""

    hidden: tuple[int, ...] = knob((48,), low=1, high=1024, doc="neurons of each hidden layer")
    regularisation: float = knob(1.0, low=0.0, high=1e3, doc="L2 penalty on the weights")
    learning_rate: float = knob(2e-3, low=1e-6, high=1.0, doc="of Adam")
    passes: int = knob(32, low=1, high=1000, doc="over the training samples, each through another changed copy")
    averaged: float = knob(0.3, low=0.0, high=1.0, doc="last share of the passes over whose ends the weights are averaged")
    batch: int = knob(256, low=1, high=65536, doc="samples a step")
    seed: int = knob(1, low=0, high=2**31 - 1, doc="of the copies, the start weights and the order of samples")


@dataclass(frozen=True, eq=False)
class RealSet:
    """Labelled events of one data set.

    Attributes
    ----------
    events : EventMaps
        Their feature maps.
    label : ndarray of str, shape (n,)
        As the data set names them; mTransSee's in mHomeGes's words.
    person : ndarray of int64, shape (n,)
        Whose.
    distance : ndarray of float64, shape (n,)
        Of the person from the radar [m].
    thirteen : ndarray of float64, shape (n, 13)
        The features of section 4.2; 0 where there was too little motion for them.
    """

    events: EventMaps
    label: NDArray[np.str_]
    person: NDArray[np.int64]
    distance: NDArray[np.float64]
    thirteen: NDArray[np.float64]

    @property
    def labels(self) -> tuple[str, ...]:
        """Its gestures, sorted."""
        return tuple(str(label) for label in np.unique(self.label))

    @property
    def number(self) -> NDArray[np.int64]:
        """Index of each event's label in `labels`."""
        return np.asarray(np.searchsorted(self.labels, self.label))

    def only(self, labels: Sequence[str]) -> RealSet:
        """Events with one of the labels."""
        index = np.flatnonzero(np.isin(self.label, labels))
        return RealSet(self.events.select(index), self.label[index], self.person[index], self.distance[index], self.thirteen[index])


@functools.cache
def read(kind: str, limit: int = 0) -> RealSet:
    """Read a data set through the importer and make its feature maps; the person is what lies around the body that `locate` finds.

    Parameters
    ----------
    kind : str
        One of `GATES`.
    limit : int
        At most this many segments, spread evenly; 0: all.

    Raises
    ------
    DataError
        When the recordings are not there.
    """
    path = folder() / kind / "segments.npz"
    if not path.is_file():
        raise DataError(f"{path}: not there; docs/recordings.md says where the original is")
    recording = open_original(kind, path, limit=limit, idle=0.0)
    found = recording.tally.segments
    maps, thirteen = [], []
    for clouds in _segments(recording.items, found):
        own, body = person_of(clouds, GATES[kind])
        maps.append(feature_maps(own, GATES[kind], MAX_SPEED))
        thirteen.append(_thirteen(own, body, GATES[kind]))
    return RealSet(
        join(maps),
        np.array([SHARED.get(segment.label, segment.label) for segment in found]),
        np.array([segment.subject for segment in found], np.int64),
        np.array([segment.distance for segment in found]),
        np.array(thirteen),
    )


def _segments(items: Iterator[object], found: Sequence[object]) -> Iterator[list[PointCloud]]:
    """Clouds of each segment; the importer appends a segment to ``found`` before it gives its first cloud."""
    clouds: list[PointCloud] = []
    current = 0
    for item in items:
        if len(found) != current:
            if clouds:
                yield clouds
            clouds, current = [], len(found)
        if isinstance(item, PointCloud):
            clouds.append(item)
    if clouds:
        yield clouds


def person_of(clouds: Sequence[PointCloud], gate: float) -> tuple[list[PointCloud], tuple[float, float, float]]:
    """Keep what is near the body, as the tracker does for people who are tracked, in the first `LONGEST` seconds.

    Returns
    -------
    tuple of (list of PointCloud, tuple of float)
        The person's points, and distance [m], azimuth and elevation [rad] of the body.
    """
    clouds = [cloud for cloud in clouds if cloud.stamp_ns - clouds[0].stamp_ns <= LONGEST * 1e9]
    distance, side, height = locate(join([feature_maps(clouds, gate, MAX_SPEED)]), CURVES.nearest, CURVES.farthest)[0]
    own = []
    for cloud in clouds:
        lateral = cloud.range * np.cos(cloud.elevation) * np.sin(cloud.azimuth)
        near = (np.abs(cloud.range - distance) < CURVES.reach) & (np.abs(lateral - side) < CURVES.side)
        own.append(cloud.select(near))
    elevation = float(np.arcsin(np.clip(height / max(distance, 1e-3), -1.0, 1.0)))
    azimuth = float(np.arcsin(np.clip(side / max(distance * np.cos(elevation), 1e-3), -1.0, 1.0)))
    return own, (float(distance), azimuth, elevation)


def _thirteen(clouds: Sequence[PointCloud], body: tuple[float, float, float], gate: float) -> NDArray[np.float64]:
    settings = FeatureConfig(gate=gate, body_speed=gate / 2)
    found = extract([summarise(cloud, body, settings) for cloud in clouds], clouds[0].stamp_ns, settings)
    return found if found is not None else np.zeros(len(FEATURE_NAMES))


def train_perceptron(
    changed: NDArray[np.float32], number: NDArray[np.int64], labels: Sequence[str], names: Sequence[str], settings: PerceptronTraining
) -> GestureModel:
    """Train a perceptron with scikit-learn.

    Parameters
    ----------
    changed : ndarray of float32, shape (n_copies, n, n_features)
        Samples, in copies that the passes take in turn; the first one sets the standardisation.
    number : ndarray of int64, shape (n,)
        Index into ``labels``.
    labels, names : sequence of str
        What outputs and inputs are called.
    settings : PerceptronTraining
        The knobs.
    """
    from sklearn.neural_network import MLPClassifier

    mean, scale = changed[0].mean(axis=0), changed[0].std(axis=0) + 1e-3
    net = MLPClassifier(
        settings.hidden, alpha=settings.regularisation, batch_size=min(settings.batch, len(number)),
        learning_rate_init=settings.learning_rate, random_state=settings.seed,
    )  # fmt: skip
    first = settings.passes - max(1, round(settings.averaged * settings.passes))
    total: list[NDArray[np.float64]] = []
    for turn in range(settings.passes):
        x = changed[turn % len(changed)]
        net.partial_fit(((x - mean) / scale).astype(np.float32), number, classes=np.arange(len(labels)))
        if turn >= first:
            layers = [np.asarray(part, np.float64) for part in (*net.coefs_, *net.intercepts_)]
            total = layers if not total else [a + b for a, b in zip(total, layers, strict=True)]
    mean_layers = [(part / (settings.passes - first)).astype(np.float32) for part in total]
    half = len(net.coefs_)
    return GestureModel(
        mean.astype(np.float32),
        scale.astype(np.float32),
        tuple(mean_layers[:half]),
        tuple(mean_layers[half:]),
        labels=tuple(labels),
        names=tuple(names),
    )


@dataclass(frozen=True, eq=False)
class Study:
    """A data set as vectors, ready to train on.

    Attributes
    ----------
    data : RealSet
        What it was made from.
    names : tuple of str
        Of the features.
    plain : ndarray of float32, shape (n, n_features)
        Samples as they are.
    changed : ndarray of float32, shape (n_copies, n, n_features), or None
        Changed copies.
    settings : PerceptronTraining
        How to train on them.
    """

    data: RealSet
    names: tuple[str, ...]
    plain: NDArray[np.float32]
    changed: NDArray[np.float32] | None
    settings: PerceptronTraining | CurveTraining

    def fit(self, rows: Mask | None = None) -> GestureModel | CurveNet:
        """Train on some of the samples; None: on all."""
        own = np.ones(len(self.plain), np.bool_) if rows is None else rows
        changed = self.plain[None, own] if self.changed is None else self.changed[:, own]
        number, labels = self.data.number[own], self.data.labels
        if isinstance(self.settings, PerceptronTraining):
            return train_perceptron(changed, number, labels, self.names, self.settings)
        steps = (len(self.names) - len(TOTALS)) // len(SIGNALS)
        return train_net(changed, number, names=self.names, labels=labels, steps=steps, settings=self.settings)

    def validate(self, folds: Sequence[Mask], split: str) -> Validation:
        """Train once for every fold and judge the samples it leaves out."""

        def judge(training: Mask, test: Mask) -> NDArray[np.float64]:
            return self.fit(training).probabilities(self.plain[test])

        return cross_validate(self.data.number, self.data.person, folds, judge, labels=self.data.labels, split=split)

    def folds(self, split: str, most: int = 10) -> list[Mask]:
        """Give the test parts: "subjects" for people who are not in the training, two at a time; "random" for a fifth of the samples."""
        return (leave_subjects_out(self.data.person, 2) if split == "subjects" else random_split(len(self.plain)))[:most]

    def held_out(self, most: int = 10) -> Validation:
        """Judge people who are not in the training."""
        return self.validate(self.folds("subjects", most), "subjects")

    def random(self, most: int = 10) -> Validation:
        """Judge a random fifth of the samples at a time."""
        return self.validate(self.folds("random", most), "random")


def study(data: RealSet, settings: PerceptronTraining | CurveTraining, curves: CurveConfig = CURVES, n_copies: int = COPIES) -> Study:
    """Make the curves of a data set, and changed copies."""
    plain = Curves(curves).process_many(data.events).astype(np.float32)
    changed = copies(data.events, curves, VariationConfig(), n=n_copies, seed=settings.seed) if n_copies else None
    return Study(data, curve_names(curves), plain, changed, settings)


def thirteen(data: RealSet, settings: PerceptronTraining) -> Study:
    """Take the thirteen features instead; there are no changed copies of these."""
    return Study(data, FEATURE_NAMES, data.thirteen.astype(np.float32), None, settings)


def learning_curve(made: Study, counts: Sequence[int], seeds: Sequence[int]) -> list[dict[str, float]]:
    """Train on more and more people, test on the same four others; rows of people, samples and accuracy, means over the seeds."""
    rows = []
    for count in counts:
        found = []
        for seed in seeds:
            people = np.random.default_rng(seed).permutation(np.unique(made.data.person))
            test, training = np.isin(made.data.person, people[:4]), np.isin(made.data.person, people[4 : 4 + count])
            right = made.fit(training).probabilities(made.plain[test]).argmax(axis=-1) == made.data.number[test]
            found.append((float(training.sum()), float(right.mean())))
        samples, accuracy = np.mean(found, axis=0)
        rows.append({"people": float(count), "samples": float(samples), "accuracy": float(accuracy)})
    return rows


def transfer(training: Study, test: Study) -> Validation:
    """Train on one data set, test on another that has the same gestures."""
    probabilities = training.fit().probabilities(test.plain)
    return Validation("all", training.data.labels, probabilities, test.data.number, test.data.person, 1)


def event_times(made: Study, model: GestureModel | CurveNet, repeat: int) -> list[float]:
    """Milliseconds from the feature maps of one event to its probabilities; for the thirteen features: of the classifier only."""
    if model.names == FEATURE_NAMES:
        return measure(lambda: model.probabilities(made.plain[0]), repeat=repeat)
    events = itertools.cycle(made.data.events.select(np.array([k])) for k in range(min(20, len(made.plain))))
    extractor = Curves(replace(CURVES, steps=(len(model.names) - len(TOTALS)) // len(SIGNALS)))
    return measure(lambda: model.probabilities(extractor.process_many(next(events))[0]), repeat=repeat)


def model_bytes(model: GestureModel | CurveNet) -> int:
    """Size of the model's file."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "model.npz"
        if isinstance(model, CurveNet):
            save_net(model, path)
        else:
            save_model(model, path)
        return path.stat().st_size


def matrix(validation: Validation) -> dict[str, Any]:
    """Give a confusion matrix and the recalls as plain data."""
    recall = {name: float(value) for name, value in zip(validation.labels, validation.recall, strict=True)}
    return {"labels": list(validation.labels), "confusion": validation.confusion.tolist(), "recall": recall}


def default_training(quick: bool) -> PerceptronTraining | CurveTraining:
    """Give the network where PyTorch is installed, else the perceptron."""
    if importlib.util.find_spec("torch") is None:
        return PerceptronTraining(passes=10 if quick else 32)
    return CurveTraining(passes=6 if quick else 60)


def figures(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Measure everything.

    Parameters
    ----------
    quick : bool
        Few samples and two folds, to see that it runs.
    keep : Path or None
        Folder for what is simulated to train on; None: it is thrown away.

    Returns
    -------
    dict
        Accuracies by data set and split over all segments and, unless quick, with ``_gestures`` behind the name without those that hold
        none, and ``_closing`` on these (`benchmarks.gestures_closing`); ``mhomeges_to_mtranssee`` (the five shared gestures, no sample of
        the second set in training), size and operations of the model, ``confusion``, ``learning_curve`` and ``choices``; with the figures
        of `gestures_transfer` and `gestures_daily`.
    """
    from benchmarks import gestures_daily, gestures_transfer  # these need this module

    limit, folds, n_copies = (1500, 2, 2) if quick else (0, 10, COPIES)
    settings = default_training(quick)
    ours, other = read("mhomeges", limit), read("mtranssee", limit)
    sets = {"mhomeges": study(ours, settings, n_copies=n_copies), "mtranssee": study(other, settings, n_copies=n_copies)}
    first = sets["mhomeges"]
    result: dict[str, Any] = {"real_classifier": type(settings).__name__, "real_samples": len(ours.label), "confusion": {}}
    for name, made in sets.items():
        data = made.data
        closing = from_the_end(data.label, data.person, data.distance)
        if not quick:
            result[f"{name}_closing"] = closing_figures(made.plain, data.label, data.number, data.person, data.distance)
        for split, short in (("subjects", "held_out"), ("random", "random")):
            parts = made.folds(split, folds)
            found = made.validate(parts, split)
            result[f"{name}_{short}"] = found.accuracy
            result |= {} if quick else {f"{name}_{short}_gestures": accuracy_without(found, parts, closing)}
            result["confusion"][f"{name}_{short}"] = matrix(found)
    moved = transfer(study(ours.only(other.labels), settings, n_copies=n_copies), sets["mtranssee"])
    result["mhomeges_to_mtranssee"], result["confusion"]["mhomeges_to_mtranssee"] = moved.accuracy, matrix(moved)
    model = first.fit()
    result |= {"real_model_bytes": model_bytes(model), "real_model_flop": model.flop}
    result["learning_curve"] = learning_curve(first, (2, 6) if quick else (1, 2, 4, 8, 14), (1,))
    simulated = gestures_transfer.figures(first, quick, keep)
    result["confusion"] |= simulated.pop("confusion")
    rows = choices(first, model, quick) + simulated.pop("choices")
    return result | simulated | gestures_daily.figures(first, quick, keep) | {"choices": rows}


def choices(first: Study, model: GestureModel | CurveNet, quick: bool) -> list[dict[str, Any]]:
    """Measure each choice's accuracy on the same held-out people (the first `CHOICE_FOLDS` folds) beside its time."""
    rows, reference = [], event_times(first, model, 20 if quick else 200)
    for name, made in _variants(first, quick):
        accuracy = made.held_out(CHOICE_FOLDS).accuracy
        few = made.data.person == made.data.person[0]  # times do not depend on how well it is trained
        times = reference if made is first else event_times(made, made.fit(few), 20 if quick else 200)
        rows.append(choice("gestures of real people", name, accuracy=("held out", accuracy, ""), times_ms=times, reference_ms=reference))
    return rows


def _variants(first: Study, quick: bool) -> Iterator[tuple[str, Study]]:
    """Name and study of each choice; the first is the default."""
    perceptron = PerceptronTraining(passes=10 if quick else 32)
    yield "curves", first
    yield "thirteen features, 32 neurons", thirteen(first.data, replace(perceptron, hidden=(32,), regularisation=0.01))
    for hidden in (16, 48):
        yield f"perceptron, {hidden} neurons", replace(first, settings=replace(perceptron, hidden=(hidden,)))
    if quick:
        return
    yield "no changed copies", replace(first, changed=None)
    for steps in (7, 20):
        yield f"{steps} steps", study(first.data, first.settings, replace(CURVES, steps=steps))
    if isinstance(first.settings, CurveTraining):
        yield "half the channels and passes", replace(first, settings=replace(first.settings, channels=(40, 48), hidden=32, passes=30))


run = figures
