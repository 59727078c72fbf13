"""Bodies and occlusion where numbers get hard: nothing there, at the radar itself, inside a hull, huge, tiny, folded, straight."""

from dataclasses import replace

import numpy as np
import pytest
from oracles.shadows import hidden_by_triangles

from radar_sim.bodies.base import BONES, stand
from radar_sim.bodies.ellipsoids import EllipsoidBody, spread
from radar_sim.bodies.make import make_figure
from radar_sim.bodies.shadows import MARGIN, View
from radar_sim.bodies.skeleton import Skeleton
from radar_sim.bodies.skin import MeshBody, facets
from radar_sim.bodies.subject import Subject
from radar_sim.effects import config
from radar_sim.effects.base import Moment, Setting
from radar_sim.effects.sight import Occlusion
from radar_sim.people import Person
from radar_sim.scatterers import Ellipsoids, Motion, Scatterers, Triangles
from radar_sim.scene import Scene, SceneRadar

SPAN = 0.0148


@pytest.fixture(scope="module")
def skeleton():
    return Skeleton(Subject.of(Person()))


def rotations_hold(pose):
    eye = np.tile(np.eye(3), (*pose.rotation.shape[:2], 1, 1))
    assert np.isfinite(pose.joint).all()
    np.testing.assert_allclose(pose.rotation @ pose.rotation.swapaxes(-1, -2), eye, atol=1e-9)


def wanting(hand, n=1):
    return replace(stand(np.zeros(n)), hands=np.tile(np.asarray(hand, float), (n, 2, 1)))


@pytest.mark.parametrize("hand", [(0, 0, 0), (1e-12, 0, 0), (0, 0, 1e-9), (1e9, 0, 0), (-1e6, 1e6, -1e6), (0, 0, 1), (0, 1, 0), (0, -1, 0)])
def test_arms_stand_any_target(skeleton, hand):
    """At the shoulder, next to it, on the other side of the world: rotations remain rotations and bones keep their lengths."""
    pose = skeleton.pose(wanting(hand))
    rotations_hold(pose)
    upper, lower = (BONES.index(n) for n in ("upperarm_l", "lowerarm_l"))
    assert np.linalg.norm(pose.joint[0, lower] - pose.joint[0, upper]) == pytest.approx(0.186 * 1.75, rel=1e-9)


@pytest.mark.parametrize("off", [0.0, 1e-15, 1e-12, 1e-9, 1e-6, 1e-4])
def test_arms_against_their_rest_direction(skeleton, off):
    """Backwards and up, where no smallest rotation exists, to rounding and a little beside it: still a pose."""
    h = np.sqrt(0.5)
    pose = skeleton.pose(wanting((-h * 0.8, off, h * 0.8)))
    rotations_hold(pose)


@pytest.mark.parametrize("foot", [(0, 0, 2.5), (0, 0, 1.0), (0, 0, -5.0), (3.0, 0, 0.9), (0, 1e7, 0)])
def test_legs_stand_any_target(skeleton, foot):
    """Straight up, folded, torn off."""
    rotations_hold(skeleton.pose(replace(stand(np.zeros(1)), feet=np.tile(np.asarray(foot, float), (1, 2, 1)))))


@pytest.mark.parametrize("n", [0, 1, 500])
def test_poses_at_any_number_of_times(skeleton, n):
    """None, one, many; each is what it is alone."""
    pose = skeleton.pose(wanting((0.6, 0.1, 0.2), n))
    assert pose.joint.shape == (n, 22, 3)
    assert pose.rotation.shape == (n, 22, 3, 3)
    assert pose.hand.shape == (n, 2, 3)
    if n:
        np.testing.assert_array_equal(pose.joint[0], skeleton.pose(wanting((0.6, 0.1, 0.2))).joint[0])


