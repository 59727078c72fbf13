"""Is the model that comes with Handwave the one that its command makes? Simulates, trains, and compares (`COMMANDS`)."""

from __future__ import annotations

import dataclasses
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.report import against_first, timed
from benchmarks.stores import kept
from radar_core.paths import find_config
from radar_gestures.classifiers.classifier import Classifier
from radar_gestures.classifiers.loading import load_perceptron
from radar_gestures.classifiers.model import save_model
from radar_gestures.classifiers.perceptron import GestureModel
from radar_lab.datasets.samples import SampleSet, join_samples
from radar_lab.datasets.scenes import generate
from radar_lab.datasets.synthesis import synthesise
from radar_lab.datasets.synthesis_plan import named_plan
from radar_lab.training.training import TrainingConfig, TrainingReport, read_folder, reject_limit, train_on

SCENES: Final = 320
STROKES: Final = 1_500
STARTS: Final = 8  # networks tried; that with the least loss is kept, so that start weights decide less by chance
LOST: Final = 0.02
"""Share of known gestures given up to reject unknown ones: of people beside each other a higher one costs more than it keeps out."""
COMMANDS: Final = (
    f"handwave dataset generate strokes --plan all --body ellipsoids -n {STROKES}",
    f"handwave train scenes strokes --scenes {SCENES} --starts {STARTS} --lost {LOST} --out gestures.npz",
)


def data(folder: Path, quick: bool, n_jobs: int) -> SampleSet:
    """Do what the commands do, as far as the folder does not hold it yet: about an hour and a half of one core."""
    scenes, strokes = (2, 20) if quick else (SCENES, STROKES)
    generate(folder / "scenes", scenes, seed=1, n_jobs=n_jobs)
    synthesise(folder / "strokes", strokes, seed=1, n_jobs=n_jobs, plan=named_plan("all"), body="ellipsoids")
    return join_samples([read_folder(folder / name) for name in ("scenes", "strokes")])


def model_file(model: Classifier) -> bytes:
    """Content of the file that a model is saved to."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.npz"
        save_model(model, path)
        return path.read_bytes()


def equal_predictions(first: GestureModel, second: GestureModel, samples: SampleSet) -> float:
    """Share of the samples that two models name alike, rejected ones as random."""
    return float(np.mean([_named(first, row) == _named(second, row) for row in samples.features]))


def _named(model: GestureModel, features: np.ndarray[Any, Any]) -> int:
    probabilities = model.probabilities(features)
    return int(np.argmax(probabilities)) if model.known(features, probabilities) else 0


def compare(samples: SampleSet, shipped: Path, starts: int = STARTS) -> dict[str, Any]:
    """Train twice, and compare the files with each other and with the one that is shipped; once more from one start, for what more cost."""
    once, several = TrainingConfig(lost=LOST), TrainingConfig(starts=starts, lost=LOST)
    reports, seconds = [], []
    for one in (several, several, once):
        report, spent = timed(train_on, samples, one)
        reports.append(report)
        seconds.append(1e-3 * spent)
    single, alone = reports.pop(), seconds.pop()
    files = [model_file(report.model) for report in reports]
    return {
        "repeats_bit_for_bit": files[0] == files[1],
        "shipped_bit_for_bit": files[0] == shipped.read_bytes(),
        "equal_predictions": equal_predictions(reports[0].model, load_perceptron(shipped), samples),
        "n_samples": len(samples.label),
        "held_out": reports[0].validation.accuracy,
        "held_out_gestures": reports[0].validation.figures()["gesture_accuracy"],
        "train_s": min(seconds),
        "choices": start_rows({1: (single, alone), starts: (reports[0], min(seconds))}) + rejection_rows(reports[0], samples),
    }


def start_rows(trained: Mapping[int, tuple[TrainingReport, float]]) -> list[dict[str, Any]]:
    """Accuracy of people left out beside the time of the whole training [s], by the number of starts, the first as the reference."""
    found = {f"starts={starts}": (report.validation.accuracy, [1e3 * seconds]) for starts, (report, seconds) in trained.items()}
    return against_first("training", "right, people left out", found)


def rejection_rows(report: TrainingReport, samples: SampleSet, shares: Sequence[float] = (LOST, 0.05, 0.1)) -> list[dict[str, Any]]:
    """Gestures of people left out that are kept, beside the time of naming one, for several limits of rejection."""
    found: dict[str, tuple[float, list[float]]] = {}
    for lost in shares:
        limit, gone = reject_limit(report.validation, report.score, lost)
        model = dataclasses.replace(report.model, reject=limit)
        found[f"lost={lost:g}"] = 1.0 - gone, [timed(_named, model, row)[1] for row in samples.features[:300]][50:]
    return against_first("rejection", "known gestures kept", found)


def run(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Make the shipped model again; quick: of few samples, where nothing can be equal to it.

    Returns ``repeats_bit_for_bit``, ``shipped_bit_for_bit`` (on the machine that made it), ``equal_predictions`` (on any), ``n_samples``,
    ``held_out``, ``held_out_gestures``: accuracy for people left out, of all events and of gestures; ``train_s``, ``choices``.
    """
    n_jobs, shipped = (1 if quick else os.cpu_count() or 1), find_config("gestures", "models", ".npz")
    with kept(keep) as folder:
        return compare(data(folder, quick, n_jobs), shipped, 2 if quick else STARTS)
