"""Both hands of real people from sparse clouds: learned postures against the mean pose, on MARS (docs/reference/recordings.md)."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.recordings import PRESETS, TRACKERS, folder, tracker_for
from benchmarks.report import AbsentError, against_first, timed
from radar_core import PointCloud, RadarInfo
from radar_driver.clouds import to_our_axes
from radar_lab.importers import open_original
from radar_lab.posture.features import PostureFeatureConfig
from radar_lab.posture.posture import PostureModel, PostureTracker
from radar_lab.posture.training import HandRecording, PostureSamples, PostureTrainingConfig, fit_postures, samples_of
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
    """Read and track one of `MARS`; ``name:400``: its first 400 clouds. Raises AbsentError when the recordings are not there."""
    file, _, most = name.partition(":")
    path = folder() / "mars" / f"{file}.npz"
    if not path.is_file():
        raise AbsentError(f"{path}: there is no such recording; HANDWAVE_DATA names the folder with them (docs/reference/recordings.md)")
    recording = open_original("mars", path)
    tracker = tracker_for(PRESETS["mars"], TRACKERS[0])
    found = (item.to_room(recording.info.mount) for item in recording.items if isinstance(item, PointCloud))
    clouds = list(itertools.islice(found, int(most) if most else None))
    with np.load(path) as data:
        joints, names = to_our_axes(data["joint_xyz"])[: len(clouds)], [str(joint) for joint in data["joints"]]
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
    """Errors (n_clouds, 2, 3) [m] of `HandTracker`, restarted when lost: of the hand nearer when it was found; NaN elsewhere."""
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


AXES: Final = ("depth", "across", "height")
SIDES: Final = ("left", "right")
HISTORIES: Final = {"none": (), "short, 0.2 s": (0.2,), "0.2 0.5 1.5 s": (0.2, 0.5, 1.5), "long, 0.2 0.5 1.5 4 s": (0.2, 0.5, 1.5, 4.0)}
_QUICK: Final = PostureTrainingConfig(hidden=(16,), members=1, epochs=5)
_FEW: Final = ":400"  # clouds of each file in quick runs


@dataclasses.dataclass(frozen=True, eq=False)
class Split:
    """Files to train on and to test on, and what follows from the former alone."""

    train: tuple[str, ...]
    test: tuple[str, ...]
    kinect: Float64Array  # shape (3,): where the Kinect stands, fitted to the training files [m]
    recordings: tuple[HandRecording, ...]  # the training files
    # pose, moving_pose: shape (2, 3): their mean pose, and that of the clouds in which a hand moves [m]
    pose: Float64Array
    moving_pose: Float64Array

    @classmethod
    def of(cls, train: Sequence[str], test: Sequence[str]) -> Split:
        """Read the training files and fit what is fitted before anything is learned."""
        kinect = kinect_place(train)
        recordings = tuple(recording_of(name, kinect) for name in train)
        return cls(tuple(train), tuple(test), kinect, recordings, mean_pose(train, kinect), mean_pose(train, kinect, moving=True))

    @cache  # noqa: B019 - a run makes few splits, and several fits take the same samples
    def samples(self, features: PostureFeatureConfig, block: float) -> PostureSamples:
        """Make samples of the training files."""
        return samples_of(self.recordings, features, block)

    def truth(self, name: str) -> Float64Array:
        """Hands in the room, shape (n_clouds, 2, 3) [m]."""
        return exercises(name).hands + self.kinect

    def mean_error(self, name: str) -> Float64Array:
        """Error of the mean pose, shape (n_clouds, 2, 3) [m]."""
        return self.pose + bodies(exercises(name).clouds) - self.truth(name)

    def compare(self, name: str, wrong: Float64Array) -> tuple[float, float]:
        """Errors (rms) of an estimate and of the mean pose while a hand moves, in the same clouds [m]."""
        own = exercises(name).moving & np.isfinite(wrong[..., 0])
        return rms(wrong[own]), rms(self.mean_error(name)[own])

    def ratio(self, wrong: dict[str, Float64Array]) -> float:
        """Error over the mean pose's, all test files together."""
        pairs = [(one, self.mean_error(name), exercises(name).moving & np.isfinite(one[..., 0])) for name, one in wrong.items()]
        return rms(np.concatenate([a[own] for a, _, own in pairs])) / rms(np.concatenate([b[own] for _, b, own in pairs]))


