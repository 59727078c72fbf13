"""What features are made of, and who names them: gestures of people left out that are recognised, beside the time."""

from __future__ import annotations

import dataclasses
import functools
import importlib.util
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Found, Panel, measure_together, of_share, timed
from benchmarks.stores import sources
from benchmarks.tradeoff.echoes import INFO, busy
from benchmarks.tradeoff.people import moments
from benchmarks.tradeoff.stages import StudyConfig
from radar_core import DataError
from radar_core.config import load_file
from radar_core.paths import find_config
from radar_core.transmitters import one_transmitter, one_transmitter_frame
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.stage import EventStage, GestureConfig
from radar_lab.datasets.readings import collect, cubes
from radar_lab.datasets.samples import SampleSet
from radar_lab.datasets.synthesis import synthesise
from radar_lab.datasets.synthesis_plan import named_plan
from radar_lab.training.training import TrainingConfig, fit, validate
from radar_lab.training.validation import Mask, Validation, cross_validate, leave_subjects_out
from radar_tracking import PeopleTracker, TrackedCloud

_FIGURE = "gestures recognised, people left out"
_DEFAULT = "2 transmitters, 50 Hz, relative angles"
SOURCE = Panel("feature source", _FIGURE, "", "higher", _DEFAULT, "the baseband's time of as many frames")
CLASSIFIER = Panel("classifier", _FIGURE, "", "higher", "MLP 13-32-10", "bare numpy products of the default's layers")
_QUICK = (_DEFAULT, "angles of the sensor", "1 transmitter", "25 Hz")
_LAYERS = ((8,), (16,), (32,), (64,), (128, 64))
_CNN = "feature cube and CNN"
_PACKAGES = ("radar_core", "radar_sim", "radar_dsp", "radar_tracking", "radar_gestures")


def strokes(study: StudyConfig) -> Path:
    """Simulate strokes of several people with one transmitter and with both; what is in the folder already is not made again."""
    plan = named_plan("subjects", **study.pick({"n_subjects": 4, "repetitions": 2}, {"n_subjects": 8, "repetitions": 5}))
    folder = study.folder / f"strokes-{plan.n_samples}-{study.seed}-{sources(_PACKAGES)[:8]}"
    synthesise(folder, plan.n_samples, seed=study.seed, n_jobs=1, plan=plan, body="ellipsoids", one_tx=True, progress=False)
    return folder


def _folds(person: NDArray[np.int64], study: StudyConfig) -> list[Mask]:
    """Leave two people out at a time, of four quick ones one: of the others enough is left to train with."""
    return leave_subjects_out(person, study.pick(1, 2))


def recognised(found: Validation, samples: SampleSet) -> tuple[float, int]:
    """Share of performed gestures named right, and their number; one without an event is wrong, a random movement without one is right."""
    right = np.diag(found.confusion).astype(float)
    right[0] += samples.missed[0]
    performed = int((found.confusion.sum(axis=1) + samples.missed).sum())
    return float(right.sum() / performed), performed


@functools.lru_cache(maxsize=2)
def _tracked(study: StudyConfig) -> tuple[TrackedCloud, ...]:
    """People who walk, tracked: for times only."""
    info, found = moments("two_crossing", dataclasses.replace(study, scene=None))
    tracker = PeopleTracker(None, info)
    return tuple(TrackedCloud(moment.cloud, tracker.process(moment.cloud)) for moment in found)


def _stage_ms(config: GestureConfig, study: StudyConfig) -> list[float]:
    """Milliseconds of events and features, cloud by cloud."""
    stage, times = EventStage(config, INFO.mount), []
    for tracked in _tracked(study):
        times.append(timed(stage.process, tracked)[1])
    return times[5:]  # the first ones compile


def _sources() -> dict[str, tuple[GestureConfig, int, int]]:
    """Name the configurations of events and features, every how many'th frame, and how many transmitters."""
    default = GestureConfig()

    def features(**knobs: Any) -> GestureConfig:
        return dataclasses.replace(default, features=dataclasses.replace(default.features, **knobs))

    return {
        _DEFAULT: (default, 1, 2),
        "angles of the sensor": (features(angles="sensor"), 1, 2),
        "offsets in metres": (features(angles="offset"), 1, 2),
        "no medians": (features(median=0.0), 1, 2),
        "neighbours count fully": (features(lateral=100.0), 1, 2),
        "preset thesis": (load_file(GestureConfig, find_config("thesis", "gestures", ".yaml")), 1, 2),
        "1 transmitter": (default, 1, 1),
        "25 Hz": (default, 2, 2),
        "17 Hz": (default, 3, 2),
    }


