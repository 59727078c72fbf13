"""Conversions between polar coordinates and positions against Monte-Carlo runs and difference quotients."""

import numpy as np
import pytest

from radar_core import DataError, Pose
from radar_tracking.estimators import from_polar
from radar_tracking.estimators.measurement_models import range_rate, range_rate_jacobian, wrap
from radar_tracking.estimators.polar_model import polar_jacobian, to_polar

# (range, azimuth, elevation, range std, azimuth std, elevation std)
CASES = [(5.0, 0.7, 0.2, 0.05, 0.02, 0.03), (5.0, 2.0, -0.5, 0.05, 0.3, 0.2), (3.0, -2.0, 1.0, 0.1, 0.4, 0.3)]


def nees(error: np.ndarray, covariance: np.ndarray) -> float:
    """Mean normalised squared error."""
    return float((error * np.linalg.solve(covariance, error[..., None])[..., 0]).sum(axis=1).mean())


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("d", [2, 3])
def test_converted_positions_are_unbiased_and_their_covariance_true(case, d):
    """100,000 draws: the mean error is within 4.5 standard errors of zero, the mean NEES within 10 % of d.

    The covariance is evaluated at what was measured, not at the truth, which at angle errors of 0.4 rad costs some per cent.
    """
    r, azimuth, elevation, r_std, a_std, e_std = case
    rng = np.random.default_rng(5)
    n = 100_000
    elevation = elevation if d == 3 else 0.0
    truth = r * np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])[:d]
    polar = [r + rng.normal(0, r_std, n), azimuth + rng.normal(0, a_std, n)]
    polar += [elevation + rng.normal(0, e_std, n)] if d == 3 else []
    measured = from_polar(*polar, range_std=r_std, azimuth_std=a_std, elevation_std=e_std if d == 3 else None)
    error = measured.position - truth
    assert (np.abs(error.mean(axis=0)) < 4.5 * error.std(axis=0) / np.sqrt(n)).all()
    assert abs(nees(error, measured.covariance) / d - 1) < 0.1


def test_the_plain_conversion_is_neither():
    """The same draws at an angle error of 0.3 rad: biased by r (1 - exp(-0.045)) = 0.22 m, and its NEES is more than twice too large."""
    rng = np.random.default_rng(6)
    n, r, r_std, a_std = 100_000, 5.0, 0.05, 0.3
    ranges, angles = r + rng.normal(0, r_std, n), rng.normal(0, a_std, n)
    unit = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    error = ranges[:, None] * unit - [r, 0.0]
    J = np.stack([unit, ranges[:, None] * unit[:, ::-1] * [-1, 1]], axis=-1)
    covariance = J @ np.diag([r_std**2, a_std**2]) @ np.swapaxes(J, -1, -2)
    assert abs(error[:, 0].mean() + r * (1 - np.exp(-(a_std**2) / 2))) < 0.01
    assert nees(error, covariance) > 2 * 2


def test_small_errors_give_the_first_order_covariance():
    """At 1e-7 of the range nothing cancels: the covariance is J R J' to 1e-6 of it."""
    measured = from_polar(4.0, 0.3, 0.2, range_std=4e-7, azimuth_std=2e-7, elevation_std=1e-7)
    J = np.linalg.inv(polar_jacobian(measured.position))[0]
    np.testing.assert_allclose(measured.covariance[0], J @ np.diag([4e-7, 2e-7, 1e-7]) ** 2 @ J.T, rtol=1e-6, atol=1e-19)


def test_origin_and_rotation():
    """A tilted, turned radar somewhere in the room: positions are Pose's, the covariance turns along."""
    mount = Pose(x=1.0, y=-2.0, z=2.0, yaw=0.6, tilt=-0.3)
    own = from_polar(3.0, 0.4, 0.1, range_std=0.1, azimuth_std=0.02, elevation_std=0.05)
    room = from_polar(
        3.0,
        0.4,
        0.1,
        range_std=0.1,
        azimuth_std=0.02,
        elevation_std=0.05,
        origin=mount.origin,
        rotation=mount.rotation,
        rate=0.5,
        rate_std=0.1,
    )
    np.testing.assert_allclose(room.position, mount.to_room(own.position), atol=1e-12)
    np.testing.assert_allclose(room.covariance[0], mount.rotation @ own.covariance[0] @ mount.rotation.T, atol=1e-14)
    assert np.isnan(own.rate).all()
    assert room.rate[0] == 0.5
    assert room.rate_variance[0] == pytest.approx(0.01)
    np.testing.assert_allclose(room.origin, [mount.origin])


@pytest.mark.parametrize("d", [2, 3])
def test_jacobians_are_derivatives(d):
    """Central differences over random places (error 1e-9 at distances above 0.1 m), behind the radar too."""
    rng = np.random.default_rng(7)
    p, v = rng.uniform(-3, 3, (50, d)), rng.normal(size=(50, d))
    p[:, 0] = np.where(np.abs(p[:, 0]) < 0.3, 0.3, p[:, 0])
    for j in range(d):
        h = np.zeros(d)
        h[j] = 1e-6
        difference = to_polar(p + h) - to_polar(p - h)
        difference[:, 1] = wrap(difference[:, 1])
        np.testing.assert_allclose(polar_jacobian(p)[:, :, j], difference / 2e-6, atol=1e-7)
        slope = (range_rate(p + h, v) - range_rate(p - h, v)) / 2e-6
        np.testing.assert_allclose(range_rate_jacobian(p, v)[:, j], slope, atol=1e-7)
        np.testing.assert_allclose(range_rate_jacobian(p, v)[:, d + j], (range_rate(p, v + h) - range_rate(p, v - h)) / 2e-6, atol=1e-7)


def test_polar_coordinates_of_known_places():
    """Left is positive azimuth, up positive elevation, receding a positive rate."""
    np.testing.assert_allclose(to_polar(np.array([[0.0, 2.0, 0.0], [1.0, 0.0, 1.0]])), [[2, np.pi / 2, 0], [np.sqrt(2), 0, np.pi / 4]])
    assert range_rate(np.array([3.0, 4.0]), np.array([3.0, 4.0])) == pytest.approx(5.0)


@pytest.mark.parametrize(
    "change", [{"range_": -1.0}, {"range_": np.nan}, {"azimuth": np.inf}, {"azimuth_std": 0.0}, {"elevation_std": None}, {"rate_std": -1.0}]
)
def test_impossible_measurements_are_refused(change):
    """With an error that names what is wrong."""
    given = {"range_": 3.0, "azimuth": 0.1, "elevation": 0.0, "range_std": 0.1, "azimuth_std": 0.1, "elevation_std": 0.1} | change
    with pytest.raises(DataError):
        from_polar(**given)
