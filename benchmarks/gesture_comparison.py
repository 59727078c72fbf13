"""Do features come from the same distribution: the tests of table 5.3 and figure 5.15, on simulated worlds and on real people.

Three pairs: two simulated worlds (`gesture_worlds`), simulated people before the radar of mHomeGes (`gesture_drills`) against its real
ones, and real people of mHomeGes against those of mTransSee, which says how much two recordings differ. The tests are those of
``handwave dataset compare``.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.gesture_drills import Drills, generate, read_drill
from benchmarks.gesture_studies import GATES, RealSet, person_of, read, thirteen_of
from benchmarks.gesture_worlds import FASTER, SEVEN, TRAINING
from benchmarks.gesture_worlds import generate as generate_world
from benchmarks.gestures_transfer import DEVELOPMENT
from benchmarks.report import AbsentError
from benchmarks.stores import kept
from radar_core import DataError
from radar_gestures.features import FEATURE_NAMES
from radar_lab.datasets.readings import collect
from radar_lab.datasets.samples import SampleSet
from radar_lab.evaluation.comparison import Comparison, compare
from radar_lab.training.training import of_labels

EFFECTS: Final = (0.06, 0.14)  # eta squared from which an effect is called middling, and large (Cohen 1988)
_SAMPLES: Final = 200  # of each world
_DRILLS, _SEGMENTS = 150, 1500


def worlds(folder: Path, quick: bool) -> tuple[SampleSet, SampleSet]:
    """Simulate two worlds, bodies of ellipsoids in both, seven gestures."""
    for world in (TRAINING, FASTER):
        generate_world(world, folder, 4 if quick else _SAMPLES, progress=not quick)
    one, other = (of_labels(collect(folder / world.name), SEVEN) for world in (TRAINING, FASTER))
    return one, other


def simulated_people(folder: Path, quick: bool) -> tuple[SampleSet, SampleSet]:
    """Drills of simulated people, and segments of the real ones of mHomeGes whose recordings did not set the simulation."""
    n = 5 if quick else _DRILLS
    place, gate = generate(Drills(), n, folder, progress=not quick), GATES["mhomeges"]
    features, label = [], []
    for number in range(n):
        name, _, clouds = read_drill(place, number)
        if any(len(cloud) for cloud in clouds):
            features.append(thirteen_of(*person_of(clouds, gate), gate))
            label.append(name)
    real = _read("mhomeges", quick)
    return _set(np.array(features), np.array(label), np.arange(len(label))), _of(real.select(~np.isin(real.person, DEVELOPMENT)))


def real_people(folder: Path, quick: bool) -> tuple[SampleSet, SampleSet]:
    """Segments of two public sets; the gestures that both have."""
    return _of(_read("mhomeges", quick)), _of(_read("mtranssee", quick))


PAIRS: Final[dict[str, Callable[[Path, bool], tuple[SampleSet, SampleSet]]]] = {
    "real people of two sets": real_people,
    "simulated and real people, one radar": simulated_people,
    "two simulated worlds": worlds,
}


def _read(kind: str, quick: bool) -> RealSet:
    return read(kind, 50 if quick else _SEGMENTS)


def _of(real: RealSet) -> SampleSet:
    return _set(real.thirteen, real.label, real.person)


def _set(features: np.ndarray[Any, Any], label: np.ndarray[Any, Any], person: np.ndarray[Any, Any]) -> SampleSet:
    """Make a data set of features that were found; those without motion, all 0, count as missed."""
    words = tuple(str(word) for word in np.unique(label))
    number, found = np.searchsorted(words, label), np.any(features != 0.0, axis=1)
    missed = np.bincount(number[~found], minlength=len(words))
    return SampleSet(features[found], number[found], person[found], np.zeros(int(found.sum())), missed, {}, FEATURE_NAMES, words)


def figures(found: Comparison) -> dict[str, Any]:
    """Give tables 5.1 and 5.3, and figure 5.15 in numbers."""
    tests = np.isfinite(found.kruskal)
    middling, large = ((found.eta_squared[tests] >= least).mean() for least in EFFECTS)
    names = [found.words[label] for label in found.labels]
    return {
        "samples": found.counts.sum(axis=1).tolist(),
        "kruskal_different": float((found.kruskal[tests] < found.significance).mean()),
        "kruskal_tests": int(tests.sum()),
        "eta_squared_median": float(np.median(found.eta_squared[tests])),
        "eta_squared_middling": float(middling),
        "eta_squared_large": float(large),
        "eta_squared_by_feature": dict(zip(found.names, np.nanmean(found.eta_squared, axis=0).tolist(), strict=True)),
        "wilcoxon": dict(zip(names, found.wilcoxon.tolist(), strict=True)),
        "rank_biserial": dict(zip(names, found.rank_biserial.tolist(), strict=True)),
        "recall": {} if found.transfer is None else dict(zip(names, found.transfer.recall.tolist(), strict=True)),
        "transfer": None if found.transfer is None else found.transfer.accuracy,
        "left_out": [found.names[i] for i in found.left_out],
        "transfer_without_them": None if found.reduced is None else found.reduced.accuracy,
    }


def run(quick: bool, keep: Path | None = None) -> dict[str, Any]:
    """Compare the pairs; those of real people where their recordings are (docs/reference/recordings.md)."""
    result: dict[str, Any] = {"pairs": {}, "absent": {}}
    with kept(keep) as folder:
        for name, pair in PAIRS.items():
            try:
                result["pairs"][name] = figures(compare(*pair(folder, quick)))
            except (AbsentError, DataError) as error:
                result["absent"][name] = str(error)
    return result | {"choices": []}
