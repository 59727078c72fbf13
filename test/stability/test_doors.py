"""Every public entry: NaN and infinity are refused with the field's name, or are the mark for "not measured" and stay one.

A door is a class with a public ``process``, or a function that people call. All such classes are looked up; a new one has to be put into
the table of doors, or into that of rooms behind a door, with the door's name.
"""

import ast
import dataclasses
import math
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "dsp"))
from echoes import frame, noise

from radar_core import GESTURES, HandwaveError, PointCloud, Pose, RadarFrame, RadarInfo, merge
from radar_core.cloud import ARRAY_FIELDS
from radar_core.governor import Governor
from radar_core.ladder import Level
from radar_core.linalg import solve_spd
from radar_driver.targets import Targets
from radar_dsp import Baseband, BasebandConfig, DoaConfig, SpectrumConfig
from radar_dsp.bounds import Bound
from radar_dsp.doa import DirectionFinder
from radar_dsp.refine import Refiner
from radar_dsp.unfold import Unfolder
from radar_gestures import FEATURE_NAMES, EventConfig, EventDetector, GestureConfig, GestureRecognizer
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.event_maps import EventMaps
from radar_gestures.one_channel import ChannelGestures
from radar_gestures.signals import CurveConfig
from radar_gestures.stage import EventStage
from radar_gestures.stream.network import Member, Memory, StreamNet
from radar_gestures.stream.slots import NAMES, SlotStreams
from radar_lab.alignment import Trajectory, align_points
from radar_lab.alignment.pair import PairConfig, Walker
from radar_lab.arrays.calibration import Calibration, Calibrator, Snapshots
from radar_lab.camera.depth import DepthReader
from radar_lab.camera.residual import ReferenceSample, TrackSample
from radar_lab.datasets.samples import SampleSet
from radar_lab.evaluation.truth_events import CriterionConfig, TrueEvents
from radar_lab.posture.features import PostureFeatureConfig
from radar_lab.posture.posture import PostureModel, PostureTracker
from radar_lab.training.calibration import fit_temperature
from radar_lab.training.encoder import EncoderConfig, encode
from radar_lab.training.training import TrainingConfig, train_on
from radar_tracking import HandTracker, PeopleTracker, Track, TrackedCloud, Tracks, TrackStatus, dbscan, kmeans
from radar_tracking.assignment import assign_tracks, mahalanobis
from radar_tracking.clustering import optics, split
from radar_tracking.estimators import EstimatorConfig, Measurement, Snapshot, from_polar, make_estimator
from radar_tracking.estimators.config import ESTIMATORS
from radar_tracking.metrics import ConsistencyMonitor, ObjectSet, nees
from radar_tracking.presence import Presence, PresenceConfig, PresenceDetector
from radar_tracking.targets import TargetTracker

ROOT = Path(__file__).resolve().parents[2]
INFO = RadarInfo()
EYE = np.eye(2)
BAD = pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf], ids=str)


