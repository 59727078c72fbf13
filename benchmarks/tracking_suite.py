"""The suite: every tracker over every scene, each scene simulated once in a process of its own."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from joblib import Memory, Parallel, delayed, parallel_config
from rich.console import Console
from rich.progress import track

from benchmarks.report import timed
from benchmarks.scenarios import MOUNT, SCENARIOS, WALLS, Moment, moments
from benchmarks.stores import sources
from benchmarks.tracking_score import Score, Scorer, total
from radar_core import PointCloud, Pose, RadarInfo
from radar_core.config import load, load_file, nest, plain
from radar_core.paths import find_config
from radar_dsp import BasebandConfig
from radar_tracking import TrackerConfig, Tracks, make_tracker
from radar_tracking.people.make import AnyTracker
from radar_tracking.people.zones import Zones, ZonesConfig

FLOOR: Final = (0.0, 5.1, -2.1, 2.1)  # m: where people walk in the furnished room, half a metre inside its walls
PROCESSES: Final = 2
PEER: Final = "stone_soup"
_OWN: Final = ("scenarios", "tracking_suite", "tracking_score", "tracking_choices", "stone_soup")
PACKAGES: Final = (
    "radar_core",
    "radar_dsp",
    "radar_sim",
    "radar_tracking",
    "radar_lab/evaluation",
    *(f"benchmarks/{name}.py" for name in _OWN),
)
"""What finished scenes depend on."""
_TURN: Final = 50  # clouds


class Tracker(Protocol):
    """Anything that follows people through clouds in ``room``."""

    def process(self, cloud: PointCloud) -> Tracks:
        """Take in one cloud."""
        ...


def changed(knobs: Mapping[str, Any]) -> TrackerConfig:
    """Make the default configuration with some knobs changed, by dotted names."""
    return load(TrackerConfig, nest(knobs))


TRACKERS: Final[Mapping[str, TrackerConfig]] = {
    "poisson_bernoulli": TrackerConfig(),
    "group_clustering": changed({"tracker": "group_clustering"}),
    "group": changed({"tracker": "group"}),
    "cluster_first": changed({"tracker": "cluster_first"}),
    "cluster_first_kmeans": changed({"tracker": "cluster_first", "association.split": "kmeans"}),
}
"""The product's, the thesis's three, and the one of these that splits merged clusters."""

THESIS: Final[Mapping[str, TrackerConfig]] = {
    f"thesis_{name}": replace(load_file(TrackerConfig, find_config("thesis", "tracking", ".yaml")), tracker=name)
    for name in ("group_clustering", "group", "cluster_first")
}
"""The same as the thesis describes them, without what we added."""


@dataclass(frozen=True)
class Job:
    """One scene and who tracks it."""

    name: str
    seed: int
    trackers: Mapping[str, TrackerConfig]  # run one after the other
    # run in turn, so that a drifting machine favours none; the first is their reference
    choices: Mapping[str, TrackerConfig] = field(default_factory=dict)
    mount: Pose = MOUNT
    peer: bool = False  # whether Stone Soup runs too
    seconds: float = float("inf")  # only the scene's first so many
    plain: bool = False  # whether the baseband looks for one direction only in each cell of the range-Doppler map, as the thesis's does
    told: bool = True  # whether our trackers and Stone Soup know the furnished room: where people walk, and its walls


@dataclass(frozen=True)
class Done:
    """A job, its scores by the names of the trackers and of the choices, and what the baseband took for each cloud [ms]."""

    job: Job
    trackers: Mapping[str, Score]
    choices: Mapping[str, Score]
    baseband_ms: Sequence[float] = ()


def peer_installed() -> bool:
    """Whether there is a Stone Soup."""
    try:
        import benchmarks.stone_soup  # noqa: F401
    except ImportError:
        return False
    return True


class Peer:
    """Stone Soup's tracker, told the room like ours: it has no boundaries, so it does not get the points beyond them."""

    def __init__(self, zones: ZonesConfig) -> None:
        from benchmarks.stone_soup import StoneSoupTracker

        self._tracker, self._zones = StoneSoupTracker(), Zones(zones)

    def process(self, cloud: PointCloud) -> Tracks:
        """Take in one cloud."""
        inside = self._zones.inside(cloud.position)
        tracks = self._tracker.process(cloud.select(inside))
        owner = np.full(len(cloud), -1, np.int32)
        owner[inside] = tracks.point_track_id
        return replace(tracks, point_track_id=owner)


def zones_of(name: str) -> ZonesConfig:
    """Tell trackers about the room of a scene: the floor on which people walk, and the walls."""
    return ZonesConfig(boundaries=FLOOR, walls=tuple(np.ravel(WALLS).tolist())) if SCENARIOS[name].room else ZonesConfig()


