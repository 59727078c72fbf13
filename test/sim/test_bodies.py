"""Bodies: shapes, skeleton and surfaces against anatomy, closed forms and physics."""

import numpy as np
import pytest
from anatomy import FLIP, PEOPLE, bone, length, rest_pose, volume
from figures import GESTURES, SPAN, posture, ring
from oracles import skin as oracle

from radar_sim import Scene, Simulator
from radar_sim.bodies import skin
from radar_sim.bodies.base import LEG, stand
from radar_sim.bodies.ellipsoids import EllipsoidBody, sphere, spread
from radar_sim.bodies.make import make_figure
from radar_sim.bodies.shadows import View
from radar_sim.bodies.skeleton import Skeleton
from radar_sim.bodies.skin import MeshBody
from radar_sim.bodies.subject import MIRROR, Subject
from radar_sim.people import Person
from radar_sim.scatterers import Motion, Scatterers, Triangles
from radar_sim.world import World


@pytest.fixture(scope="module")
def ellipsoids(subject):
    return EllipsoidBody(subject, 0.4)


# subjects


@pytest.mark.parametrize("person", PEOPLE, ids=lambda p: f"{p.sex}-{p.height}-{p.build}")
def test_subject_has_the_wanted_stature_and_human_limbs(person):
    """Stature is exact; arms are those of Drillis and Contini, legs within 3 % of stature of theirs (hip 0.530, knee 0.285)."""
    subject, h = Subject.of(person), person.height
    joint, z = subject.joint, subject.vertices[:, 2]
    assert z.min() == pytest.approx(0.0, abs=1e-9)
    assert z.max() == pytest.approx(h, rel=1e-9)
    for side in "lr":
        assert length(joint, f"upperarm_{side}", f"lowerarm_{side}") == pytest.approx(0.186 * h, rel=1e-9)
        assert length(joint, f"lowerarm_{side}", f"hand_{side}") == pytest.approx(0.146 * h, rel=1e-9)
        assert joint[bone(f"thigh_{side}"), 2] == pytest.approx(LEG * h, abs=0.03 * h)
        assert joint[bone(f"calf_{side}"), 2] == pytest.approx(0.285 * h, abs=0.03 * h)
    np.testing.assert_allclose(joint[list(MIRROR)] * FLIP, joint, atol=1e-12)
    hand = subject.hand - joint[[bone("lowerarm_l"), bone("lowerarm_r")]]
    np.testing.assert_allclose(np.linalg.norm(hand, axis=-1), 0.2 * h, rtol=1e-9)


def test_hands_of_the_mesh_reach_a_hand_beyond_the_wrist(subject):
    """The fingertips are 0.108 of stature from the wrist; the stretched arm's skin stays around its bones, 9 cm at most from them."""
    for i, side in enumerate("lr"):
        wrist = subject.joint[bone(f"hand_{side}")]
        along = subject.hand[i] - wrist
        along /= np.linalg.norm(along)
        own = subject.vertices[(subject.weight * (subject.bone == bone(f"hand_{side}"))).sum(1) > 0.5]
        assert ((own - wrist) @ along).max() == pytest.approx(0.108 * 1.75, rel=0.03)
        elbow = subject.joint[bone(f"lowerarm_{side}")]
        fore = subject.vertices[(subject.weight * (subject.bone == bone(f"lowerarm_{side}"))).sum(1) > 0.5] - elbow
        share = (fore @ (wrist - elbow)) / ((wrist - elbow) @ (wrist - elbow))
        assert -0.3 < share.min() < 0.1
        assert 0.9 < share.max() < 1.2
        assert np.linalg.norm(fore - share[:, None] * (wrist - elbow), axis=1).max() < 0.09


def test_build_and_sex_change_the_volume():
    """Heavier builds are larger at the same stature; body-mass indices (1000 kg/m^3) stay between 16 and 32."""
    for sex in ("male", "female"):
        volumes = [volume(Subject.of(Person(sex=sex, build=b))) for b in (0.0, 0.25, 0.5, 0.75, 1.0)]
        assert np.all(np.diff(volumes) > 0)
        assert 1000 * volumes[0] > 16 * 1.75**2
        assert 1000 * volumes[-1] < 32 * 1.75**2


def test_stature_beyond_the_corner_bodies_scales():
    """From children to giants: a body twice as tall as the smallest corner body is that body scaled."""
    small, smaller = Subject.of(Person(height=1.2)), Subject.of(Person(height=0.9))
    np.testing.assert_allclose(small.vertices * 0.75, smaller.vertices, atol=1e-9)


