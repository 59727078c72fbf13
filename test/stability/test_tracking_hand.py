"""Hazards of hand tracking: snapshots of hundreds of points or of almost none, single precision, hands without height, long rests."""

import numpy as np
import pytest

from radar_tracking.estimators import Snapshot, SnapshotConfig
from radar_tracking.hand import HandConfig, ValueConfig
from radar_tracking.hand.candidates import Candidates
from radar_tracking.hand.measure import HandMeter
from radar_tracking.hand.value import ControlValue


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