def make(name: str, config: TrackerConfig, info: RadarInfo, *, told: bool = True) -> AnyTracker:
    """Make one of our trackers for a scene; told of the furnished room, the thesis's have what our preset for such rooms changes, too."""
    if not told:
        return make_tracker(config, info)
    if SCENARIOS[name].room and config.tracker != "poisson_bernoulli":
        preset = load_file(TrackerConfig, find_config("furnished", "tracking", ".yaml"))
        config = load(TrackerConfig, over(plain(config), plain(preset)))
    zones = zones_of(name) if config.zones == ZonesConfig() else config.zones
    return make_tracker(replace(config, zones=zones), info)


def over(given: dict[str, Any], preset: dict[str, Any]) -> dict[str, Any]:
    """Put a configuration over a preset's."""
    inner = {key: over(value, preset.get(key, {})) if isinstance(value, dict) else value for key, value in given.items()}
    return preset | inner


def follow(name: str, made: Sequence[Moment], trackers: Mapping[str, Tracker], info: RadarInfo) -> dict[str, Score]:
    """Run trackers over the same clouds in turn, a second of one, then of the next: one at a time would chill each other's caches."""
    scorers = {label: Scorer(name, info) for label in trackers}
    for first in range(0, len(made), _TURN):
        for label, tracker in trackers.items():
            for moment in made[first : first + _TURN]:
                scorers[label].process(moment, *timed(tracker.process, moment.cloud))
    return {label: scorer.score(made) for label, scorer in scorers.items()}


def simulate(job: Job) -> list[Moment]:
    """Make the clouds of a job; whose the points are is found out where people gesture side by side."""
    made: list[Moment] = []
    config = BasebandConfig() if job.plain else None
    for moment in moments(job.name, job.seed, job.mount, owners=job.name == "side_by_side", config=config):
        if made and (moment.cloud.stamp_ns - made[0].cloud.stamp_ns) * 1e-9 >= job.seconds:
            break
        made.append(moment)
    return made


def work(job: Job) -> Done:
    """Simulate a scene and run everybody over it."""
    made, info = simulate(job), RadarInfo(mount=job.mount)
    scores: dict[str, Score] = {}
    for label, config in job.trackers.items():
        scores |= follow(job.name, made, {label: make(job.name, config, info, told=job.told)}, info)
    if job.peer:
        scores |= follow(job.name, made, {PEER: Peer(zones_of(job.name) if job.told else ZonesConfig())}, info)
    choices = {label: make(job.name, config, info, told=job.told) for label, config in job.choices.items()}
    return Done(job, scores, follow(job.name, made, choices, info), [moment.baseband_ms for moment in made])


def run_all(jobs: Sequence[Job], processes: int = PROCESSES, keep: Path | None = None) -> list[Done]:
    """Do all jobs, the longest first; finished ones are taken from the folder ``keep`` while the sources are the same."""
    do = work if keep is None else Memory(keep / sources(PACKAGES), verbose=0).cache(work)
    order = sorted(range(len(jobs)), key=lambda i: -_length(jobs[i]))
    with parallel_config(backend="loky", inner_max_num_threads=1) if processes > 1 else parallel_config(backend="sequential"):
        results = Parallel(n_jobs=min(processes, os.cpu_count() or 1), return_as="generator")(delayed(do)(jobs[i]) for i in order)
        console = Console(stderr=True)
        done = dict(zip(order, track(results, "scenes", total=len(jobs), console=console), strict=True))
    return [done[i] for i in range(len(jobs))]


def _length(job: Job) -> float:
    """How long a job takes, about: clouds times trackers, the simulation as ten of them."""
    return min(SCENARIOS[job.name].duration, job.seconds) * (10 + len(job.trackers) + 8 * job.peer + len(job.choices))


def pooled(done: Sequence[Done], tracker: str, names: Sequence[str] = (), mount: Pose = MOUNT, *, plain: bool = False) -> Score:
    """Add up a tracker's scores over all seeds of some scenes; no names: of all scenes."""
    own = [d for d in done if d.job.mount == mount and d.job.plain == plain]
    chosen = [d for d in own if tracker in d.trackers and (not names or d.job.name in names)]
    return total([d.trackers[tracker] for d in chosen])


def figures(score: Score, name: str) -> dict[str, float]:
    """Figures of a tracker on one kind of scene."""
    found = {
        "gospa": score.mean_gospa,
        "id_switches": score.switches,
        "mota": score.mota,
        "frame_ms": float(np.median(score.times)),
        "torso_error_m": score.torso_error,
        "ghosts_per_minute": score.ghosts_per_minute,
        "ghost_track_frames_per_minute": score.ghost_track_frames_per_minute,
        "misses": score.misses,
        "false": score.false,
        "truths": score.truths,
        "scenes": score.scenes,
    }
    return found | ({"wrong_point_fraction": score.wrong_fraction} if name == "side_by_side" else {})
