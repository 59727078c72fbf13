"""Occlusion: what hides what, against ray casting by brute force and against geometry."""

import math

import numpy as np
import pytest
from figures import GESTURES, SPAN, posture
from hypothesis import example, given, settings
from hypothesis import strategies as st
from oracles.shadows import hidden_by_ellipsoids, hidden_by_triangles

from radar_core import Pose as Mount
from radar_sim.bodies.ellipsoids import sphere, spread
from radar_sim.bodies.make import make_figure
from radar_sim.bodies.shadows import MARGIN, View, angle
from radar_sim.effects import config
from radar_sim.effects.base import Moment, Setting
from radar_sim.effects.sight import Occlusion
from radar_sim.people import Person
from radar_sim.scatterers import THING, Echoes, Ellipsoids, Motion, Scatterers, Triangles
from radar_sim.scene import Scene, SceneRadar

RADAR = np.array([0.0, 0.0, 1.2])
MOMENT = Moment(0, 0.0)


def effect(mount=None, resolution=0.005):
    radar = SceneRadar(mount=mount or Mount())
    return Occlusion(config.OcclusionConfig(resolution=resolution), Setting(Scene(radars=(radar,)), radar))


@pytest.fixture(scope="module")
def figures():
    return {kind: make_figure(Person(body=kind), 0) for kind in ("ellipsoids", "mesh")}


def person(figures, kind, place=(2.5, 0.0), hands="stand", owner=0, heading=math.pi):
    figure = figures[kind]
    return figure.body.surface(figure.skeleton.pose(posture(GESTURES[hands], place, heading)), SPAN, owner)


def rectangle(x, y, z):
    """An upright sheet across x, as two triangles."""
    a, b, c, d = ([x, *p] for p in ((y[0], z[0]), (y[1], z[0]), (y[1], z[1]), (y[0], z[1])))
    return Triangles(np.array([[a, b, c], [a, c, d]], float))


def points(position, owner=THING, hulls=()):
    """Scatterers that echo in all directions."""
    n = len(position)
    return Scatterers(Motion.still(np.asarray(position, float)), np.zeros((n, 3)), np.ones(n), np.full(n, owner, np.int32), hulls)


def section(scatterers, owner=None):
    chosen = scatterers if owner is None else scatterers.select(scatterers.owner == owner)
    return chosen.towards(RADAR).sum()


@settings(max_examples=200, deadline=None)
@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_the_fast_angle_is_an_angle(y, x):
    """To 2e-6 rad: half of what the boxes of triangles are widened by."""
    assert abs(math.remainder(angle(y, x) - math.atan2(y, x), 2 * math.pi)) < 2e-6 or (x == 0 == y)


@pytest.mark.parametrize("distance", [0.6, 2.5, 8.0])
@pytest.mark.parametrize("hands", ["stand", "across", "raised"])
def test_hidden_faces_of_the_mesh_are_those_of_ray_casting(figures, distance, hands):
    """The raster only sorts: the same faces are hidden as with every ray against every triangle (allowed: 1.5 % of faces; found: none)."""
    body = person(figures, "mesh", (distance, 0.3), hands)
    hull = body.hulls[0]()
    seen = View(RADAR, np.eye(3), 0.005).look([hull]).visible(body.motion.position)
    facing = np.flatnonzero(body.towards(RADAR) > 0)
    sample = np.random.default_rng(1).choice(facing, 250, replace=False)
    hidden = hidden_by_triangles(body.motion.position[sample] - RADAR, hull.corner - RADAR, MARGIN)
    assert 0.05 < hidden.mean() < 0.35
    assert (seen[sample] == hidden).mean() <= 1 / 250  # one face whose ray runs along an edge


