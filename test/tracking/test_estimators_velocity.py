"""MMVelEst and the velocity of one snapshot (thesis, 7.3.1): against the textbook, Monte-Carlo runs and the single filter."""

import numpy as np
import pytest

from radar_core import DataError
from radar_tracking.estimators import Belief, EstimatorConfig, VelocityMeasurement, from_polar, make_estimator, snapshot_velocity


def same(a: Belief, b: Belief, tolerance: float) -> None:
    """Assert that beliefs are equal."""
    for name in ("mean", "covariance", "weight"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=tolerance, atol=tolerance)


def test_mm_vel_est_switches_between_two_filters():
    """Velocity measured: the Kalman filter on position and velocity; not measured: that on position; both on one state (figure 7.4)."""
    rng = np.random.default_rng(18)
    estimator = make_estimator(EstimatorConfig(name="mm_vel_est"), 2)
    linear = make_estimator(EstimatorConfig(), 2)
    z = from_polar(rng.uniform(2, 5, 4), rng.uniform(-1, 1, 4), range_std=0.1, azimuth_std=0.03)
    velocity = np.where(np.arange(4)[:, None] % 2 == 0, rng.normal(size=(4, 2)), np.nan)
    noise = np.tile(0.04 * np.eye(2), (4, 1, 1))
    noise[1::2] = np.nan
    belief = estimator.predict(estimator.start(z, 1.0), 0.1)
    both = VelocityMeasurement(z.position, z.covariance, z.rate, z.rate_variance, z.origin, velocity, noise)
    updated, innovation = estimator.update(belief, both)
    assert np.array_equal(innovation.dof, [4, 2, 4, 2])
    odd, even = np.array([1, 3]), np.array([0, 2])
    same(updated.select(odd), linear.update(belief, z)[0].select(odd), 1e-12)
    P = belief.covariance[even, 0]
    R = np.zeros((2, 4, 4))
    R[:, :2, :2], R[:, 2:, 2:] = z.covariance[even], noise[even]
    gain = P @ np.linalg.inv(P + R)
    y = np.concatenate([z.position, velocity], axis=1)[even] - belief.mean[even, 0]
    np.testing.assert_allclose(updated.mean[even, 0], belief.mean[even, 0] + (gain @ y[..., None])[..., 0], atol=1e-11)
    np.testing.assert_allclose(updated.covariance[even, 0], (np.eye(4) - gain) @ P, atol=1e-11)
    picked = both.select(even)
    assert isinstance(picked, VelocityMeasurement)
    assert np.array_equal(picked.velocity, velocity[even])
    with pytest.raises(DataError, match="shapes"):
        VelocityMeasurement(z.position, z.covariance, z.rate, z.rate_variance, z.origin)


def test_mm_vel_est_follows_a_fast_hand_better_than_one_filter():
    """The thesis's finding (figure 7.11): a hand that goes to and fro, 0.3 m at 1 Hz, is left behind by the filter that follows people.

    With velocities known to 0.2 m/s the error is less than half, over 30 hands and 2 s.
    """
    rng = np.random.default_rng(19)
    n, dt, noise = 30, 0.05, 0.2
    none, one, R = np.full(n, np.nan), np.ones(n), np.tile(0.0025 * np.eye(2), (n, 1, 1))
    error = {}
    for name in ("linear", "mm_vel_est"):
        estimator, belief, errors = make_estimator(EstimatorConfig(name=name, process_noise=1.0), 2), None, []
        for t in dt * np.arange(60):
            place = np.array([2.0, 0.3 * np.sin(2 * np.pi * t)]) + np.zeros((n, 2))
            speed = np.array([0.0, 0.6 * np.pi * np.cos(2 * np.pi * t)]) + rng.normal(0, noise, (n, 2))
            seen = place + rng.normal(0, 0.05, (n, 2))
            z = VelocityMeasurement(seen, R, none, one, np.zeros((n, 2)), speed, np.tile(noise**2 * np.eye(2), (n, 1, 1)))
            belief = estimator.start(z, 2.0) if belief is None else estimator.update(estimator.predict(belief, dt), z)[0]
            errors.append(((belief.mean[:, 0, :2] - place) ** 2).sum(axis=1).mean())
        error[name] = np.sqrt(np.mean(errors[20:]))
    assert error["mm_vel_est"] < 0.5 * error["linear"]


def test_velocity_of_one_snapshot():
    """Two radars 0.6 m apart, as in the thesis, and a hand at 1.5 m: unbiased, with the covariance it says (4 sigma of 20,000 draws)."""
    rng = np.random.default_rng(20)
    place, truth = np.array([1.5, 0.2, 0.0])[:2], np.array([0.7, -1.1])
    sensors = np.array([[0.0, 0.3], [0.0, -0.3]])[[0, 0, 0, 1, 1]]
    direction = (place - sensors) / np.linalg.norm(place - sensors, axis=1)[:, None]
    variance = np.array([0.01, 0.02, 0.01, 0.01, 0.03])
    exact, covariance = snapshot_velocity(direction, direction @ truth, variance)
    np.testing.assert_allclose(exact, truth, atol=1e-12)
    found = np.array(
        [snapshot_velocity(direction, direction @ truth + rng.normal(0, np.sqrt(variance)), variance)[0] for _ in range(20_000)]
    )
    assert (np.abs(found.mean(axis=0) - truth) < 4 * np.sqrt(np.diag(covariance) / 20_000)).all()
    np.testing.assert_allclose(np.cov(found.T), covariance, rtol=0.06, atol=1e-4)


def test_a_velocity_that_nobody_can_see_is_not_estimated():
    """One radar, few points, too wide an error, or rates not measured: NaN, not a guess."""
    direction = np.array([[1.0, 0.0], [0.8, 0.6]])
    rate, variance = np.array([0.5, 0.1]), np.full(2, 0.01)
    assert np.isfinite(snapshot_velocity(direction, rate, variance)[0]).all()
    for rates in (
        (direction[[0, 0]], rate, variance, 1.0),
        (direction[:1], rate[:1], variance[:1], 1.0),
        (direction, rate, variance, 0.01),
        (direction, np.array([0.5, np.nan]), variance, 1.0),
        (np.empty((0, 2)), np.empty(0), np.empty(0), 1.0),
    ):
        velocity, covariance = snapshot_velocity(*rates)
        assert np.isnan(velocity).all()
        assert np.isnan(covariance).all()
    with pytest.raises(DataError, match="rate_variance"):
        snapshot_velocity(direction, rate, np.zeros(2))
