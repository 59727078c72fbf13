"""Gestures of real people: mHomeGes and mTransSee, people held out, through the product's feature maps, curves and cells."""

from __future__ import annotations

import functools
import importlib.util
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks import gestures_daily, gestures_shipped, gestures_transfer
from benchmarks.gesture_model import model_file
from benchmarks.gesture_studies import (
    CELLS,
    CHOICE_FOLDS,
    COPIES,
    CURVES,
    FEW,
    PerceptronTraining,
    Study,
    files,
    read,
    study,
    thirteen,
    usual_inputs,
)
from benchmarks.report import against_first, matrix, measure
from benchmarks.stores import digest, once, sources
from radar_core import DataError
from radar_gestures.cells import CellConfig, maker_of
from radar_gestures.classifiers.curve_net import CurveNet
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.features import FEATURE_NAMES
from radar_lab.training.networks import CurveTraining
from radar_lab.training.operations import operations
from radar_lab.training.validation import Mask, Validation, leave_subjects_out

REACH: Final = 0.8  # m: body and arms are that near the distance that the data set states
FEWEST: Final = 6  # detections of a person in a whole segment; medians are above 60 everywhere


def from_the_end(label: NDArray[np.str_], person: NDArray[np.int64], distance: NDArray[np.float64], back: int = 0) -> Mask:
    """Mark the last segment of every recording (person, gesture, distance), or ``back`` ones before; DataError without segments."""
    if not len(label) or not len(label) == len(person) == len(distance):
        raise DataError(f"{len(label)} labels, {len(person)} people and {len(distance)} distances; each segment needs one of each")
    change = (label[1:] != label[:-1]) | (person[1:] != person[:-1]) | (distance[1:] != distance[:-1])
    end = np.flatnonzero(np.append(change, True))
    start = np.concatenate([[0], end[:-1] + 1])
    marked = np.zeros(len(label), np.bool_)
    marked[(end - back)[end - back >= start]] = True
    return marked


def nobody_in(kind: str) -> Mask:
    """Mark the segments of a data set in which `nobody_there` sees nobody, in the order of `read`."""
    return np.concatenate([nobody_there(path) for path in files(kind)])


def nobody_there(path: Path) -> Mask:
    """Mark the segments with hardly a detection within `REACH` of the distance at which the person is said to stand."""
    with np.load(path, allow_pickle=False) as file:
        xyz, offset, distance = file["xyz_mm"].astype(np.float32) * 1e-3, file["offset"].astype(np.int64), file["distance_m"]
    near = np.abs(np.linalg.norm(xyz, axis=1) - np.repeat(distance, np.diff(offset))) < REACH
    return np.asarray(np.diff(np.concatenate([[0], np.cumsum(near)])[offset]) < FEWEST)


def accuracy_without(validation: Validation, folds: Sequence[Mask], left_out: Mask) -> float:
    """Give the share of tested samples with the right label, those that a mask over all samples marks left out."""
    right = validation.probabilities.argmax(axis=-1) == validation.label
    return float(right[~left_out[np.any(folds, axis=0)]].mean())


def alone(vectors: NDArray[np.float32], number: NDArray[np.int64], person: NDArray[np.int64], chosen: Mask) -> float:
    """Train on some segments' curves only, test on the same of other people: the accuracy, which is chance where they hold nothing."""
    from sklearn.ensemble import ExtraTreesClassifier

    x, y = vectors[chosen], number[chosen]
    right = np.zeros(len(y), np.bool_)
    for test in leave_subjects_out(person[chosen], 2):
        trees = ExtraTreesClassifier(200, min_samples_leaf=2, max_features=0.1, random_state=1).fit(x[~test], y[~test])
        right[test] = trees.predict(x[test]) == y[test]
    return float(right.mean())


def closing_figures(
    vectors: NDArray[np.float32], number: NDArray[np.int64], person: NDArray[np.int64], closing: Mask, nobody: Mask, others: Mask
) -> dict[str, Any]:
    """Measure what segments without a gesture hold, beside others from near the end of the same recordings.

    ``vectors``, ``number``, ``person``: as in `alone`; ``closing``, ``nobody``, ``others``, shape (n,): the last segments, those with
    nobody there, and ordinary ones.
    Returns ``closing_share``, ``nobody_share``: of all segments, where nobody is there of those that are not the last; ``without_alone``,
    ``others_alone``: see `alone`; ``chance``: one label in so many; ``ceiling``: accuracy on everything of a recogniser that names every
    other segment rightly and these as `alone` does.
    """
    without = closing | nobody
    share, accuracy = float(without.mean()), alone(vectors, number, person, without)
    return {
        "closing_share": float(closing.mean()),
        "nobody_share": float((nobody & ~closing).mean()),
        "without_alone": accuracy,
        "others_alone": alone(vectors, number, person, others & ~nobody),
        "chance": 1.0 / len(np.unique(number)),
        "ceiling": 1.0 - share * (1.0 - accuracy),
    }


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
    assert made.inputs is not None
    extractor = maker_of(made.inputs)
    return measure(lambda: model.probabilities(extractor.process_many(next(events))[0]), repeat=repeat)


def default_training(quick: bool) -> PerceptronTraining | CurveTraining:
    """Give the network where PyTorch is installed, else the perceptron."""
    if importlib.util.find_spec("torch") is None:
        return PerceptronTraining(passes=4 if quick else 32)
    return CurveTraining(passes=4 if quick else 60)


