"""The mesh body posed by Blender, as the thesis did (sections 5.2.1 and 5.2.2): a cross-check of our own skinning, limbs and shadows.

Blender as a Python module (`bpy`, GPL-3.0) is optional: `pip install 'handwave[blender]'` on Python 3.11 or 3.13. It is imported when the
first `BlenderBody` is made, not before. All of Blender's numbers are float32; places are given to it relative to the pelvis, so that what
it loses, about a micrometre, does not grow with the size of the room.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterable
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError
from radar_sim.bodies.base import BONES, PARENTS, REACH, Pose, Posture
from radar_sim.bodies.shadows import MARGIN
from radar_sim.bodies.skeleton import FOLDED, STRAIGHT, Skeleton
from radar_sim.bodies.skin import MeshBody, facets
from radar_sim.bodies.subject import Subject
from radar_sim.scatterers import Float64Array

_UPPER, _LOWER, _HAND = ([BONES.index(f"{name}_{side}") for side in "lr"] for name in ("upperarm", "lowerarm", "hand"))
_PELVIS = BONES.index("pelvis")
_START = np.pi / 3
"""Arms bend by so much before inverse kinematics begins [rad]: a straight arm does not know which way to bend."""
_ITERATIONS = 500


@dataclass(frozen=True, eq=False)
class Reached:
    """A body whose arms Blender's inverse kinematics posed, in ``room`` at T times."""

    pose: Pose  # as read back from Blender's armature
    vertices: Float64Array  # as read back from Blender's mesh, shape (T, n_vertex, 3) [m]


class BlenderBody(MeshBody):
    """A `MeshBody` that Blender poses: an armature of 22 bones deforms the same mesh with the same weights (linear blend skinning).

    Use it in a ``with`` statement, or call `close`: each body is a scene in Blender's memory. Bodies do not see each other.

    Parameters
    ----------
    subject : Subject
        Whose body.
    reflectivity : float
        Share of the power that skin and clothes reflect.

    Raises
    ------
    ConfigError
        When Blender is not installed.
    """

    def __init__(self, subject: Subject, reflectivity: float) -> None:
        super().__init__(subject, reflectivity)
        self._skeleton = Skeleton(subject)
        bpy, self._tree = blender()
        self._rig = Rig(bpy, subject, self._swell)
        self._close = weakref.finalize(self, self._rig.remove)
        self._close.atexit = False  # Blender has then gone already

    def __enter__(self) -> BlenderBody:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Remove the body from Blender's memory; a second time does nothing."""
        self._close()

    def reach(self, posture: Posture) -> Reached:
        """Pose the arms with Blender's inverse kinematics, all else with the skeleton.

        Each arm has an inverse kinematics constraint with two bones: shoulder to elbow, and elbow to the middle of the hand. Its target is
        the wanted hand, kept within the same reach as in the skeleton's own arms; its pole lies beyond the elbow of
        `radar_sim.bodies.skeleton.Skeleton`. How far the elbow bends, and how the arm turns, is Blender's answer. Raises `DataError` when
        the posture, at T times, comes from motion capture, which wants no hands, or the body is closed.
        """
        if posture.rotation is not None:
            raise DataError("BlenderBody.reach: a posture of motion capture wants no hands; pose its skeleton and use vertices")
        rig, subject = self._open(), self.subject
        guide = self._skeleton.pose(posture)
        target, pole = _targets(subject, posture, guide)
        joint, rotation, skin = np.empty_like(guide.joint), np.empty_like(guide.rotation), np.empty((len(target), *subject.vertices.shape))
        for t, origin in enumerate(guide.joint[:, _PELVIS]):
            rig.pose(guide.rotation[t], guide.joint[t] - origin, guide.breath[t])
            rig.aim(target[t] - origin, pole[t] - origin)
            skin[t] = rig.skin() + origin
            rotation[t], joint[t] = rig.bones()
            joint[t] += origin
        palm = subject.hand - subject.joint[_HAND]
        hand = joint[:, _HAND] + (rotation[:, _HAND] @ palm[..., None])[..., 0]
        return Reached(Pose(joint, rotation, hand, guide.centre, guide.breath), skin)

    def visible(self, vertices: Float64Array, radar: Float64Array) -> NDArray[np.bool_]:
        """Tell which faces, shape (n_face,), a radar sees, by casting a ray at the middle of each with Blender's BVH tree.

        A face is seen when it faces the radar and nothing is met more than `radar_sim.bodies.shadows.MARGIN` before it. The first condition
        is not implied by the second: at the rim a ray just reaches faces that look away. ``vertices``, shape (n_vertex, 3), and ``radar``,
        shape (3,), are in ``room`` [m].
        """
        away = vertices - radar
        centroid, normal, _ = facets(away[None], self.subject.faces)
        seen: NDArray[np.bool_] = (centroid[0] * normal).sum(1) < 0.0
        facing = np.flatnonzero(seen)
        distance = np.sqrt((centroid[0, facing] ** 2).sum(1))
        tree = self._tree.FromPolygons(away.tolist(), self.subject.faces.tolist(), all_triangles=True)
        rays = zip((centroid[0, facing] / distance[:, None]).tolist(), (distance - MARGIN).tolist(), strict=True)
        cast, start = tree.ray_cast, (0.0, 0.0, 0.0)
        seen[facing] = [cast(start, direction, far)[2] is None for direction, far in rays]
        return seen

    def _skin(self, pose: Pose) -> Float64Array:
        rig = self._open()
        moved = np.empty((len(pose.joint), *self.subject.vertices.shape))
        for t, origin in enumerate(pose.joint[:, _PELVIS]):
            rig.pose(pose.rotation[t], pose.joint[t] - origin, pose.breath[t])
            moved[t] = rig.skin() + origin
        return moved

    def _open(self) -> Rig:
        if not self._close.alive:
            raise DataError("BlenderBody: it is closed; make a new one")
        return self._rig


