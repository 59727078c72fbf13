"""Gestures before boards whose radar is not the default's: simulated people, the boards' waveforms and antennas, the shipped model."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from benchmarks.gesture_scenes import body, effects, stroke
from benchmarks.report import rate, share
from radar_core import GESTURES, Pose, RadarInfo
from radar_driver.bgt60.config import Bgt60Config
from radar_driver.tinyrad.config import TinyRadConfig
from radar_gestures import Gesture
from radar_lab.pipeline import Pipeline
from radar_sim import Action, Scene, Simulator
from radar_sim.scene import SceneRadar

NAMES: Final = ("pull", "push", "swipe_up", "swipe_down", "swipe_left", "swipe_right", "rotate", "wave", "push_pull")
RADARS: Final = {"bgt60": Bgt60Config().info(), "tinyrad": TinyRadConfig(calibrate=False).info()}
SCENES: Final = {"bgt60": 4, "tinyrad": 1}
AROUND_NS: Final = 300_000_000  # by which what is seen may begin and end beside what is done


def measured(radar: RadarInfo, scenes: int, names: Sequence[str] = NAMES) -> dict[str, Any]:
    """Count what became of every gesture of some scenes: a person 1 to 2 m away does each once, in random order."""
    counts: Counter[str] = Counter()
    length = max(4.0 * len(names), 8.0)  # s
    for number in range(scenes):
        rng = np.random.default_rng([28, 7, number])
        script = [Action(stand=2.0)]
        for name in rng.permutation(names):
            script += [Action(stand=float(rng.uniform(1.5, 2.0))), stroke(rng, str(name))]
        person = body(rng, 1, (float(rng.uniform(1.0, 2.0)), float(rng.uniform(-0.3, 0.3))), [*script, Action(stand=2.0)])
        placed = dataclasses.replace(radar, mount=Pose(z=1.2))
        simulator = Simulator(Scene(duration=length, seed=number, radars=(SceneRadar.of(placed),), people=(person,), effects=effects(rng)))
        pipeline = Pipeline(placed)
        named: list[Gesture] = []
        done: dict[int, tuple[int, int, int]] = {}
        for k in range(simulator.n_frames):
            made = simulator.process(k)
            named += pipeline.process(made.frame).gestures
            for label, index in zip(made.truth.gesture.tolist(), made.truth.gesture_index.tolist(), strict=True):
                if label < len(GESTURES):
                    done[index] = (label, done.get(index, (0, made.truth.stamp_ns))[1], made.truth.stamp_ns)
        free = set(range(len(named)))
        for label, start, end in done.values():
            over = [k for k, one in enumerate(named) if one.start_ns < end + AROUND_NS and one.end_ns > start - AROUND_NS]
            free -= set(over)
            said = named[over[0]].name if over else ""
            counts["right" if said == GESTURES[label] else "missed" if said in ("", "random") else "wrong"] += 1
        counts["nothing"] += sum(named[k].name != "random" for k in free)
    total = counts["right"] + counts["wrong"] + counts["missed"]
    found = {"gestures": total, **share("right", counts["right"], total), **share("wrong", counts["wrong"], total)}
    return found | rate("of_nothing_per_minute", counts["nothing"], scenes * length / 60)


def run(quick: bool) -> dict[str, Any]:
    """Measure every board; quick: one push before each."""
    boards = {name: measured(RADARS[name], 1 if quick else SCENES[name], ("push",) if quick else NAMES) for name in RADARS}
    return {"boards": boards, "choices": []}
