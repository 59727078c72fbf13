"""Long simulated streams: simulated once, a minute at a time, kept on disk, and followed by tracker and recogniser."""

from __future__ import annotations

import ast
import dataclasses
import functools
import hashlib
import json
import math
import time
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError, PointCloud
from radar_core.config import plain
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.datasets.samples import write_chunk
from radar_gestures.datasets.workers import work_through
from radar_gestures.evaluation.scoring import nearest_person
from radar_gestures.recognizer import Gesture, GestureConfig, GestureRecognizer, TrackEvent
from radar_sim import Scene, Simulator, Truth
from radar_sim.motions.script import Timeline
from radar_sim.people import Action, Person
from radar_tracking import PeopleTracker, TrackedCloud, TrackerConfig

PIECE: Final = 60.0
"""Scene time in one file [s]."""
PACKAGES: Final = ("radar_core", "radar_dsp", "radar_sim")
"""What clouds depend on."""
_POINT: Final = ("x", "y", "z", "range", "azimuth", "elevation", "radial_speed", "snr", "azimuth_std", "elevation_std")
_WHO: Final = ("gesture", "gesture_index", "walking", "drawing", "gesture_start_ns", "gesture_end_ns")
_MOTION: Final = ("position", "velocity", "hand_position", "hand_velocity", "other_hand_position", "other_hand_velocity")


@dataclass(frozen=True, eq=False)
class Moment:
    """One cloud in ``room`` and what is true then, scatterers left out."""

    cloud: PointCloud
    truth: Truth


def code_of(text: str) -> str:
    """Strip comments, docstrings and layout from a module: they change nothing that is simulated."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node, clean=False) is not None:
            node.body = node.body[1:]
    return ast.unparse(tree)


@functools.cache
def sources(packages: tuple[str, ...] = PACKAGES) -> str:
    """Digest of the code of all modules on which clouds, or what else is made by some packages, depend."""
    root = Path(__file__).resolve().parent.parent
    found = hashlib.sha256()
    for path in sorted(path for package in packages for path in (root / package).rglob("*.py")):
        found.update(f"{path.relative_to(root)}\n{code_of(path.read_text(encoding='utf-8'))}\n".encode())
    return found.hexdigest()[:16]


class Store:
    """Clouds of scenes on disk; what is there is not simulated again while scene, baseband and our sources stay the same.

    Parameters
    ----------
    folder : Path
        Where files go, in a folder of their own for each state of the sources.
    baseband : BasebandConfig or None
        None: all defaults.
    """

    def __init__(self, folder: Path, baseband: BasebandConfig | None = None) -> None:
        self._folder = folder.absolute() / f"clouds_{sources()}"
        self._baseband = baseband if baseband is not None else BasebandConfig()

    def path(self, scene: Scene, piece: int) -> Path:
        """File of one piece of a scene."""
        text = json.dumps([plain(scene), plain(self._baseband), PIECE], sort_keys=True)
        return self._folder / f"{hashlib.sha256(text.encode()).hexdigest()[:16]}_{piece:03d}.npz"

    def fill(self, scenes: Iterable[Scene], *, n_jobs: int = 1, progress: bool = True) -> float:
        """Simulate what is not there yet; a stopped run goes on where it stopped.

        Returns
        -------
        float
            Seconds that it took per simulated minute of scene; NaN when nothing was left to do.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        pieces = [(scene, piece) for scene in scenes for piece in range(math.ceil(scene.duration / PIECE))]
        todo = [number for number, (scene, piece) in enumerate(pieces) if not self.path(scene, piece).exists()]
        start = time.monotonic()
        make = functools.partial(_make, self, pieces)
        work_through(make, todo, n_total=len(pieces), n_jobs=n_jobs, progress=progress, title="simulating streams")
        made = sum(min(PIECE, pieces[number][0].duration - pieces[number][1] * PIECE) for number in todo) / 60.0
        return (time.monotonic() - start) / made if made else math.nan

    def write(self, scene: Scene, piece: int) -> None:
        """Simulate one piece of a scene and keep it."""
        simulator = Simulator(scene)
        baseband, mount = Baseband(self._baseband, simulator.info), simulator.info.mount
        clouds, truths = [], []
        for number in _frames(simulator, piece):
            made = simulator.process(number)
            clouds.append(baseband.process(made.frame).to_room(mount))
            truths.append(made.truth)
        write_chunk(self.path(scene, piece), _packed(clouds, truths))

    def moments(self, scene: Scene) -> Iterator[Moment]:
        """Read a scene's clouds and truth, in order of time.

        Raises
        ------
        DataError
            When a piece is missing or cannot be read.
        """
        for piece in range(math.ceil(scene.duration / PIECE)):
            path = self.path(scene, piece)
            try:
                with np.load(path, allow_pickle=False) as content:
                    columns = {name: content[name] for name in content.files}
            except (OSError, ValueError, zipfile.BadZipFile) as error:
                raise DataError(f"{path}: cannot be read ({error}); delete it and fill the store again") from None
            yield from _unpacked(columns)


def _make(store: Store, pieces: Sequence[tuple[Scene, int]], number: int) -> None:
    store.write(*pieces[number])


def _frames(simulator: Simulator, piece: int) -> range:
    """Numbers of the frames that begin within a piece."""
    first, last = (
        math.ceil((t - simulator.radar.trigger_offset) / simulator.interval - 1e-9) for t in (piece * PIECE, (piece + 1) * PIECE)
    )
    return range(max(first, 0), min(last, simulator.n_frames))


