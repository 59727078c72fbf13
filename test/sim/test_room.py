"""Things in the room: cross-sections by closed forms, faces that are where the scene says, hulls that enclose."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core import Pose, RadarInfo, Waveform
from radar_sim.room import TILE, Things, trihedral_rcs
from radar_sim.scatterers import Triangles
from radar_sim.scene import Scene, SceneRadar
from radar_sim.things import Corner, Furniture, Point, Wall

WAVELENGTH = Waveform().wavelength
RADAR = np.array([0.0, 0.0, 1.2])


def corner_towards(azimuth, elevation, edge=0.05):
    """Cross-section of a corner at the origin that looks along x, seen from a direction."""
    scene = Scene(
        radars=(
            SceneRadar(
                mount=Pose(
                    x=5 * math.cos(elevation) * math.cos(azimuth), y=5 * math.cos(elevation) * math.sin(azimuth), z=5 * math.sin(elevation)
                )
            ),
        ),
        corners=(Corner(position=(0.0, 0.0, 0.0), edge=edge, heading=0.0),),
    )
    return float(Things(scene).scatterers(0.0).rcs[0])


def traced_area(axes, towards, n=200_000):
    """Area seen from a direction, of an edge-1 trihedral, through which rays leave again after meeting all three faces; by casting rays."""
    rng = np.random.default_rng(3)
    u = towards / np.linalg.norm(towards)
    side = np.cross(u, [0.3, 0.5, 0.8])
    side /= np.linalg.norm(side)
    up = np.cross(u, side)
    half = 1.2
    start = 10 * u + rng.uniform(-half, half, (n, 2)) @ np.stack([side, up])
    # In the frame of the edges, faces are the coordinate planes and a ray turns one of its signs at each.
    place, way = start @ axes.T, np.tile(-u @ axes.T, (n, 1))
    met, inside = np.zeros((n, 3), bool), np.ones(n, bool)
    for _ in range(3):
        with np.errstate(divide="ignore", invalid="ignore"):
            times = np.where((way < 0) & ~met, -place / way, np.inf)
        face = times.argmin(1)
        time = times[np.arange(n), face]
        inside &= np.isfinite(time)
        place = np.where(inside[:, None], place + np.where(inside, time, 0.0)[:, None] * way, place)
        inside &= (place > -1e-9).all(1) & (place.sum(1) <= 1.0)  # on the triangle between two edges
        met[np.arange(n), face] = True
        way[np.arange(n), face] *= -1
    return inside.mean() * (2 * half) ** 2


def test_corner_on_its_axis():
    """4 pi a^4 / (3 lambda^2): 5 cm give 1.71 m^2, 2.3 dBsm, at 76.75 GHz."""
    assert corner_towards(0.0, 0.0) == pytest.approx(4 * math.pi * 0.05**4 / (3 * WAVELENGTH**2), rel=1e-9)
    assert corner_towards(0.0, 0.0, edge=0.1) == pytest.approx(16 * corner_towards(0.0, 0.0), rel=1e-9)


@pytest.mark.parametrize(("azimuth", "elevation"), [(0, 0), (15, 0), (-15, 0), (30, 10), (0, 20), (0, -25), (-38, -12)])
def test_corner_beside_its_axis_by_ray_tracing(azimuth, elevation):
    """The closed form is 4 pi A^2 / lambda^2 for the area of rays that three faces send back (Monte Carlo, 0.5 % rms of A)."""
    rng = np.random.default_rng(1)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    axis = axes.sum(0) / math.sqrt(3.0)
    side = (axes[0] - axes[1]) / math.sqrt(2.0)
    a, e = math.radians(azimuth), math.radians(elevation)
    towards = math.cos(e) * (math.cos(a) * axis + math.sin(a) * side) + math.sin(e) * np.cross(axis, side)
    area = math.sqrt(trihedral_rcs(np.ones(1), axes[None], towards[None], 1.0)[0] / (4 * math.pi))
    assert area == pytest.approx(traced_area(axes, towards), rel=0.02)


def test_corner_beside_and_behind():
    """3 dB down at 20 degrees or so to the sides (Knott: a beam about 40 degrees wide), alike on both; nothing from behind."""
    axis = corner_towards(0.0, 0.0)
    for angle in (math.radians(20), -math.radians(20)):
        assert 1.5 < 10 * math.log10(axis / corner_towards(angle, 0.0)) < 3.5
    assert corner_towards(0.4, 0.1) == pytest.approx(corner_towards(-0.4, 0.1), rel=1e-9)
    assert corner_towards(math.pi, 0.0) == corner_towards(2.0, 0.3) == 0.0


@given(x=st.floats(-1, 1), y=st.floats(-1, 1), z=st.floats(-1, 1))
def test_corner_is_never_more_than_on_its_axis(x, y, z):
    """In no direction is the area negative or larger than on the axis."""
    rcs = trihedral_rcs(np.ones(1), np.eye(3)[None], np.array([[x, y, z]]), 1.0)[0]
    assert 0.0 <= rcs <= 4 * math.pi / 3 * (1 + 1e-9)


def test_corner_without_heading_looks_at_the_first_radar():
    """Its axis is horizontal, towards the first radar; another radar sees it from beside, by its own wavelength."""
    first = SceneRadar(frame_id="a/radar", mount=Pose(x=1.0, y=2.0, z=1.2))
    wave = Waveform(carrier=60e9)
    second = SceneRadar.of(RadarInfo(frame_id="b/radar", waveform=wave, mount=Pose(x=1.0, y=0.5, z=1.2)))
    corner = Corner(position=(4.0, 0.5, 1.2), edge=0.07)
    scene = Scene(radars=(first, second), corners=(corner,))
    on_axis = 4 * math.pi * 0.07**4 / 3
    assert Things(scene).scatterers(0.0).rcs[0] == pytest.approx(on_axis / WAVELENGTH**2, rel=1e-9)
    assert 0 < Things(scene, second).scatterers(0.0).rcs[0] < 0.8 * on_axis / wave.wavelength**2
    turned = dataclasses.replace(scene, corners=(dataclasses.replace(corner, heading=math.pi),))
    assert Things(turned, second).scatterers(0.0).rcs[0] == pytest.approx(on_axis / wave.wavelength**2, rel=1e-9)


def test_points_and_corners_move_evenly_from_time_0():
    """position + velocity * time, no acceleration, no normals; a corner's cross-section changes on its way."""
    scene = Scene(
        points=(Point(position=(1.0, 2.0, 3.0), velocity=(0.5, -1.0, 0.25), rcs=0.3),),
        corners=(Corner(position=(3.0, -1.0, 1.2), velocity=(0.0, 0.5, 0.0), heading=math.pi),),
    )
    things = Things(scene)
    now = things.scatterers(2.0)
    np.testing.assert_allclose(now.motion.position, [[2.0, 0.0, 3.5], [3.0, 0.0, 1.2]])
    np.testing.assert_array_equal(now.motion.velocity, [[0.5, -1.0, 0.25], [0.0, 0.5, 0.0]])
    assert not now.motion.acceleration.any()
    assert not now.normal.any()
    assert (now.owner < 0).all()
    assert now.rcs[0] == 0.3
    assert now.rcs[1] == pytest.approx(4 * math.pi * 0.05**4 / (3 * WAVELENGTH**2), rel=1e-9)
    assert things.scatterers(0.0).rcs[1] < 0.9 * now.rcs[1]
    np.testing.assert_array_equal(now.towards(RADAR), now.rcs)


