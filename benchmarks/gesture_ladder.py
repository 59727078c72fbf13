"""Where gestures in random rooms are lost: networks on streams that are told ever more of the truth, in the rooms of `gesture_rooms`.

    python -m benchmarks gesture_ladder --json --keep FOLDER     # a quarter of an hour beside lives and rooms, which take hours

Each step has a network of its own, which learned from the same lives, seen in the same way:

- ``tracker``: clouds and the default tracker, as shipped.
- ``places``: the same clouds; where people are is known, and a point within `GATE` of somebody is of who is nearest.
- ``bodies``: in place of clouds the joints of each body, `EVERY` seconds apart, with their true places and range rates. Nothing hides
  another, all are equally strong, and there is nothing but people.

So what the first two differ by is lost in following people, what the last two differ by between the echo and the cloud, and what is missing
after the last is not in motions of arms as slots hold them, or was not learned. Limits are chosen in hindsight: these are no figures of
what anybody gets.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits

from benchmarks.report import AbsentError
from benchmarks.room_scenes import DEVELOP, room
from benchmarks.room_score import KeptRoom
from benchmarks.rooms import PART, PROCESSES, RoomStore
from benchmarks.stores import digest, kept, once, sources
from radar_core import ConfigError, PointCloud, RadarInfo
from radar_core.types import Float32Array, Float64Array
from radar_gestures.stream.network import StreamNet
from radar_lab.datasets.body_targets import placed
from radar_lab.datasets.lives import Life, generate_lives, life_files, read_life, scene_of
from radar_lab.evaluation.scoring import truth_segments
from radar_lab.training.networks import need_torch
from radar_lab.training.slot_sequences import LifeSlots, slots_of
from radar_lab.training.stream_figures import Judged, figures_of, judge
from radar_lab.training.stream_training import StreamTraining, train_stream_net
from radar_sim import Scene
from radar_sim.bodies.base import Pose
from radar_sim.world import World
from radar_tracking import TrackedCloud
from radar_tracking.tracks import Track, Tracks, TrackStatus

STEPS: Final = ("tracker", "places", "bodies")
GATE: Final = 1.0  # m
EVERY: Final = 0.05  # s
FALSE: Final = (1.0, 0.05)  # a minute
LIVES: Final = 300
TRAINING: Final = StreamTraining(members=1, passes=30)
_SEED: Final = 1  # of the lives
_SPAN: Final = 4e-3  # s: range rates are of so long
_STRONG: Final = 20.0  # dB, of everything 2 m away
_LIMITS: Final = np.round(np.arange(0.0, 1.0, 0.005), 3)
_SOURCES: Final = ("radar_core", "radar_sim", "radar_tracking", "radar_gestures/stream", "radar_lab/training", "radar_lab/datasets")


def with_places(clouds: Sequence[PointCloud], person_id: Sequence[int], position: Float64Array) -> Iterator[TrackedCloud]:
    """Follow people whose places are known.

    Parameters
    ----------
    clouds : sequence of PointCloud
        In ``room``.
    person_id : sequence of int
        Who is there.
    position : ndarray of float64, shape (n_clouds, n_people, 3)
        Where, at the stamp of each cloud [m].
    """
    stamps = np.array([cloud.stamp_ns for cloud in clouds], np.int64) / 1e9
    velocity = np.gradient(position, stamps, axis=0) if len(clouds) > 1 else np.zeros_like(position)
    for cloud, places, rates in zip(clouds, position, velocity, strict=True):
        away = np.hypot(cloud.x[:, None] - places[:, 0], cloud.y[:, None] - places[:, 1])
        nearest = away.argmin(axis=1)
        owner = np.where(away[np.arange(len(cloud)), nearest] <= GATE, np.asarray(person_id)[nearest], -1).astype(np.int32)
        tracks = tuple(_track(number, *known) for number, *known in zip(person_id, places, rates, strict=True))
        yield TrackedCloud(cloud, Tracks(cloud.stamp_ns, cloud.sequence, "room", tracks, owner))


def _track(number: int, place: Float64Array, rate: Float64Array) -> Track:
    unknown = np.full(3, np.nan)
    return Track(number, TrackStatus.CONFIRMED, 1.0, 0.0, 1, place, rate, unknown, np.zeros((6, 6)))


def of_bodies(life: Life, scene: Scene) -> Life:
    """Put the joints of all bodies in place of a life's clouds, in ``room``."""
    world = World(scene)
    times = np.arange(EVERY / 2, scene.duration, EVERY)
    poses = [world.poses(float(time), _SPAN) for time in times]
    clouds = [_joints(number, float(time), each, life.info) for number, (time, each) in enumerate(zip(times, poses, strict=True))]
    centres = np.array([[pose.centre[1] for pose in each] for each in poses], np.float32)
    return dataclasses.replace(life, clouds=clouds, position=centres)


