"""MARS for both hands: clouds of one radar with tracks, the Kinect's hands beside them, and errors while a hand moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.recordings import PRESETS, TRACKERS, folder, tracker_for
from benchmarks.report import AbsentError, timed
from radar_core import PointCloud, RadarInfo
from radar_driver.ti_demo.points import to_our_axes
from radar_lab.importers import open_original
from radar_lab.posture.model import PostureModel
from radar_lab.posture.posture import PostureTracker
from radar_lab.posture.training import HandRecording
from radar_tracking import HandConfig, HandTracker, TrackedCloud

Float64Array = NDArray[np.float64]
MaskArray = NDArray[np.bool_]

_HANDS: Final = ("HandLeft", "HandRight")
MOVING: Final = 0.4  # a hand faster than this moves [m/s]
KNOWN: Final = (("subject1_validate", "subject3_validate"), ("subject1_test", "subject3_test"))
"""Files to train on and to test on: the same people, other minutes of the same session."""
STRANGERS: Final = (
    (("subject1_test", "subject1_validate"), ("subject3_test", "subject3_validate")),
    (("subject3_test", "subject3_validate"), ("subject1_test", "subject1_validate")),
)
"""The same with the other person held out."""
_FRAME: Final = 0.1  # s, between two clouds
_REACH: Final = 0.5  # m: a point farther than this from every joint says nothing about where the Kinect stands
_ROUNDS: Final = 50
_EVERY: Final = 5  # clouds: neighbours are alike


@dataclass(frozen=True, eq=False)
class Exercises:
    """One file."""

    clouds: tuple[TrackedCloud, ...]  # in the room, with tracks of the preset for sparse clouds
    joints: Float64Array  # shape (n_clouds, 25, 3) = (cloud, joint, axis): all joints in our axes, relative to the Kinect [m]
    hands: Float64Array  # shape (n_clouds, 2, 3) = (cloud, hand, axis): left and right hand of them
    speed: Float64Array  # shape (n_clouds, 2): of the hands, over two clouds [m/s]
    info: RadarInfo  # the radar, with its place in the room

    @property
    def moving(self) -> MaskArray:
        """Whether each hand moves, shape (n_clouds, 2)."""
        return self.speed > MOVING


@cache
def exercises(name: str) -> Exercises:
    """Read and track one of `MARS`.

    Raises AbsentError when the recordings are not there.
    """
    path = folder() / "mars" / f"{name}.npz"
    if not path.is_file():
        raise AbsentError(f"{path}: there is no such recording; HANDWAVE_DATA names the folder that holds them (docs/recordings.md)")
    recording = open_original("mars", path)
    tracker = tracker_for(PRESETS["mars"], TRACKERS[0])
    clouds = [item.to_room(recording.info.mount) for item in recording.items if isinstance(item, PointCloud)]
    with np.load(path) as data:
        joints, names = to_our_axes(data["joint_xyz"]), [str(joint) for joint in data["joints"]]
    hands = joints[:, [names.index(hand) for hand in _HANDS]]
    speed = np.linalg.norm(np.gradient(hands, _FRAME, axis=0), axis=2)
    return Exercises(tuple(TrackedCloud(c, tracker.process(c)) for c in clouds), joints, hands, speed, recording.info)


def kinect_place(names: Sequence[str]) -> Float64Array:
    """Where the Kinect's origin is in the room, shape (3,) [m]: the shift that brings the joints to the radar's points.

    Points and joints are brought together as in the iterative closest point method (Besl, McKay, 1992), shifts only: every point is paired
    with the joint nearest to it, pairs farther apart than 0.5 m are left out, and the shift is their mean difference; again until it stays.
    The radar sees the front of people, so that half a body's depth is part of the shift.
    """
    shift = np.array([0.0, 0.0, exercises(names[0]).info.mount.z])
    pairs = [pair for name in names for pair in _thinned(exercises(name))]
    chosen = [(tracked.cloud.position.astype(np.float64), cKDTree(joints)) for tracked, joints in pairs]
    for _ in range(_ROUNDS):
        apart = np.concatenate([_apart(points - shift, tree) for points, tree in chosen])
        step = apart[np.linalg.norm(apart, axis=1) < _REACH].mean(axis=0)
        shift = shift + step
        if np.linalg.norm(step) < 1e-4:
            break
    return shift


def _thinned(one: Exercises) -> list[tuple[TrackedCloud, Float64Array]]:
    pairs = list(zip(one.clouds, one.joints, strict=True))
    return [pair for pair in pairs[::_EVERY] if len(pair[0].cloud)]


def _apart(points: Float64Array, tree: cKDTree) -> Float64Array:
    """From the nearest joint to each point, shape (n, 3) [m]."""
    return np.asarray(points - tree.data[tree.query(points)[1]], np.float64)


def recording_of(name: str, kinect: Float64Array) -> HandRecording:
    """One file as something to train on, with the Kinect at a place, shape (3,) [m]."""
    one = exercises(name)
    return HandRecording(one.clouds, one.hands + kinect, one.info.mount.origin)


def mean_pose(names: Sequence[str], kinect: Float64Array, *, moving: bool = False) -> Float64Array:
    """Mean place of the hands in some files, shape (2, 3) [m]: on the floor plane relative to the person's track, and above the floor.

    With ``moving`` only of the clouds in which each hand moves: the best that a place that never changes could know of these.
    """
    place = np.concatenate([exercises(name).hands + kinect - bodies(exercises(name).clouds) for name in names])
    own = np.concatenate([exercises(name).moving for name in names]) if moving else np.ones(place.shape[:2], np.bool_)
    return np.asarray(np.average(place, axis=0, weights=own[..., None] * np.ones(3)), np.float64)


def bodies(clouds: Sequence[TrackedCloud]) -> Float64Array:
    """Where the person's track is on the floor plane, shape (n_clouds, 1, 3) with z = 0 [m]; where there is none, it is as before."""
    place, last = np.zeros((len(clouds), 1, 3)), np.zeros(2)
    for row, tracked in zip(place, clouds, strict=True):
        if tracked.tracks.tracks:
            last = tracked.tracks.tracks[0].position[:2]
        row[0, :2] = last
    return place


