"""Simulated, labelled samples: random people gesture in random places, and the run-time chain cuts and measures what they do (section 5.3).

Samples come from whole scenes with one or two people, through the same baseband, tracking, event detection and features as at run time, so
that training sees what the recogniser will see: events cut too early, points lost to the neighbour, walking, fidgeting.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, PointCloud, Pose, RadarInfo
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.features import FEATURE_NAMES
from radar_gestures.recognizer import EventStage, GestureConfig, TrackEvent, feature_settings
from radar_gestures.samples import chunk_path, load_samples, open_folder, write_chunk
from radar_gestures.scoring import TruthSegment, nearest_person, truth_segments
from radar_gestures.workers import work_through
from radar_sim import (
    GESTURE_DURATION,
    VARIANTS,
    Action,
    Coupling,
    Draw,
    Effects,
    Losses,
    Noise,
    Occlusion,
    Pattern,
    Person,
    Scene,
    SceneRadar,
    Simulator,
    Truth,
    Variation,
    Walk,
)
from radar_sim.motions.library import library_hash
from radar_sim.motions.script import Timeline
from radar_sim.people import SHAPES
from radar_tracking import PeopleTracker, TrackedCloud, TrackerConfig

_WALKING = 6  # every sixth scene is one of walkers
_PEOPLE_APART = 1.1  # m: nearer than this two people's arms touch


def generate(
    folder: str | Path,
    n_scenes: int = 100,
    *,
    seed: int = 1,
    n_jobs: int = 1,
    settings: GestureConfig | None = None,
    info: RadarInfo | None = None,
    progress: bool = True,
) -> int:
    """Simulate scenes and write their samples to ``folder``; a stopped run goes on where it stopped.

    A scene takes about 6 s of one core and gives about 20 samples; every sixth is of people who only walk.

    Parameters
    ----------
    folder : str or Path
        Where the samples go, one file per scene.
    n_scenes : int
        Scenes that the folder shall hold in the end.
    seed : int
        Scene ``i`` depends on ``seed`` and ``i`` only: the number of jobs or a restart change nothing.
    n_jobs : int
        Scenes simulated at the same time, each on a core of its own.
    settings : GestureConfig or None
        Knobs of events and features; None: the defaults.
    info : RadarInfo or None
        The radar; None: the default radar.
    progress : bool
        Whether to show a progress bar.

    Returns
    -------
    int
        Samples that the folder now holds.

    Raises
    ------
    ConfigError
        When the folder holds samples made with another seed, radar or other settings.
    """
    settings = settings if settings is not None else GestureConfig()
    info = info if info is not None else RadarInfo()
    manifest = {"seed": seed, "settings": feature_settings(settings), "radar": dataclasses.asdict(info), "motions": library_hash()}
    place = open_folder(folder, manifest)
    todo = [number for number in range(n_scenes) if not chunk_path(place, number).exists()]
    work_through(
        functools.partial(_make_chunk, place, seed, settings=settings, info=info),
        todo,
        n_total=n_scenes,
        n_jobs=n_jobs,
        progress=progress,
        title="simulating scenes",
    )
    return len(load_samples(place).label)


def _make_chunk(folder: Path, seed: int, number: int, *, settings: GestureConfig, info: RadarInfo) -> None:
    rng = np.random.default_rng([seed, number])
    recording = record(walking_scene(rng, info) if number % _WALKING == _WALKING - 1 else random_scene(rng, info))
    columns = label_events(find_events(recording, settings), truth_segments(recording.truths))
    columns["person"] = columns["person"] + 10 * number  # people of different scenes are different people
    write_chunk(chunk_path(folder, number), columns)


def random_scene(rng: np.random.Generator, info: RadarInfo) -> Scene:
    """Draw a scene: one or two people, 1.5 to 3.5 m away and up to 35 degrees to the side, who do every gesture once in random order.

    Height, arm, the direction they face, speed and size of every stroke, and what they do in between (stand, walk, fidget) are random.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of randomness.
    info : RadarInfo
        The radar.
    """
    places: list[NDArray[np.float64]] = []
    wanted = 1 if rng.random() < 0.15 else 2
    while len(places) < wanted:
        place = _random_place(rng)
        if all(np.hypot(*(place - other)) >= _PEOPLE_APART for other in places):
            places.append(place)
    people = tuple(_random_person(rng, i + 1, place) for i, place in enumerate(places))
    return Scene(
        duration=1.0 + max(Timeline(person, 0).segments[-1].end for person in people),
        seed=int(rng.integers(1 << 31)),
        radars=(SceneRadar.of(info),),
        people=people,
        effects=_random_effects(rng),
    )


def walking_scene(rng: np.random.Generator, info: RadarInfo) -> Scene:
    """Draw a scene of two people who walk to and fro, at 0.5 to 1.5 m/s and 1.5 to 5 m away, and now and then stand; no gestures.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of randomness.
    info : RadarInfo
        The radar.
    """
    people = []
    for number, side in ((1, -1.0), (2, 1.0)):
        ways = [(float(rng.uniform(1.5, 5.0)), side * float(rng.uniform(0.3, 1.8))) for _ in range(8)]
        script: list[Action] = []
        for way in ways[1:]:
            script += [Action(stand=float(rng.uniform(0.3, 1.0)))] * int(rng.random() < 0.5)
            script.append(Action(walk=Walk(to=way, speed=float(rng.uniform(0.5, 1.5)))))
        people.append(Person(id=number, height=float(rng.uniform(1.5, 1.95)), position=ways[0], script=tuple(script)))
    duration = max(Timeline(person, 0).segments[-1].end for person in people)
    seed, effects = int(rng.integers(1 << 31)), _random_effects(rng)
    return Scene(duration=duration, seed=seed, radars=(SceneRadar.of(info),), people=tuple(people), effects=effects)


def _random_place(rng: np.random.Generator) -> NDArray[np.float64]:
    distance, side = rng.uniform(1.5, 3.5), math.radians(rng.uniform(-35.0, 35.0))
    return distance * np.array([math.cos(side), math.sin(side)])


def _random_person(rng: np.random.Generator, number: int, place: NDArray[np.float64]) -> Person:
    x, y = float(place[0]), float(place[1])
    gestures = [name for name in GESTURES if name != "random"] + ["random"] * 2
    script = [_random_stroke(rng, str(name)) for name in rng.permutation(gestures)]
    script.insert(int(rng.integers(len(script))), Action(stand=float(rng.uniform(0.2, 1.0))))
    if rng.random() < 0.4:  # a drawing hand is no gesture
        shape = SHAPES[int(rng.integers(len(SHAPES)))]
        script.append(Action(draw=Draw(shape=shape, duration=2.5, size=float(rng.uniform(0.2, 0.35)), speed=float(rng.uniform(0.5, 1.0)))))
    if rng.random() < 0.3:
        script.insert(int(rng.integers(len(script))), Action(fidget=float(rng.uniform(1.0, 3.0))))
    start = (x, y)
    if rng.random() < 0.4:
        script.insert(0, _walk_to(rng, x, y))
        start = (min(x + 1.5, 5.0), y * 1.4)
    if rng.random() < 0.4:
        script.append(_walk_to(rng, x + (0.8 if x < 2.0 else -0.8), y + float(rng.uniform(-0.2, 0.2))))
    return Person(
        id=number,
        height=float(rng.uniform(1.5, 1.95)),
        position=start,
        heading=float(math.atan2(-y, -x) + math.radians(np.clip(rng.normal(0.0, 10.0), -25.0, 25.0))),
        arm="right" if rng.random() < 0.75 else "left",
        sex="male" if rng.random() < 0.5 else "female",
        build=float(rng.uniform(0.1, 0.9)),
        variation=Variation(path=float(rng.uniform(0.01, 0.05)), sway=float(rng.uniform(0.5, 1.5))),
        script=(Action(stand=float(rng.uniform(0.3, 1.5))), *script),
    )


def _random_stroke(rng: np.random.Generator, name: str) -> Action:
    slower = float(np.exp(rng.uniform(math.log(0.75), math.log(1.3))))
    return Action(
        gesture=name,
        duration=GESTURE_DURATION[name] * slower,
        size=float(rng.uniform(0.85, 1.1)),
        tilt=float(np.clip(rng.normal(0.0, 0.12), -0.3, 0.3)),
        variant=int(rng.integers(VARIANTS.get(name, 1))),
    )


def _walk_to(rng: np.random.Generator, x: float, y: float) -> Action:
    return Action(walk=Walk(to=(x, y), speed=float(rng.uniform(0.6, 1.3))))


def _random_effects(rng: np.random.Generator) -> Effects:
    """Receivers and losses about those of the demo scene."""
    return Effects(
        occlusion=Occlusion(),
        doppler_in_chirp=True,
        pattern=Pattern(),
        noise=Noise(noise_figure=float(rng.uniform(12.0, 16.0))),
        losses=Losses(level=float(rng.uniform(17.0, 21.0))),
        coupling=Coupling(level=-60.0),
    )


@dataclass(frozen=True, eq=False)
class Recording:
    """A simulated scene after the baseband.

    Attributes
    ----------
    info : RadarInfo
        The radar.
    clouds : list of PointCloud
        In ``room``.
    truths : list of Truth
        Of the same stamps.
    """

    info: RadarInfo
    clouds: list[PointCloud]
    truths: list[Truth]

    @property
    def mount(self) -> Pose:
        """Where the radar stands."""
        return self.info.mount


def record(scene: Scene) -> Recording:
    """Simulate a scene up to its point clouds.

    Parameters
    ----------
    scene : Scene
        What happens.
    """
    simulator = Simulator(scene)
    baseband, mount = Baseband(BasebandConfig(), simulator.info), simulator.info.mount
    recording = Recording(simulator.info, [], [])
    for number in range(simulator.n_frames):
        simulated = simulator.process(number)
        recording.clouds.append(baseband.process(simulated.frame).to_room(mount))
        recording.truths.append(simulated.truth)
    return recording


def find_events(recording: Recording, settings: GestureConfig, every: int = 1) -> list[tuple[int, TrackEvent]]:
    """Run tracking and event detection over a recording.

    Parameters
    ----------
    recording : Recording
        Clouds and truth.
    settings : GestureConfig
        Knobs of events and features.
    every : int
        Take every n-th cloud only, as a radar with a lower frame rate would give them.

    Returns
    -------
    list of (int, TrackEvent)
        Events with the person whose they are (-1: nobody near).
    """
    tracker, stage = PeopleTracker(TrackerConfig(), recording.info), EventStage(settings, recording.mount)
    events = []
    for cloud, truth in zip(recording.clouds[::every], recording.truths[::every], strict=True):
        tracks = tracker.process(cloud)
        for event in stage.process(TrackedCloud(cloud, tracks)):
            track = tracks.find(event.track_id)
            person = None if track is None else nearest_person(truth, track.position)
            events.append((-1 if person is None else person, event))
    return events


def label_events(events: Iterable[tuple[int, TrackEvent]], segments: Iterable[TruthSegment]) -> dict[str, NDArray[Any]]:
    """Name every event by what its person was doing.

    An event that overlaps a gesture by 40 % of the longer of the two gets its label; one that touches no gesture is random (walking, slow
    arm movements, fidgeting); one in between (half a push-pull, say) is neither, and is left out.

    Parameters
    ----------
    events : iterable of (int, TrackEvent)
        Events and whose they are.
    segments : iterable of TruthSegment
        What was performed.

    Returns
    -------
    dict of ndarray
        The columns of `SampleSet`.
    """
    segments = list(segments)
    rows: list[tuple[NDArray[np.float64], int, int, float]] = []
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
    missed = np.zeros(len(GESTURES), np.int64)
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
