"""What the knobs of events, features and training gain and cost: 400 samples of ten people, two people left out at a time."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.gesture_tables import counted
from benchmarks.gestures_speed import four_tracks, simulated
from benchmarks.report import against_first, timed
from benchmarks.stores import kept
from radar_core import RadarInfo
from radar_core.config import load_file
from radar_core.paths import find_config
from radar_gestures.stage import EventStage, GestureConfig
from radar_lab.datasets.readings import collect
from radar_lab.datasets.samples import SampleSet
from radar_lab.datasets.synthesis import synthesise
from radar_lab.datasets.synthesis_plan import named_plan
from radar_lab.training.training import TrainingConfig, fit, validate
from radar_lab.training.validation import leave_subjects_out
from radar_tracking import TrackedCloud

REPETITIONS: Final = 4
_ACCURACY: Final = "recognised, people held out"


def configs() -> dict[str, GestureConfig]:
    """Every setting of events and features that is measured; each differs from the default, which stands first, in one thing."""
    default = GestureConfig()
    features: dict[str, list[Any]] = {
        "angles": ["offset", "sensor"],
        "smoothing": [0.0, 0.14],
        "median": [0.0, 0.2],
        "lateral": [0.2, 100.0],
        "weak": [10.0, 30.0],
        "gate": [0.26],
    }
    events: dict[str, list[Any]] = {"release": [0.8], "quiet": [0.15], "max_duration": [1.0], "min_duration": [0.1, 0.25]}
    made = {"default": default}
    for group, knobs in (("features", features), ("events", events)):
        for knob, values in knobs.items():
            for value in values:
                part = dataclasses.replace(getattr(default, group), **{knob: value})
                made[f"{knob}={value}"] = dataclasses.replace(default, **{group: part})
    made["margin=0"] = dataclasses.replace(default, margin=0.0)
    made["preset thesis"] = load_file(GestureConfig, find_config("thesis", "gestures", ".yaml"))
    return made


def trainings() -> dict[str, TrainingConfig]:
    """Every setting of the training that is measured, layers aside (`gesture_tables`); the default stands first."""
    default = TrainingConfig()
    knobs: dict[str, list[Any]] = {"regularisation": [1e-3, 1.0], "balanced": [False]}
    made = {"default": default}
    return made | {f"{knob}={value}": dataclasses.replace(default, **{knob: value}) for knob, values in knobs.items() for value in values}


def accuracy(samples: SampleSet, training: TrainingConfig) -> float:
    """Share of the performed gestures that a model of other people names right; without an event they are wrong."""
    found = counted(validate(samples, leave_subjects_out(samples.person), training), samples)
    return float(found["recognised"])


def stage_times(config: GestureConfig, clouds: list[TrackedCloud], info: RadarInfo) -> list[float]:
    """Milliseconds of maps, events and features of four tracks, cloud by cloud."""
    stage = EventStage(config, info.mount)
    return [timed(stage.process, tracked)[1] for tracked in clouds][5:]  # the first ones compile


def naming_times(samples: SampleSet, training: TrainingConfig) -> list[float]:
    """Milliseconds of naming an event, one at a time."""
    model = fit(samples, np.ones(len(samples.label), np.bool_), training)
    return [timed(model.probabilities, row)[1] for row in samples.features[:200]][20:]


def measure(folder: Path, quick: bool, n_jobs: int) -> list[dict[str, Any]]:
    """Make the samples that are missing, and measure every setting on them."""
    plan = named_plan("subjects", **({"n_subjects": 4, "repetitions": 2} if quick else {"repetitions": REPETITIONS}))
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
        return {"choices": measure(folder, quick, n_jobs)}
