"""Recordings of real people's gestures as vectors to train on: mHomeGes and mTransSee through the product's maps, curves and cells."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.recordings import folder
from radar_core import DataError, PointCloud
from radar_core.config import config, knob, load_file
from radar_core.paths import find_config
from radar_gestures.cells import CellConfig
from radar_gestures.classifiers.curve_net import CurveNet
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.event_maps import EventMaps, join, locate
from radar_gestures.features import FEATURE_NAMES, FeatureConfig, extract, summarise
from radar_gestures.inputs import InputMaker, Inputs
from radar_gestures.maps import MapConfig, feature_maps
from radar_gestures.signals import CurveConfig
from radar_gestures.stage import GestureConfig
from radar_lab.importers import open_original
from radar_lab.importers.recording import Segment
from radar_lab.training.networks import CurveTraining, train_net
from radar_lab.training.validation import Mask, Validation, cross_validate, leave_subjects_out, random_split
from radar_lab.training.variation import copies

GATES: Final = {"mhomeges": 0.356, "mtranssee": 0.3347}  # m/s: the Doppler step of each set's radar
MAX_SPEED: Final = 4.2  # m/s: no arm was faster
LONGEST: Final = 4.0  # s: of a longer segment, the beginning; in the rest people often walk up to the radar
CURVES: Final = CurveConfig(nearest=1.0, farthest=5.5)
"""People stood at 1.2 to 4.8 m; what is nearer is somebody at the desk, what is farther came over a wall."""
CELLS: Final = CellConfig(nearest=CURVES.nearest, farthest=CURVES.farthest)
BOTH: Final[Inputs] = (CELLS, CURVES)
CHOICE_FOLDS: Final = 2  # of the ten: what the choices are compared on
COPIES: Final = 8  # changed ones of every training sample
FEW: Final = 120  # segments of each set in quick runs
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


def event_config() -> GestureConfig:
    """Give the preset for radars with so few frames and gates, with the gates of mHomeGes's."""
    preset, gate = load_file(GestureConfig, find_config("slow_radar", "gestures", ".yaml")), GATES["mhomeges"]
    return replace(preset, features=FeatureConfig(gate=gate, body_speed=gate / 2), maps=MapConfig(max_speed=MAX_SPEED))


@dataclass(frozen=True, eq=False)
class RealSet:
    """Labelled events of one data set."""

    events: EventMaps  # their feature maps
    label: NDArray[np.str_]  # shape (n,): as the data set names them; mTransSee's in mHomeGes's words
    person: NDArray[np.int64]  # shape (n,): whose
    distance: NDArray[np.float64]  # shape (n,): of the person from the radar [m]
    thirteen: NDArray[np.float64]  # shape (n, 13): the features of section 4.2; 0 where there was too little motion for them

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
        return self.select(np.isin(self.label, labels))

    def select(self, chosen: Mask) -> RealSet:
        """Events that a mask picks."""
        index = np.flatnonzero(chosen)
        return RealSet(self.events.select(index), self.label[index], self.person[index], self.distance[index], self.thirteen[index])


def files(kind: str) -> list[Path]:
    """Files of a data set, in the order of their people; raise DataError without recordings."""
    found = sorted((folder() / kind).glob("segments*.npz"))
    if not found:
        raise DataError(f"{folder() / kind / 'segments.npz'}: not there; docs/reference/recordings.md says where the original is")
    return found


@functools.cache
def read(kind: str, limit: int = 0) -> RealSet:
    """Read a data set through the importer, or the first ``limit`` segments of it, and make its feature maps; see `files`."""
    found: list[Segment] = []
    maps, thirteen = [], []
    for path in files(kind)[: 1 if limit else None]:
        recording = open_original(kind, path, limit=limit, idle=0.0)
        for clouds in _segments(recording.items, recording.tally.segments):
            own, body = person_of(clouds, GATES[kind])
            maps.append(feature_maps(own, GATES[kind], MAX_SPEED))
            thirteen.append(thirteen_of(own, body, GATES[kind]))
        found += recording.tally.segments
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
    """Keep the points near the body that `locate` finds, of the first `LONGEST` seconds; also its distance [m] and angles [rad]."""
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


