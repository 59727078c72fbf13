"""Figures of gesture accuracy as the thesis has them: ten classes (4.10), frame rates and transmitters (table 4.1)."""

from __future__ import annotations

import functools
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import Memory

from benchmarks.gesture_model import model_file
from benchmarks.report import against_first, matrix, measure_together, timed
from benchmarks.stores import PACKAGES, kept, sources
from radar_core import RadarFrame
from radar_core.transmitters import one_transmitter, one_transmitter_frame
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.stage import EventStage, GestureConfig
from radar_lab.datasets.readings import collect
from radar_lab.datasets.samples import MANIFEST, SampleSet, read_manifest, sample_files
from radar_lab.datasets.synthesis import synthesise
from radar_lab.datasets.synthesis_plan import Plan, named_plan
from radar_lab.training.operations import operations
from radar_lab.training.training import TrainingConfig, fit, train_on, validate
from radar_lab.training.validation import Validation, leave_subjects_out, random_split
from radar_sim import Action, Person, Scene, Simulator
from radar_sim.motions.strokes import library_hash
from radar_tracking import TrackedCloud, make_tracker

_SIMULATED: Final = (*PACKAGES, "radar_lab/datasets/synthesis.py", "radar_lab/datasets/synthesis_plan.py")
_READ: Final = ("radar_core", "radar_tracking", "radar_gestures", "radar_lab/datasets")
RATES: Final = ((1, 50), (2, 25), (3, 17))  # every n-th frame, and the rate [Hz]
CONFIG: Final = TrainingConfig()


def data_set(folder: Path, quick: bool, n_jobs: int) -> Path:
    """Simulate what the folder does not hold yet: ten people, ten gestures, fifteen times (section 4.3); quickly four people, thrice."""
    plan: Plan = named_plan("subjects", **({"n_subjects": 4, "repetitions": 2} if quick else {}))
    place, body = folder / f"{'few' if quick else 'subjects'}_{sources(_SIMULATED)}", "ellipsoids" if quick else "mesh"
    if not holds(place, plan, body):
        synthesise(place, plan.n_samples, seed=1, n_jobs=n_jobs, plan=plan, body=body, one_tx=True)
    return place


def holds(place: Path, plan: Plan, body: str) -> bool:
    """Whether all samples are there, whatever features stand in their files: `Readings` makes these anew."""
    if not (place / MANIFEST).is_file():
        return False
    found = read_manifest(place)
    wanted = {"seed": 1, "plan": json.loads(json.dumps(plan.written)), "body": body, "one_tx": True, "motions": library_hash()}
    return {name: found[name] for name in wanted} == wanted and len(sample_files(place)) == plan.n_samples


class Readings:
    """Events and features of a data set at every frame rate, read once; ``keep``: folder for what was read; None: read again."""

    def __init__(self, place: Path, keep: Path | None, n_jobs: int) -> None:
        memory = Memory(keep, verbose=0)
        self._collect = memory.cache(_collect, ignore=["n_jobs"])
        self._place, self._n_jobs = place, n_jobs
        self._key = key_of(place)

    def samples(self, every: int = 1, one_tx: bool = False) -> SampleSet:
        """Features and labels."""
        return self._collect(self._key, self._place, every, one_tx, n_jobs=self._n_jobs)


Key = tuple[str, str, int]
"""What is read depends on: our sources, what the samples are, and how many."""


def key_of(place: Path, parts: tuple[str, ...] = ()) -> Key:
    """Key of all that is read from a data set; ``parts``: of our sources, beside those that find events and features."""
    return sources((*_READ, *parts)), json.dumps(read_manifest(place)), len(sample_files(place))


def _collect(key: Key, place: Path, every: int, one_tx: bool, n_jobs: int) -> SampleSet:
    return collect(place, GestureConfig(), every=every, one_tx=one_tx, n_jobs=n_jobs)


def counted(found: Validation, samples: SampleSet) -> dict[str, Any]:
    """Figures of a validation; ``recognised`` counts gestures without an event as wrong, and random movements without one as right."""
    return {**found.figures(), "recognised": recognised(found, samples)[0], "missed": int(samples.missed[1:].sum())}


def recognised(found: Validation, samples: SampleSet) -> tuple[float, int]:
    """Share of performed gestures named right, and their number; one without an event is wrong, a random movement without one is right."""
    right = float(np.diag(found.confusion).sum() + samples.missed[0])
    performed = int(found.confusion.sum() + samples.missed.sum())
    return right / performed, performed