# surfaces


def scatterers(points, normals, rcs):
    return Scatterers(Motion.still(points), normals, rcs, np.zeros(len(rcs), np.int32))


def globe(radius, n_el, n_az):
    """Triangles of a sphere by parallels and meridians, anticlockwise from outside; the two rows at the poles have no area in half."""
    el, az = np.linspace(-np.pi / 2, np.pi / 2, n_el + 1), np.linspace(0, 2 * np.pi, n_az, endpoint=False)
    x = radius * np.stack([np.outer(np.cos(el), np.cos(az)), np.outer(np.cos(el), np.sin(az)), np.outer(np.sin(el), np.ones(n_az))], -1)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(n_el), np.arange(n_az), indexing="ij"))
    a, b, c, d = (r * n_az + k % n_az for r, k in ((i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)))
    return x.reshape(-1, 3), np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).astype(np.int32)


@pytest.mark.parametrize("radius", [0.05, 0.3, 2.0])
@pytest.mark.parametrize("density", [1, 2, 6])
def test_a_sphere_of_facets_has_the_cross_section_pi_a_squared(radius, density):
    """Within 0.5 dB at any size and density, from a long way off (parallel rays to 1e-3) in any direction."""
    points, faces = globe(radius, 8 * density, 16 * density)
    centroid, normal, area = skin.facets(points[None], faces)
    for unit in sphere(7):
        rcs = scatterers(centroid[0], normal, area).towards(unit * 1000 * radius).sum()
        assert abs(10 * np.log10(rcs / (np.pi * radius**2))) < 0.5


@pytest.mark.parametrize("radius", [0.05, 0.3, 2.0])
@pytest.mark.parametrize("n", [60, 200, 2000])
def test_a_sphere_of_points_has_the_cross_section_pi_a_squared(radius, n):
    """The same for points of a Fibonacci lattice; the ellipsoids of a body have 15 to 120 points."""
    unit, area = spread(np.full(3, radius), n)
    for direction in sphere(7):
        rcs = scatterers(unit * radius, unit, area).towards(direction * 1000 * radius).sum()
        assert abs(10 * np.log10(rcs / (np.pi * radius**2))) < 0.5


@pytest.mark.parametrize("half", [(0.1, 0.1, 0.4), (0.05, 0.12, 0.2)])
def test_points_are_spread_evenly_over_an_ellipsoid(half):
    """Their areas sum to the closed form (prolate spheroid), and their projected area from any side is the ellipse's."""
    half = np.asarray(half)
    unit, area = spread(half, 1500)
    if half[0] == half[1]:
        e = np.sqrt(1 - (half[0] / half[2]) ** 2)
        closed = 2 * np.pi * half[0] ** 2 * (1 + half[2] / (half[0] * e) * np.arcsin(e))
        assert area.sum() == pytest.approx(closed, rel=2e-3)
    normal = unit / half
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    for direction in sphere(9):
        # the shadow of an ellipsoid: pi a b c |A^-1 d|
        shadow = np.pi * half.prod() * np.linalg.norm(direction / half)
        assert (area * np.maximum(normal @ direction, 0.0)).sum() == pytest.approx(shadow, rel=0.02)


def test_kernels_equal_numpy(subject, skeleton):
    """Compiled skinning, turning and facets against plain numpy."""
    pose = skeleton.pose(posture(GESTURES["raised"], (1, 2), 0.5, breath=0.01))
    rng = np.random.default_rng(0)
    args = (subject.vertices, rng.normal(size=subject.vertices.shape), subject.bone, subject.weight, subject.joint, pose)
    np.testing.assert_allclose(skin.blend(*args), oracle.blend_numpy(*args), atol=1e-12)
    bones = subject.bone[:, 0]
    np.testing.assert_allclose(
        skin.turn(subject.vertices, bones, pose.rotation[1]), oracle.turn_numpy(subject.vertices, bones, pose.rotation[1]), atol=1e-12
    )
    vertices = skin.blend(*args)
    for got, wanted in zip(skin.facets(vertices, subject.faces), oracle.facets_numpy(vertices, subject.faces), strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-9)


def test_the_mesh_at_rest_is_the_subject(subject, mesh):
    """Rotations that do nothing leave every vertex where it is."""
    np.testing.assert_allclose(mesh.vertices(rest_pose(subject)), subject.vertices, atol=1e-9)


