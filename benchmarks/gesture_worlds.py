"""From one simulated world to another: trained on bodies of ellipsoids in an empty room, tested on everything that can be different.

The other world has bodies of triangles, other people, exact propagation, noisier receivers, more coupling, a floor and walls that mirror,
an element pattern, and boards whose channels differ from the drawing. Nothing of it is in the training.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.report import share
from benchmarks.stores import fill_samples, kept, sources
from radar_core import GESTURES
from radar_core.config import plain
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.stage import GestureConfig
from radar_lab.datasets.readings import collect
from radar_lab.datasets.samples import FORMAT, SampleSet, sample_path, write_chunk
from radar_lab.datasets.synthesis import simulate_sample
from radar_lab.datasets.synthesis_plan import Plan, Sample, draw_sample
from radar_sim import PatternConfig, Scene, Wall
from radar_sim.effects.config import ChannelErrorsConfig, MultipathConfig
from radar_sim.scene import Fidelity

SEVEN: Final = ("pull", "push", "swipe_right", "swipe_left", "rotate", "wave", "push_pull")  # the gestures of section 5.3
WALLS: Final = ((-0.5, 2.4, 5.0, 2.4), (-0.5, -2.2, 5.0, -2.2), (5.0, -2.2, 5.0, 2.4))  # m: both ends
_BOARD: Final = 50  # samples with one board, then the next


@dataclass(frozen=True)
class World:
    """How samples are simulated."""

    name: str  # of its folder
    body: str  # as `Person.body`
    model: str  # as `Fidelity.model`
    plan: Plan  # between what bounds samples differ
    seed: int
    disturbed: bool  # whether there are mirrors, an element pattern and channel errors

    def draw(self, number: int) -> Sample:
        """Draw a sample: a function of the world and the number only."""
        sample = draw_sample(self.plan, self.seed, number, body=self.body)
        return dataclasses.replace(sample, scene=self._disturb(sample.scene, number))

    def _disturb(self, scene: Scene, number: int) -> Scene:
        scene = dataclasses.replace(scene, fidelity=Fidelity(model=self.model))
        if not self.disturbed:
            return scene
        board = ChannelErrorsConfig(seed=self.seed + number // _BOARD)
        walls = tuple(Wall(start=(x0, y0), end=(x1, y1)) for x0, y0, x1, y1 in WALLS)
        effects = dataclasses.replace(scene.effects, multipath=MultipathConfig(), pattern=PatternConfig(), channel_errors=board)
        return dataclasses.replace(scene, walls=walls, effects=effects)

    @property
    def manifest(self) -> dict[str, Any]:
        """What has to be equal for a run to go on in a folder; features are read anew, whatever stands in the files."""
        own = {"body": self.body, "model": self.model, "seed": self.seed, "disturbed": self.disturbed, "plan": plain(self.plan)}
        return {"format": FORMAT, **own, "sources": sources()}


TRAINING: Final = World("ellipsoids", "ellipsoids", "auto", Plan(animations="all"), 11, disturbed=False)
_OTHER_PLAN: Final = Plan(
    animations="all", noise_figure=(14.0, 19.0), losses=(18.0, 23.0), coupling=(-55.0, -45.0), turn=0.25, left_arm=0.4
)
OTHER: Final = World("other", "mesh", "exact", _OTHER_PLAN, 2_011, disturbed=True)
FASTER: Final = dataclasses.replace(OTHER, name="other_faster", body="ellipsoids", model="auto")
"""For a quick look: the same disturbances in a thirtieth of the time."""


@dataclass(frozen=True)
class Sizes:
    """Samples of each world."""

    training: int = 1_500
    test: int = 150


def generate(world: World, folder: Path, n_samples: int, *, n_jobs: int = 1, progress: bool = True) -> float:
    """Simulate the samples of a world that the folder does not hold yet; seconds of one core for each, NaN: there was nothing to do."""
    start = time.monotonic()
    write = functools.partial(_write, world)
    _, made = fill_samples(folder / world.name, world.manifest, n_samples, write, n_jobs=n_jobs, progress=progress)
    return (time.monotonic() - start) * n_jobs / made if made else math.nan


def _write(world: World, place: Path, number: int) -> None:
    write_chunk(sample_path(place, number), simulate_sample(world.draw(number), GestureConfig(), margin=world.plan.margin), compressed=True)


def accuracy(model: GestureModel, samples: SampleSet, names: Sequence[str]) -> dict[str, Any]:
    """Name the samples of some gestures with a model that knows these and no others.

    ``accuracy``: share right of the events that were found; ``recognised``: of all performed; ``by_gesture``: of the events.
    """
    labels = np.array([GESTURES.index(name) for name in names])
    own = np.isin(samples.label, labels)
    true = samples.label[own]
    right = labels[model.probabilities(samples.features[own]).argmax(axis=-1)] == true
    performed = int(own.sum() + samples.missed[labels].sum())
    return {
        **share("accuracy", int(right.sum()), len(right)),
        **share("recognised", int(right.sum()), performed),
        "by_gesture": {name: float(right[true == label].mean()) for name, label in zip(names, labels, strict=True) if label in true},
        "events": len(right),
        "performed": performed,
    }


def measure(folder: Path, sizes: Sizes, n_jobs: int = 1, progress: bool = True, other_world: World = OTHER) -> dict[str, Any]:
    """Simulate what is missing of both worlds, train on one, and test on the other."""
    from radar_lab.training.training import TrainingConfig, fit, of_labels

    pairs = ((TRAINING, sizes.training), (other_world, sizes.test))
    seconds = {world.name: generate(world, folder, n, n_jobs=n_jobs, progress=progress) for world, n in pairs}
    training, other = (collect(folder / world.name, n_jobs=n_jobs) for world, _ in pairs)
    result: dict[str, Any] = {}
    for names in (SEVEN, GESTURES):
        chosen = of_labels(training, names)
        model = fit(chosen, np.ones(len(chosen.label), np.bool_), TrainingConfig(), labels=names)
        found = accuracy(model, other, names)
        result[f"other_world_accuracy_{len(names)}"] = found["accuracy"]
        result[f"other_world_recognised_{len(names)}"] = found["recognised"]
        result[f"other_world_{len(names)}"] = found
    return {
        **result,
        "seconds_per_sample": {name: None if math.isnan(value) else value for name, value in seconds.items()},
        "samples": dataclasses.asdict(sizes),
        "choices": [],
    }


def run(quick: bool = False, keep: Path | None = None, n_jobs: int = 1) -> dict[str, Any]:
    """Train in one world, test in the other; quick: few samples, of a world less exact.

    ``..._accuracy_7``, ``..._10``: of the events that were found; ``..._recognised_...``: missed ones count as wrong.
    """
    sizes, other = (Sizes(30, 10), FASTER) if quick else (Sizes(), OTHER)
    with kept(keep) as folder:
        return measure(folder, sizes, n_jobs, other_world=other)
