"""What must not matter: the order of points, tracks, objects and echoes, and units where a function has none of its own."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import PointCloud, Pose, RadarInfo
from radar_core.cloud import ARRAY_FIELDS
from radar_core.config import load
from radar_dsp import DoaConfig
from radar_dsp.doa import DirectionFinder
from radar_dsp.unfold import Unfolder
from radar_gestures import GestureConfig
from radar_gestures.features import weighted_medians
from radar_gestures.stage import EventStage
from radar_lab.alignment import align_points
from radar_lab.posture.features import PostureFeatureConfig, PostureFeatures
from radar_lab.training.encoder import EncoderConfig, encode
from radar_sim import Point, Scene, SceneRadar, Simulator
from radar_tracking import HandTracker, PeopleTracker, TrackedCloud, TrackerConfig, dbscan, kmeans
from radar_tracking.clustering import Clustering, ClusteringConfig, seen_from
from radar_tracking.estimators import Snapshot
from radar_tracking.estimators.kernels import correct, predict
from radar_tracking.metrics import ClearMot, ClearMotConfig, GospaConfig, GospaMetric, ObjectSet, OspaConfig, OspaMetric

INFO = RadarInfo()
SCALES = pytest.mark.parametrize("scale", [1e-6, 1e6])
calm = settings(max_examples=20, deadline=None)


def person_cloud(k: int) -> PointCloud:
    """Two people, one of whom raises and lowers a hand before them; the other comes a fifth of a second later.

    (Those who come in the same cloud are numbered by the order of their points.)
    """
    rng = np.random.default_rng(k)
    bodies = np.repeat([[3.0, 0.8, 1.0], [4.0, -1.2, 1.0]], 7, axis=0) + rng.normal(0, 0.12, (14, 3))
    hand = np.array([2.5, 0.8, 1.2 + 0.2 * math.sin(k / 10)]) + rng.normal(0, 0.02, (4, 3))
    x, y, z = np.vstack([bodies, hand]).astype(np.float32).T
    speed = np.r_[rng.normal(0, 0.1, 14), np.full(4, -1.6 if 60 <= k < 85 else 0.3) + rng.normal(0, 0.05, 4)].astype(np.float32)
    snr = rng.uniform(12, 30, 18).astype(np.float32)
    cloud = PointCloud(
        k * 20_000_000, k, "room", x, y, z, range=np.hypot(x, y), azimuth=np.arctan2(y, x), elevation=0 * x, radial_speed=speed, snr=snr
    )
    return cloud if k >= 10 else cloud.select(np.r_[0:7, 14:18])


def shuffled(cloud: PointCloud, rng: np.random.Generator) -> tuple[PointCloud, np.ndarray]:
    """The cloud in another order, and that order."""
    order = rng.permutation(len(cloud))
    return cloud.select(order), order


@pytest.mark.long
@pytest.mark.parametrize("tracker", ["group_clustering", "group", "cluster_first"])
def test_the_order_of_points_does_not_matter_to_people_hands_and_events(tracker):
    """Sums in another order differ in the last bit: after 120 clouds tracks agree to 1e-9 m, owners, ids and events to the bit."""
    config = load(TrackerConfig, {"tracker": tracker})
    rng, pairs = np.random.default_rng(1), []
    stages = [(PeopleTracker(config), HandTracker(), EventStage(GestureConfig(), Pose())) for _ in range(2)]
    for _, hand, _ in stages:
        hand.start(None, 600_000_000)
    hands = events = 0
    for k in range(120):
        plain = person_cloud(k)
        other, order = shuffled(plain, rng)
        pairs = []
        for cloud, (people, hand, event) in zip((plain, other), stages, strict=True):
            tracks = people.process(cloud)
            both = TrackedCloud(cloud, tracks)
            pairs.append((tracks, hand.process(both), event.process(both)))
        (a, hand_a, events_a), (b, hand_b, events_b) = pairs
        assert [t.id for t in a.tracks] == [t.id for t in b.tracks]
        np.testing.assert_array_equal(b.point_track_id, a.point_track_id[order])
        for one, two in zip(a.tracks, b.tracks, strict=True):
            np.testing.assert_allclose(two.position, one.position, atol=1e-9)
            np.testing.assert_allclose(two.covariance, one.covariance, atol=1e-9)
        assert (hand_a is None) == (hand_b is None)
        if hand_a is not None and hand_b is not None:
            hands += 1
            np.testing.assert_allclose(hand_b.position, hand_a.position, atol=1e-9)
            assert hand_b.value == pytest.approx(hand_a.value, abs=1e-9)
        assert [e.event for e in events_a] == [e.event for e in events_b]
        for first, second in zip(events_a, events_b, strict=True):
            events += 1
            np.testing.assert_allclose(second.features, first.features, atol=1e-9)
    assert hands > 50
    assert events


@calm
@given(seed=st.integers(0, 2**32 - 1), name=st.sampled_from(["dbscan", "optics", "kmeans", "grid_dbscan", "polar_dbscan"]))
def test_the_order_of_points_does_not_matter_to_clusters(seed, name):
    """Bodies apart: the same groups in any order, whatever number each gets. (A border point between two is either's by its order.)"""
    rng = np.random.default_rng(seed)
    owner = np.repeat([0, 1], 20)
    place = np.array([[3.0, -2.0], [3.0, 2.0]])[owner] + rng.uniform(-0.15, 0.15, (40, 2))
    order = rng.permutation(40)
    clustering = Clustering(ClusteringConfig(name=name))
    plain, other = (clustering.labels(seen_from(points, np.zeros(2))) for points in (place, place[order]))
    same = plain[order][:, None] == plain[order][None]
    np.testing.assert_array_equal(other[:, None] == other[None], same)
    np.testing.assert_array_equal(other < 0, plain[order] < 0)


@calm
@given(st.integers(0, 2**32 - 1))
def test_the_order_of_detections_does_not_matter_to_a_cube(seed):
    """Strongest first, whatever came first; clouds in any order; to the bit."""
    rng = np.random.default_rng(seed)
    clouds = [person_cloud(k) for k in range(30)]
    expected = encode(clouds, EncoderConfig())
    other = [shuffled(cloud, rng)[0] for cloud in clouds]
    np.testing.assert_array_equal(encode([other[k] for k in rng.permutation(30)], EncoderConfig()), expected)


def test_the_order_of_points_does_not_matter_to_postures():
    """Counts and quantiles: to rounding."""
    rng, makers = np.random.default_rng(2), [PostureFeatures(PostureFeatureConfig(history=(0.2,))) for _ in range(2)]
    people = PeopleTracker()
    for k in range(60):
        cloud = person_cloud(k)
        tracks = people.process(cloud)
        other, order = shuffled(cloud, rng)
        given_ = TrackedCloud(cloud, tracks), TrackedCloud(other, dataclasses.replace(tracks, point_track_id=tracks.point_track_id[order]))
        a, b = (maker.process(one, np.zeros(3)) for maker, one in zip(makers, given_, strict=True))
        for first, second in zip(a, b, strict=True):
            np.testing.assert_allclose(second.features, first.features, atol=1e-6)  # float32 points, weighed in another order
    assert a


@calm
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(0, 6), m=st.integers(0, 6))
def test_the_order_of_objects_does_not_matter_to_metrics(seed, n, m):
    """GOSPA, OSPA and CLEAR-MOT of sets are of sets: sums in another order, 1e-12."""
    rng = np.random.default_rng(seed)
    truth, found = rng.normal(0, 1, (n, 2)), rng.normal(0, 1, (m, 2))
    p, q = rng.permutation(n), rng.permutation(m)
    plain = ObjectSet.of(truth, np.arange(n)), ObjectSet.of(found, np.arange(m))
    other = ObjectSet.of(truth[p], p), ObjectSet.of(found[q], q)
    for metric in (GospaMetric, OspaMetric):
        assert metric().process(*other).distance == pytest.approx(metric().process(*plain).distance, abs=1e-12)
    a, b = ClearMot().process(*plain), ClearMot().process(*other)
    assert a.distance.sum() == pytest.approx(b.distance.sum(), abs=1e-12)
    assert set(zip(a.truth_id.tolist(), a.estimate_id.tolist(), strict=True)) == set(
        zip(b.truth_id.tolist(), b.estimate_id.tolist(), strict=True)
    )


