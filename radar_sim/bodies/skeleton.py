"""The skeleton: postures to poses."""

from __future__ import annotations

from typing import Final

import numpy as np

from radar_sim.bodies.base import BONES, LEG, PARENTS, REACH, Pose, Posture
from radar_sim.bodies.limbs import bend, frame, turns
from radar_sim.bodies.subject import Subject, ancestors
from radar_sim.scatterers import Float64Array


def _index(*names: str) -> list[int]:
    return [BONES.index(name) for name in names]


_SPINE = _index("spine_01", "spine_02", "spine_03")
_NECK, _HEAD, _CHEST, _PELVIS = _index("neck_01", "head", "spine_03", "pelvis")
_CLAVICLES = _index("clavicle_l", "clavicle_r")
# limbs in the order left arm, right arm, left leg, right leg
_ROOT = _index("upperarm_l", "upperarm_r", "thigh_l", "thigh_r")
_MIDDLE = _index("lowerarm_l", "lowerarm_r", "calf_l", "calf_r")
_HANDS, _FEET, _BALLS = _index("hand_l", "hand_r"), _index("foot_l", "foot_r"), _index("ball_l", "ball_r")
_SHARES: Final = np.array([1.0, 2.0, 3.0])[:, None] / 3
"""How much of the trunk's rotation each bone of the spine has made: it bends evenly."""
_HEAD_SHARES: Final = np.array([[0.5], [1.0]])
_STANCE = 0.065
"""Ankles beside the middle over stature, when standing at ease."""
_PEEL = 0.12
"""Lifted so far (in legs), a foot hangs from its shank; on the floor it is flat."""


class Skeleton:
    """Poses of one subject.

    Arms and legs are solved by inverse kinematics (see `radar_sim.bodies.limbs.bend`): elbows point down, outwards and back, knees
    forward. The hand goes on in line with the forearm. What is wanted out of reach becomes the nearest within; a foot that comes off the
    floor that way hangs.

    Parameters
    ----------
    subject : Subject
        Whose.

    Attributes
    ----------
    subject : Subject
        Whose.
    """

    def __init__(self, subject: Subject) -> None:
        self.subject = subject
        joint, stature = subject.joint, subject.stature
        self._arm, self._leg = REACH * stature, LEG * stature
        self._ancestors = ancestors()
        self._parents = np.array([max(parent, 0) for parent in PARENTS])
        self._offset = joint - joint[self._parents]
        self._offset[_PELVIS] = joint[_PELVIS]
        self._palm = subject.hand - joint[_HANDS]
        ends = np.concatenate([subject.hand, joint[_FEET]])
        links = joint[_MIDDLE] - joint[_ROOT], ends - joint[_MIDDLE]
        self._lengths = [np.sqrt((link**2).sum(-1)) for link in links]
        first, second = (link / length[:, None] for link, length in zip(links, self._lengths, strict=True))
        hinge = np.cross(first, second)
        hinge /= np.sqrt((hinge**2).sum(-1, keepdims=True))
        self._rest = np.stack([frame(first, hinge), frame(second, hinge)]).swapaxes(-1, -2)
        self._shank_pitch = _pitch(second[2:])
        root = joint[_ROOT]
        self._hips = root[2:]
        self._ankles = joint[_FEET].copy()
        self._ankles[:, 1] = (_STANCE * stature, -_STANCE * stature)
        # An arm held forward and down has its elbow back, down and outwards; a leg that hangs has its knee in front.
        h = np.sqrt(0.5)
        self._direction = np.array([[h, 0.0, -h], [h, 0.0, -h], [0.0, 0.0, -1.0], [0.0, 0.0, -1.0]])
        self._pole = np.array([[-0.8 * h, 0.6, -0.8 * h], [-0.8 * h, -0.6, -0.8 * h], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])

    def pose(self, posture: Posture) -> Pose:
        """Pose the skeleton.

        Parameters
        ----------
        posture : Posture
            At T times.

        Returns
        -------
        Pose
            In ``room``.
        """
        rotation = self._solve(posture) if posture.rotation is None else posture.rotation
        local = self._joints(rotation, posture.pelvis)
        c, s, zero = np.cos(posture.heading), np.sin(posture.heading), np.zeros(len(posture.heading))
        # row vectors: x_room = x @ turn.T + place
        turn = np.array([[c, -s, zero], [s, c, zero], [zero, zero, zero + 1.0]]).transpose(2, 0, 1)
        joint = local @ turn.swapaxes(-1, -2)
        joint[..., :2] += posture.place[:, None, :]
        turned = turn[:, None] @ rotation
        hand = joint[:, _HANDS] + (turned[:, _HANDS] @ self._palm[..., None])[..., 0]
        return Pose(joint, turned, hand, joint[:, _ROOT].mean(1), posture.breath)

    def _joints(self, rotation: Float64Array, pelvis: Float64Array) -> Float64Array:
        """Forward kinematics in the person's frame, shape (T, 22, 3) [m]."""
        steps = (rotation[:, self._parents] @ self._offset[..., None])[..., 0]
        steps[:, _PELVIS] = self._offset[_PELVIS] + pelvis * self._leg
        joint: Float64Array = self._ancestors @ steps
        return joint

    def _solve(self, posture: Posture) -> Float64Array:
        """Rotation of every bone from rest to the person's frame, shape (T, 22, 3, 3)."""
        n = len(posture.heading)
        rotation = np.empty((n, len(BONES), 3, 3))
        rotation[:, _PELVIS] = np.eye(3)
        rotation[:, _SPINE] = turns(posture.trunk[:, None, :] * _SHARES)
        nod = np.zeros((n, 2, 3))
        nod[..., [2, 0]] = posture.head[:, None, :] * _HEAD_SHARES
        chest = rotation[:, _CHEST]
        rotation[:, [_NECK, _HEAD]] = chest[:, None] @ turns(nod)
        rotation[:, _CLAVICLES] = chest[:, None]
        hips = self._hips + (posture.pelvis * self._leg)[:, None]
        ankles = self._ankles + posture.feet * self._leg
        target = np.concatenate([posture.hands * self._arm, ankles - hips], 1)
        upper, lower = self._lengths
        first, second, hinge = bend(target, upper, lower, self._direction, self._pole)
        rotation[:, _ROOT] = frame(first, hinge) @ self._rest[0]
        rotation[:, _MIDDLE] = frame(second, hinge) @ self._rest[1]
        rotation[:, _HANDS] = rotation[:, _MIDDLE[:2]]
        ankle = hips + upper[2:, None] * first[:, 2:] + lower[2:, None] * second[:, 2:]
        rotation[:, _FEET] = rotation[:, _BALLS] = self._feet(ankle, second[:, 2:])
        return rotation

    def _feet(self, ankle: Float64Array, shank: Float64Array) -> Float64Array:
        """Rotation of the feet, shape (T, 2, 3, 3): flat on the floor, hanging from the shank in the air."""
        lift = np.clip((ankle[..., 2] - self._ankles[:, 2]) / (_PEEL * self._leg), 0.0, 1.0)
        angles = np.zeros(shank.shape)
        angles[..., 0] = lift * lift * (3.0 - 2.0 * lift) * (_pitch(shank) - self._shank_pitch)
        return turns(angles)


def _pitch(shank: Float64Array) -> Float64Array:
    """By how much shanks (..., 3) are turned, ankle backwards, from hanging [rad]."""
    angle: Float64Array = np.arctan2(-shank[..., 0], -shank[..., 2])
    return angle
