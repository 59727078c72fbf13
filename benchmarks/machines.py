"""The same on other machines: other kernels of OpenBLAS, numpy without its dispatch to the processor, numba for any processor.

Each environment is a process of its own; what the first one that runs gives is what the others are held against.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
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
AUDITED: Final = ("single_target", "two_crossing")  # scenes of the quick audit; else all
_MIXED: Final = 4_000  # rows of features that are made between those of simulated strokes
_CLOUD: Final = ("range", "radial_speed", "azimuth", "snr")


def cube(quick: bool) -> NDArray[np.complex64]:
    """Simulate frames all over a scene, without what is added to the samples: shape (frame, tx, chirp, rx, sample)."""
    scene = load_scene(SCENE)
    nothing: dict[str, Any] = dict.fromkeys(SIGNAL)
    simulator = Simulator(replace(scene, effects=replace(scene.effects, **nothing)))
    chosen = np.linspace(0, simulator.n_frames - 1, 4 if quick else 40).astype(int).tolist()
    return np.stack([simulator.process(k).frame.cube for k in chosen])


def audited(quick: bool) -> str:
    """Make the table of effects of docs/research/effects.md, quick: some of its columns."""
    return table([audit(*each) for each in ours() if not quick or each[0] in AUDITED])


def strokes(quick: bool) -> dict[str, NDArray[Any]]:
    """Make samples of a data set: features (n, 13), which were found (n,), and the columns of the first one's clouds."""
    plan, config = named_plan("all"), GestureConfig()
    samples = [simulate_sample(draw_sample(plan, 1, k, body="ellipsoids"), config) for k in range(3 if quick else 40)]
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


ROOT: Final = Path(__file__).resolve().parents[1]
KERNELS: Final[dict[str, tuple[str, ...]]] = {
    "Haswell": ("Haswell",),
    "SkylakeX": ("SkylakeX",),
    "Zen": ("Zen", "Haswell"),
    "Prescott": ("Prescott", "Katmai"),
}
"""Core types, and what OpenBLAS calls their kernels where it was built with fewer: it then takes those of an older processor."""
QUICK: Final = ("test/core/test_canonical.py", "test/sim/test_occlusion.py")  # the audit is compared anyway
SUITE: Final = ("test/core", "test/sim", "test/dsp", "test/tracking", "test/gestures")


@dataclass(frozen=True)
class Environment:
    """One machine, as far as variables make it: its name, the variables, and what OpenBLAS may then report (empty: anything)."""

    name: str
    variables: Mapping[str, str]
    kernels: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """What an environment gave; ``skipped`` says why there is nothing."""

    environment: Environment
    seconds: float
    skipped: str = ""
    about: Mapping[str, Any] | None = None
    arrays: Mapping[str, np.ndarray[Any, Any]] | None = None
    tests: int = 0
    failed: tuple[str, ...] = ()


def environments(cache: Path) -> list[Environment]:
    """List the environments, the machine as it is last; numba's code for any processor goes to a cache of its own."""
    found = [Environment(f"OPENBLAS_CORETYPE={name}", {"OPENBLAS_CORETYPE": name}, kernels) for name, kernels in KERNELS.items()]
    found.append(Environment("NUMBA_CPU_NAME=generic", {"NUMBA_CPU_NAME": "generic", "NUMBA_CACHE_DIR": str(cache)}))
    features: list[str] = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    return [*found, Environment("numpy without dispatch", {"NPY_DISABLE_CPU_FEATURES": " ".join(features)}), Environment("as it is", {})]


def run_in(environment: Environment, folder: Path, quick: bool) -> Outcome:
    """Make the results and run the suite in processes of the environment; raise RuntimeError when one fails for another reason."""
    place = folder / environment.name.replace(" ", "_")
    place.mkdir()
    variables = {**os.environ, **environment.variables}
    start = time.monotonic()

    def call(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, *arguments], cwd=ROOT, env=variables, capture_output=True, text=True, check=False)

    done = call("-m", "benchmarks.machines", str(place), "quick" if quick else "full")
    if done.returncode == -signal.SIGILL:
        return Outcome(environment, time.monotonic() - start, "this processor cannot run it (illegal instruction)")
    if done.returncode:
        raise RuntimeError(f"{environment.name}: the process ended with {done.returncode}:\n{done.stderr[-2000:]}")
    about = json.loads((place / "about.json").read_text(encoding="utf-8"))
    if environment.kernels and not set(about["kernels"]) <= set(environment.kernels):
        return Outcome(environment, time.monotonic() - start, f"OpenBLAS took {', '.join(about['kernels']) or 'nothing'} instead")
    with np.load(place / "results.npz") as file:
        arrays = dict(file)
    report = place / "tests.xml"
    call("-m", "pytest", *(QUICK if quick else SUITE), "-p", "no:cacheprovider", "-n0", f"--junitxml={report}")
    tests, failed = read_report(report)
    return Outcome(environment, time.monotonic() - start, "", about, arrays, tests, failed)