@calm
@given(st.integers(0, 2**32 - 1))
def test_the_order_of_points_does_not_matter_to_alignment_and_velocity(seed):
    """Least squares by singular values: 1e-9. Where outliers are weighed, rounds end at a thousandth of the result's own deviation."""
    rng = np.random.default_rng(seed)
    source = rng.normal(0, 2, (12, 2))
    target = source @ np.array([[0.8, -0.6], [0.6, 0.8]]).T + [1.0, -2.0] + rng.normal(0, 0.01, (12, 2))
    order = rng.permutation(12)
    a, b = (align_points(s, t, 1e-4 * np.eye(2), 1e-4 * np.eye(2)) for s, t in ((source, target), (source[order], target[order])))
    assert b.yaw == pytest.approx(a.yaw, abs=1e-3 * a.std["yaw"])
    np.testing.assert_allclose(b.translation, a.translation, atol=1e-3 * a.std["x"])
    direction = rng.normal(size=(12, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    rate, std = rng.normal(0, 0.5, 12), rng.uniform(0.05, 0.2, 12)
    c, d = Snapshot().process(direction, rate, std), Snapshot().process(direction[order], rate[order], std[order])
    np.testing.assert_allclose(d.velocity, c.velocity, atol=1e-9)
    np.testing.assert_allclose(d.covariance, c.covariance, atol=1e-9)


@pytest.mark.parametrize("method", ["dml", "dml2", "capon"])
def test_the_order_of_detections_does_not_matter_to_directions(method):
    """Each detection for itself: to the bit."""
    rng = np.random.default_rng(3)
    steering = INFO.array.steering(rng.uniform(-1, 1, 30), rng.uniform(-0.4, 0.4, 30), INFO.waveform.wavelength)
    snapshot = (steering + 0.1 * (rng.normal(size=(30, 8)) + 1j * rng.normal(size=(30, 8)))).astype(np.complex64)
    snr, order = np.full(30, 50.0, np.float32), rng.permutation(30)
    finder = DirectionFinder(DoaConfig(method=method), INFO)
    a, b = finder.process(snapshot, snr), finder.process(snapshot[order], snr)
    for i, k in enumerate(order):
        np.testing.assert_array_equal(b.azimuth[b.source == i], a.azimuth[a.source == k])
        np.testing.assert_array_equal(b.elevation[b.source == i], a.elevation[a.source == k])


def test_the_order_of_echoes_does_not_matter_to_a_frame():
    """A sum of 200 echoes in float32: 1e-5 of the strongest sample."""
    rng = np.random.default_rng(4)
    places = np.column_stack([rng.uniform(1, 5, 200), rng.uniform(-2, 2, 200), rng.uniform(-1, 1, 200)])
    points = [Point(position=tuple(p)) for p in places.tolist()]
    radars = (SceneRadar.of(RadarInfo(mount=Pose(z=0.0))),)
    a, b = (
        Simulator(Scene(duration=1.0, radars=radars, points=tuple(points[i] for i in order))).process(0).frame.cube
        for order in (range(200), rng.permutation(200))
    )
    assert np.abs(a - b).max() < 1e-5 * np.abs(a).max()


@SCALES
def test_clusters_of_any_unit(scale):
    """Metres, micrometres or megametres, with reach and centres in the same: the same labels."""
    rng = np.random.default_rng(5)
    place = np.repeat([[3.0, -2.0], [3.0, 2.0], [5.0, 0.0]], 15, axis=0) + rng.normal(0, 0.2, (45, 2))
    np.testing.assert_array_equal(dbscan(scale * place, scale * 0.3, 3), dbscan(place, 0.3, 3))
    start = place[[0, 20, 40]]
    labels, centres = kmeans(place, start)
    other, moved = kmeans(scale * place, scale * start)
    np.testing.assert_array_equal(other, labels)
    np.testing.assert_allclose(moved, scale * centres, rtol=1e-12)


@SCALES
def test_alignment_of_any_unit(scale):
    """A turn has no unit and a translation that of the points; rounding is relative."""
    rng = np.random.default_rng(6)
    source = rng.normal(0, 2, (20, 2))
    target = source @ np.array([[0.8, -0.6], [0.6, 0.8]]).T + [1.0, -2.0] + rng.normal(0, 0.01, (20, 2))
    plain = align_points(source, target, 1e-4 * np.eye(2), 1e-4 * np.eye(2))
    other = align_points(scale * source, scale * target, scale**2 * 1e-4 * np.eye(2), scale**2 * 1e-4 * np.eye(2))
    assert other.yaw == pytest.approx(plain.yaw, abs=1e-9)
    np.testing.assert_allclose(other.translation, scale * plain.translation, rtol=1e-8)
    assert other.condition == pytest.approx(plain.condition, rel=1e-6)


@SCALES
@pytest.mark.parametrize("p", [1.0, 2.0])
def test_metrics_of_any_unit(p, scale):
    """With the cut-off in the same unit, the distance is in it too."""
    rng = np.random.default_rng(7)
    truth, found = rng.normal(0, 1, (6, 2)), rng.normal(0, 1, (5, 2))
    plain, other = (ObjectSet.of(truth), ObjectSet.of(found)), (ObjectSet.of(scale * truth), ObjectSet.of(scale * found))
    for metric, config in ((GospaMetric, GospaConfig), (OspaMetric, OspaConfig)):
        a = metric(config(p=p, c=1.0)).process(*plain).distance
        assert metric(config(p=p, c=scale)).process(*other).distance == pytest.approx(scale * a, rel=1e-12)
    a, b = ClearMot(ClearMotConfig(radius=1.0)).process(*plain), ClearMot(ClearMotConfig(radius=scale)).process(*other)
    np.testing.assert_array_equal(a.estimate_id, b.estimate_id)


@SCALES
def test_filters_of_any_unit(scale):
    """Lengths in another unit scale states and the roots of covariances; NIS and gates have none. A power of two: to the bit."""
    rng = np.random.default_rng(8)
    root = rng.normal(size=(3, 4, 4))
    P = root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(4)
    F, Q = np.eye(4)[None] + np.eye(4, k=2)[None] * 0.1, 0.01 * np.eye(4)[None]
    H, R, y, mean = np.eye(2, 4)[None], np.tile(0.01 * np.eye(2), (3, 1, 1)), rng.normal(size=(3, 2)), rng.normal(size=(3, 4))
    used = np.ones((3, 2), bool)
    plain = correct(mean, predict(P, F, Q), y, H, R, used)
    for factor, rtol in ((scale, 1e-10), (2.0**20, 0.0)):
        other = correct(factor * mean, predict(factor**2 * P, F, factor**2 * Q), factor * y, H, factor**2 * R, used)
        np.testing.assert_allclose(other.mean, factor * plain.mean, rtol=rtol)
        np.testing.assert_allclose(other.covariance, factor**2 * plain.covariance, rtol=rtol, atol=1e-12 * factor**2 if rtol else 0.0)
        np.testing.assert_allclose(other.nis, plain.nis, rtol=rtol)


@SCALES
@pytest.mark.parametrize("method", ["dml", "dml2", "capon"])
def test_directions_of_any_unit(method, scale):
    """A snapshot's size is no part of its direction, to float32; nor is it of which speed it folds."""
    rng = np.random.default_rng(9)
    steering = INFO.array.steering(rng.uniform(-0.8, 0.8, 10), rng.uniform(-0.3, 0.3, 10), INFO.waveform.wavelength)
    snapshot = (steering + 0.05 * (rng.normal(size=(10, 8)) + 1j * rng.normal(size=(10, 8)))).astype(np.complex64)
    snr = np.full(10, 100.0, np.float32)
    finder, unfolder = DirectionFinder(DoaConfig(method=method), INFO), Unfolder(INFO)
    a, b = finder.process(snapshot, snr), finder.process(snapshot * np.float32(scale), snr)
    np.testing.assert_array_equal(a.source, b.source)
    np.testing.assert_allclose(b.azimuth, a.azimuth, atol=1e-4)
    np.testing.assert_allclose(b.elevation, a.elevation, atol=1e-4)
    speeds = np.linspace(-3, 3, 10)
    c, d = (unfolder.process(s.reshape(10, 2, 4), speeds, snr) for s in (snapshot, snapshot * np.float32(scale)))
    np.testing.assert_array_equal(c.fold, d.fold)


@SCALES
def test_medians_of_any_unit(scale):
    """Of values and of weights alike."""
    rng = np.random.default_rng(10)
    rows, weights = rng.normal(size=(4, 9)), rng.uniform(0.1, 1, 9)
    plain = weighted_medians(rows, weights)
    np.testing.assert_allclose(weighted_medians(rows, scale * weights), plain, rtol=1e-12)
    np.testing.assert_allclose(weighted_medians(scale * rows, weights), scale * np.array(plain), rtol=1e-12)


def test_a_cloud_has_all_its_fields_after_shuffling():
    """Nothing stays behind: every field moves with its point."""
    cloud = person_cloud(0)
    other, order = shuffled(cloud, np.random.default_rng(0))
    for name in ARRAY_FIELDS:
        np.testing.assert_array_equal(getattr(other, name), getattr(cloud, name)[order])
