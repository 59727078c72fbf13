"""Gesture recognition: accuracy on simulated people who were not in the training, beside the time (thesis, table 4.1)."""

from __future__ import annotations

import dataclasses
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import choice, measure_together
from radar_core import RadarInfo
from radar_gestures.dataset import Recording, find_events, label_events, random_scene, record
from radar_gestures.events import EventConfig
from radar_gestures.features import FeatureConfig
from radar_gestures.model import GestureModel, load_model
from radar_gestures.recognizer import GestureConfig, GestureRecognizer, feature_settings
from radar_gestures.samples import SampleSet
from radar_gestures.scoring import truth_segments
from radar_gestures.training import fit
from radar_tracking import PeopleTracker, TrackedCloud

FOLDS = 4


def recordings(n_scenes: int, info: RadarInfo) -> list[Recording]:
    """Random scenes, the same people for every radar."""
    return [record(random_scene(np.random.default_rng([77, number]), info)) for number in range(n_scenes)]


def collect(made: list[Recording], settings: GestureConfig, every: int = 1) -> SampleSet:
    """Return the samples of all recordings."""
    columns = [label_events(find_events(r, settings, every), truth_segments(r.truths)) for r in made]
    person = np.concatenate([c["person"] + 10 * i for i, c in enumerate(columns)])
    joined = {name: np.concatenate([c[name] for c in columns]) for name in ("features", "label", "walked")}
    return SampleSet(**joined, person=person, missed=np.sum([c["missed"] for c in columns], axis=0), settings=feature_settings(settings))


def rate(samples: SampleSet, hidden: int = 32) -> tuple[float, float, GestureModel]:
    """Cross-validated over scenes: share of the gesture samples named right, and of all gestures performed (missed ones included)."""
    scene = samples.person // 10
    folds = [fit(samples, scene % FOLDS == k, hidden=hidden, regularisation=1e-2, max_iterations=300, seed=1) for k in range(FOLDS)]
    confusion: NDArray[np.int64] = np.sum([f.confusion for f in folds], axis=0)
    hits, events = np.trace(confusion[1:, 1:]), confusion[1:].sum()
    return float(hits / events), float(hits / (events + samples.missed[1:].sum())), folds[0].model


def shipped(samples: SampleSet) -> dict[str, float]:
    """Return what the model that comes with Handwave achieves on these people, whom it has never seen."""
    gesture = samples.label != 0
    right = load_model().probabilities(samples.features).argmax(axis=-1) == samples.label
    performed = gesture.sum() + samples.missed[1:].sum()
    return {
        "shipped_accuracy": float(right.mean()),
        "shipped_gesture_accuracy": float(right[gesture].mean()),
        "shipped_recognised": float(right[gesture].sum() / performed),
    }


def cloud_times(made: Recording, settings: GestureConfig, model: GestureModel, every: int = 1) -> list[float]:
    """Milliseconds of the recogniser per cloud of a recording, its tracking left out."""
    tracker = PeopleTracker()
    recogniser, times = GestureRecognizer(settings, model, made.mount), []
    for cloud in made.clouds[::every]:
        tracked = TrackedCloud(cloud, tracker.process(cloud))
        start = time.perf_counter_ns()
        recogniser.process(tracked)
        times.append((time.perf_counter_ns() - start) * 1e-6)
    return times


def inference(model: GestureModel, samples: SampleSet, repeat: int) -> dict[str, list[float]]:
    """Milliseconds per event of our perceptron and scikit-learn's with the same weights."""
    from sklearn.neural_network import MLPClassifier

    standard = (samples.features - model.mean) / model.scale
    theirs = MLPClassifier((model.hidden_weights.shape[1],), max_iter=1, random_state=1)
    theirs.partial_fit(standard, samples.label, classes=np.arange(10))
    theirs.coefs_ = [model.hidden_weights, model.output_weights]
    theirs.intercepts_ = [model.hidden_bias, model.output_bias]
    ours, one = samples.features[0], standard[:1]
    return measure_together(
        {"sklearn": lambda: theirs.predict_proba(one), "numpy": lambda: model.probabilities(ours)}, repeat=repeat, warmup=10
    )


def variants(quick: bool) -> list[tuple[str, GestureConfig, int, int]]:
    """Name, settings, every n-th cloud and hidden neurons of each choice."""
    default = GestureConfig()
    rows = [("default", default, 1, 32), ("hidden=8", default, 1, 8)]
    if quick:
        return rows
    rows += [(f"hidden={n}", default, 1, n) for n in (16, 64)]
    rows += [("25 Hz", default, 2, 32), ("17 Hz", default, 3, 32)]
    rows += [(f"angles={a}", GestureConfig(features=FeatureConfig(angles=a)), 1, 32) for a in ("offset", "sensor")]
    rows += [(f"max_duration={d}", GestureConfig(events=EventConfig(max_duration=d)), 1, 32) for d in (1.0, 2.0)]
    thesis = EventConfig(release=0.8, min_duration=0.2, quiet=0.2, bridge=0.05)
    return [*rows, ("thesis events", GestureConfig(events=thesis), 1, 32)]


def run(quick: bool = False) -> dict[str, Any]:
    """Measure every choice on the same scenes, each trained anew on few people; a full run takes about ten minutes."""
    made = recordings(FOLDS if quick else 16, RadarInfo())
    result: dict[str, Any] = {}
    choices = []
    reference: list[float] | None = None
    for name, settings, every, hidden in variants(quick):
        samples = collect(made, settings, every)
        named, all_performed, model = rate(samples, hidden)
        times = cloud_times(made[0], settings, model, every)
        choices.append(
            choice("gestures", name, accuracy=("gestures recognised", all_performed, ""), times_ms=times, reference_ms=reference)
        )
        if reference is None:
            reference = times
            result |= {"gesture_accuracy": named, "gestures_recognised": all_performed, "n_samples": len(samples.label)}
            result |= shipped(samples)
            events = inference(model, samples, 50 if quick else 500)
            result["inference_over_sklearn"] = float(np.median(events["numpy"]) / np.median(events["sklearn"]))
            result["inference_us"] = float(np.median(events["numpy"]) * 1e3)
            result["recogniser_ms_per_cloud"] = float(np.median(times))
    if not quick:
        info = RadarInfo()
        array, waveform = dataclasses.replace(info.array, tx=info.array.tx[:1]), dataclasses.replace(info.waveform, n_tx=1)
        one = recordings(len(made), dataclasses.replace(info, array=array, waveform=waveform))
        _, all_performed, model = rate(collect(one, GestureConfig()))
        times = cloud_times(one[0], GestureConfig(), model)
        accuracy = ("gestures recognised", all_performed, "")
        choices.append(choice("gestures", "one transmitter", accuracy=accuracy, times_ms=times, reference_ms=reference))
    return result | {"choices": choices}
