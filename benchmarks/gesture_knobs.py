"""What the knobs of events, features and training gain and cost: 400 samples of ten people, two people left out at a time."""

from __future__ import annotations

import dataclasses
import functools
import importlib.util
import operator
import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.gesture_networks import network
from benchmarks.gesture_tables import recognised
from benchmarks.gestures_speed import four_tracks, simulated
from benchmarks.report import Found, Panel, against_first, measure, measure_together, of_share, timed, varied
from benchmarks.stores import kept, sources
from benchmarks.tradeoff.echoes import INFO, busy
from benchmarks.tradeoff.people import moments
from benchmarks.tradeoff.stages import StudyConfig
from radar_core import GESTURES, DataError, RadarInfo
from radar_core.config import load_file
from radar_core.paths import find_config
from radar_core.transmitters import one_transmitter, one_transmitter_frame
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.stage import EventStage, GestureConfig
from radar_lab.datasets.readings import collect, cubes
from radar_lab.datasets.samples import SampleSet
from radar_lab.datasets.synthesis import synthesise
from radar_lab.datasets.synthesis_plan import named_plan
from radar_lab.training.cnn import CnnConfig
from radar_lab.training.networks import cnn_judge
from radar_lab.training.training import TrainingConfig, fit, validate
from radar_lab.training.validation import Mask, cross_validate, leave_subjects_out
from radar_tracking import TrackedCloud, make_tracker

REPETITIONS: Final = 4
KNOBS: Final[dict[str, tuple[Any, ...]]] = {
    "features.angles": ("offset", "sensor"), "features.smoothing": (0.0, 0.14), "features.median": (0.0, 0.2),
    "features.lateral": (0.2, 100.0), "features.weak": (10.0, 30.0), "features.gate": (0.26,), "events.release": (0.8,),
    "events.quiet": (0.15,), "events.max_duration": (1.0,), "events.min_duration": (0.1, 0.25),
}  # fmt: skip
_ACCURACY: Final = "recognised, people held out"


def configs() -> dict[str, GestureConfig]:
    """Every setting of events and features that is measured; each differs from the default, which stands first, in one thing."""
    made = {name.split(".", 1)[-1]: config for name, config in varied(GestureConfig, KNOBS).items()}
    made["margin=0"] = dataclasses.replace(GestureConfig(), margin=0.0)
    return made | {"preset thesis": load_file(GestureConfig, find_config("thesis", "gestures", ".yaml"))}


def trainings() -> dict[str, TrainingConfig]:
    """Every setting of the training that is measured, layers aside (`gesture_tables`); the default stands first."""
    return varied(TrainingConfig, {"regularisation": (1e-3, 1.0), "balanced": (False,)})


def accuracy(samples: SampleSet, training: TrainingConfig) -> float:
    """Share of the performed gestures that a model of other people names right; without an event they are wrong."""
    return recognised(validate(samples, leave_subjects_out(samples.person), training), samples)[0]


def stage_times(config: GestureConfig, clouds: Sequence[TrackedCloud], info: RadarInfo) -> list[float]:
    """Milliseconds of maps, events and features, cloud by cloud."""
    stage = EventStage(config, info.mount)
    return [timed(stage.process, tracked)[1] for tracked in clouds][5:]  # the first ones compile


def naming_times(samples: SampleSet, training: TrainingConfig) -> list[float]:
    """Milliseconds of naming an event, one at a time."""
    model = fit(samples, np.ones(len(samples.label), np.bool_), training)
    return [timed(model.probabilities, row)[1] for row in samples.features[:200]][20:]


def measured(folder: Path, quick: bool, n_jobs: int) -> list[dict[str, Any]]:
    """Make the samples that are missing, and measure every setting on them."""
    plan = named_plan("subjects", **({"n_subjects": 4, "repetitions": 1} if quick else {"repetitions": REPETITIONS}))
    synthesise(folder, plan.n_samples, seed=5, n_jobs=n_jobs, plan=plan, body="ellipsoids")
    _, clouds, info = simulated(quick, 60 if quick else 300)
    tracked = four_tracks(clouds)
    events_by, training = (list(found.items())[: 2 if quick else None] for found in (configs(), trainings()))
    read = {name: collect(folder, config, n_jobs=n_jobs) for name, config in events_by}
    default = read["default"]
    events = {name: (accuracy(read[name], TrainingConfig()), stage_times(config, tracked, info)) for name, config in events_by}
    named = {name: (accuracy(default, one), naming_times(default, one)) for name, one in training}
    return against_first("events and features, four tracks", _ACCURACY, events) + against_first("training, one event", _ACCURACY, named)