def blender(what: str = "BlenderBody", without: str = "the body 'mesh' is the same without it") -> tuple[Any, Any]:
    """Import `bpy` and `BVHTree` only where they are wanted: Blender is large, and its licence is not ours.

    Raises `ConfigError`, which says ``what`` needs Blender and what does ``without``, when it is not installed.
    """
    try:
        import bpy
        from mathutils.bvhtree import BVHTree  # there once bpy is imported
    except ImportError as error:
        raise ConfigError(
            f"{what} needs Blender as a Python module ({error}): pip install 'handwave[blender]', with Python 3.11 or 3.13; {without}"
        ) from None
    return bpy, BVHTree


def _targets(subject: Subject, posture: Posture, guide: Pose) -> tuple[Float64Array, Float64Array]:
    """Where hands are wanted and where elbows are to point, both (T, 2, 3) in ``room`` [m]."""
    c, s = np.cos(posture.heading)[:, None], np.sin(posture.heading)[:, None]
    x, y, z = np.moveaxis(posture.hands * (REACH * subject.stature), -1, 0)
    wanted = np.stack([c * x - s * y, s * x + c * y, z], -1)
    shoulder, elbow = guide.joint[:, _UPPER], guide.joint[:, _LOWER]
    upper = _length(subject.joint[_LOWER] - subject.joint[_UPPER])
    lower = _length(subject.hand - subject.joint[_LOWER])
    far = _length(wanted)
    straight = guide.hand - shoulder  # for a hand wanted at the shoulder any direction is as good
    axis = np.where(far > 1e-9, wanted / np.maximum(far, 1e-9), straight / _length(straight))
    reached = axis * np.clip(far, FOLDED * np.abs(upper - lower), STRAIGHT * (upper + lower))
    aside = elbow - shoulder
    aside = aside - (aside * axis).sum(-1, keepdims=True) * axis
    return shoulder + reached, shoulder + aside * (subject.stature / _length(aside))


def _length(vectors: Float64Array) -> Float64Array:
    length: Float64Array = np.sqrt((vectors**2).sum(-1, keepdims=True))
    return length