def _joints(sequence: int, time: float, poses: Sequence[Pose], info: RadarInfo) -> PointCloud:
    """Joints, hands and the middles of upper and lower arms of some people, as a cloud."""
    origin = np.asarray(info.mount.origin, np.float64)
    places = np.concatenate([placed(pose) for pose in poses], axis=1)  # start, middle and end; points
    away = np.linalg.norm(places - origin, axis=-1)
    x, y, z = (_single(value) for value in places[1].T)
    level = _STRONG - 40.0 * np.log10(np.maximum(away[1], 0.1) / 2.0)
    rate = (away[2] - away[0]) / _SPAN
    return PointCloud(round(time * 1e9), sequence, "room", x, y, z, radial_speed=_single(rate), snr=_single(level))


def _single(values: Float64Array) -> Float32Array:
    return np.asarray(values, np.float32)


def steps_of(life: Life, scene: Scene) -> dict[str, LifeSlots]:
    """Give the slots of a life, whose clouds are in ``room``, for each of `STEPS`."""
    bodies = of_bodies(life, scene)
    return {
        "tracker": slots_of(life),
        "places": slots_of(life, _known(life)),
        "bodies": slots_of(bodies, _known(bodies)),
    }


def _known(life: Life) -> Iterator[TrackedCloud]:
    return with_places(life.clouds, life.person_id.tolist(), life.position.astype(np.float64))


def _of_life(path: Path) -> dict[str, LifeSlots]:
    with threadpool_limits(1):
        life = read_life(path)
        clouds = [cloud.to_room(life.info.mount) for cloud in life.clouds]
        return steps_of(dataclasses.replace(life, clouds=clouds), scene_of(life.number, _SEED))


def of_room(own: KeptRoom) -> dict[str, LifeSlots]:
    """Give the slots of a room for each of `STEPS`."""
    position = np.array([truth.position for truth in own.truths], np.float32)
    person = own.truths[0].person_id.astype(np.int64)
    life = Life(own.seed, own.tags.radar, own.info, list(own.clouds), person, position, tuple(truth_segments(own.truths)))
    return steps_of(life, room(own.seed).scene)


def at_false(judged: Judged, most: float) -> dict[str, Any]:
    """Figures with the lowest limit that lets no more false gestures a minute through."""
    for limit in _LIMITS.tolist():
        found = figures_of(judged, limit)
        if found["false_per_minute"] <= most:
            break
    names = ("accuracy", "accuracy_interval", "wrong", "false_per_minute", "recall", "right")
    return {"limit": limit, **{name: found[name] for name in names}}


def _lives(folder: Path, number: int) -> list[dict[str, LifeSlots]]:
    generate_lives(folder / "lives", number, seed=_SEED, n_jobs=PROCESSES)
    files = life_files(folder / "lives")[:number]
    told = digest([number, [path.stat().st_size for path in files], sources((*_SOURCES, "benchmarks/gesture_ladder.py"))])

    def read() -> list[dict[str, LifeSlots]]:
        return list(Parallel(n_jobs=PROCESSES)(delayed(_of_life)(path) for path in files))

    return once(folder / "parts" / f"lives_{told}.joblib", read)


def _trained(folder: Path, step: str, lives: Sequence[dict[str, LifeSlots]], config: StreamTraining) -> StreamNet:
    told = digest([step, len(lives), str(config), sources((*_SOURCES, "benchmarks/gesture_ladder.py"))])
    known = [sequence for life in lives for sequence in life[step].sequences]
    return once(folder / "parts" / f"{step}_{told}.joblib", functools.partial(train_stream_net, known, config=config))


def run(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Train a network for each step and judge it in rooms for development; quick: ten lives, one pass, 12 s of a room.

    Returns ``strokes``, ``rooms``, and for each step, ``at_1`` and ``at_0.05`` false gestures a minute: ``accuracy`` of all strokes, with
    its interval, ``recall`` by gesture, ``right`` by radar and so on, see `radar_lab.training.stream_figures.figures_of`.
    """
    try:
        need_torch("the networks")
    except ConfigError as error:
        raise AbsentError(str(error)) from None
    number, config = (10, StreamTraining(members=1, passes=1, width=8)) if quick else (LIVES, TRAINING)
    seeds, seconds, part = (DEVELOP[3:4], 12.0, 12.0) if quick else (DEVELOP[:24], 60.0, PART)
    with kept(keep) as folder:
        lives = _lives(folder, number)
        store = RoomStore(folder, part)
        store.fill(seeds, seconds, n_jobs=1 if quick else PROCESSES)
        rooms = [of_room(own) for own in store.rooms(seeds, "default", seconds)]
        models = {step: _trained(folder, step, lives, config) for step in STEPS}
    found: dict[str, Any] = {"lives": len(lives), "rooms": len(rooms)}
    for step, model in models.items():
        judged = judge(model, [one[step] for one in rooms])
        found["strokes"] = figures_of(judged, 0.0)["strokes"]
        found[step] = {f"at_{most:g}": at_false(judged, most) for most in FALSE}
    return found | {"choices": []}
