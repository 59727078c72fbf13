"""Blender's body against the numpy body: skinning, inverse kinematics and rays.

It needs Blender as a Python module, whose environment is best kept apart (it wants numpy below 2):
``pip install 'handwave[blender]' pytest pytest-timeout`` with Python 3.11 or 3.13, then ``pytest test/sim/test_blender.py``.
"""

import gc
import sys

import numpy as np
import pytest
from figures import GESTURES, SPAN, posture

from radar_core import ConfigError, DataError
from radar_lab.blender import BlenderBody
from radar_sim.bodies.base import BONES, REACH, stand
from radar_sim.bodies.shadows import View
from radar_sim.bodies.skeleton import Skeleton
from radar_sim.bodies.skin import MeshBody, facets
from radar_sim.bodies.subject import Subject
from radar_sim.people import Person
from radar_sim.scatterers import Triangles

HOW = "needs Blender as a Python module: see the first lines of this file, or pip install 'handwave[blender]' with Python 3.11 or 3.13"
PEOPLE = {
    "usual": Person(),
    "slim woman": Person(height=1.6, sex="female", build=0.2),
    "tall heavy man": Person(height=1.95, build=1.0),
}
POSTURES = {
    **{name: posture(hands, n=1, place=(2.5, 0.3), heading=2.5) for name, hands in GESTURES.items()},
    "both arms up": posture(((0.1, 0.1, 0.95), (0.2, -0.2, 0.9)), n=1),
    "bent and twisted": posture(GESTURES["push"], n=1, trunk=(0.6, 0.2, -0.3), head=(0.4, 0.3), pelvis=(0.0, 0.0, -0.1)),
    "walking": posture(GESTURES["stand"], n=1, feet=((0.4, 0.0, 0.1), (-0.3, 0.0, 0.2)), breath=0.01, heading=-1.0),
    "sitting": posture(GESTURES["across"], n=1, pelvis=(-0.2, 0.0, -0.45), trunk=(0.2, 0.0, 0.0)),
}
RADAR = np.array([0.0, 0.0, 1.2])
FLOAT32 = 1e-5
"""What Blender's single precision leaves [m]: within 2 m of the pelvis 1e-7 m a number, some tens of operations along a limb. A
hundredth of the wanted millimetre."""


class Trio:
    """One subject as we pose it and as Blender does."""

    def __init__(self, person):
        self.subject = Subject.of(person)
        self.skeleton = Skeleton(self.subject)
        self.mesh = MeshBody(self.subject, 0.4)
        self.blender = BlenderBody(self.subject, 0.4)


@pytest.fixture(scope="module", params=PEOPLE)
def trio(request):
    pytest.importorskip("bpy", reason=HOW)
    made = Trio(PEOPLE[request.param])
    yield made
    made.blender.close()


@pytest.fixture(scope="module")
def usual():
    pytest.importorskip("bpy", reason=HOW)
    made = Trio(Person())
    yield made
    made.blender.close()


def bones(name):
    return [BONES.index(f"{name}_{side}") for side in "lr"]


def far(a, b):
    """Largest distance between corresponding points."""
    return np.linalg.norm(a - b, axis=-1).max()


def test_without_blender_the_message_names_the_extra(monkeypatch):
    """What is missing, how to get it, and what does without."""
    monkeypatch.setitem(sys.modules, "bpy", None)
    with pytest.raises(ConfigError, match=r"pip install 'handwave\[blender\]', with Python 3\.11 or 3\.13; the body 'mesh'"):
        BlenderBody(Subject.of(Person()), 0.4)


@pytest.mark.parametrize("name", POSTURES)
def test_skin_is_that_of_the_numpy_body(trio, name):
    """Same mesh, weights and bones: every vertex within 1 mm (wanted); rounding in truth."""
    pose = trio.skeleton.pose(POSTURES[name])
    assert far(trio.blender.vertices(pose), trio.mesh.vertices(pose)) < FLOAT32


@pytest.mark.parametrize("name", POSTURES)
def test_inverse_kinematics_of_blender_agree_with_ours(trio, name):
    """Hands within 1 mm and elbows within a few (wanted); Blender iterates until it rounds.

    An elbow is up to 11 times as wrong as its hand when the arm is at its straightest, 0.999 of its length: d(aside)/d(distance) =
    distance / (4 aside) for links of one length.
    """
    pose = trio.skeleton.pose(POSTURES[name])
    reached = trio.blender.reach(POSTURES[name])
    assert far(reached.pose.hand, pose.hand) < 1e-4
    assert far(reached.pose.joint[:, bones("lowerarm")], pose.joint[:, bones("lowerarm")]) < 1e-3
    assert far(reached.pose.joint, pose.joint) < 1e-3
    assert far(reached.vertices[0], trio.mesh.vertices(pose)) < 1e-3
    rotation = reached.pose.rotation
    # scale creeps in with every bone of the chain: 1e-5 of a bone is some micrometres
    np.testing.assert_allclose(rotation @ rotation.swapaxes(-1, -2), np.tile(np.eye(3), (1, 22, 1, 1)), atol=1e-4)


