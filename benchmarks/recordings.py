"""Real recordings: people trackers on walkers without truth and on exercises beside a Kinect (docs/reference/recordings.md)."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from benchmarks.report import AbsentError, choice, timed
from radar_core import PointCloud
from radar_core.config import load_file
from radar_core.paths import find_config
from radar_driver.clouds import to_our_axes
from radar_lab.importers import open_original
from radar_tracking import PeopleTracker, TrackerConfig, Tracks, TrackStatus

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]

WALKERS = {"one_person": (0,), "two_people": (-1, 1)}  # recordings of walkers, and how each of them walks: coming (-1), going (1), both (0)
MARS = ("subject1_test", "subject1_validate", "subject3_test", "subject3_validate")
SPINE = ("SpineBase", "SpineMid", "SpineShoulder")
PRESETS = {"crossing": "dense", "mars": "sparse"}  # files of config/tracking for the two kinds
TRACKERS = ("group_clustering", "group", "cluster_first")
RADIUS = 0.7  # m: a walker has a track while one is this near to their path
_FEW = 300  # clouds of a file of MARS in quick runs
_DEGREE = 6  # of the path's polynomials: what is left over does not fall any more (7 cm in range)
_REACHES = (3.0, 2.0, 1.5, 1.0, 0.8, 0.8, 0.8, 0.8)  # m: points this near to the path are the walker's, fit by fit


class Tracker(Protocol):
    """Anything that follows people through clouds in ``room``."""

    def reset(self) -> None: ...  # noqa: D102
    def process(self, cloud: PointCloud) -> Tracks: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class Path2D:
    """Where a walker was, from all of the recording's points at once: no tracker sees the future, this does."""

    # first, last: clouds of the walker's first and last point
    first: int
    last: int
    place: Float64Array  # shape (n_clouds, 2): (x, y) [m]; beyond ``first`` and ``last`` the nearest of the two

    @property
    def n_seen(self) -> int:
        """Number of clouds from first to last."""
        return self.last - self.first + 1


@dataclass(frozen=True, eq=False)
class Run:
    """What a tracker made of a recording: a result and milliseconds for every cloud."""

    results: tuple[Tracks, ...]
    times_ms: tuple[float, ...]

    def people(self) -> Counter[int]:
        """Identities that were ever confirmed, and in how many clouds."""
        return Counter(t.id for tracks in self.results for t in tracks.people)

    def path(self, identity: int) -> Float64Array:
        """Places (x, y) of a confirmed track, shape (n_clouds, 2) [m]; NaN where there is none."""
        found = np.full((len(self.results), 2), np.nan)
        for row, tracks in enumerate(self.results):
            track = tracks.find(identity)
            if track is not None and track.status is not TrackStatus.TENTATIVE:
                found[row] = track.position[:2]
        return found


