"""Motion captures on our skeleton: CMU's joints to the 22 bones, any time between frames."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from radar_core import DataError
from radar_sim.bodies.base import BONES, LEG, PARENTS
from radar_sim.bodies.subject import Subject, between
from radar_sim.motions.bvh import Bvh, about
from radar_sim.motions.carriage import Carriage
from radar_sim.motions.curves import window
from radar_sim.scatterers import Float64Array

_SIDES = (("l", "Left"), ("r", "Right"))
_LIMBS = {
    "clavicle": "Shoulder",
    "upperarm": "Arm",
    "lowerarm": "ForeArm",
    "hand": "Hand",
    "thigh": "UpLeg",
    "calf": "Leg",
    "foot": "Foot",
    "ball": "ToeBase",
}
JOINTS: Final[dict[str, str]] = {
    "pelvis": "Hips",
    "spine_01": "LowerBack",
    "spine_02": "Spine",
    "spine_03": "Spine1",
    "neck_01": "Neck",
    "head": "Head",
} | {f"{bone}_{side}": name + joint for side, name in _SIDES for bone, joint in _LIMBS.items()}
"""Joint of CMU's skeleton that turns each of our bones."""
_OPTIONAL = ("spine_01", "spine_03", "neck_01", "head", "clavicle_l", "clavicle_r", "hand_l", "hand_r", "ball_l", "ball_r")
_NEXT = {
    "spine_01": "spine_02",
    "spine_02": "spine_03",
    "spine_03": "neck_01",
    "neck_01": "head",
} | {f"{a}_{s}": f"{b}_{s}" for s in "lr" for a, b in (("clavicle", "upperarm"), ("upperarm", "lowerarm"), ("lowerarm", "hand"),
                                                       ("thigh", "calf"), ("calf", "foot"), ("foot", "ball"))}  # fmt: skip
"""Bone that each bone points to; the others point to the joint's End Site, or go with the bone before."""
BLEND = 0.5
"""A capture comes in and goes out within that time [s]."""
_FLOOR = 5.0  # percentile of the lower ankle's height that is taken as standing


class Capture:
    """A motion capture, turned and scaled to fit a subject.

    Bones point where the capture's point: a bone's rest pose there (T-pose, say) and here (arms half raised) differ by the smallest
    rotation between its two directions. The capture is scaled so that its legs are as long as the subject's, and lowered or raised so that
    the lower foot usually stands on the floor. Bones without a joint go with the bone before.

    Parameters
    ----------
    bvh : Bvh
        Y up; facing any way at rest.
    subject : Subject
        Whose skeleton.

    Raises
    ------
    DataError
        When joints are missing that cannot be done without.
    """

    def __init__(self, bvh: Bvh, subject: Subject) -> None:
        self._interval, self.duration = bvh.interval, bvh.duration  # of all [s]
        index = {joint.name: i for i, joint in enumerate(bvh.joints)}
        missing = [name for bone, name in JOINTS.items() if name not in index and bone not in _OPTIONAL]
        if missing:
            raise DataError(f"{bvh.source}, line {bvh.joints[0].line}: the skeleton has no {', '.join(missing)}; joints need CMU's names")
        place = _rest_places(bvh)
        axes = _axes(place[index["LeftUpLeg"]] - place[index["RightUpLeg"]])
        rotation = self._bones(bvh, index, axes, subject)
        scale = _leg(subject) / _length(bvh, index)
        root = scale * bvh.root @ axes.T
        self.travel = root[:, :2] - root[0, :2]
        # The file's hip joints tell where the pelvis is: its own Hips lie higher or lower than our pelvis.
        hips = 0.5 * (place[index["LeftUpLeg"]] + place[index["RightUpLeg"]]) - place[index["Hips"]]
        pelvis = rotation[:, 0]
        ours = subject.joint[[BONES.index("thigh_l"), BONES.index("thigh_r")]].mean(0) - subject.joint[0]
        height = root[:, 2] + (pelvis @ (scale * axes @ hips))[:, 2] - (pelvis @ ours)[:, 2] - subject.joint[0, 2]
        self.height = height - self._float(rotation, height, subject)
        self.yaw = np.unwrap(np.arctan2(pelvis[:, 1, 0], pelvis[:, 0, 0]))
        upright = about(2, -self.yaw)[:, None] @ rotation
        self._quaternion = _continuous(Rotation.from_matrix(upright.reshape(-1, 3, 3)).as_quat().reshape(*upright.shape[:2], 4))

    def at(self, time: float) -> tuple[float, float, float, float]:
        """Travel x and y, height [m] and yaw [rad] at a time [s]."""
        at = min(max(time / self._interval, 0.0), len(self.yaw) - 1.0)
        row = min(int(at), max(len(self.yaw) - 2, 0))
        after, share = min(row + 1, len(self.yaw) - 1), at - row
        x, y = self.travel[row] + share * (self.travel[after] - self.travel[row])
        height = self.height[row] + share * (self.height[after] - self.height[row])
        return float(x), float(y), float(height), float(self.yaw[row] + share * (self.yaw[after] - self.yaw[row]))

    def rotation(self, times: Float64Array) -> Float64Array:
        """Rotation of every bone from rest to the person's frame, shape (T, 22, 3, 3), at times of the capture, shape (T,) [s].

        Between frames quaternions turn at an even rate (Shoemake 1985): velocities jump at the file's frames, places do not.
        """
        at = np.clip(times / self._interval, 0.0, len(self.yaw) - 1)
        row = np.minimum(at.astype(int), max(len(self.yaw) - 2, 0))
        a, b = self._quaternion[row], self._quaternion[np.minimum(row + 1, len(self.yaw) - 1)]
        share = (at - row)[:, None]
        angle = np.arccos(np.clip((a * b).sum(-1), -1.0, 1.0))
        scale = np.maximum(np.sin(angle), 1e-9)
        small = angle < 1e-4
        first = np.where(small, 1 - share, np.sin((1 - share) * angle) / scale)
        second = np.where(small, share, np.sin(share * angle) / scale)
        return _matrices(first[..., None] * a + second[..., None] * b)

    def _bones(self, bvh: Bvh, index: dict[str, int], axes: Float64Array, subject: Subject) -> Float64Array:
        """Rotation of every bone from our rest pose, along our axes, shape (n_frame, 22, 3, 3)."""
        n = len(bvh.root)
        whole = np.empty_like(bvh.rotation)
        for i, joint in enumerate(bvh.joints):
            whole[:, i] = bvh.rotation[:, i] if joint.parent < 0 else whole[:, joint.parent] @ bvh.rotation[:, i]
        rotation = np.empty((n, len(BONES), 3, 3))
        fit = np.tile(np.eye(3), (len(BONES), 1, 1))
        for i, bone in enumerate(BONES):
            if JOINTS[bone] not in index:
                rotation[:, i] = rotation[:, PARENTS[i]]
                continue
            row = index[JOINTS[bone]]
            theirs, ours = _their_direction(bvh, index, bone), _our_direction(subject, bone)
            if theirs is not None and ours is not None:
                fit[i] = between(ours, axes @ theirs)
            elif i:
                fit[i] = fit[PARENTS[i]]
            rotation[:, i] = axes @ whole[:, row] @ axes.T @ fit[i]
        return rotation

    def _float(self, rotation: Float64Array, height: Float64Array, subject: Subject) -> float:
        """How far the lower ankle is usually over where it is at rest [m]."""
        ankles = []
        for side in "lr":
            chain = [BONES.index(name) for name in ("pelvis", f"thigh_{side}", f"calf_{side}", f"foot_{side}")]
            up = subject.joint[0, 2] + height
            for bone, child in pairwise(chain):
                up = up + (rotation[:, bone] @ (subject.joint[child] - subject.joint[bone]))[:, 2]
            ankles.append(up - subject.joint[chain[-1], 2])
        return float(np.percentile(np.minimum(*ankles), _FLOOR))