def figures_of(split: Split, name: str, found: Estimated) -> dict[str, Any]:
    """Errors of one test file while a hand moves.

    Returns ``rms_m``, ``median_m``, the same of the mean pose (``mean_pose_``), ``ratio`` of the rms, of both hands and of each;
    ``rms_depth_m``, ``rms_across_m``, ``rms_height_m``; ``seen``: share of the clouds with an estimate; ``nees``: squared error over the
    variance that was told, 1 where the estimate knows itself, while a hand moves and (``nees_all``) always; ``ratio_to_moving_mean``: to a
    mean pose of the moving phases alone.
    """
    one, wrong, plain = exercises(name), found.position - split.truth(name), split.mean_error(name)
    own = one.moving & np.isfinite(wrong[..., 0])
    result: dict[str, Any] = {"seen": float(np.isfinite(wrong[..., 0]).mean()), "moving": float(one.moving.mean())}
    for label, mask in {"": own, **{f"{side}_": own & (np.arange(2) == k) for k, side in enumerate(SIDES)}}.items():
        result |= {
            f"{label}rms_m": rms(wrong[mask]),
            f"{label}median_m": float(np.median(np.linalg.norm(wrong[mask], axis=1))),
            f"{label}mean_pose_rms_m": rms(plain[mask]),
            f"{label}mean_pose_median_m": float(np.median(np.linalg.norm(plain[mask], axis=1))),
            f"{label}ratio": rms(wrong[mask]) / rms(plain[mask]),
        }
    for label, errors in {"": wrong, "mean_pose_": plain}.items():
        lengths = np.sqrt((errors[own] ** 2).mean(axis=0)).tolist()
        result |= {f"{label}rms_{axis}_m": value for axis, value in zip(AXES, lengths, strict=True)}
    score = ((wrong / found.std) ** 2).mean(axis=2)
    harder = plain + split.moving_pose - split.pose
    result["ratio_to_moving_mean"] = rms(wrong[own]) / rms(harder[own])
    return result | {"nees": float(score[own].mean()), "nees_all": float(np.nanmean(score))}


def geometric_figures(split: Split, name: str) -> dict[str, float]:
    """Errors of `HandTracker`, which is made for denser clouds, while the hand moves that it found."""
    wrong = geometric(name, split.kinect)
    ours, plain = split.compare(name, wrong)
    return {"rms_m": ours, "mean_pose_rms_m": plain, "ratio": ours / plain, "active": float(np.isfinite(wrong[..., 0]).any(axis=1).mean())}


def over_tests(split: Split, model: PostureModel) -> dict[str, Estimated]:
    """Run a model over the test files."""
    return {name: estimate(model, name) for name in split.test}


def evaluate(split: Split, config: PostureTrainingConfig) -> tuple[dict[str, Any], PostureModel]:
    """Train, and give the figures of every test file."""
    model, took = timed(lambda: fit_postures(split.samples(config.features, config.block), config))
    files = {name: figures_of(split, name, found) for name, found in over_tests(split, model).items()}
    about = {
        "training_s": 1e-3 * took,
        "samples": model.figures["samples"],
        "kinect_m": split.kinect.tolist(),
        "parameters": model.n_parameters,
    }
    return {"files": files, "worst_ratio": max(one["ratio"] for one in files.values()), **about}, model


def configs_of(quick: bool) -> dict[str, PostureTrainingConfig]:
    """Everything that is varied; each differs from the default, which stands first, in one thing."""
    default = _QUICK if quick else PostureTrainingConfig()

    def features(**changed: Any) -> PostureTrainingConfig:
        return dataclasses.replace(default, features=dataclasses.replace(PostureFeatureConfig(), **changed))

    made = {"default": default, **{f"history {name}": features(history=times) for name, times in HISTORIES.items()}}
    made |= {f"grid {rows} x {columns}": features(rows=rows, columns=columns) for rows, columns in ((3, 3), (5, 5), (8, 8))}
    own = {
        "hidden": ((16,), (64,), (128, 64)), "members": (1, 8), "components": (30, 200), "regularisation": (0.1, 2.0), "epochs": (8, 50),
    }  # fmt: skip
    made |= {f"{knob} {value}": dataclasses.replace(default, **{knob: value}) for knob, values in own.items() for value in values}
    return dict(list(made.items())[:2]) if quick else made


