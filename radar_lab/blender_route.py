"""A scene's animation to Blender and back, as a route of data (thesis, sections 5.2.1 and 5.2.2).

`export` writes the people of a scene as a .blend file: for each a mesh ``person_ID``, which an armature ``bones_ID`` deforms, with keys at
every time that a radar's frame needs. `BlendFile` reads the animation back, from that file or from one that somebody changed in Blender:
Blender evaluates the meshes at any time. `radar_lab.vertex_targets` makes targets of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_lab.blender import Rig, blender
from radar_lab.vertex_targets import OwnMeshes, Posed
from radar_sim.bodies.base import BONES, Pose
from radar_sim.bodies.skin import MeshBody
from radar_sim.bodies.subject import Subject
from radar_sim.scatterers import Float64Array
from radar_sim.scene import Scene
from radar_sim.simulator import Simulator

FPS: Final = 60
"""Blender's frames a second; keys lie between them."""
_HANDS, _ROOTS = ([BONES.index(f"{name}_{side}") for name in names for side in "lr"] for names in (("hand",), ("upperarm", "thigh")))


class _Skin(MeshBody):
    """A mesh body that tells how breath moves it."""

    @property
    def swell(self) -> Float64Array:
        """Where each vertex goes per metre of breath, shape (n_vertex, 3)."""
        swell: Float64Array = self._swell
        return swell


def need_blender() -> Any:
    """Import Blender; a `ConfigError` says how to install it."""
    return blender("the Blender route", "handwave simulate does without")[0]


def times(radars: Sequence[Simulator]) -> Float64Array:
    """Give the times at which simulators pose people, in order, shape (T,) [s]: start, middle and end of every frame of every radar."""
    found = [np.empty(0)]
    for radar in radars:
        span = radar.info.waveform.acquisition_time
        middle = radar.radar.trigger_offset + np.arange(radar.n_frames) * radar.interval + span / 2
        found.append((middle[:, None] + np.array([-0.5, 0.0, 0.5]) * span).ravel())
    return np.unique(np.concatenate(found))


def export(scene: Scene, at: Float64Array, path: Path) -> None:
    """Write the animation of a scene's people as a .blend file.

    Parameters
    ----------
    scene : Scene
        Whose people.
    at : ndarray, shape (T,)
        Times of the keys, ascending [s]; Blender goes evenly from one to the next. Its frame ``FPS * t`` is the time t.
    path : Path
        The file; one that exists is written anew.

    Raises
    ------
    ConfigError
        When Blender is not installed.
    """
    bpy = need_blender()
    own = bpy.data.scenes.new("handwave")
    own.render.fps, own.render.fps_base = FPS, 1.0
    own.frame_start, own.frame_end = 0, int(np.ceil(at[-1] * FPS)) if len(at) else 0
    before = _blocks(bpy)
    try:
        for person, pose in zip(scene.people, OwnMeshes(scene).poses(at), strict=True):
            subject = Subject.of(person)
            rig = Rig(bpy, subject, _Skin(subject, 0.0).swell, own)
            rig.mesh.name, rig.armature.name = f"person_{person.id}", f"bones_{person.id}"
            rig.mesh.parent = rig.armature  # whoever moves the armature in Blender moves both
            _animate(bpy, rig, pose, at)
        bpy.data.libraries.write(str(path), {own}, compress=True)
    finally:
        bpy.data.scenes.remove(own)
        _remove(bpy, before)


def _animate(bpy: Any, rig: Rig, pose: Pose, at: Float64Array) -> None:
    """Key every bone and the breath at T times."""
    rig.pose(pose.rotation[0], pose.joint[0], 0.0)
    basis = np.array([rig.basis(rotation, joint) for rotation, joint in zip(pose.rotation, pose.joint, strict=True)])
    turned = quaternions(basis[:, :, :3, :3])
    values: dict[tuple[str, int], Float64Array] = {}
    for bone, name in enumerate(BONES):
        where = f'pose.bones["{name}"]'
        values |= {(f"{where}.rotation_quaternion", k): turned[:, bone, k] for k in range(4)}
        values |= {(f"{where}.location", k): basis[:, bone, k, 3] for k in range(3)}
    _key(bpy, rig.armature, values, at)
    _key(bpy, rig.mesh.data.shape_keys, {('key_blocks["breath"].value', -1): pose.breath}, at)