def _baseband_ms(study: StudyConfig) -> dict[int, list[float]]:
    """Time the baseband with one transmitter and with both."""
    frame = busy(np.random.default_rng(study.seed))[1]
    one = one_transmitter(INFO)
    alone = one_transmitter_frame(frame, INFO)
    both, single = Baseband(BasebandConfig(), INFO), Baseband(BasebandConfig(), one)
    times = measure_together({"2": partial(both.process, frame), "1": partial(single.process, alone)}, repeat=study.pick(20, 100))
    return {2: times["2"], 1: times["1"]}


def _feature_sources(folder: Path, study: StudyConfig) -> tuple[Found, SampleSet]:
    """Compare what features are made of; times are of baseband, events and features for one second of radar."""
    found, baseband, training = Found(), _baseband_ms(study), TrainingConfig()
    first: SampleSet | None = None
    reference = (50.0 * np.asarray(baseband[2])).tolist()
    choices = _sources()
    for name in study.pick(_QUICK, tuple(choices)):
        config, every, n_tx = choices[name]
        samples = collect(folder, config, every=every, one_tx=n_tx == 1)
        first = first or samples
        try:
            judged = validate(samples, _folds(samples.person, study), training)
        except DataError as error:
            found.leave_out(SOURCE.name, name, f"too few events are found with it ({error})")
            continue
        share, n = recognised(judged, samples)
        times = (50.0 / every * (np.asarray(_stage_ms(config, study)) + np.median(baseband[n_tx]))).tolist()
        found.rows.append(SOURCE.row(name, share, times, reference, margin=of_share(share, n)))
    assert first is not None
    return found, first


def _bare(layers: tuple[NDArray[np.float32], ...]) -> Callable[[], Any]:
    """Make the products of a perceptron's layers and nothing else."""
    start = np.ones(layers[0].shape[0], np.float32)

    def call() -> Any:
        values = start
        for layer in layers:
            values = values @ layer
        return values

    return call


def _perceptrons(samples: SampleSet, study: StudyConfig) -> tuple[Found, list[float]]:
    found, folds, one = Found(), _folds(samples.person, study), samples.features[0]
    every, names = np.ones(len(samples.label), np.bool_), {}
    for hidden in study.pick(_LAYERS[1:4], _LAYERS):
        names["-".join(map(str, (samples.features.shape[1], *hidden, 10)))] = TrainingConfig(hidden=hidden)
    models = {name: fit(samples, every, training) for name, training in names.items()}
    calls: dict[str, Callable[[], Any]] = {"": _bare(fit(samples, every, TrainingConfig()).weights)}
    calls |= {name: partial(model.probabilities, one) for name, model in models.items()}
    times = measure_together(calls, repeat=study.pick(200, 2000), warmup=10)
    for name, training in names.items():
        share, n = recognised(validate(samples, folds, training), samples)
        found.rows.append(CLASSIFIER.row(f"MLP {name}", share, times[name], times[""], margin=of_share(share, n)))
    return found, times[""]


def _network(folder: Path, samples: SampleSet, study: StudyConfig, reference: list[float], found: Found) -> None:
    """Train the convolutional network on the same people, where PyTorch and the ONNX runtime are installed."""
    missing = [name for name in ("torch", "onnx", "onnxruntime") if importlib.util.find_spec(name) is None]
    if missing:
        found.leave_out(CLASSIFIER.name, _CNN, f"{' and '.join(missing)} not installed; pip install 'handwave[train]'")
        return
    from radar_core import GESTURES
    from radar_lab.training.cnn import CnnConfig, CnnModel, export
    from radar_lab.training.cnn_training import cnn_judge, train_cnn

    given = cubes(folder, GestureConfig())
    judge = cnn_judge(given.cube, given.label, CnnConfig(epochs=study.pick(3, 40)))
    judged = cross_validate(given.label, given.person, _folds(given.person, study), judge, labels=GESTURES, split="subjects")
    share, n = recognised(judged, dataclasses.replace(samples, missed=given.missed))
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "network.onnx"
        export(train_cnn(given.cube[:64], given.label[:64], CnnConfig(epochs=1)), path, given.cube.shape[1:])
        model = CnnModel(path)
        times = measure_together({"": partial(model.probabilities, given.cube[:1])}, repeat=study.pick(50, 300), warmup=10)
    found.rows.append(CLASSIFIER.row(_CNN, share, times[""], reference, margin=of_share(share, n)))


def measure(study: StudyConfig) -> Found:
    """Compare sources of features and classifiers on simulated strokes of people who are left out of the training."""
    folder = strokes(study)
    features, samples = _feature_sources(folder, study)
    classifiers, reference = _perceptrons(samples, study)
    _network(folder, samples, study, reference, classifiers)
    return Found(features.rows + classifiers.rows, features.left_out + classifiers.left_out)
