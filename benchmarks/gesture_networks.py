"""Features with a perceptron against convolutional networks on feature maps and feature cubes (thesis, 4.5.3, 4.5.5 and table 4.2).

The samples, and who is left out, are those of `gesture_tables`. Both networks have the same layers and the same training.
"""

from __future__ import annotations

import functools
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import Memory
from numpy.typing import NDArray

from benchmarks.gesture_model import model_file
from benchmarks.gesture_tables import CONFIG, Key, Readings, data_set, key_of, recognised
from benchmarks.report import against_first, matrix, measure_together
from benchmarks.stores import kept, sources
from radar_core import GESTURES, ConfigError
from radar_gestures.stage import GestureConfig
from radar_lab.datasets.readings import Cubes, cubes, network_maps
from radar_lab.datasets.samples import SampleSet
from radar_lab.training.cnn import CnnConfig, CnnModel, export
from radar_lab.training.networks import cnn_judge, train_cnn
from radar_lab.training.operations import operations
from radar_lab.training.training import fit, validate
from radar_lab.training.validation import Mask, Validation, cross_validate, leave_subjects_out

INPUTS: Final[dict[str, Callable[..., Cubes]]] = {"maps": network_maps, "cubes": cubes}
"""What a network takes, and what reads it."""
_ENCODER: Final = ("radar_lab/training/encoder.py",)
_TRAINING: Final = ("radar_gestures/classifiers", "radar_lab/training")


class Judged:
    """Networks on the samples of a data set; ``keep``: folder for what was read, and for each fold; None: anew."""

    def __init__(self, place: Path, keep: Path | None, n_jobs: int) -> None:
        memory = Memory(keep, verbose=0)
        self._inputs, self._judge = memory.cache(_inputs, ignore=["n_jobs"]), memory.cache(_judge)
        self._place, self._n_jobs = place, n_jobs
        self._key = key_of(place, _ENCODER)

    def inputs(self, name: str) -> Cubes:
        """Read what a network takes, one of `INPUTS`."""
        return self._inputs(self._key, self._place, name, n_jobs=self._n_jobs)

    def validate(self, name: str, config: CnnConfig) -> Validation:
        """Judge a network, by the name of its input, on people left out: it takes long, and is kept fold by fold."""
        given, code = self.inputs(name), sources(_TRAINING)

        def judge(known: Mask, test: Mask) -> NDArray[np.float64]:
            return self._judge(code, given, config, known, test)

        return cross_validate(given.label, given.person, leave_subjects_out(given.person), judge, labels=GESTURES, split="subjects")


def _inputs(key: Key, place: Path, name: str, n_jobs: int) -> Cubes:
    return INPUTS[name](place, GestureConfig(), n_jobs=n_jobs)


def _judge(code: str, given: Cubes, config: CnnConfig, known: Mask, test: Mask) -> NDArray[np.float64]:
    return cnn_judge(given.cube, given.label, config)(known, test)


def network(given: Cubes) -> CnnModel:
    """Convolutional network of one epoch on a few samples: its size and its time do not depend on how well it is trained."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "network.onnx"
        export(train_cnn(given.cube[:64], given.label[:64], CnnConfig(epochs=1)), path, given.cube.shape[1:])
        return CnnModel(path)


def table_4_2(samples: SampleSet, judged: Judged, quick: bool) -> dict[str, Any]:
    """Compare on the same people left out: accuracy, bytes, FLOP and time; without PyTorch only the perceptron, and why.

    ``networks`` has a row for each: accuracy of the events; ``recognised``, see `gesture_tables.recognised`, of so many ``performed``.
    """
    mlp = fit(samples, np.ones(len(samples.label), np.bool_), CONFIG)
    found = {"features": validate(samples, leave_subjects_out(samples.person), CONFIG)}
    sizes = {"features": (len(model_file(mlp)), operations(mlp))}
    calls = {"features": functools.partial(mlp.probabilities, samples.features[0])}
    why: dict[str, str] = {}
    try:
        for name in INPUTS:
            found[name] = judged.validate(name, CnnConfig(epochs=3) if quick else CnnConfig())
            given = judged.inputs(name)
            net = network(given)
            sizes[name], calls[name] = (net.n_bytes, net.flop), functools.partial(net.probabilities, given.cube[:1])
    except ConfigError as error:
        why["networks_left_out"] = str(error)
    times = measure_together(calls, repeat=50 if quick else 300, warmup=10)
    table, rows = {}, {}
    for name, (n_bytes, flop) in sizes.items():
        share, performed = recognised(found[name], samples)
        accuracy = found[name].accuracy
        table[name] = {"accuracy": accuracy, "recognised": share, "performed": performed, "bytes": n_bytes, "flop": flop}
        what = "perceptron on thirteen features" if name == "features" else f"network on feature {name}"
        rows[f"{what}, {flop if flop < 1e5 else f'{flop / 1e6:.1f} M'} FLOP"] = accuracy, times[name]
    confusion = {name: matrix(one) for name, one in found.items() if name in INPUTS}
    choices = against_first("classifier", "held-out accuracy", rows)
    return {"networks": table, **why, "confusion_networks": confusion, "choices": choices}


def measure(folder: Path, quick: bool, n_jobs: int) -> dict[str, Any]:
    """Make the data set of `gesture_tables` and the table."""
    place = data_set(folder, quick, n_jobs)
    return table_4_2(Readings(place, folder / "read", n_jobs).samples(), Judged(place, folder / "read", n_jobs), quick)


def run(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Make the table; see `measure`."""
    n_jobs = 1 if quick else os.cpu_count() or 1
    with kept(keep) as folder:
        return measure(folder, quick, n_jobs)