@pytest.mark.parametrize("person", PEOPLE, ids=lambda p: f"{p.sex}-{p.height}-{p.build}")
def test_both_bodies_cast_the_same_shadow(person):
    """Area seen from the front and from the side: ellipsoids within 10 % of the mesh. Volumes within 12 %."""
    subject = Subject.of(person)
    pose = Skeleton(subject).pose(posture(n=1))
    solids, mesh = EllipsoidBody(subject, 0.4).ellipsoids(pose), Triangles(MeshBody(subject, 0.4).vertices(pose)[subject.faces])
    step = 0.01
    y, z = (g.ravel() for g in np.meshgrid(np.arange(-1, 1, step), np.arange(-0.1, 2.1, step)))
    for front in (True, False):
        # from 1 km off rays are parallel to 1 mm; points beyond that no ray reaches are in the shadow
        far, beyond = np.array([1000.0, 0, 1]), np.stack([np.full_like(y, -5.0), y, z], -1)
        if not front:
            far, beyond = far[[1, 0, 2]], beyond[:, [1, 0, 2]]
        shadows = [(~View(far, np.eye(3), 1e-3).look([hull]).visible(beyond)).sum() * step**2 for hull in (solids, mesh)]
        assert shadows[0] == pytest.approx(shadows[1], rel=0.10)
    rng = np.random.default_rng(1)
    low, size = np.array([-0.7, -1.2, -0.1]), np.array([1.4, 2.4, 2.3])
    points = low + size * rng.uniform(size=(40_000, 3))
    inside = (np.einsum("mij,nmj->nmi", np.linalg.inv(solids.axes), points[:, None] - solids.centre) ** 2).sum(-1).min(1) < 1
    litres = 1000 * inside.mean() * size.prod()  # to 2 %, 1 sigma
    assert litres == pytest.approx(1000 * volume(subject), rel=0.12)
    if person == Person():
        assert 60 < litres < 110


def test_a_person_has_the_cross_section_of_a_person(skeleton, ellipsoids, mesh):
    """From the front 0.1 to 0.6 m^2; ellipsoids and mesh within 1.5 dB of one another from eight sides, hidden parts left out."""
    for hands in GESTURES.values():
        pose = skeleton.pose(posture(hands))
        for i, place in enumerate(ring(8)):
            sections = []
            for body in (ellipsoids, mesh):
                surface = body.surface(pose, SPAN, 0)
                seen = View(place, np.eye(3), 0.005).look([hull() for hull in surface.hulls]).visible(surface.motion.position)
                sections.append(surface.select(seen).towards(place).sum())
            assert abs(10 * np.log10(sections[0] / sections[1])) < 1.5
            if i == 0:
                assert min(sections) > 0.1
                assert max(sections) < 0.6


def test_left_and_right_look_alike(skeleton, ellipsoids, mesh):
    """Seen from 45 degrees left and right, without and with occlusion, a standing person's cross-section is the same within 0.3 dB."""
    pose = skeleton.pose(posture())
    for body in (ellipsoids, mesh):
        surface = body.surface(pose, SPAN, 0)
        left, right = (surface.towards(ring(8)[k]).sum() for k in (1, 7))
        assert abs(10 * np.log10(left / right)) < 0.3


def test_points_stay_on_their_ellipsoids(skeleton, ellipsoids):
    """In any pose and breath every point is on its ellipsoid to rounding, its normal outward, of unit length and across the surface."""
    pose = skeleton.pose(posture(GESTURES["raised"], (2, 1), 2.0, breath=0.012, trunk=(0.3, 0.1, 0.2)))
    surface, solids = ellipsoids.surface(pose, SPAN, 3), ellipsoids.ellipsoids(pose, 1)
    part = ellipsoids._points.part
    inverse = np.linalg.inv(solids.axes)[part]
    unit = (inverse @ (surface.motion.position - solids.centre[part])[..., None])[..., 0]
    np.testing.assert_allclose((unit**2).sum(-1), 1.0, atol=1e-9)
    gradient = (inverse.swapaxes(-1, -2) @ unit[..., None])[..., 0]
    gradient /= np.linalg.norm(gradient, axis=-1, keepdims=True)
    # normals leave out that breath changes the chest by a few millimetres in 150
    assert (gradient * surface.normal).sum(-1).min() > 0.995
    np.testing.assert_allclose(np.linalg.norm(surface.normal, axis=-1), 1.0, atol=1e-9)
    assert (surface.owner == 3).all()
    assert 700 < len(surface) < 900


