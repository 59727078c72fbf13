"""Point targets from meshes that anybody may have posed, as in the thesis (section 5.2.2): its facets, or its vertices, all alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from radar_sim.bodies.base import Pose
from radar_sim.bodies.shadows import View
from radar_sim.bodies.skeleton import Skeleton
from radar_sim.bodies.skin import MeshBody, at, facets
from radar_sim.bodies.subject import Subject
from radar_sim.effects.config import OcclusionConfig
from radar_sim.motions.script import Timeline
from radar_sim.scatterers import Float64Array, Motion, Scatterers, Triangles
from radar_sim.scene import Scene, SceneRadar
from radar_sim.simulator import Simulator
from radar_sim.world import World

Rcs = Literal["facets", "constant"]
"""Cross-sections: of each facet by its area and direction, or the same for every vertex that the radar sees."""
RCS: Final[tuple[Rcs, ...]] = get_args(Rcs)
TOTAL: Final = 0.2
"""Cross-section of a person whom nobody hides, with ``constant`` [m^2]: about what the facets of our bodies have together when they
face the radar (docs/research/simulator.md)."""


@dataclass(frozen=True, eq=False)
class Posed:
    """One person's body at T times, in ``room``."""

    pose: Pose  # what the truth is taken from
    vertices: Float64Array  # of the mesh, shape (T, n_vertex, 3) [m]
    faces: NDArray[np.int32]  # vertices of each triangle, anticlockwise seen from outside, shape (n_face, 3)


class Source(Protocol):
    """Where meshes come from."""

    def posed(self, times: Float64Array) -> list[Posed]:
        """Give the bodies of all people of a scene, in its order, at ``times``, shape (T,) [s]."""
        ...


class OwnMeshes:
    """The mesh bodies of our own simulator, without Blender: what others are compared with."""

    def __init__(self, scene: Scene) -> None:
        subjects = [Subject.of(person) for person in scene.people]
        mount = scene.radars[0].mount
        self._skeletons = [Skeleton(subject) for subject in subjects]
        self._bodies = [MeshBody(subject, 0.0) for subject in subjects]
        self._timelines = [Timeline(person, scene.seed, (mount.x, mount.y), scene.strokes) for person in scene.people]

    def poses(self, times: Float64Array) -> list[Pose]:
        """Give the skeletons of all people at ``times``, shape (T,) [s]."""
        return [skeleton.pose(line.posture(times)) for skeleton, line in zip(self._skeletons, self._timelines, strict=True)]

    def posed(self, times: Float64Array) -> list[Posed]:
        """Give the bodies of all people; see `Source`."""
        return [
            Posed(pose, np.stack([body.vertices(at(pose, t)) for t in range(len(times))]), body.subject.faces)
            for body, pose in zip(self._bodies, self.poses(times), strict=True)
        ]


class VertexWorld(World):
    """A scene's world whose people are meshes of a source; things and what people do remain the scene's.

    Parameters
    ----------
    scene : Scene
        What happens.
    radar : SceneRadar
        Who looks.
    source : Source
        Where people's meshes come from.
    rcs : {"facets", "constant"}
        ``facets``: every triangle echoes from its middle, with its area times the person's reflectivity, by its direction. ``constant``:
        every vertex that the radar sees echoes alike.
    total : float
        Of ``constant``: the vertices of a person that their own body does not hide share this cross-section evenly [m^2]. What others
        hide of them is then missing.
    """

    def __init__(self, scene: Scene, radar: SceneRadar, source: Source, rcs: Rcs = "facets", total: float = TOTAL) -> None:
        super().__init__(scene, radar)
        self._source, self._rcs, self._total = source, rcs, total
        self._reflectivity = [person.reflectivity for person in scene.people]
        self._view = View(radar.mount.origin, radar.mount.rotation, OcclusionConfig().resolution)
        self._last: tuple[tuple[float, float], list[Posed]] = ((np.nan, np.nan), [])

    def poses(self, middle: float, span: float) -> list[Pose]:
        """Skeletons at start, middle and end of a stretch of time [s], as the source has them."""
        return [body.pose for body in self._posed(middle, span)]

    def scatterers(self, middle: float, span: float, poses: list[Pose]) -> Scatterers:
        """Everything that could echo, in ``room``; arguments are those of `poses`."""
        bodies = self._posed(middle, span)
        people = self._facets(bodies, span) if self._rcs == "facets" else self._vertices(bodies, span)
        moving = [] if self._movers is None else [self._movers.scatterers(middle, span)]
        return Scatterers.join([self._things.scatterers(middle), *moving, *people])

    def _posed(self, middle: float, span: float) -> list[Posed]:
        if self._last[0] != (middle, span):
            self._last = (middle, span), self._source.posed(middle + np.array([-0.5, 0.0, 0.5]) * span)
        return self._last[1]

    def _facets(self, bodies: Sequence[Posed], span: float) -> list[Scatterers]:
        made = []
        for owner, (body, share) in enumerate(zip(bodies, self._reflectivity, strict=True)):
            centroid, normal, area = facets(body.vertices, body.faces)
            owners, sheet = np.full(len(area), owner, np.int32), hull(body)
            made.append(Scatterers(Motion.through(centroid, span), normal, area * share, owners, (partial(_given, sheet),)))
        return made

    def _vertices(self, bodies: Sequence[Posed], span: float) -> list[Scatterers]:
        """Leave the vertices that the radar sees, whatever effects the scene names: the thesis casts rays always."""
        sheets, made = [hull(body) for body in bodies], []
        everybody = self._view.look(sheets) if sheets else None
        for owner, (body, sheet) in enumerate(zip(bodies, sheets, strict=True)):
            alone = np.flatnonzero(facing(body, self._view.origin))
            alone = alone[self._view.look([sheet]).visible(body.vertices[1][alone])]
            kept = alone if everybody is None else alone[everybody.visible(body.vertices[1][alone])]
            n = len(kept)
            rcs = np.full(n, self._total / max(len(alone), 1))
            motion = Motion.through(body.vertices[:, kept], span)
            made.append(Scatterers(motion, np.zeros((n, 3)), rcs, np.full(n, owner, np.int32), (partial(_given, sheet),)))
        return made


def with_meshes(radars: Sequence[Simulator], source: Source, rcs: Rcs = "facets", total: float = TOTAL) -> list[Simulator]:
    """Make simulators of the same scene and radars, whose people are the meshes of a source; arguments are those of `VertexWorld`."""
    return [Simulator(r.scene, r.radar.frame_id, VertexWorld(r.scene, r.radar, source, rcs, total)) for r in radars]


def _given(sheet: Triangles) -> Triangles:
    return sheet


def hull(body: Posed) -> Triangles:
    """Give what a body hides with, in the middle of its times."""
    return Triangles(body.vertices[len(body.vertices) // 2][body.faces])


def facing(body: Posed, origin: Float64Array) -> NDArray[np.bool_]:
    """Tell which vertices, shape (n_vertex,), belong to a face that looks towards ``origin`` (3,) [m] in the middle of the times."""
    centroid, normal, _ = facets(body.vertices, body.faces)
    towards = ((origin - centroid[len(body.vertices) // 2]) * normal).sum(1) > 0.0
    result = np.zeros(body.vertices.shape[1], np.bool_)
    result[body.faces[towards]] = True
    return result