def _key(bpy: Any, thing: Any, values: dict[tuple[str, int], Float64Array], at: Float64Array) -> None:
    """Give something an action with a curve for each property: straight lines through values at T times."""
    made = thing.animation_data_create()
    made.action = bpy.data.actions.new(thing.name)
    keys = np.empty((len(at), 2), np.float32)
    keys[:, 0] = at * FPS
    linear = np.full(len(at), bpy.types.Keyframe.bl_rna.properties["interpolation"].enum_items["LINEAR"].value, np.uint8)
    for (path, index), value in values.items():
        curve = made.action.fcurves.new(path) if index < 0 else made.action.fcurves.new(path, index=index)
        curve.keyframe_points.add(len(at))
        keys[:, 1] = value
        curve.keyframe_points.foreach_set("co", keys.ravel())
        curve.keyframe_points.foreach_set("interpolation", linear)
        curve.update()
    if hasattr(made, "action_slot") and made.action_slot is None:
        made.action_slot = made.action.slots[0]  # from Blender 4.4 on an action is for several things


def quaternions(rotation: Float64Array) -> Float64Array:
    """Turn rotations (T, n, 3, 3) into quaternions w, x, y, z, shape (T, n, 4), each on the side of the one before it."""
    trace = np.einsum("...ii", rotation)
    diagonal = np.einsum("...ii->...i", rotation)
    size = np.concatenate([trace[..., None], 2 * diagonal - trace[..., None]], -1)  # 4 q^2 - 1
    # the products of the largest component with all four: the largest makes the others exact
    r = rotation
    a, b, c = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    d, e, f = r[..., 0, 1] + r[..., 1, 0], r[..., 0, 2] + r[..., 2, 0], r[..., 1, 2] + r[..., 2, 1]
    w, x, y, z = np.moveaxis(1.0 + size, -1, 0)
    products = np.stack([np.stack(row, -1) for row in ((w, a, b, c), (a, x, d, e), (b, d, y, f), (c, e, f, z))], -2)
    found = np.take_along_axis(products, size.argmax(-1)[..., None, None], -2)[..., 0, :]
    found /= np.sqrt((found**2).sum(-1, keepdims=True))
    for t in range(1, len(found)):
        found[t] *= np.where((found[t] * found[t - 1]).sum(-1, keepdims=True) < 0.0, -1.0, 1.0)
    return np.asarray(found)


