"""Synthetic to real: trained on simulated push, pull, up, down and circle alone, tested on real people of mHomeGes and mTransSee.

No recorded sample is in the training. How people gesture, how long and how far, and how many points their radar gave was looked up in the
recordings of four people, `DEVELOPMENT`, and in figures of all recordings that need no labels: where the radar stood, how loud points were,
which range rates occurred, how long segments are. The main figures are of the other fourteen people of mHomeGes, and of all eight of
mTransSee. They were seen three times on the way; the last change was to widen the bounds of `gesture_drills` to all that had been tried,
between which the four people could not decide.

Two things differ between the worlds and say little about gestures, so neither training nor test sees them: how strong echoes are (the demo
of the radar gives intensities in a unit of its own), and what stands still (its firmware removes some of it). `LEFT_OUT` names the signals.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.gesture_drills import LABELS, Drills, draw_drill, generate, read_drill, simulate
from benchmarks.gesture_studies import (
    CELLS,
    COPIES,
    CURVES,
    FEW,
    GATES,
    MAX_SPEED,
    PerceptronTraining,
    RealSet,
    Study,
    person_of,
    read,
    usual_inputs,
)
from benchmarks.report import choices, matrix, measure, share
from benchmarks.stores import kept
from radar_gestures.cells import CellConfig
from radar_gestures.event_maps import EventMaps, join, locate
from radar_gestures.features import FEATURE_NAMES
from radar_gestures.inputs import InputMaker, Inputs
from radar_gestures.maps import feature_maps
from radar_gestures.signals import CurveConfig
from radar_lab.training.networks import CurveTraining
from radar_lab.training.validation import Validation
from radar_lab.training.variation import copies

DEVELOPMENT: Final = (801, 804, 812, 822)
"""People of mHomeGes on whose recordings the simulation was set; they are in no figure but their own."""
LEFT_OUT: Final = ("still", "strength", "count")  # signals whose name has one of these words read 0 in training and test
SAMPLES: Final = 2000
_FEWER: Final = (250, 500, 1000)
_TIMED: Final = 10  # drills, two of each gesture


def masked(vectors: NDArray[np.float32], names: Sequence[str]) -> NDArray[np.float32]:
    """Set what the two worlds do not share (`LEFT_OUT`) to 0 in vectors, shape (..., n_features) = ``names``."""
    kept = np.array([not any(word in name for word in LEFT_OUT) for name in names])
    return np.where(kept, vectors, np.float32(0.0))


def seen_moving(events: EventMaps) -> tuple[EventMaps, NDArray[np.float64]]:
    """Leave out the cells that stand still; also give where the bodies are, which these tell best."""
    body, maps = locate(events, CELLS.nearest, CELLS.farthest), events.maps.copy()
    maps[3][:, np.abs(events.speed) < CURVES.slow] = np.nan
    return replace(events, maps=maps), body


def simulated(place: Path, n: int) -> RealSet:
    """Read the first drills of a folder as if they were recordings; those of which the radar saw nothing are left out."""
    gate = GATES["mhomeges"]
    maps, label, distance = [], [], []
    for number in range(n):
        name, far, clouds = read_drill(place, number)
        if not any(len(cloud) for cloud in clouds):
            continue
        maps.append(feature_maps(person_of(clouds, gate)[0], gate, MAX_SPEED))
        label.append(name)
        distance.append(far)
    person = np.arange(len(label))  # each drill is somebody else's
    return RealSet(join(maps), np.array(label), person, np.array(distance), np.zeros((len(label), len(FEATURE_NAMES))))


def transfer_training(quick: bool) -> PerceptronTraining | CurveTraining:
    """Give the network where PyTorch is installed, else the perceptron; fewer passes than on recordings: it fits drills less."""
    if importlib.util.find_spec("torch") is None:
        return PerceptronTraining(passes=4 if quick else 20)
    return CurveTraining(passes=4 if quick else 16)


def vectors_of(events: EventMaps, inputs: Inputs) -> NDArray[np.float32]:
    """Make the vectors of events, shape (n, n_features), without what is left out."""
    return _each(inputs, events, lambda one, seen, body: InputMaker((one,)).process_many(seen, body).astype(np.float32))


def transfer_study(data: RealSet, config: PerceptronTraining | CurveTraining, n_copies: int = COPIES) -> Study:
    """Make the vectors of simulated events and changed copies, without what is left out."""
    inputs = usual_inputs(config)
    changed = _each(inputs, data.events, lambda one, seen, body: copies(seen, (one,), n=n_copies, seed=config.seed, body=body))
    return Study(data, InputMaker(inputs).names, vectors_of(data.events, inputs), changed, config, inputs)


def _each(
    inputs: Inputs,
    events: EventMaps,
    make: Callable[[CellConfig | CurveConfig, EventMaps, NDArray[np.float64] | None], NDArray[np.float32]],
) -> NDArray[np.float32]:
    """Make the vectors of each kind of inputs without what is left out, one behind the other."""
    found = []
    for one in inputs:
        seen, body = seen_moving(events) if isinstance(one, CellConfig) else (events, None)
        found.append(masked(make(one, seen, body), InputMaker((one,)).names))
    return np.concatenate(found, axis=-1)


def judge(training: Study, test: RealSet) -> Validation:
    """Train on all simulated events, and name the recorded ones of the same gestures."""
    test = test.only(training.data.labels)
    labels = training.data.labels
    assert training.inputs is not None
    vectors = vectors_of(test.events, training.inputs)
    number = np.searchsorted(labels, test.label)  # a test set need not hold every gesture
    return Validation("all", labels, training.fit().probabilities(vectors), np.asarray(number), test.person, 1)


def figures(made: Study, quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Simulate, train, and test on recordings.

    Returns ``synthetic_to_real``: accuracy over the five gestures of the fourteen people of mHomeGes (``made``) who are not in
    `DEVELOPMENT`; ``synthetic_to_real_development``: of these four; ``synthetic_to_mtranssee``: over push, pull, up and circle of
    mTransSee; ``confusion`` of the first and the last; ``choices``: accuracy and time to simulate by number of drills.
    """
    n = 10 if quick else SAMPLES
    drills, config = Drills(), transfer_training(quick)
    with kept(keep) as folder:
        data = simulated(generate(drills, n, folder), n)
    training = transfer_study(data, config, 1 if quick else COPIES)
    developed = np.isin(made.data.person, DEVELOPMENT)
    tests = {
        "synthetic_to_real": made.data.select(~developed),
        "synthetic_to_real_development": made.data.select(developed),
        "synthetic_to_mtranssee": read("mtranssee", FEW if quick else 0),
    }
    validations = {name: judge(training, test) for name, test in tests.items()}
    timed, repeat, warmup = (len(LABELS), 1, 0) if quick else (_TIMED, 3, 1)
    times = measure(lambda: [simulate(draw_drill(drills, number)) for number in range(timed)], repeat=repeat, warmup=warmup)
    each = [time / timed for time in times]
    result: dict[str, Any] = {}
    for name, validation in validations.items():
        right = validation.probabilities.argmax(axis=-1) == validation.label
        result |= share(name, int(right.sum()), len(right))
    result |= {"synthetic_samples": len(data.label), "synthetic_seconds_per_sample": float(np.median(each)) * 1e-3}
    result["confusion"] = {name: matrix(validations[name]) for name in ("synthetic_to_real", "synthetic_to_mtranssee")}
    accuracy = {n: validations["synthetic_to_real"].accuracy}
    for fewer in () if quick else _FEWER:
        part = transfer_study(data.select(data.person < fewer), config)
        accuracy[fewer] = judge(part, tests["synthetic_to_real"]).accuracy
    values = {f"{count} drills": accuracy[count] for count in sorted(accuracy)}
    taken = {f"{count} drills": [value * count for value in each] for count in accuracy}
    return result | {"choices": choices("synthetic to real", ("fourteen real people", ""), values, taken, f"{n} drills")}
