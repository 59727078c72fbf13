"""Long simulated streams: simulated once, a minute at a time, kept on disk, and followed by tracker and recogniser."""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.stores import Columns, Store, pack, unpack
from radar_core import PointCloud
from radar_core.config import plain
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.recognizer import Gesture, GestureConfig, GestureRecognizer, TrackEvent
from radar_lab.datasets.scenes import nearest_person
from radar_sim import Scene, Simulator, Truth
from radar_sim.motions.script import Timeline
from radar_sim.people import Action, Person
from radar_tracking import PeopleTracker, TrackedCloud, TrackerConfig

PIECE: Final = 60.0
"""Scene time in one file [s]."""
_POINT: Final = ("x", "y", "z", "range", "azimuth", "elevation", "radial_speed", "snr", "azimuth_std", "elevation_std")
_WHO: Final = ("gesture", "gesture_index", "walking", "drawing", "gesture_start_ns", "gesture_end_ns")
_MOTION: Final = ("position", "velocity", "hand_position", "hand_velocity", "other_hand_position", "other_hand_velocity")


@dataclass(frozen=True, eq=False)
class Moment:
    """One cloud in ``room`` and what is true then, scatterers left out."""

    cloud: PointCloud
    truth: Truth


class StreamStore(Store):
    """Streams on disk, a minute in a file.

    Parameters
    ----------
    folder : Path
        Where files go.
    baseband : BasebandConfig or None
        None: all defaults.
    """

    def __init__(self, folder: Path, baseband: BasebandConfig | None = None) -> None:
        settings = baseband if baseband is not None else BasebandConfig()
        super().__init__(folder, "clouds", functools.partial(_simulate, settings), [plain(settings), PIECE])

    def fill(self, scenes: Iterable[Scene], *, n_jobs: int = 1, progress: bool = True) -> float:
        """Simulate what is not there yet.

        Returns
        -------
        float
            Seconds that it took per simulated minute of scene; NaN when nothing was left to do.
        """
        start = time.monotonic()
        pieces = [(scene, piece) for scene in scenes for piece in range(math.ceil(scene.duration / PIECE))]
        made = (
            sum(min(PIECE, scene.duration - piece * PIECE) for scene, piece in self.make(pieces, n_jobs=n_jobs, progress=progress)) / 60.0
        )
        return (time.monotonic() - start) / made if made else math.nan

    def moments(self, scene: Scene) -> Iterator[Moment]:
        """Read a scene's clouds and truth, in order of time."""
        for piece in range(math.ceil(scene.duration / PIECE)):
            yield from _unpacked(self.columns(scene, piece))


def _simulate(baseband: BasebandConfig, scene: Scene, piece: int) -> dict[str, NDArray[Any]]:
    simulator = Simulator(scene)
    stage, mount = Baseband(baseband, simulator.info), simulator.info.mount
    clouds, truths = [], []
    for number in _frames(simulator, piece):
        made = simulator.process(number)
        clouds.append(stage.process(made.frame).to_room(mount))
        truths.append(made.truth)
    return _packed(clouds, truths)


def _frames(simulator: Simulator, piece: int) -> range:
    """Numbers of the frames that begin within a piece."""
    first, last = (
        math.ceil((t - simulator.radar.trigger_offset) / simulator.interval - 1e-9) for t in (piece * PIECE, (piece + 1) * PIECE)
    )
    return range(max(first, 0), min(last, simulator.n_frames))


def _packed(clouds: Sequence[PointCloud], truths: Sequence[Truth]) -> dict[str, NDArray[Any]]:
    """Columns of a file: clouds, and truth as (n_frames, n_people, ...)."""
    columns = pack(clouds, _POINT) | {"person_id": truths[0].person_id}
    columns |= {name: np.stack([getattr(truth, name) for truth in truths]) for name in _WHO}
    return columns | {name: np.stack([getattr(truth, name) for truth in truths]).astype(np.float32) for name in _MOTION}


def _unpacked(columns: Columns) -> Iterator[Moment]:
    motion = {name: columns[name].astype(np.float64) for name in _MOTION}
    for k, cloud in enumerate(unpack(columns, "room")):
        own: dict[str, Any] = {name: columns[name][k] for name in _WHO} | {name: motion[name][k] for name in _MOTION}
        truth = Truth(stamp_ns=cloud.stamp_ns, sequence=cloud.sequence, frame_id="room", person_id=columns["person_id"], **own)
        yield Moment(cloud, truth)


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
    store: StreamStore, scene: Scene, model: GestureModel, settings: GestureConfig | None = None, tracker: TrackerConfig | None = None
) -> Run:
    """Run tracking and recognition over a stored scene; every event is kept, random ones too.

    Parameters
    ----------
    store : StreamStore
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
