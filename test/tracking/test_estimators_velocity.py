"""MMVelEst (thesis, 7.3.1): against the textbook and the single filter."""

import numpy as np
import pytest

from radar_core import DataError
from radar_tracking.estimators import Belief, EstimatorConfig, VelocityMeasurement, from_polar, make_estimator


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


def test_a_velocity_along_turned_axes_is_the_same_measurement():
    """Components along any orthonormal axes with the covariance turned with them give the same belief; one component, that of its row."""
    rng = np.random.default_rng(21)
    estimator = make_estimator(EstimatorConfig(name="mm_vel_est"), 3)
    z = from_polar(np.array([2.0]), np.array([0.3]), np.array([0.1]), range_std=0.1, azimuth_std=0.03, elevation_std=0.05)
    belief = estimator.predict(estimator.start(z, 1.0), 0.1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    velocity, noise = rng.normal(size=3), np.diag([0.02, 0.05, 0.1])
    rest = (z.position, z.covariance, z.rate, z.rate_variance, z.origin)
    plain = VelocityMeasurement(*rest, velocity[None], noise[None])
    turned = VelocityMeasurement(*rest, (turn @ velocity)[None], (turn @ noise @ turn.T)[None], turn[None])
    same(estimator.update(belief, turned)[0], estimator.update(belief, plain)[0], 1e-10)
    part = np.array([[(turn @ velocity)[0], np.nan, np.nan]])
    variance = np.full((1, 3, 3), np.nan)
    variance[0, 0, 0] = 0.03
    updated, innovation = estimator.update(belief, VelocityMeasurement(*rest, part, variance, turn[None]))
    assert innovation.dof[0] == 4
    H = np.zeros((4, 6))
    H[:3, :3], H[3, 3:] = np.eye(3), turn[0]
    R = np.zeros((4, 4))
    R[:3, :3], R[3, 3] = z.covariance[0], 0.03
    P, x = belief.covariance[0, 0], belief.mean[0, 0]
    gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    np.testing.assert_allclose(updated.mean[0, 0], x + gain @ (np.append(z.position[0], part[0, 0]) - H @ x), atol=1e-11)
    with pytest.raises(DataError, match="velocity_axes"):
        VelocityMeasurement(*rest, velocity[None], noise[None], turn)
