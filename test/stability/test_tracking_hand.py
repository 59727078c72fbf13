"""Hazards of hand tracking: snapshots of hundreds of points or of almost none, single precision, hands without height, long rests."""

import numpy as np
import pytest

from radar_tracking.estimators import Snapshot, SnapshotConfig
from radar_tracking.hand import HandConfig, ValueConfig
from radar_tracking.hand.candidates import Candidates
from radar_tracking.hand.measure import HandMeter
from radar_tracking.hand.tracker import ControlValue


def points(position: np.ndarray, rate: np.ndarray, sensor_at: np.ndarray | None = None) -> Candidates:
    """Make candidates of one sensor at the origin, or of one sensor at each place."""
    n = len(position)
    away = np.nan_to_num(position) - (np.zeros(3) if sensor_at is None else sensor_at)
    away[np.isnan(position[:, 2]), 2] = 0.0
    direction = away / np.maximum(np.linalg.norm(away, axis=1), 1e-6)[:, None]
    one = np.ones(n)
    return Candidates(
        position, direction, np.zeros(n, np.int64), rate, 0.05 * one, one, np.full((n, 3), 0.03), 0.4 * one, 0.4 * one, one > 0
    )


@pytest.mark.parametrize("n", [1, 2, 500])
@pytest.mark.parametrize("spread", [0.0, 1e-12, 1.0])
def test_snapshots_of_any_number_of_points(n, spread):
    """All at one place, or all around: what is told is finite, and what is not is NaN; a velocity is never huge for a small rate."""
    rng = np.random.default_rng(n)
    direction = np.array([1.0, 0.0, 0.0]) + spread * rng.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    found = Snapshot().process(direction, 0.3 * direction[:, 0], np.full(n, 0.05), offset=0.05 * rng.normal(size=(n, 3)))
    told = np.isfinite(found.along)
    assert told.sum() == found.rank >= 1
    assert np.abs(found.along[told]).max() < 3.0
    assert (found.std[told] <= SnapshotConfig().max_std * (1 + 1e-9)).all()


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e2])
def test_errors_of_any_size(scale):
    """Rates and their errors a million times smaller or a hundred times larger give the velocity scaled with them."""
    rng = np.random.default_rng(5)
    direction = rng.normal(size=(8, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    rate, snapshot = rng.normal(size=8), Snapshot(SnapshotConfig(spread=0.0, common=0.0, spin=0.0, max_std=100.0))
    plain = snapshot.process(direction, rate, np.full(8, 0.1))
    scaled = snapshot.process(direction, scale * rate, np.full(8, scale * 0.1))
    assert plain.whole
    assert scaled.whole
    np.testing.assert_allclose(scaled.velocity, scale * plain.velocity, rtol=1e-9)


def test_directions_in_single_precision():
    """Unit vectors rounded to float32 change the velocity by rounding only."""
    rng = np.random.default_rng(6)
    direction = rng.normal(size=(12, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    rate, std = direction @ np.array([0.4, -0.8, 0.1]), np.full(12, 0.05)
    exact = Snapshot().process(direction, rate, std).velocity
    rounded = Snapshot().process(direction.astype(np.float32).astype(np.float64), rate.astype(np.float32).astype(np.float64), std).velocity
    np.testing.assert_allclose(rounded, exact, atol=1e-5)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("scale", [1e-100, 1e-9, 1.0, 1e9, 1e100])
def test_rates_and_errors_of_any_size_together(scale):
    """All of the same size, from where squares underflow to where they overflow: deviations scale with it, and nothing warns."""
    rng = np.random.default_rng(7)
    direction = rng.normal(size=(8, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    rate, snapshot = rng.normal(size=8), Snapshot(SnapshotConfig(spread=0.0, common=0.0, spin=0.0))
    found, plain = snapshot.process(direction, scale * rate, np.full(8, scale)), snapshot.process(direction, rate, np.ones(8))
    np.testing.assert_allclose(found.std, scale * plain.std, rtol=1e-12)
    told = np.isfinite(found.along)
    assert told.all() == (found.std <= 0.6).all()
    np.testing.assert_allclose(found.weight, plain.weight, rtol=1e-9)


@pytest.mark.filterwarnings("error")
def test_points_far_more_exact_than_what_they_have_in_common():
    """Range rates exact to 1e-12 m/s, 50 of each radar: only the error in common is left, in two directions that it tells exactly.

    The covariance of such points has a condition of 1e22, beyond what a matrix of doubles can hold; their velocity is found all the same.
    """
    directions = np.array([[0.8, 0.6], [0.8, -0.6]])
    sensor = np.repeat([0, 1], 50)
    found = Snapshot(SnapshotConfig(spread=0.0, common=0.05)).process(
        directions[sensor], directions[sensor] @ np.array([0.3, -0.5]), np.full(100, 1e-12), sensor=sensor
    )
    np.testing.assert_allclose(found.covariance, 0.05**2 * np.linalg.inv(directions.T @ directions), atol=1e-9)
    np.testing.assert_allclose(found.velocity, [0.3, -0.5], atol=1e-9)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("far", [0.3, 1e3, 1e12])
@pytest.mark.parametrize("wrong", [4.0, 1e2, 1e4, 1e12])
def test_one_point_with_any_rate_anywhere(far, wrong):
    """One of nine points is off by any distance and recedes with any speed: the velocity may be refused, but it is never wrong.

    The other rates are exact, so the error is what the outlier pulls: no more than two of its deviations (`huber`), and one more is allowed
    where four rounds are too few. Up to 100 m/s, which is more than any cloud has, nothing is refused.
    """
    rng = np.random.default_rng(10)
    sensor = np.repeat([0, 1], [4, 5])
    offset = np.vstack([0.04 * rng.normal(size=(8, 3)), [0.0, far, 0.0]])
    away = np.array([1.0, 0.0, 0.0]) + offset - np.array([[0.0, 0.25, 0.0], [0.0, -0.25, 0.0]])[sensor]
    direction = away / np.linalg.norm(away, axis=1)[:, None]
    velocity = np.array([0.4, -0.6, 0.0])
    rate = direction @ velocity
    rate[8] = wrong
    found = Snapshot().process(direction, rate, np.full(9, 0.04), offset=offset, sensor=sensor)
    told = np.isfinite(found.along)
    assert (np.abs(found.along - found.axes @ velocity)[told] < 3 * found.std[told]).all()
    if wrong <= 100.0:
        assert found.rank == 2


@pytest.mark.filterwarnings("error")
def test_everything_in_single_precision():
    """Arrays of float32 as they come from a cloud: the estimate is float64, and off by their rounding only."""
    rng = np.random.default_rng(11)
    direction = rng.normal(size=(12, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    given = [direction, direction @ np.array([0.4, -0.8, 0.1]), np.full(12, 0.05), 0.04 * rng.normal(size=(12, 3)), rng.uniform(0.5, 2, 12)]
    exact, rounded = (
        Snapshot().process(*arrays[:3], offset=arrays[3], amplitude=arrays[4])
        for arrays in (given, [array.astype(np.float32) for array in given])
    )
    assert rounded.along.dtype == rounded.std.dtype == rounded.axes.dtype == np.float64
    np.testing.assert_allclose(rounded.velocity, exact.velocity, atol=1e-5)
    np.testing.assert_allclose(rounded.std, exact.std, rtol=1e-5)


def test_a_hand_without_any_height():
    """No point measures z: the hand is as high as the body, with an error that says so, and everything is finite."""
    position = np.array([[1.5, 0.1, np.nan], [1.52, 0.12, np.nan]])
    found = HandMeter(HandConfig()).process(points(position, np.array([0.3, np.nan])), np.array([2.0, 0.0, 1.1]), np.array([1.5, 0.1, 1.1]))
    assert found.state.position[0, 2] == 1.1
    assert found.state.covariance[0, 2, 2] > 0.08
    assert np.isfinite(found.state.covariance).all()
    assert (np.linalg.eigvalsh(found.state.covariance[0]) > 0).all()


def test_points_all_around_their_sensor():
    """Opposite directions: their mean rate is nobody's, and is not given."""
    position = np.array([[0.3, 0.0, 1.0], [-0.3, 0.0, 1.0]])
    made = points(position, np.array([0.2, -0.2]), np.array([[0.0, 0.0, 1.0]] * 2))
    found = HandMeter(HandConfig()).process(made, np.array([0.0, 0.1, 1.0]), np.array([0.0, 0.0, 1.0]))
    assert np.isnan(found.state.rate[0])
    assert np.isfinite(found.state.covariance).all()


@pytest.mark.long
def test_a_value_of_a_million_steps_does_not_drift():
    """A random walk in a room of 0.8 m: after a million steps the value is still within the hysteresis of what the place says."""
    rng, config = np.random.default_rng(7), ValueConfig()
    control, body = ControlValue(config), np.zeros(3)
    height = 0.35 * np.sin(np.cumsum(rng.normal(0, 0.01, 1_000_000)))
    hand = np.zeros(3)
    for z in height.tolist():
        hand[2] = z
        value = control.process(hand, body)
    assert abs(value - (height[-1] - config.low) / (config.high - config.low)) <= config.hysteresis + 1e-12
