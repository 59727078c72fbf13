"""Short simulated scenes with people for the stages behind the baseband: moments with truth, and how far tracks are from it."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Panel, Row, timed
from benchmarks.tradeoff.config import StudyConfig
from radar_core import ConfigError, PointCloud, RadarInfo
from radar_dsp import Baseband, BasebandConfig
from radar_lab.evaluation.matching import MatchingConfig, Visibility, without_scatterers
from radar_sim import Fidelity, Scene, SimulatedFrame, Simulator, Truth, load_scene
from radar_tracking import PeopleTracker, TrackerConfig, Tracks
from radar_tracking.metrics import GospaMetric, ObjectSet, people

_SCENES = ("two_crossing", "side_by_side", "five_people")
_SECONDS = (6.0, 12.0)  # quick, full


@dataclass(frozen=True, eq=False)
class Moment:
    """One frame's cloud in ``room``, what is true, who can be seen (shape (n_people,)), and what the baseband took [ms]."""

    cloud: PointCloud
    truth: Truth
    visible: NDArray[np.bool_]
    baseband_ms: float


def scenes(study: StudyConfig) -> tuple[str, ...]:
    """Name the scenes with people that are measured: the user's, else ours."""
    if study.scene is not None:
        return (study.scene,)
    return study.pick(_SCENES[:1], _SCENES)


def short(name: str, seed: int, ours: bool, radars: int = 1) -> Scene:
    """Load a scene, with another seed than its own unless ``seed`` is 1; one of ours in the cheapest model of propagation.

    Raises ConfigError when nobody is in the scene, or it has fewer radars than asked for.
    """
    scene = load_scene(name)
    if not scene.people or len(scene.radars) < radars:
        has = f"{len(scene.people)} people and {len(scene.radars)} radars"
        raise ConfigError(f"--scene {name}: it has {has}; this needs somebody in it, and {radars} or more radars")
    scene = dataclasses.replace(scene, seed=scene.seed + seed - 1)
    return dataclasses.replace(scene, fidelity=Fidelity(model="separable")) if ours else scene


def visible(truth: Truth, info: RadarInfo) -> NDArray[np.bool_]:
    """Say who counts, shape (n_people,); nobody has time to be found."""
    return Visibility(info, MatchingConfig(settle=0.0)).process(truth)


def frames(name: str, study: StudyConfig) -> tuple[RadarInfo, Iterator[SimulatedFrame]]:
    """Simulate the first seconds of a scene, frame by frame; also the radar that sees it."""
    simulator = Simulator(short(name, study.seed, study.scene is None))
    n = min(simulator.n_frames, round(study.pick(*_SECONDS) / simulator.interval))
    return simulator.info, map(simulator.process, range(n))


@functools.lru_cache(maxsize=8)
def moments(name: str, study: StudyConfig) -> tuple[RadarInfo, tuple[Moment, ...]]:
    """Clouds of a scene by the default baseband; simulated once and shared by all stages of a run."""
    info, simulated = frames(name, study)
    baseband, found = Baseband(BasebandConfig(), info), []
    for made in simulated:
        cloud, spent = timed(baseband.process, made.frame)
        found.append(Moment(cloud.to_room(info.mount), without_scatterers(made.truth), visible(made.truth, info), spent))
    return info, tuple(found)


class Judge:
    """GOSPA of one tracker on the floor plane, moment by moment, and its times."""

    def __init__(self) -> None:
        self._metric = GospaMetric()
        self._by_second: dict[tuple[str, int], list[float]] = {}
        self.times_ms: list[float] = []

    def compare(self, scene: str, truth: Truth, seen: NDArray[np.bool_], tracks: Tracks) -> None:
        """Take in one moment of a scene; ``seen`` says who counts, shape (n_people,)."""
        step = self._metric.process(ObjectSet.of(truth.position[:, :2], truth.person_id, seen), people(tracks))
        self._by_second.setdefault((scene, truth.stamp_ns // 1_000_000_000), []).append(step.distance)

    @property
    def mean(self) -> float:
        """Mean GOSPA over all moments [m]."""
        return self._metric.summary().mean

    def margin(self, default: Judge) -> float:
        """Two standard errors of the mean difference from another judge's, on the same seconds: neighbouring moments tell the same [m]."""
        both = [key for key in self._by_second if key in default._by_second]
        apart = [float(np.mean(self._by_second[key]) - np.mean(default._by_second[key])) for key in both]
        return float(2 * np.std(apart) / max(len(both), 1) ** 0.5)


def rows(panel: Panel, judges: Mapping[str, Judge], reference_ms: Sequence[float] | None = None) -> list[Row]:
    """Rows of a panel whose figure is GOSPA, beside its default; reference: that of the times, None: the default's."""
    default = judges[panel.default]
    reference = default.times_ms if reference_ms is None else reference_ms
    return [panel.row(name, one.mean, one.times_ms, reference, margin=one.margin(default)) for name, one in judges.items()]


def track(configs: dict[str, TrackerConfig], study: StudyConfig, every: int = 1) -> tuple[dict[str, Judge], float, list[float]]:
    """Run trackers in turn over the clouds of all scenes, or over each so many'th, as a radar of a lower frame rate gives them.

    Returns ``judges``: by the names of ``configs``; ``interval``: from cloud to cloud [s]; ``baseband_ms``: what the baseband took for each
    cloud [ms].
    """
    judges, interval, spent = {name: Judge() for name in configs}, 0.02, []
    for scene in scenes(study):
        info, found = moments(scene, study)
        info = slower(info, every)
        interval = info.waveform.frame_interval
        trackers = {name: PeopleTracker(config, info) for name, config in configs.items()}
        for moment in found[::every]:
            spent.append(moment.baseband_ms)
            for name, tracker in trackers.items():
                tracks, taken = timed(tracker.process, moment.cloud)
                judges[name].times_ms.append(taken)
                judges[name].compare(scene, moment.truth, moment.visible, tracks)
    return judges, interval, spent


def slower(info: RadarInfo, every: int) -> RadarInfo:
    """Give a radar that sends only each so many'th frame."""
    return dataclasses.replace(info, waveform=dataclasses.replace(info.waveform, frame_interval=info.waveform.frame_interval * every))
