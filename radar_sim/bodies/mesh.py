"""The fine body: the mesh of 5,889 faces on the skeleton."""

from __future__ import annotations

import numpy as np

from radar_sim.bodies.base import BONES, Pose
from radar_sim.bodies.skin import blend, facets
from radar_sim.bodies.subject import Subject
from radar_sim.scatterers import Float64Array, Hull, Motion, Scatterers, Triangles


class MeshBody:
    """A person as a mesh of triangles that follows the skeleton by linear blend skinning; every triangle echoes from its centroid.

    Parameters
    ----------
    subject : Subject
        Whose body.
    reflectivity : float
        Share of the power that skin and clothes reflect.

    Attributes
    ----------
    subject : Subject
        Whose body.
    """

    def __init__(self, subject: Subject, reflectivity: float) -> None:
        self.subject = subject
        self._reflectivity = reflectivity
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
        vertices: Float64Array = self._skin(pose_at_one_time)[0]
        return vertices

    def _skin(self, pose: Pose) -> Float64Array:
        subject = self.subject
        return blend(subject.vertices, self._swell, subject.bone, subject.weight, subject.joint, pose)


def at(pose: Pose, index: int) -> Pose:
    """Keep one of a pose's times."""
    one = slice(index, index + 1)
    return Pose(pose.joint[one], pose.rotation[one], pose.hand[one], pose.centre[one], pose.breath[one])
