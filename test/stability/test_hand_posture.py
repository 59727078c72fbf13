"""Hazards of learned postures: NaN and infinities, crowds of points, a person at the sensor, long runs, long gaps, hostile model files."""

import dataclasses
import io
import struct
import zipfile

import numpy as np
import pytest

from radar_core import ConfigError, DataError, PointCloud
from radar_lab.posture.features import BodyFrame, PostureFeatureConfig, PostureFeatures
from radar_lab.posture.posture import PostureConfig, PostureModel, PostureTracker, load_postures, save_postures
from radar_lab.posture.training import PostureSamples, PostureTrainingConfig, fit_postures
from radar_tracking import Track, TrackedCloud, Tracks, TrackStatus

SETTINGS = PostureFeatureConfig(history=(0.2, 1.0))


def model(seed: int = 0, size: float = 0.1) -> PostureModel:
    """Any weights at all: hazards do not depend on what was learned."""
    rng, n = np.random.default_rng(seed), SETTINGS.n_features
    weights = (size * rng.normal(size=(n, 8)), size * rng.normal(size=(8, 3)))
    return PostureModel(SETTINGS, weights, (np.zeros(8), np.zeros(3)), np.full(3, 0.1), np.full(3, 0.3), np.array([[-1.0] * 3, [1.0] * 3]))


def cloud(points: np.ndarray, stamp_ns: int = 0, body: tuple[float, ...] = (2.0, 0.0, 1.1), rate: float = 0.0) -> TrackedCloud:
    """Points of the person at ``body``."""
    p = np.asarray(points, np.float32).reshape(-1, 3)
    made = PointCloud(stamp_ns, 0, "room", p[:, 0].copy(), p[:, 1].copy(), p[:, 2].copy(), radial_speed=np.full(len(p), rate, np.float32))
    track = Track(1, TrackStatus.CONFIRMED, 9.0, 0.0, len(p), np.array(body), np.zeros(3), np.full(3, 0.2), np.eye(6))
    return TrackedCloud(made, Tracks(stamp_ns, 0, "room", (track,), np.ones(len(p), np.int32)))


POINTS = np.array([[1.9, 0.1, 1.0], [1.8, -0.4, 1.5], [2.0, 0.2, 0.4]])


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_infinite_points_are_refused_by_name(axis):
    """An infinity in x, y or z, and in the range rate."""
    points = POINTS.copy()
    points[1, axis] = np.inf
    with pytest.raises(DataError, match=rf"PointCloud\.{'xyz'[axis]} .*infinite"):
        PostureTracker(model()).process(cloud(points))
    with pytest.raises(DataError, match=r"PointCloud\.radial_speed .*infinite"):
        PostureTracker(model()).process(cloud(POINTS, rate=-np.inf))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_what_was_not_measured_is_left_out(axis):
    """NaN in x, y or z takes the point away and nothing else; a NaN range rate counts as 0."""
    points = np.vstack([POINTS, POINTS[:1]])
    points[3, axis] = np.nan
    given, expected = PostureTracker(model()).process(cloud(points)), PostureTracker(model()).process(cloud(POINTS))
    np.testing.assert_array_equal(given.people[0].position, expected.people[0].position)
    silent = PostureTracker(model()).process(cloud(POINTS, rate=np.nan))
    np.testing.assert_array_equal(silent.people[0].position, expected.people[0].position)


def test_a_track_that_is_nowhere_is_refused():
    """NaN in the track's position."""
    with pytest.raises(DataError, match=r"Track\.position of track 1"):
        PostureTracker(model()).process(cloud(POINTS, body=(2.0, np.nan, 1.1)))


def test_features_that_are_no_numbers_are_refused():
    """NaN, infinite, beyond all measure, too few."""
    good = np.zeros(SETTINGS.n_features)
    for bad in (np.nan, np.inf, 1e10):
        with pytest.raises(DataError, match="non-finite"):
            model().predict(np.where(np.arange(len(good)) == 3, bad, good))
    with pytest.raises(DataError, match="has shape"):
        model().predict(good[1:])


def test_a_person_who_has_no_point_at_first():
    """No result before the first point, then one; the empty clouds before leave no trace."""
    tracker = PostureTracker(model())
    for k in range(5):
        assert tracker.process(cloud(np.empty((0, 3)), k * 10**8)).people == ()
    found = tracker.process(cloud(POINTS, 5 * 10**8)).people[0]
    np.testing.assert_array_equal(found.position, PostureTracker(model()).process(cloud(POINTS)).people[0].position)


@pytest.mark.parametrize("n", [1, 2, 50_000])
def test_any_number_of_points_gives_a_hand_within_bounds(n):
    """One point, or fifty thousand at 20 m/s and more: finite, and where hands were in training."""
    rng = np.random.default_rng(n)
    points = np.array([2.0, 0.0, 1.0]) + rng.normal(0, 0.5, (n, 3))
    found = PostureTracker(model(size=10.0)).process(cloud(points, rate=1e6)).people[0]
    own = found.position - [2.0, 0.0, 0.0]
    assert (np.abs(own) <= 1.0 + 1e-6).all()
    assert (found.std > 0).all()


def test_a_person_at_the_sensor_has_axes():
    """Straight above or below the sensor there is no line of sight on the floor plane: the room's axes serve."""
    frame = BodyFrame.of(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 2.5]))
    np.testing.assert_array_equal(frame.axes, np.eye(3))
    for body in ((1e-12, 0.0, 1.0), (-1e-12, 1e-300, 1.0), (1e6, -1e6, 1.0)):
        axes = BodyFrame.of(np.array(body), np.zeros(3)).axes
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)