def read_report(path: Path) -> tuple[int, tuple[str, ...]]:
    """Read how many tests ran and which failed. Raises RuntimeError when there is no report: pytest did not run."""
    if not path.is_file():
        raise RuntimeError(f"pytest wrote no {path.name}; run this from a checkout, where the tests are, with pytest installed")
    cases = [case for case in ElementTree.parse(path).iter("testcase") if case.find("skipped") is None]
    failed = [f"{c.get('classname')}::{c.get('name')}" for c in cases if c.find("failure") is not None or c.find("error") is not None]
    return len(cases), tuple(failed)


def compare(outcome: Outcome, reference: Outcome) -> dict[str, Any]:
    """Hold one environment against the reference: one row of the result."""
    row: dict[str, Any] = {"environment": outcome.environment.name, "seconds": round(outcome.seconds, 1)}
    if outcome.arrays is None or outcome.about is None or reference.arrays is None or reference.about is None:
        return row | {"state": f"skipped: {outcome.skipped}"}
    one, other = outcome.arrays, reference.arrays
    same = len(one["own"]) == len(other["own"])
    return row | {
        "state": "ran",
        "kernels": outcome.about["kernels"],
        "cube_rel_error": float(np.linalg.norm(one["cube"] - other["cube"]) / np.linalg.norm(other["cube"])),
        "cube_equal_bits": bool((one["cube"] == other["cube"]).all()),
        "audit_equal": outcome.about["audit"] == reference.about["audit"],
        "audit_differences": _differences(outcome.about["audit"], reference.about["audit"]),
        "sample_points_differ": abs(len(one["clouds"]) - len(other["clouds"])),
        "features_error": _error(one["features"], other["features"]),
        "equal_predictions": _share(one["stored"], other["stored"]),
        "equal_simulated": _share(one["own"], other["own"]) if same else 0.0,
        "tests": outcome.tests,
        "tests_failed": list(outcome.failed),
    }


def run(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Run all environments, two at a time where there are two cores, and compare; ``keep``: where numba's code for any processor stays."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first, *rest = environments(keep.resolve() if keep else folder / "numba")[: -1 if quick else None]
        outcomes = [run_in(first, folder, quick)]
        while rest and outcomes[-1].arrays is None:  # one alone first: it makes the features that the others name
            outcomes.append(run_in(rest.pop(0), folder, quick))
        with ThreadPoolExecutor(max(min(os.cpu_count() or 1, 4), 1)) as pool:
            outcomes += pool.map(lambda each: run_in(each, folder, quick), rest)
    reference = next(outcome for outcome in outcomes if outcome.arrays is not None)
    return summary([compare(outcome, reference) for outcome in outcomes], reference.environment.name)


def summary(rows: Sequence[Mapping[str, Any]], reference: str) -> dict[str, Any]:
    """Put rows together: the worst of all that ran."""
    ran = [row for row in rows if row["state"] == "ran"]
    return {
        "reference": reference,
        "cube_rel_error": max(row["cube_rel_error"] for row in ran),
        "audit_equal": all(row["audit_equal"] for row in ran),
        "features_error": max(row["features_error"] for row in ran),
        "equal_predictions": min(min(row["equal_predictions"], row["equal_simulated"]) for row in ran),
        "tests_failed": sum(len(row["tests_failed"]) for row in ran),
        "ran": len(ran),
        "skipped": [f"{row['environment']}: {row['state']}" for row in rows if row["state"] != "ran"],
        "environments": list(rows),
    }


def _differences(one: str, other: str) -> list[str]:
    """Cells of the audit that differ, as ``effect, column: here / there``."""
    found = []
    for a, b in zip(one.splitlines(), other.splitlines(), strict=True):
        cells = list(zip(a.split(" | "), b.split(" | "), strict=True))
        found += [f"{cells[0][0].strip('| ')}, {k}: {x} / {y}" for k, (x, y) in enumerate(cells) if x != y]
    return found


def _error(one: np.ndarray[Any, Any], other: np.ndarray[Any, Any]) -> float:
    """Largest difference over the largest magnitude of the column; infinite where only one of them is NaN."""
    if one.shape != other.shape or (np.isnan(one) != np.isnan(other)).any():
        return float("inf")
    size = np.maximum(np.nanmax(np.abs(other), axis=0), 1e-12)
    return float(np.nanmax(np.abs(one - other) / size))


def _share(one: np.ndarray[Any, Any], other: np.ndarray[Any, Any]) -> float:
    return float(np.mean(one == other))


if __name__ == "__main__":
    main(*sys.argv[1:])