def _packed(clouds: Sequence[PointCloud], truths: Sequence[Truth]) -> dict[str, NDArray[Any]]:
    """Columns of a file: points of all clouds one after the other, truth as (n_frames, n_people, ...)."""
    columns: dict[str, NDArray[Any]] = {
        "stamp_ns": np.array([cloud.stamp_ns for cloud in clouds], np.int64),
        "sequence": np.array([cloud.sequence for cloud in clouds], np.int64),
        "count": np.array([len(cloud) for cloud in clouds], np.int32),
        "person_id": truths[0].person_id,
    }
    columns |= {f"point_{name}": np.concatenate([getattr(cloud, name) for cloud in clouds]) for name in _POINT}
    columns |= {name: np.stack([getattr(truth, name) for truth in truths]) for name in _WHO}
    return columns | {name: np.stack([getattr(truth, name) for truth in truths]).astype(np.float32) for name in _MOTION}


def _unpacked(columns: Mapping[str, NDArray[Any]]) -> Iterator[Moment]:
    edge = np.concatenate([[0], np.cumsum(columns["count"])])
    motion = {name: columns[name].astype(np.float64) for name in _MOTION}
    for k, (stamp, sequence) in enumerate(zip(columns["stamp_ns"].tolist(), columns["sequence"].tolist(), strict=True)):
        own: dict[str, Any] = {name: columns[f"point_{name}"][edge[k] : edge[k + 1]] for name in _POINT}
        cloud = PointCloud(stamp_ns=stamp, sequence=sequence, frame_id="room", **own)
        who = {name: columns[name][k] for name in _WHO} | {name: motion[name][k] for name in _MOTION}
        yield Moment(cloud, Truth(stamp_ns=stamp, sequence=sequence, frame_id="room", person_id=columns["person_id"], **who))


def fitted(person: Person, duration: float, seed: int, more: Callable[[], Sequence[Action]], mount: tuple[float, float]) -> Person:
    """Add steps to a script until it is longer than a scene, cut it after the last step that is over in time, and stand still from then on.

    Parameters
    ----------
    person : Person
        With the beginning of a script.
    duration : float
        Of the scene [s].
    seed : int
        Of the scene.
    more : callable
        Gives the next steps; each call has to take some time.
    mount : tuple of float
        (x, y) of what the person faces [m].
    """

    def end(script: Sequence[Action]) -> float:
        return Timeline(dataclasses.replace(person, script=tuple(script)), seed, mount).end

    script = list(person.script)
    reached = 0.0
    while reached <= duration:
        before, goal = len(script), 1.2 * (duration - reached)
        pace = reached / before if reached else 10.0
        while (len(script) - before) * pace <= goal:
            script += more()
        reached = end(script)
    low, high = 0, len(script)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if end(script[:middle]) <= duration else (low, middle)
    return dataclasses.replace(person, script=(*script[:low], Action(stand=duration)))


@dataclass(frozen=True, eq=False)
class Found:
    """An event, what the recogniser calls it, and the person nearest to its track when it was decided; None: nobody is near."""

    person_id: int | None
    gesture: Gesture
    event: TrackEvent


@dataclass(frozen=True, eq=False)
class Run:
    """A stream that was followed.

    Attributes
    ----------
    scene : Scene
        What happened.
    tracked : list of TrackedCloud
        Clouds and tracks.
    truths : list of Truth
        Of the same stamps.
    found : list of Found
        Every event, those called random too.
    times_ms : list of float
        What the recogniser took for each cloud [ms].
    """

    scene: Scene
    tracked: list[TrackedCloud]
    truths: list[Truth]
    found: list[Found]
    times_ms: list[float]

    @property
    def hours(self) -> float:
        """Length [h]."""
        return self.scene.duration / 3600.0


def follow(
    store: Store, scene: Scene, model: GestureModel, settings: GestureConfig | None = None, tracker: TrackerConfig | None = None
) -> Run:
    """Run tracking and recognition over a stored scene; every event is kept, random ones too.

    Parameters
    ----------
    store : Store
        That holds the scene.
    scene : Scene
        Which.
    model : GestureModel
        The classifier.
    settings : GestureConfig or None
        Knobs of the recogniser. None: the defaults.
    tracker : TrackerConfig or None
        None: the defaults.
    """
    info = scene.radars[0].info
    people = PeopleTracker(tracker if tracker is not None else TrackerConfig(), info)
    recogniser = GestureRecognizer(settings if settings is not None else GestureConfig(), model, info.mount)
    run = Run(scene, [], [], [], [])
    for moment in store.moments(scene):
        tracked = TrackedCloud(moment.cloud, people.process(moment.cloud))
        start = time.perf_counter_ns()
        events = recogniser.find(tracked)
        gestures = [recogniser.name(event, tracked.tracks.stamp_ns) for event in events]
        run.times_ms.append((time.perf_counter_ns() - start) * 1e-6)
        for event, gesture in zip(events, gestures, strict=True):
            track = tracked.tracks.find(gesture.track_id)
            person = None if track is None else nearest_person(moment.truth, track.position)
            run.found.append(Found(person, gesture, dataclasses.replace(event, maps=None)))
        run.tracked.append(tracked)
        run.truths.append(moment.truth)
    return run
