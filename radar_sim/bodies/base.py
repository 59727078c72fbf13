"""What bodies and motions agree on: postures, poses of the skeleton, surfaces and hulls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from radar_sim.scatterers import Float64Array, Hull, Scatterers

BONES = (
    "pelvis", "spine_01", "spine_02", "spine_03", "neck_01", "head",
    "clavicle_l", "upperarm_l", "lowerarm_l", "hand_l", "clavicle_r", "upperarm_r", "lowerarm_r", "hand_r",
    "thigh_l", "calf_l", "foot_l", "ball_l", "thigh_r", "calf_r", "foot_r", "ball_r",
)  # fmt: skip
"""Bones of the skeleton, parents first, as in the mesh's file."""
PARENTS = (-1, 0, 1, 2, 3, 4, 3, 6, 7, 8, 3, 10, 11, 12, 0, 14, 15, 16, 0, 18, 19, 20)
REACH = 0.386
"""Shoulder to the middle of the hand over stature (Drillis and Contini 1966): upper arm 0.186, forearm 0.146, half a hand 0.054."""
LEG = 0.53
"""Height of the hip over stature."""


@dataclass(frozen=True, eq=False)
class Posture:
    """What a motion asks of a body at T times; lengths are relative to the body, so that every subject can do it.

    The person's frame has its origin on the floor below the pelvis, x forward (heading), y left, z up. Sides are (left, right).
    """

    place: Float64Array  # origin of the person's frame in the room, shape (T, 2) [m]
    heading: Float64Array  # from the room's x towards its y, shape (T,) [rad]
    # Wanted middle of each hand from its shoulder, along the person's axes, in units of the arm's reach (`REACH` x stature): (T, 2, 3).
    hands: Float64Array
    # Wanted ankle of each foot from where it is when the person stands at ease, along the person's axes, in units of the leg (`LEG` x
    # stature): (T, 2, 3).
    feet: Float64Array
    # Shift of the pelvis from where it is when the person stands, likewise: down when sitting; (T, 3).
    pelvis: Float64Array
    trunk: Float64Array  # rotation of the trunk over the pelvis: forward pitch, roll to the left, twist to the left, shape (T, 3) [rad]
    head: Float64Array  # turn to the left and nod (down positive) of the head over the trunk, shape (T, 2) [rad]
    breath: Float64Array  # how far the front of the chest stands out from its mean, shape (T,) [m]
    # Motion capture: rotation of every bone from its rest pose to the person's frame, shape (T, 22, 3, 3); hands, feet, trunk and head
    # then do not count.
    rotation: Float64Array | None = None


@dataclass(frozen=True, eq=False)
class Pose:
    """A skeleton at T times, in ``room``.

    At rest feet are on z = 0, facing +x, with arms as in the mesh's file. A point x of the rest pose is now at
    ``rotation @ (x - rest_joint) + joint``.
    """

    joint: Float64Array  # head (the end nearer to the pelvis) of every bone, shape (T, 22, 3) [m]
    rotation: Float64Array  # of every bone from its rest pose, shape (T, 22, 3, 3)
    hand: Float64Array  # middle of the left and of the right hand, shape (T, 2, 3) [m]
    centre: Float64Array  # centre of the body: the middle between hips and shoulders, shape (T, 3) [m]
    breath: Float64Array  # as in `Posture`, shape (T,) [m]


class Body(Protocol):
    """A surface on a skeleton."""

    def surface(self, pose: Pose, span: float, owner: int) -> Scatterers:
        """Surface elements of the whole body, both sides of it, seen or not.

        Parameters
        ----------
        pose : Pose
            At T = 3 times: start, middle and end of the frame.
        span : float
            From start to end [s].
        owner : int
            Index of the person in the scene.
        """
        ...

    def hull(self, pose: Pose) -> Hull:
        """Return what the body hides with, in the middle of the frame; not computed before it is called."""
        ...


def stand(times: NDArray[np.float64]) -> Posture:
    """Posture of standing at ease at the room's origin, facing +x, arms hanging."""
    n = len(times)
    hands = np.tile(np.array([[0.06, 0.0, -0.93]] * 2), (n, 1, 1))
    zeros = np.zeros
    return Posture(zeros((n, 2)), zeros(n), hands, zeros((n, 2, 3)), zeros((n, 3)), zeros((n, 3)), zeros((n, 2)), zeros(n))