class Playing:
    """A capture as a step of a script: it comes in and goes out softly, from and to standing at ease.

    The part of the capture from ``begin`` for ``duration`` [s]; ``travel``: whether the person, of that height [m], goes where it goes.
    """

    def __init__(self, start: Carriage, capture: Capture, begin: float, duration: float, travel: bool, height: float) -> None:
        self._start, self._capture, self._begin, self._duration = start, capture, begin, duration
        self._leg = LEG * height
        n = max(2, math.ceil(duration / 0.008)) + 1
        self._times = np.linspace(0.0, duration, n)
        states = np.array([capture.at(begin + t) for t in self._times.tolist()])
        weight = np.array([self.weight(t) for t in (0.5 * (self._times[1:] + self._times[:-1])).tolist()])
        # Rates, not places, come in softly: a capture may begin in the middle of a step.
        yaw = np.diff(states[:, 3])
        heading = start.heading + np.concatenate([[0.0], np.cumsum(weight * yaw)])
        turn = 0.5 * (heading[1:] + heading[:-1]) - 0.5 * (states[1:, 3] + states[:-1, 3])
        dx, dy = np.diff(states[:, 0]), np.diff(states[:, 1])
        c, s = weight * travel * np.cos(turn), weight * travel * np.sin(turn)
        x = start.x + np.concatenate([[0.0], np.cumsum(c * dx - s * dy)])
        y = start.y + np.concatenate([[0.0], np.cumsum(s * dx + c * dy)])
        self._way = np.stack([x, y, heading], -1)

    @property
    def end(self) -> Carriage:
        """How the person stands afterwards."""
        x, y, heading = self._way[-1].tolist()
        return self._start._replace(x=x, y=y, heading=heading)

    def weight(self, time: float) -> float:
        """Share of the capture in what the body does, 0..1."""
        return window(time, self._duration, BLEND)

    def at(self, time: float) -> Carriage:
        """Place and pelvis ``time`` seconds after the start; the rest is as in standing at ease."""
        u = min(max(time / self._duration, 0.0), 1.0) * (len(self._times) - 1)
        row = min(int(u), len(self._times) - 2)
        x, y, heading = (self._way[row] + (u - row) * (self._way[row + 1] - self._way[row])).tolist()
        raised = self.weight(time) * self._capture.at(self._begin + time)[2] / self._leg
        return self._start._replace(x=x, y=y, heading=heading, pelvis=(0.0, 0.0, raised))

    def rotation(self, times: Float64Array, standing: Float64Array | None) -> Float64Array:
        """Rotation of every bone, shape (T, 22, 3, 3), at times (T,) since the start [s], mixed with that of ``standing`` if given."""
        played = self._capture.rotation(self._begin + times)
        if standing is None:
            return played
        base = Rotation.from_matrix(standing.reshape(-1, 3, 3))
        step = (base.inv() * Rotation.from_matrix(played.reshape(-1, 3, 3))).as_rotvec()
        weight = np.repeat([self.weight(time) for time in times.tolist()], len(BONES))
        return np.asarray((base * Rotation.from_rotvec(weight[:, None] * step)).as_matrix().reshape(played.shape))