def thirteen_of(clouds: Sequence[PointCloud], body: tuple[float, float, float], gate: float) -> NDArray[np.float64]:
    """Give the thirteen features of a segment, shape (13,), 0 where there is too little motion; ``clouds`` and ``body``: of `person_of`."""
    config = FeatureConfig(gate=gate, body_speed=gate / 2)
    found = extract([summarise(cloud, body, config) for cloud in clouds], clouds[0].stamp_ns, config)
    return found if found is not None else np.zeros(len(FEATURE_NAMES))


def train_perceptron(
    changed: NDArray[np.float32], number: NDArray[np.int64], labels: Sequence[str], names: Sequence[str], config: PerceptronTraining
) -> GestureModel:
    """Train a perceptron with scikit-learn on copies of the samples, shape (n_copies, n, n_features), that the passes take in turn.

    The first copy sets the standardisation; ``number``: index into ``labels``, shape (n,); ``names``: of the inputs.
    """
    from sklearn.neural_network import MLPClassifier

    mean, scale = changed[0].mean(axis=0), changed[0].std(axis=0) + 1e-3
    net = MLPClassifier(
        config.hidden, alpha=config.regularisation, batch_size=min(config.batch, len(number)),
        learning_rate_init=config.learning_rate, random_state=config.seed,
    )  # fmt: skip
    first = config.passes - max(1, round(config.averaged * config.passes))
    total: list[NDArray[np.float64]] = []
    for turn in range(config.passes):
        x = changed[turn % len(changed)]
        net.partial_fit(((x - mean) / scale).astype(np.float32), number, classes=np.arange(len(labels)))
        if turn >= first:
            layers = [np.asarray(part, np.float64) for part in (*net.coefs_, *net.intercepts_)]
            total = layers if not total else [a + b for a, b in zip(total, layers, strict=True)]
    mean_layers = [(part / (config.passes - first)).astype(np.float32) for part in total]
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
    """A data set as vectors, ready to train on."""

    data: RealSet
    names: tuple[str, ...]
    plain: NDArray[np.float32]  # shape (n, n_features): samples as they are
    changed: NDArray[np.float32] | None  # shape (n_copies, n, n_features), or None: changed copies
    config: PerceptronTraining | CurveTraining
    inputs: Inputs | None  # what the vectors are; None: the thirteen features

    def fit(self, rows: Mask | None = None, others: Study | None = None) -> GestureModel | CurveNet:
        """Train on some of the samples, None: on all, and on all samples of ``others``, who made the same gestures."""
        changed, number = self.samples(rows)
        if others is not None:
            assert others.data.labels == self.data.labels
            assert others.names == self.names
            more, numbers = others.samples()
            changed, number = np.concatenate([changed, more], axis=1), np.concatenate([number, numbers])
        labels = self.data.labels
        if isinstance(self.config, PerceptronTraining) or self.inputs is None:
            assert isinstance(self.config, PerceptronTraining)  # networks take curves or cells
            return train_perceptron(changed, number, labels, self.names, self.config)
        return train_net(changed, number, labels=labels, inputs=self.inputs, config=self.config)

    def samples(self, rows: Mask | None = None) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Give what a training takes of some samples, None: of all: copies, shape (n_copies, n, n_features), and labels, shape (n,)."""
        own = np.ones(len(self.plain), np.bool_) if rows is None else rows
        return self.plain[None, own] if self.changed is None else self.changed[:, own], self.data.number[own]

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


def study(
    data: RealSet,
    config: PerceptronTraining | CurveTraining,
    inputs: Inputs | None = None,
    n_copies: int = COPIES,
    *,
    farther: bool = False,
) -> Study:
    """Make the vectors of a data set, and changed copies; ``inputs`` None: see `usual_inputs`; ``farther``: see `copies`."""
    inputs = inputs if inputs is not None else usual_inputs(config)
    plain = InputMaker(inputs).process_many(data.events).astype(np.float32)
    changed = copies(data.events, inputs, n=n_copies, seed=config.seed, farther=farther) if n_copies else None
    return Study(data, InputMaker(inputs).names, plain, changed, config, inputs)


def usual_inputs(config: PerceptronTraining | CurveTraining) -> Inputs:
    """Give what networks take unless a study says otherwise, cells and curves, or a perceptron, curves."""
    return BOTH if isinstance(config, CurveTraining) else (CURVES,)


def thirteen(data: RealSet, config: PerceptronTraining) -> Study:
    """Take the thirteen features instead; there are no changed copies of these."""
    return Study(data, FEATURE_NAMES, data.thirteen.astype(np.float32), None, config, None)
