"""What nodes with a time budget choose from: levels of accuracy of a stage, with their times on this machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from rich.progress import track
from threadpoolctl import threadpool_limits

from benchmarks.plot import draw
from benchmarks.report import FASTER, Found, Panel, Row, timed
from benchmarks.tradeoff.people import Judge, frames, scenes, visible
from benchmarks.tradeoff.stages import StudyConfig
from radar_core import PointCloud, RadarFrame, RadarInfo
from radar_core.config import flat, load, nest
from radar_core.ladder import Ladder, Level, machine, save_ladders
from radar_dsp import Baseband, BasebandConfig
from radar_ros.messages.convert import cloud_from_msg, cloud_to_msg
from radar_ros.messages.tracks import tracks_to_msg
from radar_sim import SimulatedFrame
from radar_tracking import TrackerConfig, Tracks, make_tracker

LEVELS: Final = "levels.json"
FIGURE: Final = "mean GOSPA of the people"
_BASEBAND: Final[Mapping[str, Mapping[str, Any]]] = {
    "one refinement step": {"doa.newton_steps": 1},
    "one echo in a cell": {},
    "two echoes in a cell": {"doa.method": "dml2"},
}
_REFINED: Final[Mapping[str, Mapping[str, Any]]] = {  # ten times the time of the rest: not for a quick look
    "one echo, refined on the samples": {"refine": "ml"},
    "two echoes, refined on the samples": {"doa.method": "dml2", "refine": "ml"},
}
_TRACKING: Final[Mapping[str, Mapping[str, Any]]] = {"every frame": {}}  # tracks do not outlive a change of the tracker
_EVERY: Final = (1, 2, 3, 5)  # below 10 Hz people are lost, and gestures long before
_OTHERS: Final = np.zeros(1_000_000)
"""Walked through before each timed frame, so that caches are as cold as between two frames of a radar, when other processes run."""
DEFAULTS: Final = {"baseband": "one echo in a cell", "tracking": "every frame"}
_REFERENCE: Final = "the default at every frame"
BASEBAND: Final = Panel("levels of the baseband", FIGURE, "m", "lower", DEFAULTS["baseband"], _REFERENCE)
TRACKING: Final = Panel("levels of the tracking", FIGURE, "m", "lower", DEFAULTS["tracking"], _REFERENCE)


@dataclass(eq=False)
class Candidate:
    """One way to run a stage, and what it showed so far."""

    name: str
    knobs: Mapping[str, Any]  # by dotted name; all that any candidate of its stage sets
    every: int  # every so many'th frame is processed
    times_ms: list[float] = field(default_factory=list)  # of processed frames
    judge: Judge = field(default_factory=Judge)  # of the tracks that are there at every frame, new or not

    @property
    def level(self) -> Level:
        """What it showed."""
        name = self.name if self.every == 1 else f"{self.name}, one frame in {self.every}"
        return Level(name, dict(self.knobs), self.every, float(np.median(self.times_ms)), self.judge.mean)


def candidates(presets: Mapping[str, Mapping[str, Any]], config: Any) -> list[Candidate]:
    """List all presets at all frame rates; each says the value of every knob that one of them sets, so that it means the same anywhere."""
    usual = flat(config)
    every_knob = {name: usual[name] for knobs in presets.values() for name in knobs}
    return [Candidate(name, {**every_knob, **knobs}, every) for every in _EVERY for name, knobs in presets.items()]


class _Follower:
    """A tracker behind one candidate's clouds; between them its last tracks stay, as for whoever reads them."""

    def __init__(self, candidate: Candidate, config: TrackerConfig, info: RadarInfo) -> None:
        self.candidate, self._tracker = candidate, make_tracker(config, info)
        self._last: Tracks | None = None

    def process(self, scene: str, made: SimulatedFrame, seen: NDArray[np.bool_], cloud: PointCloud, *, with_time: bool) -> None:
        if made.frame.sequence % self.candidate.every == 0:
            _OTHERS.sum()
            self._last, spent = timed(self._publish, cloud)
            if with_time:
                self.candidate.times_ms.append(spent)
        if self._last is not None:
            self.candidate.judge.compare(scene, made.truth, seen, self._last)

    def _publish(self, cloud: PointCloud) -> Tracks:
        tracks = self._tracker.process(cloud)
        tracks_to_msg(tracks)
        return tracks


def _published(chain: Baseband, frame: RadarFrame) -> PointCloud:
    cloud = chain.process(frame)
    cloud_to_msg(cloud)
    return cloud


def baseband(study: StudyConfig) -> list[Candidate]:
    """Run all candidates of the baseband over the same frames, each with a default tracker of people behind it."""
    found = candidates({**_BASEBAND, **study.pick({}, _REFINED)}, BasebandConfig())
    for scene in scenes(study):
        info, simulated = frames(scene, study)
        chains = {one.name: Baseband(load(BasebandConfig, nest(one.knobs)), info) for one in found if one.every == 1}
        followers = [_Follower(one, TrackerConfig(), info) for one in found]
        for made in simulated:
            seen = visible(made.truth, info)
            for name, chain in chains.items():
                _OTHERS.sum()
                cloud, spent = timed(_published, chain, made.frame)
                room = cloud.to_room(info.mount)
                for follower in followers:
                    if follower.candidate.name == name:
                        follower.process(scene, made, seen, room, with_time=False)
                        if made.frame.sequence % follower.candidate.every == 0:
                            follower.candidate.times_ms.append(spent)
    return found