def spoilt(array: np.ndarray, bad: float) -> np.ndarray:
    """A copy with one bad number in the middle."""
    copy = np.array(array, np.complex64 if np.iscomplexobj(array) else None)
    copy.reshape(-1)[copy.size // 2] = bad
    return copy


def cloud(stamp_ns: int = 0, frame_id: str = "room", **fields: float) -> PointCloud:
    """Eight points of a person at 3 m, half of them moving; one point of the named fields is spoilt."""
    rng, n = np.random.default_rng(stamp_ns % 1000), 8
    arrays = {name: np.full(n, 0.1, np.float32) for name in ARRAY_FIELDS}
    arrays["x"] = (3 + 0.1 * rng.normal(size=n)).astype(np.float32)
    arrays |= {"range": arrays["x"].copy(), "z": np.ones(n, np.float32), "snr": np.full(n, 20, np.float32)}
    arrays["radial_speed"][:4] = -1.5
    for name, bad in fields.items():
        arrays[name][1] = bad
    return PointCloud(stamp_ns, 0, frame_id, **arrays)


def tracked(bad: float | None = None, **fields: float) -> TrackedCloud:
    """The same with a track of everybody; ``bad``: in the track's position."""
    one = cloud(**fields)
    place = np.array([3.0 if bad is None else bad, 0.0, 1.0])
    track = Track(1, TrackStatus.CONFIRMED, 9.0, 0.0, 8, place, np.zeros(3), np.full(3, 0.2), np.eye(6))
    return TrackedCloud(one, Tracks(0, 0, "room", (track,), np.ones(8, np.int32)))


def measurement(**fields: np.ndarray) -> Measurement:
    """One track, three metres away, with a range rate."""
    usual = {"position": np.array([[3.0, 1.0]]), "covariance": 0.01 * EYE[None], "rate": np.zeros(1), "rate_variance": np.ones(1)}
    return Measurement(**(usual | {"origin": np.zeros((1, 2))} | fields))


def updated(name: str, **fields: np.ndarray) -> object:
    """Give a measurement to an estimator that knows better."""
    estimator = make_estimator(EstimatorConfig(name=name), 2)
    return estimator.update(estimator.start(measurement(), 0.1), measurement(**fields))


def snapshots(bad: float) -> Snapshots:
    """Of a turntable."""
    angle = np.linspace(-1, 1, 9)
    return Snapshots(angle, 0 * angle, np.zeros(9, np.int64), spoilt(np.ones((9, 8), complex), bad).astype(complex), 3.0)


def model(**fields: object) -> GestureModel:
    """Of no layers."""
    n, k = len(FEATURE_NAMES), 10
    usual = {"mean": np.zeros(n), "scale": np.ones(n), "weights": (np.zeros((n, k)),), "biases": (np.zeros(k),)}
    return GestureModel(**(usual | fields))


def stream_net(**fields: np.ndarray) -> StreamNet:
    """Of one network without blocks that knows nothing."""
    n, k = len(NAMES), 10
    usual = {"mean": np.zeros(n, np.float32), "scale": np.ones(n, np.float32), "weights": np.zeros((n, k), np.float32)} | fields
    last = (np.eye(k, dtype=np.float32), np.zeros(k, np.float32))
    member = Member((usual["weights"], np.zeros(k, np.float32)), (), last)
    return StreamNet(usual["mean"], usual["scale"], (member,), NAMES, GESTURES, 0)


def samples(bad: float) -> SampleSet:
    """Two labels, two features."""
    features = spoilt(np.random.default_rng(0).normal(size=(40, 2)), bad)
    label = np.arange(40) % 2
    return SampleSet(features, label, np.arange(40) % 4, np.zeros(40), np.zeros(10, np.int64), {}, names=("a", "b"))


def postures(bad: float | None = None, **fields: float) -> object:
    """Ask a posture model of any weights."""
    settings = PostureFeatureConfig(history=(0.2, 1.0))
    n = settings.n_features
    weights, biases = (np.zeros((n, 8)), np.zeros((8, 3))), (np.zeros(8), np.zeros(3))
    learned = PostureModel(settings, weights, biases, np.full(3, 0.1), np.full(3, 0.3), np.array([[-1.0] * 3, [1.0] * 3]))
    return PostureTracker(learned).process(tracked(bad, **fields))


def truth(bad: float) -> SimpleNamespace:
    """What a simulator or a camera says of one person's hand."""
    return SimpleNamespace(
        stamp_ns=0,
        person_id=np.array([1], np.uint32),
        hand_position=np.array([[2.0, 0.0, 1.2]]),
        hand_velocity=np.array([[0.0, bad, 0.0]]),
        gesture=np.array([1], np.uint8),
        gesture_index=np.array([0], np.uint32),
    )


def targets(**fields: float) -> Targets:
    """Two targets of a board; one number of the named fields is spoilt."""
    arrays = {"position": np.ones((2, 3)), "covariance": np.tile(0.01 * np.eye(3), (2, 1, 1)), "radial_speed": np.full(2, 0.1)}
    arrays |= {name: spoilt(arrays[name], bad) for name, bad in fields.items()}
    return Targets(0, 0, "radar", np.arange(2), velocity=np.full((2, 3), np.nan), **arrays)


UNIT = np.eye(3)[:2]
# What refuses NaN and infinities alike.
REFUSED: dict[str, Callable[[float], object]] = {
    "Baseband": lambda bad: Baseband(BasebandConfig(), INFO).process(
        RadarFrame(spoilt(noise(INFO, np.random.default_rng(0)), bad), 0, 0, "radar")
    ),
    "Baseband fixed": lambda bad: Baseband(BasebandConfig(spectrum=SpectrumConfig(fft="fixed")), INFO).process(
        RadarFrame(spoilt(noise(INFO, np.random.default_rng(0)), bad), 0, 0, "radar")
    ),
    "PresenceDetector": lambda bad: PresenceDetector(PresenceConfig(), INFO).process(
        RadarFrame(spoilt(noise(INFO, np.random.default_rng(0)), bad), 0, 0, "radar")
    ),
    "ChannelGestures": lambda bad: ChannelGestures().process(Presence(0, 0, True, True, False, 1.0, bad, math.nan, 10.0)),
    "Calibrator": lambda bad: Calibrator(Calibration(), INFO).process(snapshots(bad)),
    "Refiner": lambda bad: Refiner(INFO).process(
        spoilt(np.ones(INFO.cube_shape, np.complex64), bad), *np.array([[2.0], [0.0], [0.0], [0.0]])
    ),
    "Unfolder": lambda bad: Unfolder(INFO).process(spoilt(np.ones((2, 2, 4), np.complex64), bad), np.zeros(2), np.ones(2)),
    **{
        f"DirectionFinder {method} {backend}": lambda bad, m=method, b=backend: DirectionFinder(DoaConfig(method=m), INFO, b).process(
            spoilt(np.ones((2, 8), np.complex64), bad), np.full(2, 10.0, np.float32)
        )
        for method in ("dml", "dml2", "capon")
        for backend in ("numba", "numpy")
    },
    "TargetTracker position": lambda bad: TargetTracker().process(targets(position=bad)),
    "TargetTracker covariance": lambda bad: TargetTracker().process(targets(covariance=bad)),
    "from_polar range_": lambda bad: from_polar(bad, 0.1, range_std=0.1, azimuth_std=0.1),
    "from_polar azimuth": lambda bad: from_polar(1.0, bad, range_std=0.1, azimuth_std=0.1),
    "from_polar range_std": lambda bad: from_polar(1.0, 0.1, range_std=bad, azimuth_std=0.1),
    "from_polar origin": lambda bad: from_polar(1.0, 0.1, range_std=0.1, azimuth_std=0.1, origin=[0.0, bad]),
    **{f"{name} position": lambda bad, n=name: updated(n, position=np.array([[3.0, bad]])) for name in ESTIMATORS},
    **{f"{name} covariance": lambda bad, n=name: updated(n, covariance=np.full((1, 2, 2), bad)) for name in ESTIMATORS},
    **{f"{name} step": lambda bad, n=name: make_estimator(EstimatorConfig(name=n), 2).predict(None, bad) for name in ESTIMATORS},
    **{
        f"{name} speed_std": lambda bad, n=name: make_estimator(EstimatorConfig(name=n), 2).start(measurement(), bad) for name in ESTIMATORS
    },
    "extended rate_variance": lambda bad: updated("extended", rate_variance=np.full(1, bad)),
    "unscented rate_variance": lambda bad: updated("unscented", rate_variance=np.full(1, bad)),
    "Snapshot direction": lambda bad: Snapshot().process(spoilt(UNIT, bad), np.zeros(2), np.ones(2)),
    "Snapshot rate_std": lambda bad: Snapshot().process(UNIT, np.zeros(2), np.array([1.0, bad])),
    "Snapshot offset": lambda bad: Snapshot().process(UNIT, np.zeros(2), np.ones(2), offset=spoilt(UNIT, bad)),
    "Snapshot speed": lambda bad: Snapshot().process(UNIT, np.zeros(2), np.ones(2), speed=bad),
    "Snapshot amplitude": lambda bad: Snapshot().process(UNIT, np.zeros(2), np.ones(2), amplitude=np.array([1.0, bad])),
    "dbscan": lambda bad: dbscan(spoilt(np.zeros((4, 2)), bad), 0.3, 2),
    "optics": lambda bad: optics(spoilt(np.zeros((4, 2)), bad), 2),
    "kmeans points": lambda bad: kmeans(spoilt(np.zeros((4, 2)), bad), np.zeros((1, 2))),
    "kmeans centres": lambda bad: kmeans(np.zeros((4, 2)), np.array([[0.0, bad]])),
    "split": lambda bad: split(spoilt(np.zeros((4, 2)), bad), 2, np.zeros((1, 2))),
    "ObjectSet": lambda bad: ObjectSet.of([[0.0, bad]]),
    "Governor": lambda bad: Governor([Level("only", {}, 1, 1.0, 0.0)], 1.0).process(bad, 0.0),
    "ConsistencyMonitor": lambda bad: ConsistencyMonitor().process(0, np.array([bad]), np.array([2])),
    "nees error": lambda bad: nees(np.array([0.0, bad]), EYE),
    "nees covariance": lambda bad: nees(np.zeros(2), spoilt(EYE, bad)),
    "solve_spd": lambda bad: solve_spd(np.array([[bad, 0.0], [0.0, 1.0]]), np.ones((2, 1))),
    "mahalanobis": lambda bad: mahalanobis(np.zeros((1, 2)), spoilt(EYE[None], bad), np.ones((1, 2))),
    "align_points source": lambda bad: align_points(spoilt(np.ones((5, 2)), bad), np.zeros((5, 2)), EYE, EYE),
    "align_points covariance": lambda bad: align_points(np.ones((5, 2)), np.zeros((5, 2)), np.array([[bad, 0.0], [0.0, 1.0]]), EYE),
    "Trajectory": lambda bad: Trajectory(np.arange(3), spoilt(np.zeros((3, 2)), bad), EYE),
    "TrackSample": lambda bad: TrackSample("hand", 0, np.array([0.0, bad, 0.0]), np.eye(3)),
    "ReferenceSample": lambda bad: ReferenceSample(0, np.array([0.0, bad, 0.0])),
    "HandTracker track": lambda bad: HandTracker().process(tracked(bad)),
    "GestureRecognizer track": lambda bad: EventStage(GestureConfig(), Pose()).process(tracked(bad)),
    "SlotStreams track": lambda bad: SlotStreams(INFO).process(tracked(bad)),
    "Memory": lambda bad: Memory(stream_net()).process(spoilt(np.zeros(len(NAMES)), bad)),
    "StreamNet scale": lambda bad: stream_net(scale=spoilt(np.ones(len(NAMES), np.float32), bad)),
    "StreamNet weights": lambda bad: stream_net(weights=spoilt(np.zeros((len(NAMES), 10), np.float32), bad)),
    "PostureTracker track": lambda bad: postures(bad),
    "GestureModel one": lambda bad: model().probabilities(spoilt(np.zeros(13), bad)),
    "GestureModel many": lambda bad: model().probabilities(spoilt(np.zeros((2, 13)), bad)),
    "GestureModel scale": lambda bad: model(scale=spoilt(np.ones(13), bad)),
    "GestureModel weights": lambda bad: model(weights=(spoilt(np.zeros((13, 10)), bad),)),
    "GestureModel temperature": lambda bad: model(temperature=bad),
    "SampleSet": lambda bad: samples(bad),
    "train_on": lambda bad: train_on(samples(bad), TrainingConfig(hidden=(4,), max_iterations=5, folds=2), labels=("push", "pull")),
    "fit_temperature": lambda bad: fit_temperature(np.array([[0.5, bad], [0.5, 0.5]]), np.array([0, 1])),
    "Curves time": lambda bad: EventMaps(np.array([0, 1]), np.array([bad]), np.zeros(3), np.zeros((4, 1, 3))),
    "encode body": lambda bad: encode([cloud()], EncoderConfig(relative=True), body=(2.0, bad, 0.0)),
    "TrueEvents": lambda bad: TrueEvents(CriterionConfig(), Pose()).process([truth(bad)]),
    "merge tolerance": lambda bad: merge([cloud()], [Pose()], bad),
}


@BAD
@pytest.mark.parametrize("door", REFUSED)
def test_what_is_no_number_is_refused_at_the_door(door, bad):
    """With an error of ours that says so; numpy may have warned on the way, but nothing comes out."""
    with np.errstate(all="ignore"), pytest.raises(HandwaveError, match=r"(?i)finite|infinit|\bnan\b|\b-?inf\b|not positive|must not fall"):
        REFUSED[door](bad)


# Where NaN is the mark for what was not measured: an infinity is refused.
UNMEASURED: dict[str, Callable[[float], object]] = {
    **{
        f"PeopleTracker {name}": lambda bad, n=name: PeopleTracker().process(cloud(**{n: bad}))
        for name in ("x", "y", "z", "radial_speed", "snr", "range", "azimuth_std")
    },
    **{f"PostureTracker {name}": lambda bad, n=name: postures(**{n: bad}) for name in ("x", "y", "z", "radial_speed")},
    "Walker": lambda bad: Walker(PairConfig(), INFO).process(cloud(frame_id="radar", x=bad)),
    "Unfolder speed": lambda bad: Unfolder(INFO).process(np.ones((2, 2, 4), np.complex64), np.array([0.0, bad]), np.ones(2)),
    "Unfolder snr": lambda bad: Unfolder(INFO).process(np.ones((2, 2, 4), np.complex64), np.zeros(2), np.array([1.0, bad])),
    "Bound": lambda bad: Bound(INFO).process([10.0, 10.0], [0.0, bad], [0.0, 0.0]),
    "Snapshot rate": lambda bad: Snapshot().process(UNIT, np.array([0.0, bad]), np.ones(2)),
    "Trajectory velocity": lambda bad: Trajectory(np.arange(3), np.zeros((3, 2)), EYE, spoilt(np.zeros((3, 2)), bad)),
    "from_polar rate": lambda bad: from_polar(1.0, 0.1, range_std=0.1, azimuth_std=0.1, rate=bad),
    "extended rate": lambda bad: updated("extended", rate=np.full(1, bad)),
    "unscented rate": lambda bad: updated("unscented", rate=np.full(1, bad)),
    "mm_vel_est rate": lambda bad: updated("mm_vel_est", rate=np.full(1, bad)),
}


@pytest.mark.parametrize("door", UNMEASURED)
def test_nan_may_stand_for_what_was_not_measured_but_infinity_may_not(door):
    """The first is taken without a warning, the second refused."""
    UNMEASURED[door](math.nan)
    for bad in (math.inf, -math.inf):
        with np.errstate(all="ignore"), pytest.raises(HandwaveError, match=r"(?i)finite|infinit|singular"):
            UNMEASURED[door](bad)


@BAD
@pytest.mark.parametrize("name", ARRAY_FIELDS)
def test_a_bad_field_leaves_the_hand_and_the_events_whole(name, bad):
    """The stages behind the people tracker look at fields of their own: whatever one point holds there, results are finite."""
    people, hand, events = PeopleTracker(), HandTracker(), EventStage(GestureConfig(), Pose())
    hand.start(None, 300_000_000)
    for k in range(30):
        one = cloud(k * 20_000_000)
        tracks = people.process(one)
        spoilt_one = dataclasses.replace(one, **{name: np.where(np.arange(8) == k % 8, np.float32(bad), getattr(one, name))})
        both = TrackedCloud(spoilt_one if k > 20 else one, tracks)
        found = hand.process(both)
        events.process(both)
    assert found is not None
    for array in (found.position, found.velocity, found.covariance, found.value):
        assert np.isfinite(array).all()


@BAD
def test_events_take_a_speed_that_is_no_number_for_rest(bad):
    """An infinite one is a fast one, for one cloud: neither makes an event, and afterwards all is as before."""
    detector, twin = EventDetector(EventConfig()), EventDetector(EventConfig())
    for k in range(50):
        found = detector.process(k * 20_000_000, bad if k == 5 else 2.0 if 20 <= k < 30 else 0.0)
        assert found == twin.process(k * 20_000_000, 2.0 if 20 <= k < 30 else 0.0)


@BAD
def test_costs_and_depths(bad):
    """A NaN cost is refused, plus infinity forbids a pair, minus infinity is refused; a depth that is none is not measured."""
    if bad == math.inf:
        assert len(assign_tracks(np.full((2, 2), bad), 1.0)) == 0
    else:
        with pytest.raises(HandwaveError):
            assign_tracks(np.full((2, 2), bad), 1.0)
    found = DepthReader().process(np.full((20, 20), bad, np.float32), np.array([[10.0, 10.0], [bad, 10.0]]))
    assert np.isnan(found.depth).all()
    assert all(found.reason)


# Who is behind which door: what they take was made by the one who is named.
BEHIND = {
    "Observer": "preview of the command, drawn from results",
    **dict.fromkeys(("FixedFft", "FloatFft", "FmcwSpectrum", "CwSpectrum", "OfdmSpectrum"), "Baseband"),
    "TwoSources": "DirectionFinder",
    "Pipeline": "Baseband, PeopleTracker",
    "Curves": "its own tests of absurd detections; EventMaps refuses times",
    "InputMaker": "Curves, Cells",
    "Branch": "CurveNet",
    "Cells": "its own tests of absurd detections, with those of curves; EventMaps refuses times",
    **dict.fromkeys(("TrackManagement", "Pairs", "Reflections", "Background", "Admission", "Birth"), "PeopleTracker"),
    **dict.fromkeys(("PoissonTracker", "Measure", "Decisions"), "test/stability/test_poisson.py"),
    "Gaps": "Baseband",
    **dict.fromkeys(("GroupTracking", "GroupTrackingWithClustering", "ClusterFirstTrackLater"), "PeopleTracker"),
    **dict.fromkeys(("HandMeter", "ControlValue"), "HandTracker"),
    "Zones": "its own test of whatever a cloud holds",
    "ZoneMonitor": "test/tracking/test_zone_monitor.py: places and covariances that are no numbers",
    "PostureFeatures": "PostureTracker",
    "VitalMonitor": "test/stability/test_vital_hazards.py: frames that are not finite, places beyond all cells",
    **dict.fromkeys(("GospaMetric", "OspaMetric", "ClearMot"), "ObjectSet"),
    "HandResiduals": "TrackSample, ReferenceSample",
    **dict.fromkeys(("SyntheticCamera", "MarkerFinder", "MediapipePose"), "images of 8 bits, which have no NaN"),
    "CameraTruth": "DepthReader",
    "GestureRecognizer": "EventStage",
    "StreamRecognizer": "SlotStreams, Memory",
    "EnsembleRecognizer": "GestureRecognizer, StreamRecognizer",
    "EventDetector": "its own test above",
    "Rests": "EventDetector, SlotStreams",
    "Activation": "GestureRecognizer",
    "EventStage": "GestureRecognizer track",
    "DepthReader": "its own test above",
    "HandTracker": "its own test above",
}


def test_every_door_is_in_the_table():
    """Classes with a public ``process`` outside the simulator, whose numbers all come from knobs, and outside nodes."""
    known = {name.split()[0] for table in (REFUSED, UNMEASURED) for name in table} | set(BEHIND)
    found = set()
    for package in ("radar_core", "radar_dsp", "radar_tracking", "radar_gestures"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                public = isinstance(node, ast.ClassDef) and not node.name.startswith("_") and "Protocol" not in map(ast.unparse, node.bases)
                if public and any(isinstance(f, ast.FunctionDef) and f.name == "process" for f in node.body):
                    found.add(node.name)
    assert found <= known, f"not in the table of doors: {sorted(found - known)}"
    assert GestureRecognizer.__name__ in found


def test_frames_from_the_simulator_pass():
    """The doors are open to what is in order: no error for noise."""
    cloud_of_noise = Baseband(BasebandConfig(), INFO).process(frame(INFO, noise(INFO, np.random.default_rng(0))))
    PeopleTracker().process(cloud_of_noise.to_room(Pose()))
    assert CurveConfig().steps >= 2
