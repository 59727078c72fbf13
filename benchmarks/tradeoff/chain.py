"""The whole chain end to end: raw frames of simulated scenes through presets, GOSPA of the people beside time.

Times are those that a second of radar takes (a core has a thousand milliseconds for it), because the frame rate is one of the knobs.
"""

from __future__ import annotations

import dataclasses
import time
from typing import Any, Final

import numpy as np

from benchmarks.tradeoff.people import Judge, frames, scenes, visible
from benchmarks.tradeoff.rows import Found, Panel
from benchmarks.tradeoff.settings import Settings
from radar_core.config import load, nest
from radar_dsp import Baseband
from radar_gestures.classifiers.model import load_model
from radar_gestures.recognizer import GestureRecognizer
from radar_lab.pipeline import PipelineConfig
from radar_sim import SimulatedFrame, Simulator
from radar_tracking import PeopleTracker, TrackedCloud

PANEL = Panel("whole chain", "mean GOSPA of the people", "m", "lower", "default", "the default chain")
PRESETS: Final[dict[str, tuple[int, dict[str, Any]]]] = {
    "fast": (2, {"baseband.doa.newton_steps": 1}),
    "default": (1, {}),
    "people": (1, {"baseband.doa.method": "dml2"}),
    "thorough": (1, {"baseband.doa.method": "dml2", "baseband.doa.newton_steps": 3, "tracking.filter.estimator.name": "mm_vel_est"}),
    "most thorough": (
        1,
        {
            "baseband.doa.method": "dml2",
            "baseband.doa.newton_steps": 3,
            "baseband.refine": "ml",
            "tracking.filter.estimator.name": "mm_vel_est",
        },
    ),
}
"""Every how many'th frame each preset takes, and the knobs that it sets apart from the defaults."""
PARTS: Final = ("baseband", "tracking", "gestures")


class Chain:
    """One preset, its judge, and the times of its parts."""

    def __init__(self, name: str, simulator: Simulator, judge: Judge, parts: dict[str, list[float]]) -> None:
        self._every, knobs = PRESETS[name]
        config, info = load(PipelineConfig, nest(knobs)), simulator.info
        interval = info.waveform.frame_interval * self._every
        info = dataclasses.replace(info, waveform=dataclasses.replace(info.waveform, frame_interval=interval))
        self._baseband, self._tracker = Baseband(config.baseband, info), PeopleTracker(config.tracking, info)
        self._gestures = GestureRecognizer(config.gestures, load_model(config.gestures.model), info.mount)
        self._info, self._rate, self._judge, self._parts = info, 1.0 / interval, judge, parts

    def process(self, scene: str, made: SimulatedFrame) -> None:
        """Take one frame of a scene through baseband, tracking and gestures, and compare the people with the truth."""
        if made.frame.sequence % self._every:
            return
        marks = [time.perf_counter_ns()]
        cloud = self._baseband.process(made.frame).to_room(self._info.mount)
        marks.append(time.perf_counter_ns())
        tracks = self._tracker.process(cloud)
        marks.append(time.perf_counter_ns())
        self._gestures.process(TrackedCloud(cloud, tracks))
        marks.append(time.perf_counter_ns())
        for name, spent in zip(PARTS, np.diff(marks) * 1e-6, strict=True):
            self._parts[name].append(float(spent * self._rate))
        self._judge.times_ms.append((marks[-1] - marks[0]) * 1e-6 * self._rate)
        self._judge.compare(scene, made.truth, visible(made.truth, self._info), tracks)


def measure(settings: Settings) -> Found:
    """Run all presets over the same raw frames, in turn; ``parts`` of a row are the medians of its stages [ms]."""
    judges = {name: Judge() for name in PRESETS}
    parts: dict[str, dict[str, list[float]]] = {name: {part: [] for part in PARTS} for name in PRESETS}
    for scene in scenes(settings):
        chains: dict[str, Chain] = {}
        for simulator, made in frames(scene, settings):
            chains = chains or {name: Chain(name, simulator, judges[name], parts[name]) for name in PRESETS}
            for chain in chains.values():
                chain.process(scene, made)
    found, default = Found(), judges["default"]
    for name, judge in judges.items():
        medians = {part: float(np.median(times)) for part, times in parts[name].items()}
        found.rows.append(PANEL.row(name, judge.mean, judge.times_ms, default.times_ms, margin=judge.margin(default), parts=medians))
    return found
