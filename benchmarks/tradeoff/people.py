"""Short simulated scenes with people for the stages behind the baseband: moments with truth, and how far tracks are from it."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Found, Panel, Row, timed
from benchmarks.scenarios import Moment
from benchmarks.tradeoff.stages import StudyConfig
from radar_core import ConfigError, RadarFrame, RadarInfo
from radar_core.config import load, nest
from radar_core.transmitters import one_transmitter, one_transmitter_frame
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.classifiers.model import load_model
from radar_gestures.make import make_recognizer
from radar_gestures.stage import config_for
from radar_lab.evaluation.matching import MatchingConfig, Visibility, without_scatterers
from radar_lab.pipeline import PipelineConfig
from radar_sim import Fidelity, Scene, SimulatedFrame, Simulator, Truth, load_scene
from radar_tracking import TrackedCloud, TrackerConfig, Tracks, make_tracker
from radar_tracking.metrics import GospaMetric, ObjectSet, people
from radar_tracking.people.make import AnyTracker

_SCENES = ("two_crossing", "side_by_side", "five_people")
_SECONDS = (4.0, 12.0)  # quick, full


def scenes(study: StudyConfig) -> tuple[str, ...]:
    """Name the scenes with people that are measured: the user's, else ours."""
    if study.scene is not None:
        return (study.scene,)
    return study.pick(_SCENES[:1], _SCENES)


def short(name: str, seed: int, ours: bool, radars: int = 1) -> Scene:
    """Load a scene with another seed; ours in the cheapest propagation; raise ConfigError without people or with too few radars."""
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
        owner = np.full(len(cloud), -1, np.int32)
        found.append(Moment(cloud.to_room(info.mount), without_scatterers(made.truth), visible(made.truth, info), owner, spent))
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
    """Run trackers in turn over the clouds of all scenes, or each so many'th, as at a lower frame rate.

    Returns judges by the names of ``configs``, the interval from cloud to cloud [s], and what the baseband took for each cloud [ms].
    """
    judges, interval, spent = {name: Judge() for name in configs}, 0.02, []
    for scene in scenes(study):
        info, found = moments(scene, study)
        info = slower(info, every)
        interval = info.waveform.frame_interval
        trackers = {name: make_tracker(config, info) for name, config in configs.items()}
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


_REFERENCE = "the baseband's time of the same frames"
TRACKER = Panel("tracker", "mean GOSPA", "m", "lower", "poisson_bernoulli", _REFERENCE)
ESTIMATOR = Panel("estimator", "mean GOSPA", "m", "lower", "linear", _REFERENCE)
WITHIN = Panel("clustering within the tracker", "mean GOSPA", "m", "lower", "dbscan", _REFERENCE)

_GROUPS = {"tracker": "group_clustering"}  # estimators and clusterings are of the thesis's trackers
KNOBS: dict[Panel, dict[str, dict[str, str]]] = {
    TRACKER: {
        "poisson_bernoulli": {},
        "group_clustering": _GROUPS,
        "group": {"tracker": "group"},
        "cluster_first": {"tracker": "cluster_first"},
        "cluster_first, split=kmeans": {"tracker": "cluster_first", "association.split": "kmeans"},
    },
    ESTIMATOR: {
        name: {**_GROUPS, "filter.estimator.name": name} for name in ("linear", "extended", "unscented", "imm", "mmae", "mm_vel_est")
    },
    WITHIN: {
        name: {**_GROUPS, "association.clustering.name": name} for name in ("dbscan", "optics", "kmeans", "grid_dbscan", "polar_dbscan")
    },
}  # fmt: skip


def trackers(study: StudyConfig) -> Found:
    """Compare trackers, estimators and clusterings within the tracker on the same clouds."""
    configs = {f"{panel.name}: {name}": load(TrackerConfig, nest(knobs)) for panel, own in KNOBS.items() for name, knobs in own.items()}
    judges, _, baseband = track(configs, study)
    return Found([row for panel, own in KNOBS.items() for row in rows(panel, {n: judges[f"{panel.name}: {n}"] for n in own}, baseband)])


RATE = Panel("frame rate", "mean GOSPA", "m", "lower", "50 Hz", "the same at 50 Hz")
TRANSMITTERS = Panel("number of transmitters", "mean GOSPA", "m", "lower", "2 transmitters", "baseband and tracking with 2 transmitters")


def _rates(study: StudyConfig) -> Found:
    """Take every n-th cloud; times are of baseband and tracking for one second of radar."""
    found, reference, default = Found(), [0.0], Judge()
    for every in (1, 2, 3, 5):
        judges, interval, baseband = track({"": TrackerConfig()}, study, every)
        judge, rate = judges[""], 1.0 / interval
        times = (rate * np.add(baseband, judge.times_ms)).tolist()
        reference, default = (times, judge) if every == 1 else (reference, default)
        name = "50 Hz" if every == 1 and round(rate) == 50 else f"{rate:.3g} Hz"
        found.rows.append(RATE.row(name, judge.mean, times, reference, margin=judge.margin(default)))
    return found


def _whole(baseband: Baseband, tracker: AnyTracker, frame: RadarFrame, info: RadarInfo) -> Tracks:
    return tracker.process(baseband.process(frame).to_room(info.mount))


def _transmitters(study: StudyConfig) -> Found:
    """Keep the chirps of the first transmitter of the same frames."""
    judges: dict[str, Judge] = {}
    found = Found()
    for scene in scenes(study):
        info, simulated = frames(scene, study)
        if info.waveform.n_tx == 1:
            found.leave_out(TRANSMITTERS.name, "2 transmitters", f"the radar of {scene} has one transmitter")
            return found
        infos = {f"{info.waveform.n_tx} transmitters": info, "1 transmitter": one_transmitter(info)}
        chains = {name: (Baseband(BasebandConfig(), one), make_tracker(None, one)) for name, one in infos.items()}
        for made in simulated:
            seen = visible(made.truth, info)
            for name, (baseband, tracker) in chains.items():
                frame = made.frame if name != "1 transmitter" else one_transmitter_frame(made.frame, info)
                tracks, spent = timed(_whole, baseband, tracker, frame, info)
                judge = judges.setdefault(name, Judge())
                judge.times_ms.append(spent)
                judge.compare(scene, made.truth, seen, tracks)
    panel = replace(TRANSMITTERS, default=next(iter(judges)))  # a user's scene may have more
    return Found(rows(panel, judges), found.left_out)


def radars(study: StudyConfig) -> Found:
    """Compare frame rates and numbers of transmitters on the same scenes."""
    return _rates(study) + _transmitters(study)


CHAIN = Panel("whole chain", "mean GOSPA of the people", "m", "lower", "default", "the default chain")
PRESETS: Final[dict[str, tuple[int, dict[str, Any]]]] = {
    "fast": (2, {"baseband.doa.newton_steps": 1}),
    "default": (1, {}),
    "people": (1, {"baseband.doa.method": "dml2"}),
    "thorough": (1, {"baseband.doa.method": "dml2", "baseband.doa.newton_steps": 3}),
    "most thorough": (
        1,
        {
            "baseband.doa.method": "dml2",
            "baseband.doa.newton_steps": 3,
            "baseband.refine": "ml",
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
        self._baseband, self._tracker = Baseband(config.baseband, info), make_tracker(config.tracking, info)
        model = load_model(config.gestures.model)
        self._gestures = make_recognizer(config_for(model.settings, config.gestures), model, info)
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


def chain(study: StudyConfig) -> Found:
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
        found.rows.append(CHAIN.row(name, judge.mean, judge.times_ms, default.times_ms, margin=judge.margin(default), parts=medians))
    return found
