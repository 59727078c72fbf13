"""Surfaces that follow a skeleton, and the fine body: the mesh of 5,889 faces. `oracles.skin` in the tests does the same with numpy."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from radar_sim.bodies.base import BONES, Pose
from radar_sim.bodies.subject import Subject
from radar_sim.scatterers import Float64Array, Hull, Motion, Scatterers, Triangles

Int32Array = NDArray[np.int32]
_jit = numba.njit(cache=True, nogil=True)


def blend(
    points: Float64Array, swell: Float64Array, bone: Int32Array, weight: Float64Array, rest: Float64Array, pose: Pose
) -> Float64Array:
    """Move points with the skeleton: linear blend skinning.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        At rest [m].
    swell : ndarray, shape (n, 3)
        Where each goes per metre of breath, at rest.
    bone, weight : ndarray, shape (n, k)
        Bones that move each point, and by how much; rows of weights sum to 1.
    rest : ndarray, shape (22, 3)
        Heads of the bones at rest [m].
    pose : Pose
        In ``room``, at T times.

    Returns
    -------
    ndarray of float64, shape (T, n, 3)
        In ``room`` [m].
    """
    # rotation @ (x - rest) + joint = rotation @ x + shift: one blend of both per point
    shift = pose.joint - (pose.rotation @ rest[:, :, None])[..., 0]
    return np.asarray(_blend(points, swell, bone, weight, np.ascontiguousarray(pose.rotation), shift, pose.breath))


@_jit
def _blend(points: Any, swell: Any, bone: Any, weight: Any, rotation: Any, shift: Any, breath: Any) -> Any:
    moved = np.empty((len(rotation), len(points), 3))
    for t in range(len(rotation)):
        for i in range(len(points)):
            x = points[i, 0] + breath[t] * swell[i, 0]
            y = points[i, 1] + breath[t] * swell[i, 1]
            z = points[i, 2] + breath[t] * swell[i, 2]
            a = b = c = 0.0
            for k in range(bone.shape[1]):
                w = weight[i, k]
                if w == 0.0:
                    continue
                turn, base = rotation[t, bone[i, k]], shift[t, bone[i, k]]
                a += w * (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z + base[0])
                b += w * (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z + base[1])
                c += w * (turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + base[2])
            moved[t, i, 0], moved[t, i, 1], moved[t, i, 2] = a, b, c
    return moved


@_jit
def turn(normals: Any, bone: Any, rotation: Any) -> Any:
    """Turn normals (n, 3) with one bone each (n,), by rotations of the bones (22, 3, 3)."""
    turned = np.empty_like(normals)
    for i in range(len(normals)):
        by = rotation[bone[i]]
        for k in range(3):
            turned[i, k] = by[k, 0] * normals[i, 0] + by[k, 1] * normals[i, 1] + by[k, 2] * normals[i, 2]
    return turned


@_jit
def facets(vertices: Any, faces: Any) -> Any:
    """Middles of triangles at several times; normals and areas at the time in the middle.

    Parameters
    ----------
    vertices : ndarray, shape (T, n_vertex, 3)
        Places [m].
    faces : ndarray of int32, shape (n_face, 3)
        Anticlockwise seen from outside.

    Returns
    -------
    tuple of ndarray of float64
        Centroids (T, n_face, 3) [m], outward unit normals (n_face, 3), areas (n_face,) [m^2]; a triangle without area has a normal of 0.
    """
    middle = len(vertices) // 2
    n = len(faces)
    centroid, normal, area = np.empty((len(vertices), n, 3)), np.empty((n, 3)), np.empty(n)
    for t in range(len(vertices)):
        at = vertices[t]
        for i in range(n):
            p, q, r = at[faces[i, 0]], at[faces[i, 1]], at[faces[i, 2]]
            for k in range(3):
                centroid[t, i, k] = (p[k] + q[k] + r[k]) * (1.0 / 3.0)
    for i in range(n):
        p, q, r = vertices[middle, faces[i, 0]], vertices[middle, faces[i, 1]], vertices[middle, faces[i, 2]]
        ax, ay, az = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        bx, by, bz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        double = math.sqrt(x * x + y * y + z * z)
        area[i] = 0.5 * double
        inverse = 1.0 / double if double > 0.0 else 0.0
        normal[i, 0], normal[i, 1], normal[i, 2] = x * inverse, y * inverse, z * inverse
    return centroid, normal, area


class MeshBody:
    """A person as a mesh of triangles that follows the skeleton by linear blend skinning; every triangle echoes from its centroid.

    Parameters
    ----------
    subject : Subject
        Whose body.
    reflectivity : float
        Share of the power that skin and clothes reflect.
    """

    def __init__(self, subject: Subject, reflectivity: float) -> None:
        self.subject, self._reflectivity = subject, reflectivity
        chest = (subject.weight * (subject.bone == BONES.index("spine_03"))).sum(1)
        front = chest * np.maximum(subject.normals[:, 0], 0.0)
        self._swell = front[:, None] * np.array([1.0, 0.0, 0.0])

    def surface(self, pose: Pose, span: float, owner: int) -> Scatterers:
        """Surface elements of the whole body, both sides of it, seen or not: see `radar_sim.bodies.base.Body`."""
        vertices = self._skin(pose)
        centroid, normal, area = facets(vertices, self.subject.faces)
        owners = np.full(len(area), owner, np.int32)

        def hull() -> Triangles:
            return Triangles(vertices[len(vertices) // 2][self.subject.faces])

        return Scatterers(Motion.through(centroid, span), normal, area * self._reflectivity, owners, (hull,))

    def hull(self, pose: Pose) -> Hull:
        """Return what the body hides with, in the middle of the frame; not computed before it is called."""
        return lambda: Triangles(self.vertices(at(pose, len(pose.joint) // 2))[self.subject.faces])

    def vertices(self, pose_at_one_time: Pose) -> Float64Array:
        """Places of the skin's vertices in ``room`` for a pose at one time, shape (n_vertex, 3) [m]."""
        return np.asarray(self._skin(pose_at_one_time)[0])

    def _skin(self, pose: Pose) -> Float64Array:
        subject = self.subject
        return blend(subject.vertices, self._swell, subject.bone, subject.weight, subject.joint, pose)


def at(pose: Pose, index: int) -> Pose:
    """Keep one of a pose's times."""
    one = slice(index, index + 1)
    return Pose(pose.joint[one], pose.rotation[one], pose.hand[one], pose.centre[one], pose.breath[one])