def test_normals_of_the_mesh_point_outward(subject, mesh, skeleton):
    """By the divergence theorem, the flux of x through the surface is three times the volume, posed as at rest (within 6 %)."""
    surface = mesh.surface(skeleton.pose(posture(GESTURES["push"])), SPAN, 0)
    flux = ((surface.motion.position * surface.normal).sum(-1) * surface.rcs / 0.4).sum()
    assert flux / 3 == pytest.approx(volume(subject), rel=0.06)
    # every limb for itself: facets of the head, seen from its middle, face away from it
    head = subject.weight.argmax(1) == 0
    head &= subject.bone[:, 0] == bone("head")
    faces = head[subject.faces].all(1)
    outward = surface.motion.position[faces] - surface.motion.position[faces].mean(0)
    assert ((outward * surface.normal[faces]).sum(-1) > 0).mean() > 0.8  # nose, ears and chin fold


def test_breath_moves_the_front_of_the_chest_only(subject, ellipsoids, mesh):
    """A breath of 10 mm moves the foremost point of the chest by 10 mm, the back and the limbs not at all."""
    still, breathing = rest_pose(subject), rest_pose(subject, 0.01)
    moved = mesh.vertices(breathing) - mesh.vertices(still)
    assert moved.max() == pytest.approx(0.01, rel=0.05)
    assert np.abs(moved[subject.vertices[:, 0] < -0.05]).max() < 1e-3
    points = ellipsoids._points
    skinned = [
        skin.blend(points.place, points.swell, ellipsoids._bone, ellipsoids._weight, subject.joint, p)[0] for p in (still, breathing)
    ]
    step = np.linalg.norm(skinned[1] - skinned[0], axis=-1)
    assert step.max() == pytest.approx(0.01, rel=0.1)
    assert step[points.normal[:, 0] < -0.9].max() < 2e-3  # it swells evenly from back to front: (1 + cos) / 2
    assert (step > 1e-6).sum() < len(step) / 4


@pytest.mark.parametrize("kind", ["ellipsoids", "mesh"])
def test_surfaces_move_with_the_person(kind):
    """Someone who walks at 1.5 m/s and turns: velocities and accelerations are those of the rigid motion."""
    figure = make_figure(Person(body=kind), 0)
    t = np.array([-0.5, 0.0, 0.5]) * SPAN
    want = posture()
    want.place[:, 0] = 1.5 * t
    want.heading[:] = 2.0 * t
    motion = figure.body.surface(figure.skeleton.pose(want), SPAN, 0).motion
    turning = 2.0 * np.stack([-motion.position[:, 1], motion.position[:, 0], np.zeros(len(motion))], -1)
    # the chord of an arc of 0.03 rad is shorter by 4e-5
    np.testing.assert_allclose(motion.velocity, turning + np.array([1.5, 0, 0]), atol=1e-3)
    inward = -4.0 * motion.position * (1, 1, 0)
    np.testing.assert_allclose(motion.acceleration, inward, atol=1e-2)


def test_bodies_are_chosen_by_name_and_seeded():
    """The same scene gives the same points, another seed or person others; cross-sections go with reflectivity."""
    pose = make_figure(Person(), 0).skeleton.pose(stand(np.zeros(3)))

    def surface(seed=0, **more):
        return make_figure(Person(**more), seed).body.surface(pose, SPAN, 0)

    np.testing.assert_array_equal(surface().motion.position, surface().motion.position)
    assert not np.array_equal(surface().motion.position[:5], surface(seed=1).motion.position[:5])
    assert not np.array_equal(surface().motion.position[:5], surface(id=2).motion.position[:5])
    assert len(surface(body="mesh")) == 5889
    assert surface(reflectivity=0.2).rcs.sum() == pytest.approx(0.5 * surface().rcs.sum())


def test_bodies_are_made_when_they_are_asked_for():
    """Who wants postures alone does not wait for surfaces; a simulator has them before its first frame."""
    person = Person(height=1.713)
    scene = Scene(people=(person,))
    figure = make_figure(person, scene.seed)
    World(scene).skeletons(np.zeros(1))
    assert "body" not in vars(figure)
    Simulator(scene)
    assert "body" in vars(figure)
