"""Gestures of one's own and people: models that learn from few recorded samples, on top of a model that there is or from nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from radar_core import ConfigError, DataError
from radar_core.types import Float64Array, IndexArray
from radar_gestures.classifiers.classifier import Classifier
from radar_gestures.classifiers.enrolled import Base, Enrolled
from radar_gestures.event_maps import join
from radar_gestures.inputs import inputs_for
from radar_gestures.recognizer import make_extractor
from radar_gestures.stage import GestureConfig, config_for
from radar_lab.datasets.readings import collect, read
from radar_lab.datasets.samples import SampleSet, join_samples, read_manifest, read_sample, sample_files
from radar_lab.training.training import TrainingConfig, fit, of_labels, usual_labels
from radar_lab.training.tuning import TuningConfig, tune, usual_tuning
from radar_lab.training.variation import copies


@dataclass(frozen=True, eq=False)
class Samples:
    """Recorded samples as a model takes them: those whose gesture was found with the model's own settings."""

    features: Float64Array  # shape (n, n_features)
    gestures: tuple[str, ...]  # length n
    person: IndexArray  # shape (n,)
    missed: tuple[str, ...]  # gestures of the samples in which nothing was found
    changed: Float64Array | None = None  # shape (n_copies, n, n_features): changed copies, where the model takes feature maps

    def of(self, person: int | None) -> Samples:
        """Return those of one person; None: all."""
        if person is None:
            return self
        return self._select(np.flatnonzero(self.person == person), self.missed)

    def only(self, gestures: Sequence[str]) -> Samples:
        """Return those of some gestures."""
        keep = np.flatnonzero([name in gestures for name in self.gestures])
        return self._select(keep, tuple(name for name in self.missed if name in gestures))

    def _select(self, keep: IndexArray, missed: tuple[str, ...]) -> Samples:
        changed = None if self.changed is None else self.changed[:, keep]
        return Samples(self.features[keep], tuple(self.gestures[k] for k in keep), self.person[keep], missed, changed)


def read_for(folders: Sequence[str | Path], model: Classifier, n_copies: int = 0, seed: int = 1) -> Samples:
    """Read the samples of data sets into features of a model, and make changed copies of those that are made of feature maps.

    Raises `DataError` when there are none, or nothing is found in any.
    """
    config = config_for(model.settings, GestureConfig())
    _, extract = make_extractor(model.extractor, model.settings)
    rows, gestures, people, missed, maps = [], [], [], [], []
    for path in (path for folder in folders for path in sample_files(folder)):
        reading = read(read_sample(path), config)
        view = reading.event.views[0] if reading.event is not None and reading.event.views else None
        features = None if view is None else extract(view)
        if view is None or features is None:
            missed.append(reading.gesture)
            continue
        rows.append(features)
        maps.append(view.maps)
        gestures.append(reading.gesture)
        people.append(reading.person)
    if not rows:
        raise DataError(f"{', '.join(map(str, folders))}: the model's event detector finds a gesture in none of {len(missed)} samples")
    changed = None
    if n_copies and model.extractor != "events":
        inputs = inputs_for(model.extractor, model.settings)
        changed = copies(join([one for one in maps if one is not None]), inputs, n=n_copies, seed=seed).astype(np.float64)
    return Samples(np.array(rows, np.float64), tuple(gestures), np.array(people, np.int64), tuple(missed), changed)


def learn(folders: Sequence[str | Path], base: Base | None, tuning: TuningConfig | None = None) -> Base:
    """Teach a model the gestures of recorded samples.

    Parameters
    ----------
    folders : sequence of str or Path
        Data sets of single samples.
    base : GestureModel, CurveNet or None
        What learns them beside those that it knows; None: a perceptron that knows nothing else, made with the data sets' own settings.
    tuning : TuningConfig or None
        None: what is usual for the base.

    Raises
    ------
    DataError
        When there are no samples, or too few of a gesture.
    ConfigError
        When the data sets were made with different settings, or hold one gesture only where there is no base.
    """
    if base is not None:
        tuning = tuning or usual_tuning(base)
        samples = read_for(folders, base, tuning.copies, tuning.seed)
        return tune(base, samples.features, samples.gestures, tuning, samples.changed)
    made = join_samples([_features(folder) for folder in folders])
    labels = [name for number, name in enumerate(made.labels) if np.any(made.label == number)]
    if len(labels) < 2:
        raise ConfigError(
            f"there are only samples of {', '.join(labels) or 'nothing'}; record a second gesture, or name a --base that knows others"
        )
    usual = usual_labels(made) if made.labels != tuple(labels) else labels
    chosen = [name for name in usual if name in labels]
    few = of_labels(made, chosen)
    return fit(few, np.ones(len(few.label), np.bool_), TrainingConfig(), labels=chosen)


def _features(folder: str | Path) -> SampleSet:
    settings = read_manifest(folder)["settings"]
    return collect(folder, config_for(settings, GestureConfig()))


def enrol(model: Base | Enrolled, person: str, samples: Samples, tuning: TuningConfig | None = None) -> Enrolled:
    """Adapt a model to a person by three to five samples of each gesture; a head that the person had before is replaced.

    Raises `ConfigError` when the samples hold gestures that the model does not know (let it learn them first), or the name is empty.
    """
    if not person.strip():
        raise ConfigError("the person needs a name")
    known = model if isinstance(model, Enrolled) else Enrolled(model, {})
    unknown = sorted({name for name in samples.gestures if name not in known.labels})
    if unknown:
        raise ConfigError(f"the model does not know {', '.join(unknown)}; teach it with handwave gesture train first")
    head = tune(known.base, samples.features, samples.gestures, tuning, samples.changed)
    return Enrolled(known.base, {**known.heads, person: head})


@dataclass(frozen=True)
class Outcome:
    """How a model names recorded samples."""

    right: int
    total: int
    named: dict[str, dict[str, int]]  # by what was performed: what it was named, "random" and "missed" among them, and how often

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the share of right ones, by Wilson's score; (0, 1) of nothing."""
        if not self.total:
            return 0.0, 1.0
        n, share, z = self.total, self.right / self.total, 1.96
        middle, half = share + z * z / (2 * n), z * math.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
        return (middle - half) / (1 + z * z / n), (middle + half) / (1 + z * z / n)


def judge(model: Classifier, samples: Samples) -> Outcome:
    """Name recorded samples; unknown ones are random, and those in which no event was found are missed."""
    named: dict[str, dict[str, int]] = {}
    for features, gesture in zip(samples.features, samples.gestures, strict=True):
        p = model.probabilities(features)
        label = model.labels[int(np.argmax(p))]
        said = label if label == "random" or model.known(features, p) else "random"
        row = named.setdefault(gesture, {})
        row[said] = row.get(said, 0) + 1
    for gesture in samples.missed:
        row = named.setdefault(gesture, {})
        row["missed"] = row.get("missed", 0) + 1
    right = sum(row.get(gesture, 0) for gesture, row in named.items())
    return Outcome(right, sum(sum(row.values()) for row in named.values()), named)