def rows(split: Split, quick: bool) -> list[dict[str, Any]]:
    """Error of every choice, known people, beside the time of one cloud; the first is the reference."""
    made: dict[str, tuple[float, list[float]]] = {}
    for name, config in configs_of(quick).items():
        samples = split.samples(config.features, config.block)
        found = over_tests(split, fit_postures(samples, dataclasses.replace(config, folds=2)))
        error = split.ratio({name: one.position - split.truth(name) for name, one in found.items()})
        made[name] = error, [value for one in found.values() for value in one.times_ms]
    made |= other_models(split, configs_of(quick)["default"], float(np.median(made["default"][1])), quick)
    return against_first("posture", "error over the mean pose's", made)


def other_models(split: Split, config: PostureTrainingConfig, before: float, quick: bool) -> dict[str, tuple[float, list[float]]]:
    """Error and times, two hands each, of scikit-learn's models on the same features, behind what takes ``before`` [ms]."""
    from sklearn.ensemble import ExtraTreesRegressor
    from sklearn.linear_model import Ridge
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    makers: dict[str, Callable[[], Any]] = {
        "model ridge": lambda: make_pipeline(StandardScaler(), Ridge(alpha=1000.0)),
        "model extra trees, 200": lambda: ExtraTreesRegressor(10 if quick else 200, min_samples_leaf=3, max_features=0.3, random_state=0),
    }
    train = split.samples(config.features, config.block)
    test = {name: samples_of([recording_of(name, split.kinect)], config.features) for name in split.test}
    made = {}
    for label, make in makers.items():
        model = make().fit(train.features, train.hand)
        wrong = {name: _places(split, name, one, model.predict(one.features)) for name, one in test.items()}
        rows = next(iter(test.values())).features[: 20 if quick else 200]
        made[label] = split.ratio(wrong), [before + timed(model.predict, rows[k : k + 2])[1] for k in range(0, len(rows) - 1, 2)]
    return made


def _places(split: Split, name: str, samples: PostureSamples, predicted: Float64Array) -> Float64Array:
    """Errors of predictions in the person's axes, put back to clouds and hands, shape (n_clouds, 2, 3) [m]."""
    wrong = np.full(split.truth(name).shape, np.nan)
    wrong[samples.cloud, samples.side] = predicted - samples.hand
    return wrong


def run(quick: bool = False) -> dict[str, Any]:
    """Train on some files of MARS and test on others.

    ``quick``: a small network, few choices, one of two directions, the beginnings of the files: to see that it runs.
    Returns ``known``: trained on the validate files of both people, tested on their test files; ``held_out``: trained on one person, tested
    on the other, in both directions; each with the figures of every file (`figures_of`). ``geometric``: `HandTracker` on the test files of
    ``known``. ``known_worst_ratio``, ``held_out_worst_ratio``, ``choices``.
    Raises DataError when the recordings are not there.
    """
    config = configs_of(quick)["default"]
    acquainted, *strange = ([[f"{name}{_FEW if quick else ''}" for name in names] for names in split] for split in (KNOWN, *STRANGERS))
    known = Split.of(*acquainted)
    figures, _ = evaluate(known, config)
    strangers = [evaluate(Split.of(*names), config)[0] for names in strange[: 1 if quick else None]]
    return {
        "known_worst_ratio": figures["worst_ratio"],
        "held_out_worst_ratio": max(one["worst_ratio"] for one in strangers),
        "known": figures,
        "held_out": {"files": {name: one for found in strangers for name, one in found["files"].items()}},
        "geometric": {name: geometric_figures(known, name) for name in known.test[: 1 if quick else None]},
        "choices": rows(known, quick),
    }
