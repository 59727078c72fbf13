"""Frames and signs: x forward, y left, z up; azimuth left positive, elevation up positive."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from radar_core import Pose
from radar_core.geometry import cartesian_to_spherical, spherical_to_cartesian

angle = st.floats(-math.pi, math.pi)
half = st.floats(-math.pi / 2, math.pi / 2)


def test_axes():
    """Boresight is x; a quarter turn left is y; up is z."""
    np.testing.assert_allclose(spherical_to_cartesian(2.0, 0.0, 0.0), [2, 0, 0], atol=1e-15)
    np.testing.assert_allclose(spherical_to_cartesian(2.0, math.pi / 2, 0.0), [0, 2, 0], atol=1e-15)
    np.testing.assert_allclose(spherical_to_cartesian(2.0, 0.0, math.pi / 2), [0, 0, 2], atol=1e-15)


@given(st.floats(1e-3, 1e4), st.floats(-3.1, 3.1), st.floats(-1.5, 1.5))
def test_spherical_round_trip(distance, azimuth, elevation):
    """There and back, away from the poles where azimuth has no meaning; double precision leaves 1e-9 relative."""
    r, az, el = cartesian_to_spherical(spherical_to_cartesian(distance, azimuth, elevation))
    np.testing.assert_allclose([r, az, el], [distance, azimuth, elevation], rtol=1e-9, atol=1e-9)


@given(angle, half, st.floats(-50, 50), st.floats(-50, 50), st.floats(0, 5))
def test_pose_round_trip_and_isometry(yaw, tilt, x, y, z):
    """A mount moves and turns points, never stretches them, and undoes itself."""
    pose = Pose(x=x, y=y, z=z, yaw=yaw, tilt=tilt)
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0.3, -2, 0.7]])
    room = pose.to_room(points)
    np.testing.assert_allclose(pose.from_room(room), points, atol=1e-9)
    np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose.rotation) > 0.999


def test_pose_directions():
    """Tilt raises the boresight, yaw turns it left."""
    np.testing.assert_allclose(Pose(z=0, tilt=math.pi / 2).to_room(np.array([1.0, 0, 0])), [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(Pose(z=0, yaw=math.pi / 2).to_room(np.array([1.0, 0, 0])), [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(Pose(z=0, yaw=0.4).to_room(np.array([0, 1.0, 0])), [-math.sin(0.4), math.cos(0.4), 0], atol=1e-12)


@given(angle, half)
def test_quaternion_is_the_rotation(yaw, tilt):
    """Tf gets the same turn as the library: the quaternion's matrix equals the rotation matrix."""
    pose = Pose(yaw=yaw, tilt=tilt)
    x, y, z, w = pose.quaternion
    matrix = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    np.testing.assert_allclose(matrix, pose.rotation, atol=1e-12)