def _rest_places(bvh: Bvh) -> Float64Array:
    """Joints of the file's rest pose from its root, shape (n_joint, 3)."""
    place = np.zeros((len(bvh.joints), 3))
    for i, joint in enumerate(bvh.joints):
        if joint.parent >= 0:
            place[i] = place[joint.parent] + joint.offset
    return place


def _axes(left: Float64Array) -> Float64Array:
    """Rotation from the file's axes, Y up, to ours, x forward, where ``left`` points to the skeleton's left at rest."""
    aside = np.array([left[0], 0.0, left[2]])
    length = float(np.sqrt(aside @ aside))
    aside = aside / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    up = np.array([0.0, 1.0, 0.0])
    return np.stack([np.cross(aside, up), aside, up])


def _leg(subject: Subject) -> float:
    chain = subject.joint[[BONES.index(name) for name in ("thigh_l", "calf_l", "foot_l")]]
    return float(np.sqrt((np.diff(chain, axis=0) ** 2).sum(-1)).sum())


def _length(bvh: Bvh, index: dict[str, int]) -> float:
    """Thigh and shank in the file's units."""
    length = sum(math.hypot(*bvh.joints[index[name]].offset) for name in ("LeftLeg", "LeftFoot"))
    if length <= 0.0:
        line = bvh.joints[index["LeftLeg"]].line
        raise DataError(f"{bvh.source}, line {line}: LeftLeg and LeftFoot have no offset, so nothing tells how large the skeleton is")
    return length


def _their_direction(bvh: Bvh, index: dict[str, int], bone: str) -> Float64Array | None:
    """Where a bone points in the file's rest pose; None: nowhere."""
    along: tuple[float, float, float] | None = None
    if bone in _NEXT and JOINTS[_NEXT[bone]] in index:
        place = _rest_places(bvh)
        step = place[index[JOINTS[_NEXT[bone]]]] - place[index[JOINTS[bone]]]
        along = (float(step[0]), float(step[1]), float(step[2]))
    elif bone != "pelvis":
        along = bvh.joints[index[JOINTS[bone]]].tip
    length = 0.0 if along is None else math.hypot(*along)
    return np.array(along) / length if length > 0.0 else None


def _our_direction(subject: Subject, bone: str) -> Float64Array | None:
    """Where a bone points in our rest pose."""
    if bone in _NEXT:
        step = subject.joint[BONES.index(_NEXT[bone])] - subject.joint[BONES.index(bone)]
    elif bone.startswith("hand"):
        step = subject.hand["lr".index(bone[-1])] - subject.joint[BONES.index(bone)]
    elif bone == "head":
        step = np.array([0.0, 0.0, 1.0])
    elif bone.startswith("ball"):
        step = np.array([1.0, 0.0, 0.0])
    else:
        return None
    return np.asarray(step / np.sqrt(step @ step))


def _continuous(quaternion: Float64Array) -> Float64Array:
    """Choose signs so that neighbours in time are on the same side, shape (n_frame, n, 4)."""
    flips = np.where((quaternion[1:] * quaternion[:-1]).sum(-1) < 0, -1.0, 1.0)
    quaternion[1:] *= np.cumprod(flips, axis=0)[..., None]
    return quaternion


def _matrices(q: Float64Array) -> Float64Array:
    """Rotations of quaternions (x, y, z, w), shape (..., 4), about normalised."""
    q = q / np.sqrt((q * q).sum(-1, keepdims=True))
    turn = np.empty((*q.shape[:-1], 3, 3))
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    turn[..., 0, 0], turn[..., 1, 1], turn[..., 2, 2] = 1 - 2 * (y * y + z * z), 1 - 2 * (x * x + z * z), 1 - 2 * (x * x + y * y)
    turn[..., 0, 1], turn[..., 1, 0] = 2 * (x * y - z * w), 2 * (x * y + z * w)
    turn[..., 0, 2], turn[..., 2, 0] = 2 * (x * z + y * w), 2 * (x * z - y * w)
    turn[..., 1, 2], turn[..., 2, 1] = 2 * (y * z - x * w), 2 * (y * z + x * w)
    return turn