def tracking(study: StudyConfig) -> list[Candidate]:
    """Run all candidates of the tracking over the clouds of the default baseband."""
    found = candidates(_TRACKING, TrackerConfig())
    for scene in scenes(study):
        info, simulated = frames(scene, study)
        chain = Baseband(BasebandConfig(), info)
        followers = [_Follower(one, load(TrackerConfig, nest(one.knobs)), info) for one in found]
        for made in simulated:
            cloud = cloud_from_msg(cloud_to_msg(chain.process(made.frame))).to_room(info.mount)
            seen = visible(made.truth, info)
            for follower in followers:
                follower.process(scene, made, seen, cloud, with_time=True)
    return found


def losses(found: Sequence[Candidate], default: str) -> list[float]:
    """Say how inaccurate the candidates (presets at the highest frame rate, then at the next) are [m], chance left out.

    What cannot be told from the default at the same frame rate is as accurate as it; leaving out more frames makes nothing more accurate.
    """
    result: list[float] = []
    worst: dict[str, float] = {}
    usual = {one.every: one.judge for one in found if one.name == default}
    for one in found:
        own, other = one.judge.mean, usual[one.every].mean
        loss = other if abs(own - other) <= one.judge.margin(usual[one.every]) else own
        worst[one.name] = max(loss, worst.get(one.name, loss))
        result.append(worst[one.name])
    return result


def ladder(stage: str, found: Sequence[Candidate], small: bool = False) -> Ladder:
    """Keep what is worth its time, the most accurate first.

    A candidate stays when it is clearly quicker for each frame of the radar than all that are as accurate and leave out no more frames. Of
    several that cannot be told apart the default stays, else the quickest. Of ``small``, for gestures on a small device, the default is the
    first, and those that leave out frames are the last.
    """
    default = DEFAULTS[stage]
    groups: dict[tuple[float, int], list[Candidate]] = {}
    for loss, one in zip(losses(found, default), found, strict=True):
        groups.setdefault((loss, one.every), []).append(one)
    kept = [one.level for one in found if small and one.name == default and one.every == 1]
    for key in sorted(groups, key=lambda group: group[::-1] if small else group):
        quickest = min(one.level.cost_ms for one in groups[key])
        near = [one for one in groups[key] if (1 - FASTER) * one.level.cost_ms <= quickest]
        level = min(near, key=lambda one: (one.name != default, one.level.cost_ms)).level
        if not kept or level.cost_ms < (1 - FASTER) * kept[-1].cost_ms:
            kept.append(level)
    return Ladder(stage, FIGURE, "m", "lower", tuple(kept), machine())


@dataclass(frozen=True, eq=False)
class Tuned:
    """What was measured of a stage, and what of it is worth its time."""

    ladder: Ladder
    candidates: tuple[Candidate, ...]

    @property
    def rows(self) -> list[Row]:
        """A row of everything that was measured; times are those for each frame of the radar."""
        panel = {"baseband": BASEBAND, "tracking": TRACKING}[self.ladder.stage]
        default = next(one for one in self.candidates if one.level.name == panel.default)
        made = []
        for one in self.candidates:
            times = [value / one.every for value in one.times_ms]
            made.append(panel.row(one.level.name, one.judge.mean, times, default.times_ms, margin=one.judge.margin(default.judge)))
        return made


def tune(study: StudyConfig, factor: float = 1.0, progress: bool = True, small: bool = False) -> list[Tuned]:
    """Measure the stages that have levels, in one thread, times multiplied by ``factor``; see `ladder` for ``small``.

    A ConfigError says that nobody is in the scene.
    """
    found = []
    stages: tuple[Literal["baseband", "tracking"], ...] = ("baseband", "tracking")
    with threadpool_limits(1):
        for stage in track(stages, "tuning", disable=not progress, transient=True):
            made = (baseband if stage == "baseband" else tracking)(study)
            for one in made:
                one.times_ms = [factor * value for value in one.times_ms]
            found.append(Tuned(ladder(stage, made, small), tuple(made)))
    return found


def measure(study: StudyConfig) -> Found:
    """Compare all candidates for levels of the baseband and the tracking; `handwave tradeoff --tune` keeps some of them for the nodes."""
    return Found([row for found in tune(study, progress=False) for row in found.rows])


def write(folder: Path, found: Sequence[Tuned]) -> None:
    """Write levels for nodes, and a picture of all that was measured."""
    save_ladders(folder / LEVELS, [one.ladder for one in found])
    draw([row for one in found for row in one.rows], folder / "levels.png")