def test_still_things_are_made_once():
    """Where nothing moves, every frame gets the same scatterers, and the same hull."""
    things = Things(Scene(points=(Point(position=(1.0, 0.0, 1.0)),), walls=(Wall(start=(3.0, -1.0), end=(3.0, 1.0)),)))
    assert things.scatterers(0.0) is things.scatterers(7.0)
    (hull,) = things.scatterers(0.0).hulls
    assert hull() is hull()


def test_wall_tiles_are_its_faces():
    """Areas add up to the faces', every tile lies on the face whose normal it has, within the ends and the height."""
    wall = Wall(start=(1.0, 2.0), end=(4.0, 6.0), height=2.5, thickness=0.2, diffuse=0.01)
    tiles = Things(Scene(walls=(wall,))).scatterers(0.0)
    assert tiles.rcs.sum() == pytest.approx(0.01 * (2 * 5.0 * 2.5 + 2 * 0.2 * 2.5 + 5.0 * 0.2), rel=1e-9)
    along, across = np.array([0.6, 0.8, 0.0]), np.array([-0.8, 0.6, 0.0])
    place = tiles.motion.position - [1.0, 2.0, 0.0]
    s, d, z = place @ along, place @ across, place[:, 2]
    assert ((s > -1e-9) & (s < 5.0 + 1e-9) & (np.abs(d) < 0.1 + 1e-9) & (z > 0) & (z < 2.5 + 1e-9)).all()
    front = tiles.normal @ across > 0.99
    np.testing.assert_allclose(d[front], 0.1)
    np.testing.assert_allclose(d[tiles.normal @ across < -0.99], -0.1)
    assert tiles.rcs[front].sum() == pytest.approx(0.01 * 5.0 * 2.5, rel=1e-9)
    assert tiles.rcs.max() <= 0.01 * TILE**2 * (1 + 1e-9)
    # One point in each tile of 5.0 m / 17 by 2.5 m / 9.
    cells = np.floor(s[front] / (5.0 / 17)) * 9 + np.floor(z[front] / (2.5 / 9))
    assert len(np.unique(cells)) == front.sum() == 17 * 9