def test_hands_go_where_they_are_wanted_all_over_the_reach(usual):
    """From folded to beyond the reach, trunk bent and turned: in 60 draws at most 0.02 mm off, elbows 0.04 mm (300 draws: the same)."""
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(60, 2, 3))
    hands = direction / np.linalg.norm(direction, axis=-1, keepdims=True) * rng.uniform(0.05, 1.3, (60, 2, 1))
    asked = posture(n=60, heading=0.7)
    asked.hands[:], asked.trunk[:] = hands, rng.uniform(-0.5, 0.5, (60, 3))
    pose, reached = usual.skeleton.pose(asked), usual.blender.reach(asked).pose
    assert far(reached.hand, pose.hand) < 1e-4
    assert far(reached.joint[:, bones("lowerarm")], pose.joint[:, bones("lowerarm")]) < 1e-3
    # not by way of our own limbs: wanted = shoulder + heading turned
    c, s = np.cos(0.7), np.sin(0.7)
    wanted = hands @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T * (REACH * 1.75)
    got = reached.hand - reached.joint[:, bones("upperarm")]
    within = np.linalg.norm(hands, axis=-1)
    within = (within > 0.2) & (within < 0.99)
    assert within.mean() > 0.5
    assert far(got[within], wanted[within]) < 1e-4


def test_a_hand_wanted_at_the_shoulder_or_a_kilometre_away(usual):
    """The arm folds or stretches as ours does, and nothing overflows."""
    asked = posture(((0.0, 0.0, 0.0), (1500.0, 0.0, 0.0)), n=1)
    pose, reached = usual.skeleton.pose(asked), usual.blender.reach(asked).pose
    assert far(reached.hand, pose.hand) < 1e-4
    assert far(reached.joint, pose.joint) < 1e-3


def test_surface_of_a_moving_body_far_from_the_origin(usual):
    """Places are given to Blender relative to the pelvis: 140 m away it is as near, and speeds differ by rounding over the frame only."""
    asked = posture(GESTURES["push"], (99.0, -99.0), 1.0, feet=((0.2, 0.0, 0.1), (0.0, 0.0, 0.0)), breath=0.005)
    asked.hands[:, 1, 0] += 0.03 * np.arange(3)
    asked.place[:, 0] += 0.02 * np.arange(3)
    pose = usual.skeleton.pose(asked)
    ours, theirs = usual.mesh.surface(pose, SPAN, 4), usual.blender.surface(pose, SPAN, 4)
    assert far(theirs.motion.position, ours.motion.position) < FLOAT32
    assert np.linalg.norm(ours.motion.velocity, axis=1).max() > 2.0
    assert far(theirs.motion.velocity, ours.motion.velocity) < 2 * FLOAT32 / SPAN
    np.testing.assert_allclose(theirs.rcs.sum(), ours.rcs.sum(), rtol=1e-4)
    assert np.all(theirs.owner == 4)
    hulls = [body.hull(pose)().corner for body in (usual.mesh, usual.blender)]
    assert far(*hulls) < FLOAT32


@pytest.mark.parametrize("distance", [0.6, 2.5, 8.0])
@pytest.mark.parametrize("heading", [np.pi, 2.0, 0.0])
def test_rays_see_the_faces_that_shadows_leave(usual, distance, heading):
    """Same answer for at least 98.5 % of faces turned to the radar (wanted); found: for all, in 48 views."""
    for hands in GESTURES.values():
        vertices = usual.mesh.vertices(usual.skeleton.pose(posture(hands, (distance, 0.3), heading, n=1)))
        corners = vertices[usual.subject.faces]
        (centre,), normal, _ = facets(vertices[None], usual.subject.faces)
        front = ((RADAR - centre) * normal).sum(1) > 0
        seen = usual.blender.visible(vertices, RADAR)
        shadows = View(RADAR, np.eye(3), 0.005).look([Triangles(corners)]).visible(centre)
        assert not seen[~front].any()
        assert 0.3 < seen[front].mean() < 0.97
        assert (seen == shadows)[front].mean() >= 0.985


def test_bodies_share_nothing_and_leave_nothing_behind(usual):
    """A second body moves, and goes, without a trace; closed or forgotten, its data leave Blender's memory."""
    bpy = pytest.importorskip("bpy", reason=HOW)
    kinds = ("scenes", "objects", "meshes", "armatures", "shape_keys", "collections", "actions")

    def blocks():
        return [len(getattr(bpy.data, kind)) for kind in kinds]

    pose = usual.skeleton.pose(POSTURES["push"])
    before, count = usual.blender.vertices(pose), blocks()
    with BlenderBody(Subject.of(PEOPLE["slim woman"]), 0.4) as other:
        assert blocks() != count
        other.vertices(Skeleton(other.subject).pose(POSTURES["sitting"]))
        np.testing.assert_array_equal(usual.blender.vertices(pose), before)
    assert blocks() == count
    other.close()
    with pytest.raises(DataError, match="closed; make a new one"):
        other.vertices(pose)
    forgotten = BlenderBody(usual.subject, 0.4)
    assert blocks() != count
    del forgotten
    gc.collect()
    assert blocks() == count
    np.testing.assert_array_equal(usual.blender.vertices(pose), before)


def test_motion_capture_has_a_skin_but_wants_no_hands(usual):
    """Rotations pose the skeleton; inverse kinematics has nothing to reach for."""
    asked = posture(n=1, rotation=usual.skeleton.pose(POSTURES["bent and twisted"]).rotation[0])
    pose = usual.skeleton.pose(asked)
    assert far(usual.blender.vertices(pose), usual.mesh.vertices(pose)) < FLOAT32
    with pytest.raises(DataError, match="motion capture wants no hands"):
        usual.blender.reach(asked)


def test_no_times_give_no_poses(usual):
    """T = 0."""
    reached = usual.blender.reach(stand(np.zeros(0)))
    assert reached.vertices.shape == (0, len(usual.subject.vertices), 3)
    assert reached.pose.hand.shape == (0, 2, 3)
