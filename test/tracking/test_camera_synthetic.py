"""Pictures of simulated people: the z-buffer against rays, joints where they are, faults of a known size."""

import dataclasses

import numpy as np
import pytest
from camera_scenes import LENS, MOUNT, SMALL, camera, drawing

from radar_core import ConfigError
from radar_lab.camera.synthetic import SyntheticCamera, SyntheticCameraConfig, draw_ball, draw_triangles
from radar_sim.scene import Scene


def cast(model, corner, faces):
    """Depth of the nearest triangle that faces the camera, by casting one ray per pixel (Moeller and Trumbore 1997)."""
    ray = model.rays(np.stack(np.meshgrid(np.arange(model.width), np.arange(model.height)), -1))
    depth = np.full(ray.shape[:2], np.inf)
    for a, b, c in corner[faces]:
        e1, e2 = b - a, c - a
        if np.cross(e1, e2) @ a >= 0:
            continue
        p = np.cross(ray, e2)
        det = p @ e1
        with np.errstate(divide="ignore", invalid="ignore"):
            u = (p @ -a) / det
            q = np.cross(-a, e1)
            v = (ray @ q) / det
            t = (q @ e2) / det
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        depth = np.where(hit & (t < depth), t, depth)
    return depth


def test_z_buffer_against_rays():
    """Random triangles, near and far, through one another: equal to 1e-9 but for pixels on an edge, which rounding gives to either side."""
    rng = np.random.default_rng(0)
    model = dataclasses.replace(SMALL, width=64, height=48, fx=60.0, fy=60.0, cx=31.5, cy=23.5)
    corner = rng.uniform((-1, -1, 1), (1, 1, 4), (90, 3))
    faces = np.arange(90, dtype=np.int32).reshape(30, 3)
    colour, depth = np.zeros((48, 64, 3)), np.full((48, 64), np.inf)
    draw_triangles(model, corner, faces, rng.uniform(0, 255, (30, 3)), colour, depth)
    expected = cast(model, corner, faces)
    assert np.isclose(depth, expected, rtol=0, atol=1e-9).mean() > 0.999
    assert np.isfinite(expected).mean() > 0.2, "something is there to see"


def test_ball_against_its_equation():
    """Every point of it lies on the sphere and faces the camera; it is hidden by what is nearer."""
    ray = LENS.rays(np.stack(np.meshgrid(np.arange(640), np.arange(480)), -1))
    colour, depth = np.zeros((480, 640, 3)), np.full((480, 640), np.inf)
    depth[:, :330] = 1.0
    centre = np.array([0.05, -0.02, 1.7])
    draw_ball(ray, centre, 0.08, np.array([0.0, 255.0, 0.0]), colour, depth)
    drawn = colour[..., 1] > 0
    assert not drawn[:, :330].any()
    point = ray[drawn] * depth[drawn][:, None]
    assert np.allclose(np.sqrt(((point - centre) ** 2).sum(-1)), 0.08, atol=1e-9)
    assert ((point - centre) * point).sum(-1).max() <= 1e-9


def test_person_is_where_the_scene_says():
    """Head, hips and hands: at the pixel of each joint is the body, at most half its thickness (0.15 m) before the joint."""
    made = SyntheticCamera(drawing(), SyntheticCameraConfig(camera=LENS, mount=MOUNT, markers=(), hues=()))
    frame = made.process(1.0)
    joints = made.joints(1.0)
    for name in ("left_hip", "right_hip", "left_shoulder", "right_hand"):
        optical = MOUNT.from_room(joints[name])
        u, v = np.rint(LENS.project(optical)).astype(int)
        assert -0.02 < optical[2] - frame.depth[v, u] * 1e-3 < 0.2, name
    assert frame.depth[5, 5] == pytest.approx(1e3 * (4.5 - MOUNT.x), rel=0.05), "the wall"


def test_pictures_are_repeatable_and_stamped_late():
    """A function of settings, time and number; the latency is in the stamp only."""
    settings = {"jitter": 1.0, "noise_growth": 0.002, "holes": 0.1, "colour_noise": 3.0}
    one, _ = camera(drawing(), **settings)
    other, _ = camera(drawing(), latency=0.08, **settings)
    a, b, c = one.process(0.5, 3), other.process(0.5, 3), one.process(0.5, 4)
    assert np.array_equal(a.colour, b.colour)
    assert np.array_equal(a.depth, b.depth)
    assert (a.stamp_ns, b.stamp_ns) == (500_000_000, 580_000_000)
    assert not np.array_equal(a.depth, c.depth)


@pytest.mark.parametrize("correlation", [1.0, 4.0])
def test_depth_has_the_noise_it_is_told(correlation):
    """On the wall, 4.5 m away: standard deviation within 3 % (4,800 independent pixels: 1 %), holes within 1 %."""
    clean, _ = camera(drawing(), millimetres=False)
    noisy, _ = camera(drawing(), millimetres=False, noise_floor=0.001, noise_growth=0.002, holes=0.2, correlation=correlation)
    true, measured = (made.process(0.0).depth.astype(np.float64) for made in (clean, noisy))
    there = measured > 0
    sigma = 0.001 + 0.002 * true**2
    assert (~there).mean() == pytest.approx(0.2, abs=0.01)
    assert np.std((measured - true)[there] / sigma[there]) == pytest.approx(1.0, abs=0.03)


def test_impossible_settings_are_refused():
    """Nobody to wear the markers, joints that do not exist, numbers that differ."""
    with pytest.raises(ConfigError, match="nobody is in the scene"):
        SyntheticCamera(Scene())
    with pytest.raises(ConfigError, match="right_foot is no joint; choose from left_shoulder"):
        SyntheticCameraConfig(markers=("right_foot",))
    with pytest.raises(ConfigError, match="1 markers, 2 hues and 1 radii"):
        SyntheticCameraConfig(hues=(1.0, 50.0))
