"""Gestures of real people from what others did: mHomeGes to mTransSee, and simulated drills to both.

From set to set: trained on the five gestures that both have, of all people of mHomeGes, as `handwave lab train --farther` does, because
people of mTransSee stood farther away. No recording of mTransSee is in the training; how much places scatter for that was chosen on four
of its people, `FAR_DEVELOPMENT`, who are in the figure, and ``..._others`` is without them.

From simulation: trained on simulated push, pull, up, down and circle alone. No recorded sample is in the training. How people gesture,
how long and how far, and how many points their radar gave was looked up in the recordings of four people, `DEVELOPMENT`, and in figures of
all recordings that need no labels: where the radar stood, how loud points were, which range rates occurred, how long segments are. The main
figures are of the other fourteen people of mHomeGes, and of all of mTransSee. They were seen three times on the way (of mTransSee eight of
the 19 people); the last change was to widen the bounds of `gesture_drills` to all that had been tried, between which the four people could
not decide.

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
    study,
    usual_inputs,
)
from benchmarks.gestures_people import by_people, default_training, trained
from benchmarks.report import choices, matrix, measure
from benchmarks.stores import kept
from radar_gestures.cells import CellConfig
from radar_gestures.classifiers.curve_net import CurveNet
from radar_gestures.classifiers.perceptron import GestureModel
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
FAR_DEVELOPMENT: Final = (8, 12, 13, 17)
"""People of mTransSee on whom `FARTHER` was chosen."""
LEFT_OUT: Final = ("still", "strength", "count")  # signals whose name has one of these words read 0 in training and test
SAMPLES: Final = 2000
_FEWER: Final = (250, 500, 1000)
_SAME: Final = 0.01  # m: distances that data sets state are no nearer to each other
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


def judge(training: Study, network: GestureModel | CurveNet, test: RealSet) -> Validation:
    """Name the recorded events of the gestures that a network learned from simulated ones."""
    test = test.only(training.data.labels)
    labels = training.data.labels
    assert training.inputs is not None
    vectors = vectors_of(test.events, training.inputs)
    number = np.searchsorted(labels, test.label)  # a test set need not hold every gesture
    return Validation("all", labels, network.probabilities(vectors), np.asarray(number), test.person, 1)


def between_sets(config: PerceptronTraining | CurveTraining, quick: bool, keep: Path | None) -> dict[str, Any]:
    """Train on the gestures of mHomeGes that mTransSee has, too, and name all of mTransSee."""
    limit, n_copies = (FEW, 1) if quick else (0, COPIES)
    ours, other = read("mhomeges", limit), read("mtranssee", limit)

    def work() -> NDArray[np.float64]:
        training = study(ours.only(other.labels), config, n_copies=n_copies, farther=True)
        return training.fit().probabilities(study(other, config, n_copies=0).plain)

    probabilities = trained(keep, f"{usual_inputs(config)} {config} {limit} {n_copies} farther", "mhomeges", "to_mtranssee", work)
    found = Validation("all", other.labels, probabilities, other.number, other.person, 1)
    key = "mhomeges_to_mtranssee"
    people = {f"{key}_{what}": value for what, value in by_people(found).items()}
    right, beyond = probabilities.argmax(axis=-1) == other.number, other.distance > ours.distance.max() + _SAME
    far = {f"{key}_within": float(right[~beyond].mean()), f"{key}_beyond": float(right[beyond].mean()) if beyond.any() else None}
    others = ~np.isin(other.person, FAR_DEVELOPMENT)
    far[f"{key}_others"] = float(right[others].mean()) if others.any() else None
    return {key: found.accuracy, f"{key}_samples": len(other.label), **people, **far, "confusion": {key: matrix(found)}}


def from_simulation(config: PerceptronTraining | CurveTraining, quick: bool, folder: Path, keep: Path | None) -> dict[str, Any]:
    """Train on simulated drills, on fewer of them, too, and name recordings; see `figures`."""
    n, n_copies, drills = 10 if quick else SAMPLES, 1 if quick else COPIES, Drills()
    place = generate(drills, n, folder)
    data, ours = simulated(place, n), read("mhomeges", FEW if quick else 0)
    developed = np.isin(ours.person, DEVELOPMENT)
    tests = {
        "synthetic_to_real": ours.select(~developed),
        "synthetic_to_real_development": ours.select(developed),
        "synthetic_to_mtranssee": read("mtranssee", FEW if quick else 0),
    }
    found: dict[int, dict[str, Validation]] = {}
    for count in (n, *((n // 2,) if quick else _FEWER)):

        def work(count: int = count) -> dict[str, Validation]:
            training = transfer_study(data.select(data.person < count), config, n_copies)
            network = training.fit()
            return {name: judge(training, network, test) for name, test in tests.items()}

        settings = f"{usual_inputs(config)} {config} {place.name} {LEFT_OUT} {len(ours.label)} {n_copies}"
        found[count] = trained(keep, settings, "drills", str(count), work)
    result: dict[str, Any] = {"synthetic_samples": len(data.label)}
    for name, validation in found[n].items():
        result[name] = validation.accuracy
        result |= {f"{name}_{what}": value for what, value in by_people(validation).items()}
    result["confusion"] = {name: matrix(found[n][name]) for name in ("synthetic_to_real", "synthetic_to_mtranssee")}
    return result | _by_drills({count: one["synthetic_to_real"].accuracy for count, one in found.items()}, drills, n, quick)


def _by_drills(accuracy: dict[int, float], drills: Drills, n: int, quick: bool) -> dict[str, Any]:
    """Put accuracy by number of drills beside the time to simulate them."""
    timed, repeat, warmup = (len(LABELS), 1, 0) if quick else (_TIMED, 3, 1)
    times = measure(lambda: [simulate(draw_drill(drills, number)) for number in range(timed)], repeat=repeat, warmup=warmup)
    each = [time / timed for time in times]
    values = {f"{count} drills": accuracy[count] for count in sorted(accuracy)}
    taken = {f"{count} drills": [value * count for value in each] for count in accuracy}
    rows = choices("synthetic to real", ("fourteen real people", ""), values, taken, f"{n} drills")
    return {"synthetic_seconds_per_sample": float(np.median(each)) * 1e-3, "choices": rows}


def figures(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Measure both.

    ``quick``: few samples, to see that it runs; ``keep``: folder for what is simulated and for what networks answered: the same command
    goes on where it stopped; None: nothing is kept.
    Returns ``mhomeges_to_mtranssee``: accuracy over mTransSee's five gestures, no sample of which is in training, ``_within``
    and ``_beyond``: at the distances of mHomeGes and farther away, ``_others``: of people on whom nothing was chosen;
    ``synthetic_to_real``: trained on simulated drills alone, accuracy over the five gestures of the fourteen people of mHomeGes who are
    not in `DEVELOPMENT`;
    ``synthetic_to_real_development``: of these four; ``synthetic_to_mtranssee``: over push, pull, up and circle of mTransSee; each with
    ``_interval`` (bootstrap over people) and ``_people`` (of each); ``confusion``; ``choices``: accuracy and time to simulate by number of
    drills.
    """
    recorded = between_sets(default_training(quick), quick, keep)
    with kept(keep) as folder:
        simulation = from_simulation(transfer_training(quick), quick, folder, keep)
    return recorded | simulation | {"confusion": recorded["confusion"] | simulation["confusion"]}


run = figures