@dataclass(frozen=True, eq=False)
class Estimated:
    """What a tracker said about both hands in one file."""

    # position, std: shape (n_clouds, 2, 3) = (cloud, hand, axis): [m]; NaN: nothing
    position: Float64Array
    std: Float64Array
    times_ms: tuple[float, ...]  # of every cloud


def estimate(model: PostureModel, name: str) -> Estimated:
    """Run `PostureTracker` over one file."""
    one = exercises(name)
    tracker = PostureTracker(model, info=one.info)
    position, times = np.full((len(one.clouds), 2, 3), np.nan), []
    std = position.copy()
    for k, tracked in enumerate(one.clouds):
        found, spent = timed(tracker.process, tracked)
        times.append(spent)
        if found.people:
            position[k], std[k] = found.people[0].position, found.people[0].std
    return Estimated(position, std, tuple(times))


def geometric(name: str, kinect: Float64Array, config: HandConfig | None = None) -> Float64Array:
    """Errors of `HandTracker` in one file, shape (n_clouds, 2, 3) [m]: of the hand that was nearer when it was found; NaN elsewhere.

    It is started again whenever it has lost the hand.
    """
    one = exercises(name)
    tracker = HandTracker(config, one.info)
    truth = one.hands + kinect
    wrong, side = np.full(truth.shape, np.nan), -1
    for k, tracked in enumerate(one.clouds):
        if not tracker.active:
            tracker.start(None, tracked.cloud.stamp_ns - 1_000_000_000)
        found = tracker.process(tracked)
        if found is None or not found.active:
            side = -1
            continue
        if side < 0:
            side = int(np.argmin(np.linalg.norm(truth[k] - found.position, axis=1)))
        wrong[k, side] = found.position - truth[k, side]
    return wrong


def rms(wrong: Float64Array) -> float:
    """Root mean square length of errors, shape (n, 3) [m]."""
    return float(np.sqrt((wrong**2).sum(axis=1).mean())) if len(wrong) else float("nan")
