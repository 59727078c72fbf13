"""Simulated, labelled samples: random people gesture in random places, and the run-time chain cuts and measures what they do (section 5.3).

Samples come from whole scenes with one to three people, through the same baseband, tracking, event detection and features as at run time,
so that training sees what the recogniser will see: events cut too early, points lost to the neighbour, walking, fidgeting.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, PointCloud, RadarInfo
from radar_core.types import Float64Array
from radar_dsp import Baseband, BasebandConfig, DoaConfig
from radar_gestures.features import FEATURE_NAMES
from radar_gestures.stage import EventStage, GestureConfig, TrackEvent, feature_settings
from radar_lab.datasets.samples import chunk_path, load_samples, open_folder, work_through, write_chunk
from radar_lab.datasets.training_scenes import training_scene
from radar_lab.evaluation.scoring import TruthSegment, truth_segments
from radar_sim import Scene, Simulator, Truth
from radar_sim.motions.strokes import library_hash
from radar_tracking import PeopleTracker, TrackedCloud

BASEBANDS: Final = (BasebandConfig(), dataclasses.replace(BasebandConfig(), doa=DoaConfig(method="dml2")))
"""Scenes are seen through these in turn, so that a model does for either (preset people)."""


def generate(
    folder: str | Path,
    n_scenes: int = 100,
    *,
    seed: int = 1,
    n_jobs: int = 1,
    config: GestureConfig | None = None,
    info: RadarInfo | None = None,
    progress: bool = True,
) -> int:
    """Simulate scenes and write their samples to ``folder``; a stopped run goes on where it stopped. Returns the number of samples there.

    A scene takes about 10 s of one core and gives about 20 samples, see `radar_lab.datasets.training_scenes`.

    Parameters
    ----------
    folder : str or Path
        Where the samples go, one file per scene.
    n_scenes, n_jobs : int
        Scenes that the folder shall hold in the end, and those simulated at the same time, each on a core of its own.
    seed : int
        Scene ``i`` depends on ``seed`` and ``i`` only: the number of jobs or a restart change nothing.
    config, info : GestureConfig, RadarInfo or None
        Knobs of events and features, and the radar; None: the defaults.
    progress : bool
        Whether to show a progress bar.

    Raises
    ------
    ConfigError
        When the folder holds samples made with another seed, radar or other settings.
    """
    config = config if config is not None else GestureConfig()
    info = info if info is not None else RadarInfo()
    manifest = {"seed": seed, "settings": feature_settings(config), "radar": dataclasses.asdict(info), "motions": library_hash()}
    place = open_folder(folder, manifest)
    todo = [number for number in range(n_scenes) if not chunk_path(place, number).exists()]
    work_through(
        functools.partial(_make_chunk, place, seed, config=config, info=info),
        todo,
        n_total=n_scenes,
        n_jobs=n_jobs,
        progress=progress,
        title="simulating scenes",
    )
    return len(load_samples(place).label)


def _make_chunk(folder: Path, seed: int, number: int, *, config: GestureConfig, info: RadarInfo) -> None:
    rng = np.random.default_rng([seed, number])
    recording = record(training_scene(number, rng, info), baseband_of(number))
    columns = label_events(find_events(recording, config), truth_segments(recording.truths))
    columns["person"] = columns["person"] + 10 * number  # people of different scenes are different people
    write_chunk(chunk_path(folder, number), columns)


def baseband_of(number: int) -> BasebandConfig:
    """Return what the scene of a number is seen through; every kind of scene comes through all of `BASEBANDS`."""
    return BASEBANDS[(number + number // 8) % len(BASEBANDS)]


@dataclass(frozen=True, eq=False)
class Recording:
    """A simulated scene after the baseband: its radar, the clouds in ``room``, and the truths of the same stamps."""

    info: RadarInfo
    clouds: list[PointCloud]
    truths: list[Truth]


def record(scene: Scene, baseband: BasebandConfig | None = None) -> Recording:
    """Simulate a scene up to its point clouds, with the default baseband or another one."""
    simulator = Simulator(scene)
    processor, mount = Baseband(baseband if baseband is not None else BasebandConfig(), simulator.info), simulator.info.mount
    recording = Recording(simulator.info, [], [])
    for number in range(simulator.n_frames):
        simulated = simulator.process(number)
        recording.clouds.append(processor.process(simulated.frame).to_room(mount))
        recording.truths.append(simulated.truth)
    return recording


def find_events(recording: Recording, config: GestureConfig, every: int = 1) -> list[tuple[int, TrackEvent]]:
    """Run tracking and event detection over a recording; gives the events with the person whose they are (-1: nobody near).

    With ``every`` only every n-th cloud is taken, as a radar with a lower frame rate would give them.
    """
    tracker, stage = PeopleTracker(None, recording.info), EventStage(config, recording.info.mount)
    events = []
    for cloud, truth in zip(recording.clouds[::every], recording.truths[::every], strict=True):
        tracks = tracker.process(cloud)
        for event in stage.process(TrackedCloud(cloud, tracks)):
            track = tracks.find(event.track_id)
            person = None if track is None else nearest_person(truth, track.position)
            events.append((-1 if person is None else person, event))
    return events


def nearest_person(truth: Truth, position: NDArray[np.floating], gate: float = 0.8) -> int | None:
    """Say who is nearest to a place (3,) on the ground, None: nobody within the gate [m]; an event is labelled by what that person does.

    Evaluation asks `Matching.owner` instead.
    """
    if len(truth.person_id) == 0:
        return None
    away = np.hypot(*(np.asarray(truth.position, np.float64)[:, :2] - np.asarray(position, np.float64)[:2]).T)
    best = int(np.argmin(away))
    return int(truth.person_id[best]) if away[best] <= gate else None


def label_events(events: Iterable[tuple[int, TrackEvent]], segments: Iterable[TruthSegment]) -> dict[str, NDArray[Any]]:
    """Name every event by what its person (``events`` say whose they are) was doing; gives the columns of `SampleSet`.

    An event that overlaps a gesture by 40 % of the longer of the two gets its label; one that touches no gesture is random (walking, slow
    arm movements, fidgeting); one in between (half a push-pull, say) is neither, and is left out.
    """
    segments = list(segments)
    rows: list[tuple[Float64Array, int, int, float]] = []
    seen: set[TruthSegment] = set()
    for person, found in events:
        own = [(s, _overlap(found, s)) for s in segments if s.person_id == person]
        best, overlap = max(own, key=lambda pair: pair[1], default=(None, -math.inf))
        label = 0
        if best is not None and overlap > -0.2:
            length = (found.event.end_ns - found.event.start_ns) * 1e-9
            if overlap < 0.4 * max(length, (best.end_ns - best.start_ns) * 1e-9):
                continue
            label = best.label
            seen.add(best)
        if found.features is not None:
            rows.append((found.features, label, max(person, 0), found.walked))
    missed = np.zeros(max([len(GESTURES), *(segment.label + 1 for segment in segments)]), np.int64)
    for segment in segments:
        missed[segment.label] += segment not in seen
    return {
        "features": np.array([r[0] for r in rows], np.float64).reshape(-1, len(FEATURE_NAMES)),
        "label": np.array([r[1] for r in rows], np.int64),
        "person": np.array([r[2] for r in rows], np.int64),
        "walked": np.array([r[3] for r in rows], np.float64),
        "missed": missed,
    }


def _overlap(found: TrackEvent, segment: TruthSegment) -> float:
    """Return the common time of an event and a gesture [s]; negative: the time between them."""
    return (min(found.event.end_ns, segment.end_ns) - max(found.event.start_ns, segment.start_ns)) * 1e-9