def run(quick: bool = False, keep: Path | None = None, n_jobs: int | None = None) -> dict[str, Any]:
    """Measure the knobs beside the event stage's time of four tracks, or that of naming one event; a quarter of an hour of one core."""
    n_jobs = n_jobs if n_jobs is not None else (1 if quick else os.cpu_count() or 1)
    with kept(keep) as folder:
        return {"choices": measured(folder, quick, n_jobs)}


_FIGURE = "gestures recognised, people left out"
_BOTH = "2 transmitters, 50 Hz, relative angles"
SOURCE = Panel("feature source", _FIGURE, "", "higher", _BOTH, "the baseband's time of as many frames")
CLASSIFIER = Panel("classifier", _FIGURE, "", "higher", "MLP 13-32-10", "bare numpy products of the default's layers")
_QUICK = (_BOTH, "angles of the sensor", "1 transmitter", "25 Hz")
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


def _sources() -> dict[str, tuple[GestureConfig, int, int]]:
    """Name the configurations of events and features, every how many'th frame, and how many transmitters."""
    made = configs()
    default = made["default"]
    names = {"angles of the sensor": "angles=sensor", "offsets in metres": "angles=offset", "no medians": "median=0.0"}
    names |= {"neighbours count fully": "lateral=100.0", "preset thesis": "preset thesis"}
    varied = {name: (made[knob], 1, 2) for name, knob in names.items()}
    return {_BOTH: (default, 1, 2), **varied, "1 transmitter": (default, 1, 1), "25 Hz": (default, 2, 2), "17 Hz": (default, 3, 2)}


def _baseband_ms(study: StudyConfig) -> dict[int, list[float]]:
    """Time the baseband with one transmitter and with both."""
    frame = busy(np.random.default_rng(study.seed))[1]
    both, single = Baseband(BasebandConfig(), INFO), Baseband(BasebandConfig(), one_transmitter(INFO))
    calls = {"2": partial(both.process, frame), "1": partial(single.process, one_transmitter_frame(frame, INFO))}
    return {int(name): times for name, times in measure_together(calls, repeat=study.pick(20, 100)).items()}


def _feature_sources(folder: Path, study: StudyConfig) -> tuple[Found, SampleSet]:
    """Compare what features are made of; times are of baseband, events and features for one second of radar."""
    found, baseband, training = Found(), _baseband_ms(study), TrainingConfig()
    info, walk = moments("two_crossing", dataclasses.replace(study, scene=None))  # people who walk, for times only
    tracker = make_tracker(None, info)
    tracked = [TrackedCloud(moment.cloud, tracker.process(moment.cloud)) for moment in walk]
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
        times = (50.0 / every * (np.asarray(stage_times(config, tracked, INFO)) + np.median(baseband[n_tx]))).tolist()
        found.rows.append(SOURCE.row(name, share, times, reference, margin=of_share(share, n)))
    assert first is not None
    return found, first


def _perceptrons(samples: SampleSet, study: StudyConfig) -> tuple[Found, list[float]]:
    found, folds, one = Found(), _folds(samples.person, study), samples.features[0]
    every, names = np.ones(len(samples.label), np.bool_), {}
    for hidden in study.pick(_LAYERS[1:4], _LAYERS):
        names["-".join(map(str, (samples.features.shape[1], *hidden, 10)))] = TrainingConfig(hidden=hidden)
    models = {name: fit(samples, every, training) for name, training in names.items()}
    layers = fit(samples, every, TrainingConfig()).weights
    calls: dict[str, Callable[[], Any]] = {"": partial(functools.reduce, operator.matmul, layers, np.ones(len(layers[0]), np.float32))}
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
    given = cubes(folder, GestureConfig())
    judge = cnn_judge(given.cube, given.label, CnnConfig(epochs=study.pick(3, 40)))
    judged = cross_validate(given.label, given.person, _folds(given.person, study), judge, labels=GESTURES, split="subjects")
    share, n = recognised(judged, dataclasses.replace(samples, missed=given.missed))
    times = measure(partial(network(given).probabilities, given.cube[:1]), repeat=study.pick(50, 300), warmup=10)
    found.rows.append(CLASSIFIER.row(_CNN, share, times, reference, margin=of_share(share, n)))


def features(study: StudyConfig) -> Found:
    """Compare sources of features and classifiers on simulated strokes of people who are left out of the training."""
    folder = strokes(study)
    found, samples = _feature_sources(folder, study)
    classifiers, reference = _perceptrons(samples, study)
    _network(folder, samples, study, reference, classifiers)
    return found + classifiers