def figures(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Measure everything.

    ``quick``: few samples and two folds, to see that it runs; ``keep``: folder for what is simulated to train on and for what is finished:
    the same command goes on where it stopped; None: nothing is kept.
    Returns accuracies by data set and split over all segments and, unless quick, with ``_gestures`` behind the name without those that hold
    none, and ``_without`` on these (`closing_figures`); ``mhomeges_to_mtranssee`` (the five shared gestures, no sample of the
    second set in training), size and operations of the model, ``confusion``, ``learning_curve`` and ``choices``; with the figures of
    `gestures_transfer`, `gestures_daily` and `gestures_shipped`.
    """
    limit, folds, n_copies = (FEW, 2, 1) if quick else (0, 10, COPIES)
    config = default_training(quick)

    def part(name: str, work: Callable[[], Any]) -> Any:
        if keep is None:
            return work()
        told = digest(
            [f"{config} {usual_inputs(config)} {limit} {folds} {n_copies}", sources(("radar_core", "radar_lab", "radar_gestures"))]
        )
        return once(keep / "parts" / f"{name}_{told}.joblib", work)

    ours, other = read("mhomeges", limit), read("mtranssee", limit)
    sets = {"mhomeges": study(ours, config, n_copies=n_copies), "mtranssee": study(other, config, n_copies=n_copies)}
    first = sets["mhomeges"]
    result: dict[str, Any] = {"real_classifier": type(config).__name__, "real_samples": len(ours.label), "confusion": {}}
    for name, made in sets.items():
        found = part(name, functools.partial(one_set, name, made, folds, quick))
        result["confusion"] |= found.pop("confusion")
        result |= found
    shared = study(ours.only(other.labels), config, n_copies=n_copies)
    moved = part("transfer", lambda: transfer(shared, sets["mtranssee"]))
    result["mhomeges_to_mtranssee"], result["confusion"]["mhomeges_to_mtranssee"] = moved.accuracy, matrix(moved)
    model = part("model", first.fit)
    result |= {"real_model_bytes": len(model_file(model)), "real_model_flop": operations(model)}
    counts = (2, 6) if quick else (1, 2, 4, 8, 14)
    result["learning_curve"] = part("learning_curve", lambda: learning_curve(first, counts, (1,)))
    simulated = part("simulated", lambda: gestures_transfer.figures(first, quick, keep))
    result["confusion"] |= simulated.pop("confusion")
    rows = part("choices", lambda: choices(first, model, quick)) + simulated.pop("choices")
    daily = part("daily", lambda: gestures_daily.daily_figures(first, list(gestures_daily.read_streams(150 if quick else 0))))
    result |= simulated | daily | gestures_shipped.figures(quick)
    return result | {"choices": rows}


def one_set(name: str, made: Study, folds: int, quick: bool) -> dict[str, Any]:
    """Accuracies of one data set by split, over all segments and without those that hold no gesture; ``confusion`` by split."""
    data = made.data
    result: dict[str, Any] = {"confusion": {}}
    if not quick:
        closing, others = (from_the_end(data.label, data.person, data.distance, back) for back in (0, 3))
        nobody = nobody_in(name)
        result[f"{name}_without"] = closing_figures(made.plain, data.number, data.person, closing, nobody, others)
    for split, short in (("subjects", "held_out"), ("random", "random")):
        parts = made.folds(split, folds)
        found = made.validate(parts, split)
        result[f"{name}_{short}"] = found.accuracy
        result |= {} if quick else {f"{name}_{short}_gestures": accuracy_without(found, parts, closing | nobody)}
        result["confusion"][f"{name}_{short}"] = matrix(found)
    return result


def choices(first: Study, model: GestureModel | CurveNet, quick: bool) -> list[dict[str, Any]]:
    """Measure each choice's accuracy on the same held-out people (the first `CHOICE_FOLDS` folds) beside its time."""
    rows, reference = {}, event_times(first, model, 20 if quick else 200)
    for name, made in _variants(first, quick):
        few = made.data.person == made.data.person[0]  # times do not depend on how well it is trained
        times = reference if made is first else event_times(made, made.fit(few), 20 if quick else 200)
        rows[name] = made.held_out(CHOICE_FOLDS).accuracy, times
    return against_first("gestures of real people", "held out", rows)


def _variants(first: Study, quick: bool) -> Iterator[tuple[str, Study]]:
    """Name and study of each choice; the first is the default."""
    perceptron = PerceptronTraining(passes=4 if quick else 32)
    yield "cells" if isinstance(first.inputs, CellConfig) else "curves", first
    yield "thirteen features, 32 neurons", thirteen(first.data, replace(perceptron, hidden=(32,), regularisation=0.01))
    curves = study(first.data, first.config, CURVES, 1 if quick else COPIES)
    for hidden in (16, 48):
        yield f"perceptron on curves, {hidden} neurons", replace(curves, config=replace(perceptron, hidden=(hidden,)))
    if quick:
        return
    yield "no changed copies", replace(first, changed=None)
    if isinstance(first.config, CurveTraining):
        yield "curves", curves
        for steps in (7, 20):
            yield f"cells in {steps} steps", replace(first, config=replace(first.config, cell_steps=steps))
        for cells in (32, 192):
            yield f"{cells} cells", study(first.data, first.config, replace(CELLS, cells=cells))
        yield "mixup 0.4", replace(first, config=replace(first.config, mixup=0.4))
        yield (
            "half the channels and passes",
            replace(first, config=replace(first.config, channels=(40, 48), hidden=32, cell_width=32, passes=30)),
        )


run = figures
