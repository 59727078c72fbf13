"""Hard numerical cases of radar_tracking: empty, degenerate, huge, long, NaN, strange stamps."""

import dataclasses

import numpy as np
import pytest

from radar_core import DataError, PointCloud
from radar_tracking import FilterConfig, HandTracker, PeopleTracker, TrackedCloud, TrackerConfig, TrackStatus
from radar_tracking.clustering import cluster, dbscan, thin


def cloud_of(points: np.ndarray, stamp_ns: int, speed: float = 0.5, snr: float = 15.0) -> PointCloud:
    """A cloud in the room; points of shape (n, 3)."""
    p = np.asarray(points, np.float32).reshape(-1, 3)
    n = len(p)
    return PointCloud(
        stamp_ns,
        0,
        "room",
        p[:, 0].copy(),
        p[:, 1].copy(),
        p[:, 2].copy(),
        radial_speed=np.full(n, speed, np.float32),
        snr=np.full(n, snr, np.float32),
    )


def healthy(covariance: np.ndarray) -> bool:
    """Symmetric to the bit, positive definite, finite."""
    return bool(np.isfinite(covariance).all() and np.array_equal(covariance, covariance.T) and np.linalg.eigvalsh(covariance).min() > 0)


def run(points: np.ndarray, n: int = 30, step_ns: int = 20_000_000, config: TrackerConfig | None = None) -> list:
    """Feed the same points again and again, with the hand tracker behind; every covariance is healthy."""
    people, hand = PeopleTracker(config), HandTracker()
    hand.start(None, step_ns * 15)
    results = []
    for k in range(n):
        cloud = cloud_of(points, k * step_ns)
        tracks = people.process(cloud)
        found = hand.process(TrackedCloud(cloud, tracks))
        assert all(healthy(t.covariance) and np.isfinite(t.position).all() for t in tracks.tracks)
        assert found is None or (healthy(found.covariance) and 0 <= found.value <= 1)
        results.append(tracks)
    return results


def test_nothing_at_all():
    """Empty clouds give empty results."""
    assert all(not r.tracks and r.point_track_id.shape == (0,) for r in run(np.empty((0, 3))))


def test_one_point_is_nobody():
    """It starts no track."""
    assert not run(np.array([[3.0, 0.0, 1.0]]))[-1].tracks