def folder() -> Path:
    """Folder of the recordings: ``HANDWAVE_DATA``, or shared/data beside the project. Raises AbsentError when there is none."""
    place = Path(os.environ.get("HANDWAVE_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    if not place.is_dir():
        raise AbsentError(f"{place}: there are no recordings; HANDWAVE_DATA names the folder with them (docs/reference/recordings.md)")
    return place


def clouds_of(kind: str, name: str) -> list[PointCloud]:
    """Clouds of a recording, in the room."""
    recording = open_original(kind, folder() / kind / f"{name}.npz")
    return [item.to_room(recording.info.mount) for item in recording.items if isinstance(item, PointCloud)]


def follow(tracker: Tracker, clouds: Sequence[PointCloud]) -> Run:
    """Run a tracker, from its reset on."""
    tracker.reset()
    results, times = zip(*(timed(tracker.process, cloud) for cloud in clouds), strict=True)
    return Run(results, times)


def paths(name: str, clouds: Sequence[PointCloud]) -> tuple[Path2D, ...]:
    """Paths of the walkers of a recording, in the order of `WALKERS`."""
    number = np.concatenate([np.full(len(cloud), k) for k, cloud in enumerate(clouds)])
    place = np.concatenate([np.stack([cloud.x, cloud.y], axis=-1) for cloud in clouds]).astype(np.float64)
    speed = np.concatenate([cloud.radial_speed for cloud in clouds])
    ways = [speed * way > 0 if way else np.ones(len(speed), np.bool_) for way in WALKERS[name]]
    return tuple(_path(number[own], place[own], len(clouds)) for own in ways)


def _path(number: IndexArray, place: Float64Array, n_clouds: int) -> Path2D:
    """Fit polynomials to the points near the path, again and again with a narrower eye."""
    own = np.ones(len(number), np.bool_)
    for reach in _REACHES:
        fit = [Polynomial.fit(number[own], axis[own], _DEGREE) for axis in place.T]
        own = np.hypot(*(place[:, i] - fit[i](number) for i in (0, 1))) < reach
    first, last = int(number[own].min()), int(number[own].max())
    where = np.clip(np.arange(n_clouds), first, last)
    return Path2D(first, last, np.stack([axis(where) for axis in fit], axis=-1))


def walk_figures(name: str, clouds: Sequence[PointCloud], run: Run) -> dict[str, float]:
    """Say how well the walkers were followed.

    Returns ``identities``: ever confirmed; ``ghosts``: those that are no walker's longest; ``ghost_clouds``: clouds with one. ``life``:
    clouds in which a walker's longest identity is near, over those from the walker's first to last point; ``life_of_run``: over the whole
    run; ``seen_of_run``: what that could be at most. ``switches``: changes of the identity near a walker; ``rms_m``: from the path, which
    is of what the radar sees: a tracker that knows that this is a body's surface is 0.06 to 0.12 m behind it. Of two walkers, the worse
    figure; switches are summed.
    """
    people = run.people()
    tracked = {identity: run.path(identity) for identity in people}
    scores = [_follow_score(path, tracked) for path in paths(name, clouds)]
    ghosts = set(people) - {score.longest for score in scores}
    haunted = sum(any(t.id in ghosts and t.status is not TrackStatus.TENTATIVE for t in tracks.tracks) for tracks in run.results)
    return {
        "identities": len(people),
        "ghosts": len(ghosts),
        "ghost_clouds": haunted,
        "life": min(score.n_clouds / score.n_seen for score in scores),
        "life_of_run": min(score.n_clouds for score in scores) / len(clouds),
        "seen_of_run": min(score.n_seen for score in scores) / len(clouds),
        "switches": sum(score.switches for score in scores),
        "rms_m": max(score.rms for score in scores),
        "frame_ms": float(np.median(run.times_ms)),
    }


@dataclass(frozen=True)
class _Score:
    """How one walker was followed: identity that was near longest, in how many clouds of how many, switches, rms [m]."""

    longest: int
    n_clouds: int
    n_seen: int
    switches: int
    rms: float


def _follow_score(path: Path2D, tracked: dict[int, Float64Array]) -> _Score:
    """Compare one walker's path with all tracks, by identity."""
    apart = {identity: np.hypot(*np.nan_to_num(place - path.place, nan=np.inf).T) for identity, place in tracked.items()}
    owners = _owners(apart, path)
    if not owners:
        return _Score(-1, 0, path.n_seen, 0, RADIUS)
    longest, n_clouds = Counter(owners).most_common(1)[0]
    near = apart[longest][path.first : path.last + 1]
    rms = float(np.sqrt(np.mean(near[near < RADIUS] ** 2)))
    return _Score(longest, n_clouds, path.n_seen, sum(a != b for a, b in pairwise(owners)), rms)


def _owners(apart: dict[int, Float64Array], path: Path2D) -> list[int]:
    """Identity near the walker in each cloud from first to last that has one; whoever had it keeps it while near, as in CLEAR-MOT."""
    owners: list[int] = []
    for k in range(path.first, path.last + 1):
        near = {identity: float(distance[k]) for identity, distance in apart.items() if distance[k] < RADIUS}
        if near:
            owners.append(owners[-1] if owners and owners[-1] in near else min(near, key=near.__getitem__))
    return owners


def walkers(name: str, tracker: Tracker) -> dict[str, float]:
    """Run a tracker over one of `WALKERS`; see `walk_figures`."""
    clouds = clouds_of("crossing", name)
    return walk_figures(name, clouds, follow(tracker, clouds))


def spine(name: str) -> Float64Array:
    """Middle of the Kinect's spine joints in one of `MARS`, shape (n_clouds, 2) = (x, y) in the room [m]."""
    with np.load(folder() / "mars" / f"{name}.npz") as data:
        joints = [str(joint) for joint in data["joints"]]
        middle = data["joint_xyz"][:, [joints.index(joint) for joint in SPINE]].astype(np.float64).mean(axis=1)
    return np.asarray(to_our_axes(middle)[:, :2], np.float64)


def spine_figures(name: str, run: Run) -> dict[str, float]:
    """Say how well the longest identity follows the spine.

    ``alone``: share of the clouds with exactly one person; ``followed``: with the longest identity; ``rms_m``: distance from the spine
    without the mean difference of the file; ``still_m``: what a place that never moves would have.
    """
    people = run.people()
    body = spine(name)[: len(run.results)]
    counts = [tracks.people_count for tracks in run.results]
    track = run.path(people.most_common(1)[0][0]) if people else np.full(body.shape, np.nan)
    has = np.isfinite(track[:, 0])
    apart = track[has] - body[has]
    offset = apart.mean(axis=0) if has.any() else np.full(2, np.nan)
    error = np.sqrt(((apart - offset) ** 2).mean(axis=0)) if has.any() else np.full(2, np.nan)
    return {
        "identities": len(people),
        "alone": float(np.mean(np.equal(counts, 1))),
        "followed": float(has.mean()),
        "rms_m": float(np.hypot(*error)),
        "rms_x_m": float(error[0]),
        "rms_y_m": float(error[1]),
        "offset_x_m": float(offset[0]),
        "offset_y_m": float(offset[1]),
        "still_m": float(np.hypot(*body.std(axis=0))),
        "frame_ms": float(np.median(run.times_ms)),
    }


def mars(tracker: Tracker, names: Sequence[str] = MARS) -> dict[str, dict[str, float]]:
    """Run a tracker over MARS files, each from its reset on; see `spine_figures`."""
    return {name: spine_figures(name, follow(tracker, clouds_of("mars", name))) for name in names}


def tracker_for(preset: str, name: str) -> PeopleTracker:
    """Make one of `TRACKERS` with a preset of config/tracking; ``default``: with none."""
    config = TrackerConfig() if preset == "default" else load_file(TrackerConfig, find_config(preset, "tracking", ".yaml"))
    return PeopleTracker(replace(config, tracker=name))


def run(quick: bool) -> dict[str, Any]:
    """Measure the three trackers, and Stone Soup where it is installed; quick: one walker, and the beginning of one file of MARS."""
    result: dict[str, Any] = {}
    rows: list[dict[str, Any]] = []
    reference: dict[str, list[float]] = {}
    for label, make in _contenders().items():
        for kind, name in _tasks(quick):
            clouds = clouds_of(kind, name)
            clouds = clouds[:_FEW] if quick and kind == "mars" else clouds
            found = follow(make(kind), clouds)
            figures = walk_figures(name, clouds, found) if kind == "crossing" else spine_figures(name, found)
            result |= {f"{name}_{label}_{key}": value for key, value in figures.items()}
            accuracy = ("life", figures["life"], "") if kind == "crossing" else ("rms from the spine", figures["rms_m"], "m")
            title = f"{name}: {label}, {figures['identities']:.0f} identities"
            times = list(found.times_ms)
            rows.append(choice("recordings", title, accuracy=accuracy, times_ms=times, reference_ms=reference.setdefault(name, times)))
    return {**result, "choices": rows}


def _tasks(quick: bool) -> list[tuple[str, str]]:
    tasks = [("crossing", name) for name in WALKERS] + [("mars", name) for name in MARS]
    return [tasks[0], tasks[2]] if quick else tasks


def _contenders() -> dict[str, Callable[[str], Tracker]]:
    """Makers of trackers, by the kind of recording; the first is the reference of times."""

    def ours(name: str) -> Callable[[str], Tracker]:
        return lambda kind: tracker_for(PRESETS[kind], name)

    found: dict[str, Callable[[str], Tracker]] = {name: ours(name) for name in TRACKERS}
    try:
        from benchmarks.stone_soup import StoneSoupConfig, StoneSoupTracker
    except ImportError:
        return found
    tuned = {  # confirmed after 0.3 s, as ours; on MARS with the same filter as ours, and whole people as one cluster
        "crossing": StoneSoupConfig(confirm_updates=9, min_points=5),
        "mars": StoneSoupConfig(confirm_updates=3, eps=1.0, process_noise=0.1, position_std=0.3),
    }
    return {**found, "stone_soup": lambda kind: StoneSoupTracker(tuned[kind])}