@pytest.mark.parametrize("height", [0.8, 2.3])
@pytest.mark.parametrize("build", [0.0, 1.0])
@pytest.mark.parametrize("sex", ["male", "female"])
def test_the_smallest_and_the_largest(height, build, sex):
    """Surfaces at the limits of what scenes allow are finite, with as many points as always and the area of a person."""
    subject = Subject.of(Person(height=height, build=build, sex=sex))
    pose = Skeleton(subject).pose(stand(np.zeros(3)))
    for body in (EllipsoidBody(subject, 1.0), MeshBody(subject, 1.0)):
        surface = body.surface(pose, SPAN, 0)
        assert len(surface) > 700
        assert 0.3 * (height / 1.75) ** 2 < surface.rcs.sum() / 2 < 1.9 * (height / 1.75) ** 2
        assert all(np.isfinite(x).all() for x in (surface.motion.position, surface.motion.velocity, surface.normal, surface.rcs))


def test_no_reflectivity_and_far_away(skeleton):
    """Nothing comes back from somebody who absorbs it all; 100 m from the origin velocities are still good to 1e-6 m/s."""
    subject = skeleton.subject
    here, there = stand(np.zeros(3)), stand(np.zeros(3))
    there.place[:] = (100.0, -100.0)
    assert EllipsoidBody(subject, 0.0).surface(skeleton.pose(here), SPAN, 0).rcs.max() == 0.0
    moving = MeshBody(subject, 0.4).surface(skeleton.pose(there), SPAN, 0).motion
    assert np.abs(moving.velocity).max() < 1e-6


def test_ellipsoids_without_points_and_needles():
    """A lattice of none; very thin ellipsoids still share out their area."""
    unit, area = spread(np.ones(3), 0)
    assert unit.shape == (0, 3)
    assert area.shape == (0,)
    unit, area = spread(np.array([1e-6, 1.0, 1e3]), 50)
    assert np.isfinite(unit).all()
    assert (area > 0).all()


def test_triangles_without_area_have_no_normal():
    """Collapsed triangles neither divide by zero nor echo."""
    vertices = np.zeros((3, 3, 3))
    _, normal, area = facets(vertices, np.array([[0, 1, 2]], np.int32))
    assert not normal.any()
    assert not area.any()


# shadows


def view(cell=0.005):
    return View(np.array([0.0, 0.0, 1.2]), np.eye(3), cell)


def test_nothing_hides_nothing():
    """No hull, hulls without members, no points."""
    some = np.array([[1.0, 2, 3]])
    empty = [Ellipsoids(np.empty((0, 3)), np.empty((0, 3, 3))), Triangles(np.empty((0, 3, 3)))]
    for hulls in ([], empty, empty[:1], empty[1:]):
        assert view().look(hulls).visible(some).all()
    solid = [Ellipsoids(np.array([[2.0, 0, 1.2]]), np.eye(3)[None]), Triangles(np.ones((1, 3, 3)) * np.arange(3)[:, None])]
    assert view().look(solid).visible(np.empty((0, 3))).shape == (0,)


def test_at_the_radar_and_inside_hulls():
    """A point at the radar is seen; a radar inside an ellipsoid sees out of it; a corner at the radar hides nothing of itself."""
    radar = np.array([0.0, 0.0, 1.2])
    ball = Ellipsoids(radar[None] + 0.01, np.eye(3)[None] * 0.5)
    far = np.array([[3.0, 0, 1], [0, 2, 1], [-3, 0, 2]])
    assert view().look([ball]).visible(np.concatenate([radar[None], far])).all()
    corner = Triangles(radar + np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]]))
    assert view().look([corner]).visible(np.concatenate([radar[None], far])).all()


