"""Long simulated streams: simulated once, a minute at a time, kept on disk, and followed by tracker and recogniser."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import timed
from benchmarks.stores import Columns, Store, clouds_of, pack, unpack
from radar_core import PointCloud, Pose
from radar_core.config import plain
from radar_dsp import BasebandConfig
from radar_gestures.classifiers.classifier import Classifier
from radar_gestures.gesture import Gesture
from radar_gestures.make import Recognizer, make_recognizer
from radar_gestures.stage import GestureConfig, TrackEvent
from radar_gestures.stream.recognizer import StreamEvent
from radar_lab.datasets.scenes import nearest_person
from radar_lab.evaluation.matching import Matching, Visibility
from radar_sim import Scene, Simulator, Truth
from radar_tracking import TrackedCloud, TrackerConfig, make_tracker

PIECE: Final = 60.0  # scene time in one file [s]
_POINT: Final = ("x", "y", "z", "range", "azimuth", "elevation", "radial_speed", "snr", "azimuth_std", "elevation_std")
_WHO: Final = ("gesture", "gesture_index", "walking", "drawing", "gesture_start_ns", "gesture_end_ns")
_MOTION: Final = ("position", "velocity", "hand_position", "hand_velocity", "other_hand_position", "other_hand_velocity")


@dataclass(frozen=True, eq=False)
class Moment:
    """One cloud in ``room`` and what is true then, scatterers left out."""

    cloud: PointCloud
    truth: Truth


class StreamStore(Store):
    """Streams on disk, a minute in a file. ``folder``: where files go; ``baseband``: None: all defaults."""

    def __init__(self, folder: Path, baseband: BasebandConfig | None = None) -> None:
        config = baseband or BasebandConfig()
        super().__init__(folder, "clouds", functools.partial(_simulate, config), [plain(config), PIECE])

    def fill(self, scenes: Iterable[Scene], *, n_jobs: int = 1, progress: bool = True) -> float:
        """Simulate what is not there yet. Returns seconds that it took per simulated minute of scene; NaN when nothing was left to do."""
        start = time.monotonic()
        pieces = [(scene, piece) for scene in scenes for piece in range(math.ceil(scene.duration / PIECE))]
        new = self.make(pieces, n_jobs=n_jobs, progress=progress)
        made = sum(min(PIECE, scene.duration - piece * PIECE) for scene, piece in new) / 60.0
        return (time.monotonic() - start) / made if made else math.nan

    def moments(self, scene: Scene) -> Iterator[Moment]:
        """Read a scene's clouds and truth, in order of time."""
        for piece in range(math.ceil(scene.duration / PIECE)):
            yield from unpacked(self.columns(scene, piece))


def _simulate(baseband: BasebandConfig, scene: Scene, piece: int) -> dict[str, NDArray[Any]]:
    simulator = Simulator(scene)
    return packed(*clouds_of(simulator, _frames(simulator, piece), baseband), simulator.info.mount)


def _frames(simulator: Simulator, piece: int) -> range:
    """Numbers of the frames that begin within a piece."""
    first, last = (
        math.ceil((t - simulator.radar.trigger_offset) / simulator.interval - 1e-9) for t in (piece * PIECE, (piece + 1) * PIECE)
    )
    return range(max(first, 0), min(last, simulator.n_frames))


def packed(clouds: Sequence[PointCloud], truths: Sequence[Truth], mount: Pose) -> dict[str, NDArray[Any]]:
    """Columns of a file: clouds, put into ``room``, and truth as (n_frames, n_people, ...)."""
    columns = pack([cloud.to_room(mount) for cloud in clouds], _POINT) | {"person_id": truths[0].person_id}
    columns |= {name: np.stack([getattr(truth, name) for truth in truths]) for name in _WHO}
    return columns | {name: np.stack([getattr(truth, name) for truth in truths]).astype(np.float32) for name in _MOTION}


def unpacked(columns: Columns) -> Iterator[Moment]:
    """Give the moments that `packed` made columns of."""
    motion = {name: columns[name].astype(np.float64) for name in _MOTION}
    for k, cloud in enumerate(unpack(columns, "room")):
        own: dict[str, Any] = {name: columns[name][k] for name in _WHO} | {name: motion[name][k] for name in _MOTION}
        truth = Truth(stamp_ns=cloud.stamp_ns, sequence=cloud.sequence, frame_id="room", person_id=columns["person_id"], **own)
        yield Moment(cloud, truth)


Association = Literal["matching", "nearest"]


@dataclass(frozen=True, eq=False)
class Found:
    """An event, what the recogniser calls it, and the person whose its track was; None: the track was on nobody."""

    person_id: int | None
    gesture: Gesture
    event: TrackEvent | StreamEvent


@dataclass(frozen=True, eq=False)
class Run:
    """A stream that was followed."""

    scene: Scene
    tracked: list[TrackedCloud]
    truths: list[Truth]  # of the same stamps
    found: list[Found]  # every event, those called random too
    times_ms: list[float]  # what the recogniser took for each cloud [ms]
    matching: Matching  # tracks against people


@dataclass(eq=False)
class _Heard:
    """A recogniser, what it has found so far, with who was nearest to the track then, and what each cloud took [ms]."""

    recogniser: Recognizer
    events: list[tuple[int | None, Gesture, TrackEvent | StreamEvent]] = field(default_factory=list)
    times_ms: list[float] = field(default_factory=list)

    def process(self, tracked: TrackedCloud, truth: Truth) -> None:
        decided, spent = timed(self.recogniser.decide, tracked)
        self.times_ms.append(spent)
        for event, gesture in decided:
            track = tracked.tracks.find(gesture.track_id)
            near = None if track is None else nearest_person(truth, track.position)
            self.events.append((near, gesture, event.without_maps() if isinstance(event, TrackEvent) else event))

    def owned(self, matching: Matching, association: Association) -> list[Found]:
        def owner(near: int | None, gesture: Gesture) -> int | None:
            return near if association == "nearest" else matching.owner(gesture.track_id, gesture.start_ns, gesture.stamp_ns)

        return [Found(owner(near, gesture), gesture, event) for near, gesture, event in self.events]


def follow(
    store: StreamStore, scene: Scene, model: Classifier, tracker: TrackerConfig | None = None, association: Association = "matching"
) -> Run:
    """Run tracking and recognition over a stored scene; every event is kept, random ones too.

    An event belongs, by "matching", to the person on whom its track was longest meanwhile (`Matching.owner`); by "nearest", the first
    definition, to who was nearest to the track, within 0.8 m, when it was decided.
    """
    return follow_all(store, scene, [model], tracker, association)[0]


def follow_all(
    store: StreamStore,
    scene: Scene,
    models: Sequence[Classifier],
    tracker: TrackerConfig | None = None,
    association: Association = "matching",
) -> list[Run]:
    """`follow` with several models that recognise in the same tracks."""
    info = scene.radars[0].info
    people, matching, rule = make_tracker(tracker, info), Matching(), Visibility(info)
    heard = [_Heard(make_recognizer(GestureConfig(), model, info)) for model in models]
    tracked, truths = [], []
    for moment in store.moments(scene):
        tracked.append(TrackedCloud(moment.cloud, people.process(moment.cloud)))
        truths.append(moment.truth)
        matching.process(tracked[-1].tracks, moment.truth, rule.process(moment.truth))
        for one in heard:
            one.process(tracked[-1], moment.truth)
    return [Run(scene, tracked, truths, one.owned(matching, association), one.times_ms, matching) for one in heard]
