"""The whole chain end to end: raw frames of simulated scenes through presets, GOSPA of the people beside time.

Times are those that a second of radar takes (a core has a thousand milliseconds for it), because the frame rate is one of the knobs.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from benchmarks.report import Found, Panel, timed
from benchmarks.tradeoff.config import StudyConfig
from benchmarks.tradeoff.people import Judge, frames, scenes, slower, visible
from radar_core import RadarInfo
from radar_core.config import load, nest
from radar_dsp import Baseband
from radar_gestures.classifiers.model import load_model
from radar_gestures.recognizer import GestureRecognizer
from radar_lab.pipeline import PipelineConfig
from radar_sim import SimulatedFrame
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

    def __init__(self, name: str, info: RadarInfo, judge: Judge, parts: dict[str, list[float]]) -> None:
        self._every, knobs = PRESETS[name]
        config, info = load(PipelineConfig, nest(knobs)), slower(info, self._every)
        self._baseband, self._tracker = Baseband(config.baseband, info), PeopleTracker(config.tracking, info)
        self._gestures = GestureRecognizer(config.gestures, load_model(config.gestures.model), info.mount)
        self._info, self._rate, self._judge, self._parts = info, 1.0 / info.waveform.frame_interval, judge, parts

    def process(self, scene: str, made: SimulatedFrame) -> None:
        """Take one frame of a scene through baseband, tracking and gestures, and compare the people with the truth."""
        if made.frame.sequence % self._every:
            return
        cloud, *spent = timed(lambda: self._baseband.process(made.frame).to_room(self._info.mount))
        tracks, more = timed(self._tracker.process, cloud)
        spent += [more, timed(self._gestures.process, TrackedCloud(cloud, tracks))[1]]
        for name, value in zip(PARTS, spent, strict=True):
            self._parts[name].append(value * self._rate)
        self._judge.times_ms.append(sum(spent) * self._rate)
        self._judge.compare(scene, made.truth, visible(made.truth, self._info), tracks)


def measure(study: StudyConfig) -> Found:
    """Run all presets over the same raw frames, in turn; ``parts`` of a row are the medians of its stages [ms]."""
    judges = {name: Judge() for name in PRESETS}
    parts: dict[str, dict[str, list[float]]] = {name: {part: [] for part in PARTS} for name in PRESETS}
    for scene in scenes(study):
        info, simulated = frames(scene, study)
        chains = [Chain(name, info, judges[name], parts[name]) for name in PRESETS]
        for made in simulated:
            for chain in chains:
                chain.process(scene, made)
    found, default = Found(), judges["default"]
    for name, judge in judges.items():
        medians = {part: float(np.median(times)) for part, times in parts[name].items()}
        found.rows.append(PANEL.row(name, judge.mean, judge.times_ms, default.times_ms, margin=judge.margin(default), parts=medians))
    return found