def test_degenerate_triangles_hide_nothing():
    """Points, lines and sheets seen edge on."""
    edge = [
        [[2, 0, 1.2]] * 3,
        [[2, -1, 1.2], [2, 0, 1.2], [2, 1, 1.2]],
        [[1, 0, 1.2], [3, 0, 1.2], [2, 0, 1.2]],
        [[1, 0, 0.2], [3, 0, -2.8], [2, 0, 3]],
    ]
    behind = np.array([[4.0, 0.001, 1.2], [4.0, 0.5, 1.2]])
    assert view().look([Triangles(np.array(edge, float))]).visible(behind).all()


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_sheets_of_any_size(scale):
    """A speck hides the point straight behind it, a wall of a thousand kilometres everything beyond it."""
    sheet = Triangles(np.array([2.0, 0, 1.2]) + scale * np.array([[[0, -1.0, -1.0], [0, 1, -1], [0, 0, 2]]]))
    seen = view().look([sheet]).visible(np.array([[4.0, 0, 1.2], [4.0, 1.0, 1.5], [1.0, 0, 1.2]]))
    assert seen.tolist() == [False, scale < 1, True]


def test_triangles_around_the_poles_and_behind():
    """Ceiling, floor and a wall across the cut behind the radar hide as anywhere else."""
    rng = np.random.default_rng(0)
    corners = np.array(
        [
            [[-1, -1, 3], [1, -1, 3], [0, 1.5, 3.0]],
            [[-1, -1, 0], [1, -1, 0], [0, 1.5, 0.0]],
            [[-2, -1, 0], [-2, 1, 0], [-2, 0, 3.0]],
            [[-2, -0.01, 1.1], [-2, 0.01, 1.1], [-2, 0, 1.3]],
            [[0.001, 0, 3], [-0.001, 0.001, 3], [0, -0.002, 3.0]],
        ]
    )
    places = rng.normal(size=(5000, 3)) * 3 + (0, 0, 1.2)
    for cell in (0.001, 0.02, 0.1):
        seen = view(cell).look([Triangles(corners)]).visible(places)
        assert np.array_equal(seen, ~hidden_by_triangles(places - (0, 0, 1.2), corners - (0, 0, 1.2), MARGIN))


def test_a_crowd_all_around_does_not_need_much_memory():
    """With the finest cells and hulls in all directions the raster stays below a million cells."""
    figure = make_figure(Person(body="mesh"), 0)
    hulls = []
    for angle in np.arange(6) * np.pi / 3 + 0.2:
        posture = stand(np.zeros(3))
        posture.place[:] = 2 * np.array([np.cos(angle), np.sin(angle)])
        hulls.append(figure.body.hull(figure.skeleton.pose(posture))())
    shadows = view(0.001).look(hulls)
    assert shadows._raster.shape[0] * shadows._raster.shape[1] < 1.1e6
    assert not shadows.visible(np.array([[4 * np.cos(0.2), 4 * np.sin(0.2), 1.2]]))[0]


def test_occlusion_of_nobody():
    """No scatterers, with and without hulls."""
    radar = SceneRadar()
    occlusion = Occlusion(config.OcclusionConfig(), Setting(Scene(radars=(radar,)), radar))
    none = Scatterers(
        Motion.still(np.empty((0, 3))), np.empty((0, 3)), np.empty(0), np.empty(0, np.int32), (lambda: Triangles(np.ones((1, 3, 3))),)
    )
    assert len(occlusion.process(none, Moment(0, 0.0))) == 0
    assert len(occlusion.process(Scatterers.join([]), Moment(0, 0.0))) == 0


def test_triangles_hide_what_is_just_behind_their_middle():
    """A triangle that faces the radar is nearer in its middle than at its corners, by millimetres where it is decimetres wide."""
    angle = 2 * np.pi * np.arange(3) / 3
    corners = np.stack([np.full(3, 3.0), 0.25 * np.cos(angle), 0.25 * np.sin(angle)], axis=-1)[None]
    small = np.stack([np.full(3, 9.0), 0.05 * np.cos(angle), 4.0 + 0.05 * np.sin(angle)], axis=-1)[None]
    places = np.array([[3.0 + 2 * MARGIN, 0.0, 0.0], [3.0 - MARGIN, 0.0, 0.0]])
    assert np.linalg.norm(corners[0, 0]) > np.linalg.norm(places[0])
    seen = View(np.zeros(3), np.eye(3), 0.1).look([Triangles(np.concatenate([corners, small]))])
    assert seen._raster is not None
    np.testing.assert_array_equal(seen.visible(places), [False, True])
