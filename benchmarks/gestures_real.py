"""Gestures of real people: with fewer people to learn from, by the shipped model; choices and their time."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import gestures_shipped
from benchmarks.gesture_model import model_file
from benchmarks.gesture_studies import (
    CELLS,
    CHOICE_FOLDS,
    COPIES,
    CURVES,
    FEW,
    PerceptronTraining,
    Study,
    read,
    study,
    thirteen,
    usual_inputs,
)
from benchmarks.gestures_people import default_training
from benchmarks.report import against_first, measure
from benchmarks.stores import digest, once, sources
from radar_gestures.classifiers.curve_net import CurveNet
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.features import FEATURE_NAMES
from radar_gestures.inputs import InputMaker
from radar_lab.training.networks import CurveTraining
from radar_lab.training.operations import operations


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


def event_times(made: Study, model: GestureModel | CurveNet, repeat: int) -> list[float]:
    """Milliseconds from the feature maps of one event to its probabilities; for the thirteen features: of the classifier only."""
    if model.names == FEATURE_NAMES:
        return measure(lambda: model.probabilities(made.plain[0]), repeat=repeat)
    events = itertools.cycle(made.data.events.select(np.array([k])) for k in range(min(20, len(made.plain))))
    assert made.inputs is not None
    extractor = InputMaker(made.inputs)
    return measure(lambda: model.probabilities(extractor.process_many(next(events))[0]), repeat=repeat)


def figures(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Measure everything.

    ``quick``: few samples and two folds, to see that it runs; ``keep``: folder for what is finished: the same command goes on where it
    stopped; None: nothing is kept.
    Returns size and operations of the model, ``learning_curve`` and ``choices``; with the figures of `gestures_shipped`. People held out
    are in `gestures_people`, other worlds in `gestures_transfer`, daily life in `gestures_daily`.
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

    first = study(read("mhomeges", limit), config, n_copies=n_copies)
    result: dict[str, Any] = {"real_classifier": type(config).__name__}
    model = part("model", first.fit)
    result |= {"real_model_bytes": len(model_file(model)), "real_model_flop": operations(model)}
    counts = (2, 6) if quick else (1, 2, 4, 8, 14)
    result["learning_curve"] = part("learning_curve", lambda: learning_curve(first, counts, (1,)))
    rows = part("choices", lambda: choices(first, model, quick))
    result |= gestures_shipped.figures(quick)
    return result | {"choices": rows}


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
    yield "curves" if first.inputs == (CURVES,) else "cells and curves", first
    yield "thirteen features, 32 neurons", thirteen(first.data, replace(perceptron, hidden=(32,), regularisation=0.01))
    curves = study(first.data, first.config, (CURVES,), 1 if quick else COPIES)
    for hidden in (16, 48):
        yield f"perceptron on curves, {hidden} neurons", replace(curves, config=replace(perceptron, hidden=(hidden,)))
    if quick:
        return
    yield "no changed copies", replace(first, changed=None)
    if isinstance(first.config, CurveTraining):
        yield "curves", curves
        cells_only = study(first.data, first.config, (CELLS,))
        yield "cells", cells_only
        for steps in (7, 20):
            yield f"cells in {steps} steps, no curves", replace(cells_only, config=replace(first.config, cell_steps=steps))
        for cells in (32, 192):
            yield f"{cells} cells, no curves", study(first.data, first.config, (replace(CELLS, cells=cells),))
        for lost in (0.0, 0.4):
            yield f"cells, up to {lost:g} left out in a pass, no curves", replace(cells_only, config=replace(first.config, lost_cells=lost))
        yield "mixup 0.4", replace(first, config=replace(first.config, mixup=0.4))
        yield (
            "half the channels and passes",
            replace(first, config=replace(first.config, channels=(40, 48), hidden=32, cell_width=32, passes=30)),
        )


run = figures
