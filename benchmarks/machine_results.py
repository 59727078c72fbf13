"""What one machine makes of scenes, audit, data sets and models: run in a process of its own by `benchmarks.machines`."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_info

from radar_gestures.classifiers.model import load_model
from radar_gestures.stage import GestureConfig
from radar_lab.datasets.synthesis import simulate_sample
from radar_lab.datasets.synthesis_plan import draw_sample, named_plan
from radar_sim import Simulator, load_scene
from radar_sim.audit import audit, ours, table
from radar_sim.effects.chain import SIGNAL

SCENE: Final = "two_crossing"
AUDITED: Final = ("demo", "five_people", "single_target", "two_crossing")  # scenes of the quick audit; else all
_MIXED: Final = 4_000  # rows of features that are made between those of simulated strokes
_CLOUD: Final = ("range", "radial_speed", "azimuth", "snr")


def cube(quick: bool) -> NDArray[np.complex64]:
    """Simulate frames all over a scene, without what is added to the samples: shape (frame, tx, chirp, rx, sample)."""
    scene = load_scene(SCENE)
    nothing: dict[str, Any] = dict.fromkeys(SIGNAL)
    simulator = Simulator(replace(scene, effects=replace(scene.effects, **nothing)))
    chosen = np.linspace(0, simulator.n_frames - 1, 8 if quick else 40).astype(int).tolist()
    return np.stack([simulator.process(k).frame.cube for k in chosen])


def audited(quick: bool) -> str:
    """Make the table of effects of docs/effects.md, quick: some of its columns."""
    return table([audit(*each) for each in ours() if not quick or each[0] in AUDITED])


def strokes(quick: bool) -> dict[str, NDArray[Any]]:
    """Make samples of a data set: features (n, 13), which were found (n,), and the columns of the first one's clouds."""
    plan, config = named_plan("all"), GestureConfig()
    samples = [simulate_sample(draw_sample(plan, 1, k, body="ellipsoids"), config) for k in range(10 if quick else 40)]
    clouds = np.concatenate([np.stack([sample[f"cloud_{name}"] for name in _CLOUD], -1) for sample in samples])
    return {
        "features": np.array([sample["features"] for sample in samples]),
        "found": np.array([sample["found"] for sample in samples]),
        "clouds": clouds.astype(np.float64),
    }


def named(features: NDArray[np.float64]) -> NDArray[np.int64]:
    """Name rows of features by the shipped model; -1: rejected."""
    model, names = load_model(), []
    for row in features:
        probabilities = model.probabilities(row)
        names.append(int(np.argmax(probabilities)) if model.known(row, probabilities) else -1)
    return np.array(names, np.int64)


def mixed(features: NDArray[np.float64], n: int = _MIXED) -> NDArray[np.float64]:
    """Make rows between and about given ones, so that many lie near the borders between gestures; drawn from a fixed seed."""
    rng = np.random.default_rng(0)
    one, other = (features[rng.integers(0, len(features), n)] for _ in range(2))
    share, noise = rng.uniform(size=(n, 1)), rng.normal(0.0, 0.1, (n, features.shape[1]))
    return np.asarray(one + share * (other - one) + noise * features.std(axis=0))


def main(folder: str, quick: str) -> None:
    """Write results of this machine into a folder; it may hold the features (``stored.npy``) of another one."""
    place, short = Path(folder), quick == "quick"
    made = strokes(short)
    features = made["features"][made["found"]]
    stored = place.parent / "stored.npy"
    if not stored.is_file():
        np.save(stored, mixed(features))
    arrays: dict[str, Any] = {"cube": cube(short), **made, "own": named(features), "stored": named(np.load(stored))}
    np.savez(place / "results.npz", **arrays)
    kernels = sorted({str(pool["architecture"]) for pool in threadpool_info() if pool["internal_api"] == "openblas"})
    about = {"audit": audited(short), "kernels": kernels}
    (place / "about.json").write_text(json.dumps(about), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