class BlendFile:
    """The animation of a .blend file as a `radar_lab.vertex_targets.Source`; any mesh ``person_ID`` will do, with whatever moves it.

    Use it in a ``with`` statement: until then the file's scene is in Blender's memory.

    Parameters
    ----------
    path : Path
        The file.
    scene : Scene
        Whose people there are to be. The truth about their places and hands is read from the armatures ``bones_ID``.

    Attributes
    ----------
    held : bpy.types.Scene
        The file's scene in Blender's memory. Where the memory has things of the same names, these have numbers behind theirs.

    Raises
    ------
    ConfigError
        When Blender is not installed.
    DataError
        When the file cannot be read, or lacks a person's mesh or armature.
    """

    def __init__(self, path: Path, scene: Scene) -> None:
        self._bpy, self._path = need_blender(), path
        self._before = _blocks(self._bpy)
        self._subjects = [Subject.of(person) for person in scene.people]
        try:
            with self._bpy.data.libraries.load(str(path.absolute()), link=False) as (held, wanted):
                wanted.scenes = held.scenes
        except (OSError, RuntimeError) as error:
            raise DataError(f"{path}: Blender cannot read it ({str(error).strip()})") from None
        try:
            self.held, self._things = self._find(wanted.scenes, [f"{kind}_{p.id}" for p in scene.people for kind in ("person", "bones")])
        except DataError:
            self.close()
            raise
        self._layer = self.held.view_layers[0]
        self._fps = self.held.render.fps / self.held.render.fps_base

    def __enter__(self) -> BlendFile:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Take the file's scene out of Blender's memory."""
        _remove(self._bpy, self._before)

    def posed(self, times: Float64Array) -> list[Posed]:
        """Let Blender pose the bodies of all people; see `radar_lab.vertex_targets.Source`. Raises `DataError` when a mesh changes."""
        seen = [self._look(float(t)) for t in times]
        return [self._join(index, [look[index] for look in seen]) for index in range(len(self._subjects))]

    def _look(self, time: float) -> list[tuple[Float64Array, NDArray[np.int32], Float64Array]]:
        """Vertices, faces and placed bones of each person at one time."""
        frame = float(np.float32(time * self._fps))
        whole = int(np.floor(frame))
        self.held.frame_set(whole, subframe=frame - whole)
        graph = self._layer.depsgraph
        graph.update()
        return [(*_mesh(mesh.evaluated_get(graph)), _bones(bones.evaluated_get(graph))) for mesh, bones in self._things]

    def _join(self, index: int, seen: Sequence[tuple[Float64Array, NDArray[np.int32], Float64Array]]) -> Posed:
        if len({len(vertices) for vertices, _, _ in seen}) > 1:
            raise DataError(f"{self._path}: {self._things[index][0].name} changes its number of vertices; use modifiers that keep it")
        subject, placed = self._subjects[index], np.array([bones for _, _, bones in seen])
        rest = _rest(self._things[index][1])
        rotation, joint = placed[:, :, :3, :3] @ rest[:, :3, :3].swapaxes(-1, -2), placed[:, :, :3, 3]
        palm = subject.hand - subject.joint[_HANDS]
        hand = joint[:, _HANDS] + (rotation[:, _HANDS] @ palm[..., None])[..., 0]
        pose = Pose(joint, rotation, hand, joint[:, _ROOTS].mean(1), np.zeros(len(seen)))
        return Posed(pose, np.stack([vertices for vertices, _, _ in seen]), seen[0][1])

    def _find(self, scenes: Iterable[Any], names: Sequence[str]) -> tuple[Any, list[tuple[Any, Any]]]:
        """Find the scene with the people, and mesh and armature of each; names in pairs."""
        missing = list(names)
        for scene in scenes:
            # appended beside things of the same name, a thing's name ends with a dot and a number
            held = {thing.name.partition(".")[0]: thing for thing in scene.objects}
            missing = [name for name in names if name not in held]
            if not missing:
                things = [held[name] for name in names]
                return scene, list(zip(things[::2], things[1::2], strict=True))
        raise DataError(f"{self._path}: it has no {', '.join(missing) or 'scene'}; keep the names that the export gave")


def _mesh(thing: Any) -> tuple[Float64Array, NDArray[np.int32]]:
    """Vertices (n, 3) [m] and triangles (m, 3) of an evaluated object, in the room."""
    mesh = thing.data
    mesh.calc_loop_triangles()
    flat = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", flat)
    faces = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", faces)
    world = np.array(thing.matrix_world, np.float64)
    return flat.reshape(-1, 3).astype(np.float64) @ world[:3, :3].T + world[:3, 3], faces.reshape(-1, 3)


def _bones(thing: Any) -> Float64Array:
    """Give transforms of our bones, (22, 4, 4), of an evaluated armature, in the room."""
    pose = thing.pose.bones
    return np.asarray(np.array(thing.matrix_world, np.float64) @ np.array([pose[name].matrix for name in BONES], np.float64))


def _rest(thing: Any) -> Float64Array:
    """Give transforms of our bones at rest, (22, 4, 4)."""
    return np.array([thing.data.bones[name].matrix_local for name in BONES], np.float64)


_KINDS: Final = ("scenes", "objects", "meshes", "armatures", "shape_keys", "actions", "collections", "worlds", "materials")


def _blocks(bpy: Any) -> set[Any]:
    """All that is in Blender's memory now, by its address."""
    return {block.as_pointer() for kind in _KINDS for block in getattr(bpy.data, kind)}


def _remove(bpy: Any, before: set[Any]) -> None:
    """Take out of Blender's memory what was not there ``before``."""
    bpy.data.batch_remove([block for kind in _KINDS for block in getattr(bpy.data, kind) if block.as_pointer() not in before])
