"""The skeleton: postures to poses; limbs of two links, with elbow and knee in closed form."""

from __future__ import annotations

from typing import Final

import numpy as np

from radar_sim.bodies.base import BONES, LEG, PARENTS, REACH, Pose, Posture
from radar_sim.bodies.subject import Subject
from radar_sim.scatterers import Float64Array

STRAIGHT = 0.999
"""Limbs are never quite straight: share of both links' length that a limb can reach."""
FOLDED = 1.05
"""Nor quite folded: how many times the links' difference a hand keeps away from its shoulder."""


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

    Arms and legs are solved by inverse kinematics (see `bend`): elbows point down, outwards and back, knees
    forward. The hand goes on in line with the forearm. What is wanted out of reach becomes the nearest within; a foot that comes off the
    floor that way hangs.
    """

    def __init__(self, subject: Subject) -> None:
        self.subject = subject
        joint, stature = subject.joint, subject.stature
        self._arm, self._leg = REACH * stature, LEG * stature
        self._ancestors = np.eye(len(BONES))  # sums what belongs to a bone and all bones before it, up to the pelvis
        for bone, parent in enumerate(PARENTS[1:], 1):
            self._ancestors[bone] += self._ancestors[parent]
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
        """Pose the skeleton, in ``room``, at the posture's T times."""
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
        return np.asarray(self._ancestors @ steps)

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
    return np.asarray(np.arctan2(-shank[..., 0], -shank[..., 2]))


def bend(
    target: Float64Array, upper: Float64Array, lower: Float64Array, rest: Float64Array, pole: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Solve the inverse kinematics of limbs of two links by the law of cosines.

    The middle joint lies in the plane of the target and a pole. The pole is known for one direction of the limb, at rest, and goes along
    with the limb by the smallest rotation from there. So it turns evenly with the limb everywhere but against the rest direction, where
    no hand and no foot gets to; a fixed pole would make elbows swing round wherever a hand passes by it.

    Parameters
    ----------
    target : ndarray, shape (..., n, 3)
        Wanted ends from the limbs' roots [m]; one out of reach becomes the nearest within, in the same direction.
    upper, lower : ndarray, shape (n,)
        Lengths of the links [m].
    rest, pole : ndarray, shape (n, 3)
        A direction of the limb, and where its middle joint points then; unit vectors across one another.

    Returns
    -------
    tuple of ndarray, shape (..., n, 3)
        Directions of both links, and the axis they bend about; unit vectors.
    """
    wanted = np.sqrt((target * target).sum(-1, keepdims=True))
    axis = np.where(wanted > 1e-9, target / np.maximum(wanted, 1e-9), rest)
    a, b = upper[:, None], lower[:, None]
    distance = np.minimum(np.maximum(wanted, FOLDED * np.abs(a - b)), STRAIGHT * (a + b))
    turned = (pole * axis).sum(-1, keepdims=True) / np.maximum(1.0 + (rest * axis).sum(-1, keepdims=True), 1e-9)
    across = pole - turned * (rest + axis)
    # Against the rest direction there is no smallest rotation; the projection keeps the pole across the limb, however near to there.
    across -= (across * axis).sum(-1, keepdims=True) * axis
    across /= np.sqrt((across * across).sum(-1, keepdims=True))
    along = (a * a + distance * distance - b * b) / (2.0 * distance)
    aside = np.sqrt(np.maximum(a * a - along * along, 0.0))
    first = (along / a) * axis + (aside / a) * across
    second = ((distance - along) / b) * axis - (aside / b) * across
    return first, second, cross(across, axis)


def cross(a: Float64Array, b: Float64Array) -> Float64Array:
    """Cross product of vectors, shape (..., 3); several times faster than numpy's for few of them."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def frame(direction: Float64Array, axis: Float64Array) -> Float64Array:
    """Rotations (..., 3, 3) whose columns are a direction, an axis across it, and the cross product of both; unit vectors (..., 3)."""
    columns = np.empty((*direction.shape, 3))
    columns[..., 0] = direction
    columns[..., 1] = axis
    columns[..., 2] = cross(direction, axis)
    return columns


def turns(angles: Float64Array) -> Float64Array:
    """Rotations by pitch (forward), then roll (to the left), then twist (to the left), Rz(twist) @ Ry(pitch) @ Rx(-roll).

    Parameters
    ----------
    angles : ndarray, shape (..., 3)
        Pitch, roll and twist [rad].
    """
    c, s = np.cos(angles), np.sin(angles)
    cp, cr, ct = c[..., 0], c[..., 1], c[..., 2]
    sp, sr, st = s[..., 0], -s[..., 1], s[..., 2]
    turn = np.empty((*angles.shape, 3))
    turn[..., 0, 0] = ct * cp
    turn[..., 0, 1] = ct * sp * sr - st * cr
    turn[..., 0, 2] = ct * sp * cr + st * sr
    turn[..., 1, 0] = st * cp
    turn[..., 1, 1] = st * sp * sr + ct * cr
    turn[..., 1, 2] = st * sp * cr - ct * sr
    turn[..., 2, 0] = -sp
    turn[..., 2, 1] = cp * sr
    turn[..., 2, 2] = cp * cr
    return turn