def test_ellipsoids_hide_as_in_closed_form_with_numpy(figures):
    """Compiled and numpy agree on every point; on others in the room too."""
    body = person(figures, "ellipsoids", hands="across")
    hull = body.hulls[0]()
    room = np.random.default_rng(2).uniform([-1, -3, 0], [6, 3, 2.5], (3000, 3))
    places = np.concatenate([body.motion.position, room])
    seen = View(RADAR, np.eye(3), 0.005).look([hull]).visible(places)
    hidden = hidden_by_ellipsoids(places - RADAR, hull.centre - RADAR, hull.axes, MARGIN)
    assert np.array_equal(seen, ~hidden)
    assert hidden[len(body) :].sum() > 30


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.001, 0.005, 0.1]))
@example(579, 0.001)  # a triangle is nearer in its middle than at its corners
def test_any_triangles_hide_as_in_ray_casting(seed, cell):
    """Large and small ones, all around the radar, above, below and behind it, with rasters of any width."""
    rng = np.random.default_rng(seed)
    n = 60
    middle = rng.normal(size=(n, 1, 3)) * 3
    corners = middle + rng.normal(size=(n, 3, 3)) * rng.choice([0.02, 0.1, 1.0], (n, 1, 1))
    # aimed at triangles, at any distance beyond or before them
    targets = corners.mean(1)[rng.integers(0, n, 300)] + rng.normal(size=(300, 3)) * 0.02
    places = targets * rng.uniform(0.5, 2.0, (300, 1))
    seen = View(np.zeros(3), np.eye(3), cell).look([Triangles(corners)]).visible(places)
    assert np.array_equal(seen, ~hidden_by_triangles(places, corners, MARGIN))


@pytest.mark.parametrize("kind", ["ellipsoids", "mesh"])
def test_the_view_turns_with_the_radar(figures, kind):
    """Mounted with any yaw and tilt at the same place a radar sees the same: also somebody behind it."""
    body = person(figures, kind, (-2.0, 0.4), heading=0.0)
    results = [effect(Mount(yaw=yaw, tilt=tilt)).process(body, MOMENT) for yaw, tilt in ((0.0, 0.0), (2.0, 0.3), (-3.0, -0.5))]
    for other in results[1:]:
        assert np.array_equal(results[0].motion.position, other.motion.position)
    assert 0 < len(results[0]) < 0.6 * len(body)


def test_resolution_does_not_change_what_is_hidden(figures):
    """The cells save time, nothing else."""
    body = person(figures, "mesh", hands="across")
    fine, coarse = (effect(resolution=r).process(body, MOMENT) for r in (0.001, 0.1))
    assert np.array_equal(fine.motion.position, coarse.motion.position)


def test_a_ball_hides_a_cone():
    """A ball of radius a at distance d hides, of a plane behind it, what is less than asin(a / d) off its direction."""
    ball = Ellipsoids(np.array([[2.0, 0.0, 1.2]]), np.eye(3)[None] * 0.3)
    y, z = (g.ravel() for g in np.meshgrid(np.linspace(-2, 2, 81), np.linspace(-1, 3, 81)))
    plane = np.stack([np.full_like(y, 4.0), y, z], -1)
    off = np.arccos((plane - RADAR)[:, 0] / np.linalg.norm(plane - RADAR, axis=1))
    kept = effect().process(points(plane, hulls=(lambda: ball,)), MOMENT)
    assert np.array_equal(kept.motion.position, plane[off > math.asin(0.15)])


@pytest.mark.parametrize("half", [(0.1, 0.1, 0.1), (0.03, 0.1, 0.4)])
@pytest.mark.parametrize("distance", [0.6, 3.0, 50.0])
def test_a_convex_surface_does_not_hide_itself(half, distance):
    """All points that face the radar stay, all others go, at grazing incidence too."""
    half = np.asarray(half)
    unit, area = spread(half, 400)
    centre = np.array([distance, 0.2, 1.0])
    normal = unit / half / np.linalg.norm(unit / half, axis=1, keepdims=True)
    body = Scatterers(
        Motion.still(centre + unit * half), normal, area, np.zeros(400, np.int32), (lambda: Ellipsoids(centre[None], np.diag(half)[None]),)
    )
    kept = effect().process(body, MOMENT)
    assert section(kept) == pytest.approx(section(body), rel=1e-12)
    assert len(kept) == (body.towards(RADAR) > 0).sum()