def test_identical_points():
    """Ten points in one place: no spread, and still a positive definite covariance and a confirmed track, the surface offset behind it."""
    last = run(np.tile([3.0, 0.0, 1.0], (10, 1)))[-1]
    assert last.people_count == 1
    offset = FilterConfig().surface
    np.testing.assert_allclose(last.tracks[0].position, [3.0 + offset, 0.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(last.tracks[0].extent, [offset, 0.0, 0.0], atol=1e-9)


def test_collinear_points_and_points_at_the_origin():
    """Rank-one spread; the radar's own place, where nobody can be but its own coupling, unless one wants to track that too."""
    line = np.column_stack([np.linspace(2.8, 3.2, 9), np.zeros(9), np.ones(9)])
    assert run(line)[-1].people_count == 1
    assert not run(np.zeros((8, 3)))[-1].tracks
    assert run(np.zeros((8, 3)), config=TrackerConfig(tracker="group_clustering", min_distance=0.0))[-1].people_count == 1


@pytest.mark.long
@pytest.mark.parametrize("spread", [0.3, 3.0, 60.0])
def test_a_hundred_thousand_points(spread):
    """Dense or everywhere: results for every point, in bounded memory (no 1e5 x 1e5 matrix: that were 80 GB)."""
    points = np.random.default_rng(1).normal(0, spread, (100_000, 3))
    results = run(points, n=3)
    assert results[-1].point_track_id.shape == (100_000,)
    assert len(results[-1].tracks) <= 50


def test_clustering_time_is_bounded():
    """The work after thinning does not grow with the points: at most `max_points` are clustered, whatever the shape of the cloud."""
    for n in (5_000, 50_000):
        for points in (np.random.default_rng(1).normal(0, 1, (n, 2)), np.random.default_rng(2).uniform(-90, 90, (n, 2)), np.zeros((n, 2))):
            merged, weights, member = thin(points, 0.1, 2000)
            assert len(merged) <= 2000
            assert weights.sum() == n
            assert cluster(points, 0.4, 5, 2000).shape == (n,)
            assert member.shape == (n,)


@pytest.mark.parametrize(
    "name", ["z", "range", "azimuth", "elevation", "radial_speed", "snr", "noise", "range_std", "azimuth_std", "elevation_std"]
)
def test_a_field_of_nan(name):
    """Any one field unmeasured: the person is tracked all the same."""
    rng, tracker, hand = np.random.default_rng(1), PeopleTracker(), HandTracker()
    hand.start(None, 0)
    for k in range(30):
        cloud = cloud_of(np.array([3.0, 0.0, 1.0]) + rng.normal(0, 0.1, (10, 3)), k * 20_000_000)
        cloud = dataclasses.replace(cloud, **{name: np.full(10, np.nan, np.float32)})
        tracks = tracker.process(cloud)
        hand.process(TrackedCloud(cloud, tracks))
    assert tracks.people_count == 1
    assert healthy(tracks.tracks[0].covariance)


def test_everything_nan():
    """Points without any position: dropped, counted, nobody's."""
    tracker = PeopleTracker()
    tracks = tracker.process(cloud_of(np.full((7, 3), np.nan), 0, np.nan, np.nan))
    assert (tracks.point_track_id == -1).all()
    assert tracker.dropped_points == 7


def test_largest_float32_coordinates_and_levels():
    """Positions of 3e38 m are dropped, an SNR of 3e38 dB does not overflow."""
    top = float(np.finfo(np.float32).max)
    points = np.vstack([np.tile([3.0, 0.0, 1.0], (8, 1)), [[top, 0, 0], [0, -top, 0], [0, 0, top]]])
    tracker = PeopleTracker()
    for k in range(20):
        tracks = tracker.process(cloud_of(points, k * 20_000_000, snr=top))
    assert tracks.people_count == 1
    assert tracker.dropped_points == 60


def test_equal_stamps():
    """dt = 0: another look at the same moment updates and does not divide by it."""
    results = run(np.tile([3.0, 0.0, 1.0], (8, 1)), step_ns=0)
    assert results[-1].tracks[0].age == 0
    assert results[-1].tracks[0].status == TrackStatus.TENTATIVE


def test_a_huge_gap():
    """A thousand years of nothing: everybody is gone, a new track has a new id and a healthy covariance."""
    tracker = PeopleTracker()
    points = np.tile([3.0, 0.0, 1.0], (8, 1))
    for k in range(20):
        tracker.process(cloud_of(points, k * 20_000_000))
    gap = 2**62
    assert not tracker.process(cloud_of(np.empty((0, 3)), gap)).tracks
    tracks = tracker.process(cloud_of(points, gap + 20_000_000))
    assert [t.id for t in tracks.tracks] == [2]
    assert healthy(tracks.tracks[0].covariance)


def test_time_does_not_run_backwards():
    """Refused by both trackers, and the state is as it was."""
    tracker, hand = PeopleTracker(), HandTracker()
    new, old = (cloud_of(np.tile([3.0, 0.0, 1.0], (8, 1)), s) for s in (40_000_000, 20_000_000))
    tracks = tracker.process(new)
    hand.process(TrackedCloud(new, tracks))
    with pytest.raises(DataError, match="older"):
        tracker.process(old)
    with pytest.raises(DataError, match="older"):
        hand.process(TrackedCloud(old, dataclasses.replace(tracks, stamp_ns=old.stamp_ns)))
    assert tracker.process(dataclasses.replace(new, stamp_ns=60_000_000)).tracks[0].id == 1


def test_behind_the_radar():
    """A person who circles a radar in the middle of the room crosses azimuth +-pi: the track lives on the floor plane and does not jump."""
    rng, tracker = np.random.default_rng(2), PeopleTracker()
    for k in range(700):
        angle = 0.5 * k * 0.02
        body = np.array([2 * np.cos(angle), 2 * np.sin(angle), 1.0])
        points = body + rng.normal(0, 0.1, (8, 3))
        cloud = cloud_of(points, k * 20_000_000)
        azimuth = np.arctan2(cloud.y, cloud.x).astype(np.float32)
        tracks = tracker.process(dataclasses.replace(cloud, azimuth=azimuth, range=np.full(8, 2, np.float32)))
        assert [t.id for t in tracks.tracks] == [1]
        assert k < 25 or np.hypot(*(tracks.tracks[0].position - body)[:2]) < 0.25
    assert angle > 2 * np.pi


def test_float32_points_cluster_like_float64():
    """Far from the origin float32 rounds to 4e-6 m; clusters 0.2 m apart at eps = 0.1 m do not notice."""
    rng = np.random.default_rng(3)
    points = np.array([50.0, 50.0]) + np.vstack([rng.uniform(0, 0.08, (20, 2)), 0.3 + rng.uniform(0, 0.08, (20, 2))])
    exact, rounded = dbscan(points, 0.1, 3), dbscan(points.astype(np.float32).astype(np.float64), 0.1, 3)
    assert np.array_equal(exact, rounded)
    assert set(exact) == {0, 1}
