"""The camera model: projected and back, its lens, its derivative, its place in the room."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core import ConfigError, Pose
from radar_lab.camera.pinhole import CameraModel, CameraMount, from_optical, to_optical

LENSES = {
    "none": CameraModel(),
    "plumb_bob": CameraModel(lens="plumb_bob", distortion=(0.1, -0.2, 0.001, -0.002, 0.05)),
    "wide": CameraModel(fx=400.0, fy=410.0, lens="plumb_bob", distortion=(-0.3, 0.1, 0.0005, 0.001)),
    "rational_polynomial": CameraModel(lens="rational_polynomial", distortion=(0.4, -0.1, 3e-4, -2e-4, 0.02, 0.5, -0.05, 0.01)),
}


@pytest.mark.parametrize("camera", LENSES.values(), ids=LENSES)
def test_pixels_come_back(camera):
    """Every pixel of the image, unprojected to any depth and projected again: to 1e-6 of a pixel, a thousandth of what matters."""
    rng = np.random.default_rng(0)
    pixel = np.concatenate([rng.uniform((0, 0), (639, 479), (500, 2)), [[0, 0], [639, 0], [0, 479], [639, 479]]])
    depth = rng.uniform(0.3, 8.0, len(pixel))
    points = camera.unproject(pixel, depth)
    assert np.abs(camera.project(points) - pixel).max() < 1e-6
    assert np.allclose(points[:, 2], depth, rtol=1e-15)


@given(st.floats(-0.7, 0.7), st.floats(-0.6, 0.6), st.floats(0.2, 10.0), st.sampled_from(list(LENSES)))
def test_points_come_back(x, y, z, name):
    """Points in view, to 1e-8 of their distance: Newton ends at 1e-10 of the focal length."""
    camera = LENSES[name]
    point = np.array([x * z, y * z, z])
    pixel = camera.project(point)
    if camera.inside(pixel):
        assert np.allclose(camera.unproject(pixel, np.array(z)), point, atol=1e-8 * z)


def test_lens_against_the_formula():
    """One coefficient at a time, by hand: at x = 0.5, y = 0.25 (r^2 = 0.3125), in OpenCV's order k1 k2 p1 p2 k3 k4 k5 k6."""
    x, y, r2 = 0.5, 0.25, 0.3125
    by_hand = {
        0: (x * (1 + 0.1 * r2), y * (1 + 0.1 * r2)),
        1: (x * (1 + 0.1 * r2**2), y * (1 + 0.1 * r2**2)),
        2: (x + 2 * 0.1 * x * y, y + 0.1 * (r2 + 2 * y * y)),
        3: (x + 0.1 * (r2 + 2 * x * x), y + 2 * 0.1 * x * y),
        4: (x * (1 + 0.1 * r2**3), y * (1 + 0.1 * r2**3)),
        5: (x / (1 + 0.1 * r2), y / (1 + 0.1 * r2)),
        6: (x / (1 + 0.1 * r2**2), y / (1 + 0.1 * r2**2)),
        7: (x / (1 + 0.1 * r2**3), y / (1 + 0.1 * r2**3)),
    }
    for k, (u, v) in by_hand.items():
        camera = CameraModel(lens="rational_polynomial", distortion=tuple(0.1 * (i == k) for i in range(8)))
        assert np.allclose(camera.project(np.array([x, y, 1.0])), (600 * u + 319.5, 600 * v + 239.5), atol=1e-9)


@pytest.mark.parametrize("camera", LENSES.values(), ids=LENSES)
def test_sensitivity_is_the_derivative(camera):
    """Against central differences: steps of 1e-4 leave an error of about 1e-8 relative, 1e-6 is far above."""
    rng = np.random.default_rng(1)
    pixel, depth = rng.uniform((20, 20), (620, 460), (50, 2)), rng.uniform(0.5, 4.0, 50)
    found = camera.sensitivity(pixel, depth)
    for k in range(3):
        step = np.zeros((50, 3))
        step[:, k] = 1e-4
        ahead, behind = (camera.unproject(pixel + s * step[:, :2], depth + s * step[:, 2]) for s in (1, -1))
        assert np.allclose(found[:, :, k], (ahead - behind) / 2e-4, rtol=1e-6, atol=1e-8)


def test_frames_follow_rep_103():
    """Optical z is forward, x right, y down; ours is x forward, y left, z up."""
    assert np.array_equal(from_optical(np.eye(3)), [[0, -1, 0], [0, 0, -1], [1, 0, 0]])
    rng = np.random.default_rng(2)
    v = rng.normal(size=(5, 4, 3))
    assert np.allclose(to_optical(from_optical(v)), v)
    above_right = CameraMount(z=1.0).from_room(np.array([2.0, -0.5, 1.5]))
    pixel = CameraModel().project(above_right)
    assert pixel[0] > 319.5, "what is to the right lies in the right half"
    assert pixel[1] < 239.5, "what is above the camera lies in the upper half"


def test_mount_is_the_radars_with_roll():
    """Without roll the rotation is that of `radar_core.Pose`; with it, the right side goes down."""
    level = CameraMount(x=0.1, y=-0.2, z=1.4, yaw=0.3, tilt=-0.2)
    pose = Pose(x=0.1, y=-0.2, z=1.4, yaw=0.3, tilt=-0.2)
    assert np.allclose(level.rotation, pose.rotation, atol=1e-15)
    point = np.array([1.0, 2.0, 0.5])
    assert np.allclose(level.to_room(to_optical(point)), pose.to_room(point))
    assert np.allclose(level.from_room(level.to_room(point)), point)
    right = CameraMount(roll=0.1).rotation @ [0.0, -1.0, 0.0]
    assert right[2] == pytest.approx(-math.sin(0.1))
    turned = CameraMount(yaw=0.3, tilt=-0.2, roll=0.5).rotation
    assert np.allclose(turned @ turned.T, np.eye(3), atol=1e-15)


def test_what_no_camera_sees_is_nan():
    """Behind the camera, in its plane, beyond the lens: NaN, never a pixel; NaN beside others spoils nothing."""
    camera = LENSES["wide"]
    points = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [np.nan, 0.0, 1.0], [50.0, 0.0, 1.0], [0.1, 0.1, 1.0]])
    pixel = camera.project(points)
    assert np.isnan(pixel[:4]).all()
    assert np.isfinite(pixel[4]).all()
    rays = camera.rays(np.array([[np.nan, 0.0], [100.0, 80.0]]))
    assert np.isnan(rays[0, :2]).all()
    assert np.allclose(camera.project(rays[1]), (100.0, 80.0))
    assert np.isnan(camera.sensitivity(np.array([[np.nan, 0.0]]), np.array([1.0]))).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"lens": "plumb_bob", "distortion": (0.1, 0.2, 0.0)}, "3 coefficients; plumb_bob takes 0 or 4 or 5"),
        ({"lens": "none", "distortion": (0.1,)}, "1 coefficients; none takes 0"),
        ({"lens": "plumb_bob", "distortion": (-3.0, 0.0, 0.0, 0.0)}, "folds back within the image of 640 x 480"),
        ({"lens": "fisheye"}, "did you mean|choose one of"),
        ({"fx": 0.0}, "CameraModel.fx is 0"),
        ({"cx": math.nan}, "CameraModel.cx is nan"),
    ],
)
def test_impossible_cameras_are_refused(settings, message):
    """The message names the field."""
    with pytest.raises(ConfigError, match=message):
        CameraModel(**settings)