def test_a_wall_hides_what_is_behind_it():
    """A sheet from y = -1 to 0.5 at x = 2 hides the points at x = 4 from y = -2 to 1, and none before it."""
    y = np.linspace(-2.95, 2.95, 60)
    behind, before = np.stack([np.full(60, 4.0), y, np.full(60, 1.0)], -1), np.stack([np.full(60, 1.9), y, np.full(60, 1.0)], -1)
    kept = effect().process(points(np.concatenate([behind, before]), hulls=(lambda: rectangle(2.0, (-1.0, 0.5), (0, 2.6)),)), MOMENT)
    expected = behind[(y < -2) | (y > 1)]
    assert np.array_equal(kept.motion.position, np.concatenate([expected, before]))


@pytest.mark.parametrize("kinds", [("ellipsoids", "ellipsoids"), ("mesh", "mesh"), ("ellipsoids", "mesh")])
def test_the_one_behind_is_hidden(figures, kinds):
    """Directly behind somebody little of a person is left; 1.5 m to the side everything is; the one in front loses nothing."""
    alone = [section(effect().process(person(figures, kinds[0], (2.0, 0.0)), MOMENT))]
    for y in (0.0, 1.5):
        alone.append(section(effect().process(person(figures, kinds[1], (3.5, y)), MOMENT)))
    for y, single in zip((0.0, 1.5), alone[1:], strict=True):
        both = Scatterers.join([person(figures, kinds[0], (2.0, 0.0), owner=0), person(figures, kinds[1], (3.5, y), owner=1)])
        seen = effect().process(both, MOMENT)
        assert section(seen, 0) == pytest.approx(alone[0], rel=1e-9)
        if y:
            assert section(seen, 1) == pytest.approx(single, rel=1e-9)
        else:
            # feet and lower legs show below the hands of the nearer one, whose outline is 1.75 times as large
            assert section(seen, 1) < 0.25 * single
            position = seen.motion.position[seen.owner == 1]
            # the waist of the nearer one, between its ellipsoids, hides 0.135 m on each side (80 seeds of the points: nothing within 0.137)
            trunk = (position[:, 2] > 1.0) & (np.abs(position[:, 1]) < 0.13)
            assert not trunk.any()


def test_an_arm_before_the_chest_hides_some_of_it(figures):
    """A forearm held across the chest takes away what the same chest shows when arms hang, and comes instead at least in part."""
    for kind in figures:
        hanging, across = (effect().process(person(figures, kind, hands=h), MOMENT) for h in ("stand", "across"))
        # between the hips and the chin, not further than the shoulders from the middle, on the front of the trunk
        chest = [
            (s.motion.position[:, 2] > 1.1) & (s.motion.position[:, 2] < 1.5) & (np.abs(s.motion.position[:, 1]) < 0.15)
            & (s.motion.position[:, 0] > 2.3) & (s.motion.position[:, 0] < 2.5) for s in (hanging, across)
        ]  # fmt: skip
        assert chest[1].sum() < 0.97 * chest[0].sum()


def test_a_scene_without_hulls_is_left_alone():
    """Nothing that hides: the very same object comes back."""
    free = points(sphere(10))
    assert effect().process(free, MOMENT) is free


def test_size_says_how_wide_people_are():
    """Degrees and metres of each person, and the share of power that comes from behind others."""
    place = np.array([[2.0, -0.2, 0.0], [2.0, 0.2, 0.0], [4.0, 0.0, 0.0], [4.0, 1.5, 0.0]])
    still = Motion.still(place)
    strength = np.abs(np.array([1.0, 1.0, 4.0, 4.0])).astype(complex)  # after the two-way loss: all the same
    echoes = Echoes(still, still, strength, np.array([0, 0, 1, 1], np.int32), np.arange(4, dtype=np.int32))
    radar = SceneRadar()
    text = Occlusion(config.OcclusionConfig(), Setting(Scene(radars=(radar,)), radar)).size(echoes)
    assert "11 deg at 2.0 m" in text
    assert "2" in text.split("%")[0].split()[-1]
    assert "nobody" in Occlusion(config.OcclusionConfig(), Setting(Scene(radars=(radar,)), radar)).size(Echoes.none())