def test_axes_turn_smoothly_all_the_way_round():
    """Also behind the sensor, where the azimuth wraps: a hundredth of a turn further, the axes differ by a hundredth of a turn."""
    angles = np.linspace(-np.pi, np.pi, 629)
    axes = np.array([BodyFrame.of(np.array([np.cos(a), np.sin(a), 1.0]), np.zeros(3)).axes for a in angles])
    assert np.abs(np.diff(axes, axis=0)).max() < 0.011
    np.testing.assert_allclose(axes[0], axes[-1], atol=1e-12)


def test_a_long_gap_and_the_same_stamp_twice():
    """After an hour only the newest cloud counts, as at the start; with the same stamp again, nothing moves on in the averages."""
    maker = PostureFeatures(SETTINGS)
    maker.process(cloud(POINTS + np.array([0.0, 0.3, 0.2])), np.zeros(3))
    late = maker.process(cloud(POINTS, 3_600 * 10**9), np.zeros(3))[0].features
    np.testing.assert_allclose(late, PostureFeatures(SETTINGS).process(cloud(POINTS), np.zeros(3))[0].features, atol=1e-12)
    again = maker.process(cloud(POINTS + np.array([0.0, 0.3, 0.0]), 3_600 * 10**9), np.zeros(3))[0].features
    np.testing.assert_allclose(again[SETTINGS.n_now :], late[SETTINGS.n_now :], atol=1e-12)


def test_a_long_run_neither_drifts_nor_grows():
    """Two thousand clouds of one still person: the features stay what they are; tracks that are gone leave nothing behind."""
    maker, settings = PostureFeatures(SETTINGS), SETTINGS
    for k in range(2000):
        one = cloud(POINTS, k * 100_000_000)
        tracks = dataclasses.replace(one.tracks, tracks=(dataclasses.replace(one.tracks.tracks[0], id=k // 500),))
        own = dataclasses.replace(tracks, point_track_id=np.full(3, k // 500, np.int32))
        seen = maker.process(TrackedCloud(one.cloud, own), np.zeros(3))[0]
    np.testing.assert_allclose(seen.features, np.tile(seen.features[: settings.n_now], 3), atol=1e-9)
    assert len(maker._past) == 1


def test_stale_hands_are_never_surer():
    """Stamps of an hour without points, hold at its limits: the variance is finite and at most the learned one plus twice the spread's."""
    for hold in (0.01, 60.0):
        tracker = PostureTracker(model(), PostureConfig(hold=hold, lost_after=600.0))
        first = tracker.process(cloud(POINTS)).people[0].std
        for seconds in (1e-6, 1.0, 599.0):
            std = tracker.process(cloud(np.empty((0, 3)), round(seconds * 1e9))).people[0].std
            assert (std >= first).all()
            assert (std**2 <= 0.1**2 + 2 * 0.3**2 + 1e-6).all()


def samples(n: int, features: np.ndarray, hand: np.ndarray) -> PostureSamples:
    """Twenty pieces of time."""
    return PostureSamples(features, hand, np.arange(n), np.zeros(n, np.int64), np.arange(n) * 20 // n)


def test_features_that_never_change_are_not_blown_up():
    """Half of the features are constant but for rounding: a large step of one of them later does not move the hand."""
    rng, n = np.random.default_rng(3), 400
    features = rng.normal(size=(n, SETTINGS.n_features))
    features[:, ::2] = 5.0
    features[:, 0] += 1e-12 * rng.normal(size=n)
    hand = features[:, 1:4] * 0.1
    settings = PostureTrainingConfig(features=SETTINGS, hidden=(8,), members=1, epochs=3, folds=2)
    made = fit_postures(samples(n, features, hand), settings)
    step = features[:5].copy()
    step[:, 0] += 1.0
    np.testing.assert_allclose(made.predict(step), made.predict(features[:5]), atol=1e-6)


def test_nothing_to_learn_from_is_said():
    """All clouds alike."""
    settings = PostureTrainingConfig(features=SETTINGS, hidden=(4,), members=1, epochs=1)
    with pytest.raises(DataError, match="all alike"):
        fit_postures(samples(200, np.ones((200, SETTINGS.n_features)), np.zeros((200, 3))), settings)


def test_hostile_model_files(tmp_path):
    """Headers that promise too much, archives that are cut off or packed with zeros: refused, and no memory is set aside."""
    path = tmp_path / "hands.npz"
    save_postures(model(), path)
    whole = path.read_bytes()
    for length in (0, 10, len(whole) // 2, len(whole) - 30):
        path.write_bytes(whole[:length])
        with pytest.raises(ConfigError, match="not a posture model"):
            load_postures(path)
    header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000, 1000), }"
    promise = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header) + 1) + header + b"\n"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("format.npy", promise)
    with pytest.raises(ConfigError, match="too much"):
        load_postures(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("format.npy", bytes(20_000_000))
    with pytest.raises(ConfigError, match="16 MB"):
        load_postures(path)
    buffer = io.BytesIO()
    np.save(buffer, np.arange(3))
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("other.npy", buffer.getvalue())
    with pytest.raises(ConfigError, match="lacks 'format'"):
        load_postures(path)


def test_models_larger_than_a_reader_takes_are_not_written(tmp_path):
    """Better an error now than a file that nobody can read."""
    n = SETTINGS.n_features
    big = PostureModel(
        SETTINGS, (np.zeros((n, 8000)), np.zeros((8000, 3))), (np.zeros(8000), np.zeros(3)), np.ones(3), np.ones(3), np.zeros((2, 3))
    )
    with pytest.raises(DataError, match="fewer neurons"):
        save_postures(big, tmp_path / "big.npz")
    assert not list(tmp_path.iterdir())
