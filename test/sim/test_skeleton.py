"""Skeleton: lengths of bones, reach, joints and turns, whatever it is asked for."""

from dataclasses import replace

import numpy as np
import pytest
from anatomy import FLIP, bone
from figures import GESTURES, HANGING, posture
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_sim.bodies.base import LEG, PARENTS, REACH
from radar_sim.bodies.skeleton import STRAIGHT
from radar_sim.bodies.subject import MIRROR

SMALL = st.floats(-0.5, 0.5)
POINT = st.tuples(*[st.floats(-1.2, 1.2)] * 3)


@settings(max_examples=60, deadline=None)
@given(
    hands=st.tuples(POINT, POINT), feet=st.tuples(POINT, POINT), trunk=st.tuples(SMALL, SMALL, SMALL), pelvis=st.tuples(SMALL, SMALL, SMALL)
)
def test_bones_keep_their_lengths_whatever_is_asked(skeleton, hands, feet, trunk, pelvis):
    """Every bone's head is where its parent's rotation puts it, and rotations are rotations."""
    pose = skeleton.pose(posture(hands, n=1, feet=feet, trunk=trunk, pelvis=pelvis, head=(0.4, -0.3), heading=0.7))
    rest, joint, rotation = skeleton.subject.joint, pose.joint[0], pose.rotation[0]
    np.testing.assert_allclose(rotation @ rotation.swapaxes(-1, -2), np.tile(np.eye(3), (22, 1, 1)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0, atol=1e-9)
    for b, parent in enumerate(PARENTS):
        if parent >= 0:
            np.testing.assert_allclose(joint[b], rotation[parent] @ (rest[b] - rest[parent]) + joint[parent], atol=1e-9)
            assert np.linalg.norm(joint[b] - joint[parent]) == pytest.approx(np.linalg.norm(rest[b] - rest[parent]), abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(hands=st.tuples(POINT, POINT), trunk=st.tuples(SMALL, SMALL, SMALL))
def test_hands_reach_what_is_within_reach(skeleton, hands, trunk):
    """To 1 mm where reachable (rounding, in truth); else the hand is on the straight way there, as far as the arm goes."""
    pose = skeleton.pose(posture(hands, n=1, trunk=trunk))
    reach = REACH * 1.75
    for i, side in enumerate("lr"):
        shoulder = pose.joint[0, bone(f"upperarm_{side}")]
        wanted, got = np.asarray(hands[i]) * reach, pose.hand[0, i] - shoulder
        distance = np.linalg.norm(wanted)
        if 0.06 * reach < distance < STRAIGHT * reach:
            assert np.linalg.norm(got - wanted) < 1e-3
        elif distance >= STRAIGHT * reach:
            np.testing.assert_allclose(got, wanted * (STRAIGHT * reach / distance), atol=1e-9)


def test_elbows_point_down_outwards_and_back(skeleton):
    """The elbow against the line from shoulder to hand: below for arms held forward, behind for hanging ones, outside for both."""
    for hands, down in (((0.7, 0.0, 0.0), True), (HANGING, False)):
        joint = skeleton.pose(posture((hands, hands), n=1)).joint[0]
        for side, sign in (("l", 1), ("r", -1)):
            shoulder, elbow = joint[bone(f"upperarm_{side}")], joint[bone(f"lowerarm_{side}")]
            off = elbow - shoulder
            line = np.asarray(hands) / np.linalg.norm(hands)
            off = off - (off @ line) * line
            assert off[1] * sign > 0.01
            assert (off[2] if down else off[0]) < -0.05


def test_nothing_jumps_when_the_hand_moves_evenly(skeleton):
    """Along closed paths all around the front of the body the elbow moves no faster than a few times the hand."""
    t = np.linspace(0, 2 * np.pi, 2001)
    rng = np.random.default_rng(4)
    for _ in range(10):
        a, b = rng.normal(size=(2, 3)) * 0.35
        path = np.array([0.45, 0.1, -0.1]) + np.outer(np.cos(t), a) + np.outer(np.sin(t), b)
        path *= np.maximum(1.0, 0.25 / np.linalg.norm(path, axis=1))[:, None]  # not through the shoulder
        want = posture(n=len(t))
        want.hands[:, 0], want.hands[:, 1] = path, path * FLIP
        pose = skeleton.pose(want)
        elbow = np.linalg.norm(np.diff(pose.joint[:, [bone("lowerarm_l"), bone("lowerarm_r")]], axis=0), axis=-1)
        hand = np.linalg.norm(np.diff(pose.hand, axis=0), axis=-1)
        # a nearly straight arm folds at d(elbow)/d(reach) = 1 / tan(a few degrees), so single steps are held to 30 times the fastest hand
        assert elbow.max() < 30 * hand.max()
        assert np.abs(np.diff(elbow, axis=0)).max() < 30 * hand.max()


def test_arms_of_both_sides_mirror_each_other(skeleton):
    """A mirrored posture gives the mirrored pose."""
    left = posture(
        ((0.7, -0.4, 0.3), (0.2, 0.1, -0.9)), n=1, trunk=(0.2, 0.1, -0.3), head=(0.3, 0.1), feet=((0.3, 0.0, 0.1), (-0.2, 0, 0.05))
    )
    right = replace(
        left,
        hands=left.hands[:, ::-1] * FLIP,
        feet=left.feet[:, ::-1] * FLIP,
        trunk=left.trunk * (1, -1, -1),
        head=left.head * (-1, 1),
    )
    a, b = skeleton.pose(left), skeleton.pose(right)
    np.testing.assert_allclose(a.joint[:, list(MIRROR)] * FLIP, b.joint, atol=1e-9)
    np.testing.assert_allclose(a.hand[:, ::-1] * FLIP, b.hand, atol=1e-9)


def test_trunk_and_head_turn_the_way_they_say(skeleton):
    """Pitch brings the head forward, roll to the left; twist takes the left shoulder back; a turned head looks left."""
    straight = skeleton.pose(posture(n=1)).joint[0]

    def moved(**more):
        return skeleton.pose(posture(n=1, **more)).joint[0] - straight

    assert moved(trunk=(0.3, 0, 0))[bone("head"), 0] > 0.1
    assert moved(trunk=(0, 0.3, 0))[bone("head"), 1] > 0.1
    assert moved(trunk=(0, 0, 0.3))[bone("upperarm_l"), 0] < -0.03
    assert np.abs(moved(trunk=(0.3, 0.2, 0.1))[[bone(n) for n in ("pelvis", "thigh_l", "foot_r", "ball_l")]]).max() < 1e-9
    head = skeleton.pose(posture(n=1, head=(0.5, 0.2))).rotation[0, bone("head")]
    nose = head @ (1.0, 0.0, 0.0)
    assert np.arctan2(nose[1], nose[0]) == pytest.approx(0.5)
    assert np.arcsin(nose[2]) == pytest.approx(-0.2)


def test_standing_is_upright_at_full_stature(skeleton, mesh):
    """Feet flat on the floor and the top of the head at the stature; the centre is a bit above half of it."""
    pose = skeleton.pose(posture(n=1))
    z = mesh.vertices(pose)[:, 2]
    assert z.min() == pytest.approx(0.0, abs=0.005)
    assert z.max() == pytest.approx(1.75, abs=0.001)
    assert pose.centre[0, 2] == pytest.approx(0.67 * 1.75, abs=0.02)
    assert np.abs(pose.centre[0, :2]).max() < 0.02


def test_legs_follow_feet_and_pelvis(skeleton):
    """Ankles go where they are wanted, knees bend forward, feet stay flat on the floor and hang in the air; sitting lowers the pelvis."""
    rest = skeleton.pose(posture(n=1))
    leg = LEG * 1.75
    step = skeleton.pose(posture(n=1, feet=((0.25, 0.0, 0.1), (-0.2, 0.0, 0.0)), pelvis=(0, 0, -0.06)))
    for i, name in enumerate(("foot_l", "foot_r")):
        want = rest.joint[0, bone(name)] + np.array([(0.25, 0, 0.1), (-0.2, 0, 0.0)][i]) * leg
        np.testing.assert_allclose(step.joint[0, bone(name)], want, atol=1e-3)
    np.testing.assert_allclose(step.rotation[0, bone("foot_r")], np.eye(3), atol=1e-9)  # on the floor
    assert np.abs(step.rotation[0, bone("foot_l")] - np.eye(3)).max() > 0.02
    sit = skeleton.pose(posture(n=1, pelvis=(-0.35, 0.0, -0.45)))
    knee, hip, ankle = (sit.joint[0, bone(f"{n}_l")] for n in ("calf", "thigh", "foot"))
    assert knee[0] > hip[0] + 0.3
    assert knee[0] > ankle[0]
    assert hip[2] == pytest.approx(rest.joint[0, bone("thigh_l"), 2] - 0.45 * leg)


def test_place_and_heading_move_the_whole_person(skeleton):
    """A person turned by 90 degrees to the left who stood facing x faces y."""
    a, b = skeleton.pose(posture(GESTURES["push"], n=1)), skeleton.pose(posture(GESTURES["push"], (2.0, 1.0), np.pi / 2, n=1))
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(b.joint, a.joint @ turn.T + (2, 1, 0), atol=1e-9)
    np.testing.assert_allclose(b.hand, a.hand @ turn.T + (2, 1, 0), atol=1e-9)
    np.testing.assert_allclose(b.centre, a.centre @ turn.T + (2, 1, 0), atol=1e-9)


def test_motion_capture_takes_rotations_as_they_are(skeleton):
    """Rotations of a pose, given back as a capture at another place, give the same pose there."""
    first = skeleton.pose(posture(GESTURES["raised"], trunk=(0.2, 0, 0.1), n=2))
    again = skeleton.pose(replace(posture(n=2, place=(1.0, 2.0)), rotation=first.rotation))
    np.testing.assert_allclose(again.joint, first.joint + np.array([1, 2, 0]), atol=1e-9)
    np.testing.assert_allclose(again.hand, first.hand + np.array([1, 2, 0]), atol=1e-9)
