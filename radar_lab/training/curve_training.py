"""Training the network on curves and cells from data sets of single gestures: on events that the detector finds."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from radar_core import DataError, vocabulary
from radar_core.types import Float32Array, Float64Array, IndexArray
from radar_gestures.classifiers.curve_net import CurveNet
from radar_gestures.classifiers.model import save_model
from radar_gestures.event_maps import EventMaps, join
from radar_gestures.inputs import USUAL, InputMaker, Inputs, kind_of
from radar_gestures.maps import FeatureMaps
from radar_gestures.presets import usual_config
from radar_gestures.stage import GestureConfig, feature_settings
from radar_lab.datasets.readings import read
from radar_lab.datasets.samples import info_of, read_sample, sample_files
from radar_lab.training.networks import CurveTraining, train_net
from radar_lab.training.training import reject_limit
from radar_lab.training.validation import Mask, Validation, cross_validate, leave_subjects_out
from radar_lab.training.variation import copies

COPIES: Final = 8  # changed ones of every training sample
REMEMBERED: Final = 20  # samples of each label that the model keeps, so that it can learn from few samples later without forgetting
_FOLDS: Final = 5


@dataclass(frozen=True, eq=False)
class CurveReport:
    """What training found out."""

    model: CurveNet
    validation: Validation  # of people left out of the training
    lost: float  # share of their gestures that is rejected or called random
    missed: dict[str, int]  # gestures in which the detector found no event, by name


@dataclass(frozen=True, eq=False)
class _Events:
    """Detected events of data sets."""

    maps: EventMaps
    gestures: tuple[str, ...]
    person: IndexArray
    missed: dict[str, int]
    config: GestureConfig


def train_curves(
    folders: Sequence[str | Path],
    out: str | Path | None = None,
    config: CurveTraining | None = None,
    *,
    labels: Sequence[str] | None = None,
    gestures: GestureConfig | None = None,
    inputs: Inputs = USUAL,
    lost: float = 0.05,
    farther: bool = False,
) -> CurveReport:
    """Train a network on curves, on cells or on both, and write it to ``out``; needs PyTorch (extra ``train``).

    Figures and the limit for rejection come from people left out; the model itself is then trained on everybody, and remembers some of its
    samples (`tuning`).

    Parameters
    ----------
    folders : sequence of str or Path
        Data sets of single samples, all of radars with the same Doppler step.
    out : str or Path or None
        Model file (.npz); None: write nothing.
    config : CurveTraining or None
        The network; None: the defaults.
    inputs : Inputs
        What maps become; of more than one kind, each has a network of its own, and they are averaged.
    labels : sequence of str or None
        What to tell apart; None: all that occurs.
    gestures : GestureConfig or None
        Knobs of events; None: what `usual_config` gives for the first sample's radar. The model names them, and brings them along.
    lost : float
        Share of known gestures given up to reject unknown ones.
    farther : bool
        Whether people will stand farther from the radar than those of the samples: see `variation.copies`.

    Raises
    ------
    ConfigError, DataError
        Without PyTorch; when there are no samples, those of fewer than two people, or fewer than two labels.
    """
    config = config or CurveTraining()
    events = _read(folders, gestures, labels)
    names = [name for name in (labels or vocabulary(events.gestures)) if name in events.gestures]
    if len(names) < 2:
        raise DataError(f"there are detected events of {', '.join(names) or 'nothing'} only; it takes two gestures to tell apart")
    number = np.array([names.index(name) for name in events.gestures], np.int64)
    plain = InputMaker(inputs).process_many(events.maps).astype(np.float32)
    changed = copies(events.maps, inputs, n=COPIES, seed=config.seed, farther=farther)
    maps = dataclasses.asdict(events.config.maps)
    knobs = {kind_of(one): dataclasses.asdict(one) for one in inputs}
    settings: dict[str, Any] = {**feature_settings(events.config), "maps": maps, **knobs}

    def made(rows: Mask) -> CurveNet:
        return train_net(changed[:, rows], number[rows], labels=names, inputs=inputs, config=config, settings=settings)

    def judge(known: Mask, test: Mask) -> Float64Array:
        return made(known).probabilities(plain[test])

    folds = leave_subjects_out(events.person, max(2, len(np.unique(events.person)) // _FOLDS), seed=config.seed)
    validation = cross_validate(number, events.person, folds, judge, labels=tuple(names), split="subjects")
    model = made(np.ones(len(number), np.bool_))
    score = model.score(plain[:0].reshape(-1, plain.shape[1]), validation.probabilities)
    limit, given_up = reject_limit(validation, score, lost)
    figures = validation.figures() | {"lost": given_up, "training": json.loads(json.dumps(dataclasses.asdict(config)))}
    model = remember(dataclasses.replace(model, reject=limit, figures=figures), plain, number, seed=config.seed)
    if out is not None:
        save_model(model, out)
    return CurveReport(model, validation, given_up, events.missed)


def remember(model: CurveNet, features: Float32Array, label: IndexArray, n: int = REMEMBERED, *, seed: int = 1) -> CurveNet:
    """Let a network remember some samples of each label, see `CurveNet.memory`; ``features`` have shape (n_samples, n_features)."""
    rng = np.random.default_rng([seed, 0x3E3])
    rows = np.concatenate([rng.permutation(np.flatnonzero(label == number))[:n] for number in range(len(model.labels))])
    return dataclasses.replace(model, memory=model.inputs(features[rows]).astype(np.float16), remembered=label[rows].astype(np.int64))


def _read(folders: Sequence[str | Path], gestures: GestureConfig | None, labels: Sequence[str] | None) -> _Events:
    """Find the event of every sample; people of different data sets are different people."""
    maps: list[FeatureMaps] = []
    names: list[str] = []
    people: list[int] = []
    missed: dict[str, int] = {}
    numbers: dict[tuple[int, int], int] = {}
    for place, folder in enumerate(folders):
        for path in sample_files(folder):
            sample = read_sample(path)
            if labels is not None and str(sample["gesture"]) not in labels:
                continue
            gestures = gestures or usual_config(info_of(sample))
            reading = read(sample, gestures)
            found = None if reading.event is None else reading.event.maps
            if found is None or not len(found.stamp_ns):
                missed[reading.gesture] = missed.get(reading.gesture, 0) + 1
            elif reading.event is not None and reading.event.walked <= gestures.walk_distance:
                maps.append(found)
                names.append(reading.gesture)
                people.append(numbers.setdefault((place, reading.person), len(numbers)))
    if not maps or gestures is None:
        raise DataError(f"{', '.join(map(str, folders))}: no event was found in any sample")
    return _Events(join(maps), tuple(names), np.array(people, np.int64), missed, gestures)