def ten_classes(samples: SampleSet) -> tuple[dict[str, Any], dict[str, Validation]]:
    """Accuracy with two people left out at a time, and with the thesis's random split."""
    folds = {"subjects": leave_subjects_out(samples.person), "random": random_split(len(samples.label))}
    found = {split: validate(samples, masks, CONFIG, split=split) for split, masks in folds.items()}
    held_out = found["subjects"]
    return {
        "accuracy_held_out": held_out.accuracy,
        "accuracy_random": found["random"].accuracy,
        "worst_class": float(np.nanmin(held_out.recall)),
        "held_out": counted(held_out, samples),
    }, found


def frame_times(n_tx: int, n_frames: int) -> list[float]:
    """Milliseconds of every frame from the raw samples to the event step, one person gesturing."""
    person = Person(position=(2.3, 0.0), script=tuple(Action(gesture=name) for name in ("push", "swipe_left", "wave")))
    simulator = Simulator(Scene(duration=6.0, people=(person,)))
    frames: Sequence[RadarFrame] = [simulator.process(k).frame for k in range(min(n_frames, simulator.n_frames))]
    info = simulator.info
    if n_tx == 1:
        frames, info = [one_transmitter_frame(frame, info) for frame in frames], one_transmitter(info)
    baseband, tracker = Baseband(BasebandConfig(), info), make_tracker(None, info)
    stage = EventStage(GestureConfig(), info.mount)

    def step(frame: RadarFrame) -> None:
        cloud = baseband.process(frame).to_room(info.mount)
        stage.process(TrackedCloud(cloud, tracker.process(cloud)))

    return [timed(step, frame)[1] for frame in frames]


def table_4_1(readings: Readings, quick: bool) -> tuple[dict[str, dict[str, dict[str, float]]], list[dict[str, Any]]]:
    """Accuracy and time of a frame at three rates with both transmitters and with one; the loss of directions is in the clouds."""
    times = {n_tx: frame_times(n_tx, 60 if quick else 250) for n_tx in (2, 1)}
    table: dict[str, dict[str, dict[str, float]]] = {}
    rows = {}
    for n_tx in (2, 1):
        for every, rate in RATES:
            samples = readings.samples(every, n_tx == 1)
            found = counted(validate(samples, leave_subjects_out(samples.person), CONFIG), samples)
            table.setdefault(f"{rate} Hz", {})[f"{n_tx} Tx"] = {
                **{name: found[name] for name in ("accuracy", "recognised", "missed")},
                "frame_ms": float(np.median(times[n_tx])),
                "busy": float(np.median(times[n_tx])) * rate * 1e-3,
            }
            rows[f"{rate} Hz, {n_tx} Tx"] = found["accuracy"], [value * rate for value in times[n_tx]]
    return table, against_first("frame rate and transmitters, time per second", "held-out accuracy", rows)


def hidden_neurons(samples: SampleSet, quick: bool) -> list[dict[str, Any]]:
    """Accuracy and time of perceptrons of several sizes."""
    rows = {}
    for hidden in ((32,), (8,)) if quick else ((32,), (8,), (16,), (64,), (32, 32)):
        config = TrainingConfig(hidden=hidden)
        found = validate(samples, leave_subjects_out(samples.person), config)
        model = fit(samples, np.ones(len(samples.label), np.bool_), config)
        times = measure_together({"": functools.partial(model.probabilities, samples.features[0])}, repeat=200, warmup=10)[""]
        rows[f"hidden={'-'.join(map(str, hidden))}, {operations(model)} FLOP"] = found.accuracy, times
    return against_first("perceptron", "held-out accuracy", rows)


def repeats(samples: SampleSet) -> bool:
    """Whether training twice gives the same file, bit for bit."""
    first, second = (model_file(train_on(samples, CONFIG).model) for _ in range(2))
    return first == second


def measure(folder: Path, quick: bool, n_jobs: int) -> dict[str, Any]:
    """Make the data set and all tables. Returns flat figures, ``table_4_1``, ``confusion`` and ``choices``."""
    readings = Readings(data_set(folder, quick, n_jobs), folder / "read", n_jobs)
    samples = readings.samples()
    flat, found = ten_classes(samples)
    by_rate, rate_rows = table_4_1(readings, quick)
    flat |= {"repeats_bit_for_bit": repeats(samples), "n_samples": len(samples.label) + int(samples.missed.sum())}
    confusion = {name: matrix(one) for name, one in found.items()}
    rows = rate_rows + hidden_neurons(samples, quick)
    return {**flat, "table_4_1": by_rate, "confusion": confusion, "choices": rows}


def run(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Make the tables; see `measure`."""
    n_jobs = 1 if quick else os.cpu_count() or 1
    with kept(keep) as folder:
        return measure(folder, quick, n_jobs)