class Rig:
    """One body in Blender: mesh, armature, targets and poles of the arms; in a ``scene`` of its own, or in one that is given."""

    def __init__(self, bpy: Any, subject: Subject, swell: Float64Array, scene: Any = None) -> None:
        self._bpy = bpy
        self._scene = bpy.data.scenes.new("body") if scene is None else scene
        self._layer = self._scene.view_layers[0]
        self.armature = self._arm(subject)
        self.mesh = self._cover(subject, swell)
        names = ("hand_l", "hand_r", "elbow_l", "elbow_r")
        self._aims = [self._add(bpy.data.objects.new(name, None)) for name in names]
        self._constraints = [self._constrain(i) for i in range(2)]
        self._layer.update()
        self._flat = np.empty(subject.vertices.size, np.float32)
        self._rest = np.array([bone.matrix_local for bone in self.armature.data.bones], np.float64)
        above = self._rest[list(PARENTS)]
        above[_PELVIS] = np.eye(4)
        self._from_parent = np.linalg.inv(self._rest) @ above
        self._joint = subject.joint

    def _add(self, thing: Any) -> Any:
        self._scene.collection.objects.link(thing)
        return thing

    def _arm(self, subject: Subject) -> Any:
        """Make the armature; bones of the arms have x towards the elbow's side and turn about z."""
        bpy = self._bpy
        armature = self._add(bpy.data.objects.new("armature", bpy.data.armatures.new("armature")))
        self._layer.objects.active = armature
        tails, hinges = _tails(subject), _hinges(subject)
        with bpy.context.temp_override(scene=self._scene, view_layer=self._layer, object=armature, active_object=armature):
            bpy.ops.object.mode_set(mode="EDIT")
            edit = armature.data.edit_bones
            for name, parent, head, tail, hinge in zip(BONES, PARENTS, subject.joint, tails, hinges, strict=True):
                bone = edit.new(name)
                bone.head, bone.tail = head.tolist(), tail.tolist()
                bone.align_roll(hinge.tolist())
                bone.parent = edit[BONES[parent]] if parent >= 0 else None
            bpy.ops.object.mode_set(mode="OBJECT")
        return armature

    def _cover(self, subject: Subject, swell: Float64Array) -> Any:
        """Make the skin: breath is a shape key, the armature a modifier."""
        mesh = self._bpy.data.meshes.new("skin")
        mesh.from_pydata(subject.vertices.tolist(), [], subject.faces.tolist())
        skin = self._add(self._bpy.data.objects.new("skin", mesh))
        groups = [skin.vertex_groups.new(name=name) for name in BONES]
        for vertex, (bones, weights) in enumerate(zip(subject.bone.tolist(), subject.weight.tolist(), strict=True)):
            for bone, weight in zip(bones, weights, strict=True):
                groups[bone].add([vertex], weight, "ADD")
        skin.shape_key_add(name="rest", from_mix=False)
        breath = skin.shape_key_add(name="breath", from_mix=False)
        breath.slider_min, breath.slider_max = -1.0, 1.0
        breath.data.foreach_set("co", (subject.vertices + swell).ravel().astype(np.float32))
        modifier = skin.modifiers.new("armature", "ARMATURE")
        modifier.object = self.armature
        modifier.use_vertex_groups, modifier.use_bone_envelopes, modifier.use_deform_preserve_volume = True, False, False
        return skin

    def _constrain(self, side: int) -> Any:
        forearm = self.armature.pose.bones[_LOWER[side]]
        forearm.lock_ik_x = forearm.lock_ik_y = True  # an elbow is a hinge
        constraint = forearm.constraints.new("IK")
        constraint.target, constraint.pole_target = self._aims[side], self._aims[2 + side]
        constraint.pole_angle = 0.0  # the upper arm's x axis points to the pole
        constraint.chain_count, constraint.iterations, constraint.use_stretch = 2, _ITERATIONS, False
        constraint.mute = True
        return constraint

    def pose(self, rotation: Float64Array, joint: Float64Array, breath: float) -> None:
        """Place every bone: rotations from rest (22, 3, 3), heads (22, 3) [m]."""
        self._place(range(len(BONES)), self.basis(rotation, joint))
        self.mesh.data.shape_keys.key_blocks["breath"].value = breath
        self._mute(True)

    def basis(self, rotation: Float64Array, joint: Float64Array) -> Float64Array:
        """Give transforms of the bones from where they are at rest on their parents, (22, 4, 4); arguments are those of `pose`."""
        moved = np.tile(np.eye(4), (len(BONES), 1, 1))
        moved[:, :3, :3] = rotation
        moved[:, :3, 3] = joint - (rotation @ self._joint[:, :, None])[..., 0]
        placed = moved @ self._rest
        above = placed[list(PARENTS)]
        above[_PELVIS] = np.eye(4)
        return np.asarray(self._from_parent @ np.linalg.inv(above) @ placed)

    def aim(self, target: Float64Array, pole: Float64Array) -> None:
        """Leave the arms to inverse kinematics: wanted hands and poles, both (2, 3) [m]."""
        c, s = np.cos(_START), np.sin(_START)
        bent = np.eye(4)
        bent[:2, :2] = [[c, -s], [s, c]]
        self._place(_UPPER, [np.eye(4)] * 2)
        self._place(_LOWER, [bent] * 2)
        self._place(_HAND, [np.eye(4)] * 2)
        for empty, place in zip(self._aims, [*target, *pole], strict=True):
            empty.location = place.tolist()
        self._mute(False)

    def _place(self, bones: Iterable[int], basis: Iterable[Float64Array]) -> None:
        """Set bones' transforms from where they are at rest on their parents."""
        pose = self.armature.pose.bones
        for bone, matrix in zip(bones, basis, strict=True):
            pose[bone].matrix_basis = matrix.T.tolist()  # Blender takes columns here

    def _mute(self, mute: bool) -> None:
        for constraint in self._constraints:
            constraint.mute = mute

    def skin(self) -> Float64Array:
        """Let Blender deform the mesh; vertices (n_vertex, 3) [m]."""
        self._layer.update()
        mesh = self.mesh.evaluated_get(self._layer.depsgraph).data
        mesh.attributes["position"].data.foreach_get("vector", self._flat)
        return self._flat.reshape(-1, 3).astype(np.float64)

    def bones(self) -> tuple[Float64Array, Float64Array]:
        """Rotations from rest (22, 3, 3) and heads (22, 3) [m] of the bones, as they are after `skin`."""
        pose = self.armature.evaluated_get(self._layer.depsgraph).pose
        placed = np.array([bone.matrix for bone in pose.bones], np.float64)
        return placed[:, :3, :3] @ self._rest[:, :3, :3].swapaxes(-1, -2), placed[:, :3, 3]

    def remove(self) -> None:
        """Take everything out of Blender's memory."""
        data = self._bpy.data
        try:
            mesh, armature = self.mesh.data, self.armature.data
            for thing in (self.mesh, self.armature, *self._aims):
                data.objects.remove(thing)
            data.meshes.remove(mesh)
            data.armatures.remove(armature)
            data.scenes.remove(self._scene)
        except ReferenceError:
            pass  # somebody loaded another file into Blender: that removed it


def _tails(subject: Subject) -> Float64Array:
    """Place the ends of the bones, (22, 3) [m]: at the first child's head; of arms, in the middle of the hand; head and toes go on."""
    joint = subject.joint
    tails = np.array([joint[PARENTS.index(b)] if b in PARENTS else 2.0 * joint[b] - joint[PARENTS[b]] for b in range(len(BONES))])
    tails[_LOWER] = tails[_HAND] = subject.hand
    return tails


def _hinges(subject: Subject) -> Float64Array:
    """Axes of the bones' z, (22, 3): what the elbow bends about for the arms, to the left for all else."""
    joint, axes = subject.joint, np.tile([0.0, 1.0, 0.0], (len(BONES), 1))
    for upper, lower, hand in zip(_UPPER, _LOWER, subject.hand, strict=True):
        across = np.cross(joint[lower] - joint[upper], hand - joint[lower])
        axes[[upper, lower]] = across / np.sqrt(across @ across)
    return axes