def test_furniture_is_a_box():
    """Five faces where it stands, six where it hangs; turned by its heading; normals outward."""
    box = Furniture(position=(3.0, 1.0), size=(1.2, 0.6, 0.75), heading=0.5, diffuse=0.02)
    standing = Things(Scene(furniture=(box,))).scatterers(0.0)
    hanging = Things(Scene(furniture=(dataclasses.replace(box, base=1.0),))).scatterers(0.0)
    sides = 2 * 0.75 * (1.2 + 0.6)
    assert standing.rcs.sum() == pytest.approx(0.02 * (sides + 1.2 * 0.6), rel=1e-9)
    assert hanging.rcs.sum() == pytest.approx(0.02 * (sides + 2 * 1.2 * 0.6), rel=1e-9)
    middle = np.array([3.0, 1.0, 1.375])
    assert ((hanging.motion.position - middle) * hanging.normal).sum(-1).min() > 0.29
    c, s = math.cos(0.5), math.sin(0.5)
    local = (hanging.motion.position - middle) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    np.testing.assert_allclose(np.abs(local).max(0), [0.6, 0.3, 0.375], atol=1e-9)


def test_hulls_enclose_what_they_belong_to():
    """Triangles of one hull: a closed box has, by the divergence theorem, its volume; its corners are the box's."""
    box = Furniture(position=(3.0, 1.0), size=(1.2, 0.6, 0.75), base=0.5, heading=0.7)
    (hull,) = Things(Scene(furniture=(box,))).scatterers(0.0).hulls
    shape = hull()
    assert isinstance(shape, Triangles)
    corner = shape.corner
    assert corner.shape == (12, 3, 3)
    middle = np.array([3.0, 1.0, 0.875])
    a, b, c = np.moveaxis(corner - middle, 1, 0)
    volume = np.abs((a * np.cross(b, c)).sum(-1)).sum() / 6  # every face seen from the middle
    assert volume == pytest.approx(1.2 * 0.6 * 0.75, rel=1e-9)
    assert not Things(Scene(points=(Point(position=(1.0, 0.0, 1.0)),))).scatterers(0.0).hulls


def test_a_wall_that_only_mirrors_has_a_hull_and_no_tiles():
    """diffuse 0: no echo of its own, but it hides."""
    things = Things(Scene(walls=(Wall(start=(3.0, -1.0), end=(3.0, 1.0), diffuse=0.0),))).scatterers(0.0)
    assert len(things) == 0
    assert len(things.hulls) == 1


def test_rough_walls_do_not_flash():
    """Phases of tiles are those of a rough face: over many viewpoints the power of the coherent sum is the sum of powers, exponential."""
    wall = Wall(start=(4.0, -3.0), end=(4.0, 3.0), thickness=0.0)
    tiles = Things(Scene(walls=(wall,))).scatterers(0.0)
    ratio = []
    for k in range(300):
        place = np.array([0.1 * math.sin(k), 0.02 * (k - 150), 1.2])
        rcs = tiles.towards(place)
        distance = np.linalg.norm(tiles.motion.position - place, axis=-1)
        field = (np.sqrt(rcs) / distance**2 * np.exp(4j * np.pi * distance / WAVELENGTH)).sum()
        ratio.append(abs(field) ** 2 / (rcs / distance**4).sum())
    # The mean of 300 exponential ones: 1 with a standard deviation of 0.06; none above 12 in 300 with a probability of 0.998.
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.25)
    assert max(ratio) < 12.0


def test_seed_moves_tiles_only_within_themselves():
    """Another seed: the same areas, other places; the same seed: the same."""
    scene = Scene(walls=(Wall(start=(3.0, -1.0), end=(3.0, 1.0)),), seed=1)
    one, same, other = (Things(dataclasses.replace(scene, seed=s)).scatterers(0.0) for s in (1, 1, 2))
    np.testing.assert_array_equal(one.motion.position, same.motion.position)
    np.testing.assert_array_equal(one.rcs, other.rcs)
    shift = np.abs(one.motion.position - other.motion.position).max()
    assert 0.05 < shift < TILE
