"""Things in the room as scatterers and hulls: points, corner reflectors, walls, furniture.

Walls and furniture are rough: each tile of a face scatters a share (``diffuse``) of the power that falls on it back by the cosine of
incidence. The flash of a smooth wall seen at a right angle is not in it (a plate of 1 m^2 has 8e5 m^2 of cross-section at 76 GHz, within a
tenth of a degree); what smooth faces mirror of other things is the effect ``multipath``.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass

import numpy as np

from radar_sim.scatterers import THING, Float64Array, Hull, Motion, Scatterers, Triangles
from radar_sim.scene import Scene, SceneRadar
from radar_sim.things import Corner, Furniture, Point, Wall

TILE = 0.3
"""Faces are cut into tiles of at most this length [m]."""
_SIDES = ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0))  # axis and sign of a box's faces, the underside last


class Things:
    """What stands and moves in a room beside people.

    The scatterers come in the scene's order: points, corners (both without normals), then the tiles of walls and of furniture.

    Parameters
    ----------
    scene : Scene
        Things of a scene, and its first radar, at which corners without a heading look.
    radar : SceneRadar or None
        Who looks: cross-sections of corners depend on the wavelength and the direction. None: the scene's first radar.
    """

    def __init__(self, scene: Scene, radar: SceneRadar | None = None) -> None:
        first = scene.radars[0].mount
        radar = radar or scene.radars[0]
        evenly: tuple[Point | Corner, ...] = (*scene.points, *scene.corners)
        self._start = np.array([t.position for t in evenly], np.float64).reshape(-1, 3)
        self._velocity = np.array([t.velocity for t in evenly], np.float64).reshape(-1, 3)
        self._viewer, self._wavelength = radar.mount.origin, radar.waveform.wavelength
        self._point_rcs = np.array([p.rcs for p in scene.points], np.float64)
        self._edge = np.array([c.edge for c in scene.corners], np.float64)
        self._axes = np.array([_inner_edges(c, (first.x, first.y)) for c in scene.corners], np.float64).reshape(-1, 3, 3)
        self._faces = _rough(scene)
        self._still = None if self._velocity.any() else self._at(0.0)

    def scatterers(self, time: float) -> Scatterers:
        """Everything, seen or not, at a scene time [s]; cross-sections of corners are those towards the radar."""
        return self._at(time) if self._still is None else self._still

    def _at(self, time: float) -> Scatterers:
        motion = Motion(self._start + time * self._velocity, self._velocity, np.zeros_like(self._start))
        towards = self._viewer - motion.position[len(self._point_rcs) :]
        rcs = np.concatenate([self._point_rcs, trihedral_rcs(self._edge, self._axes, towards, self._wavelength)])
        n = len(rcs)
        reflectors = Scatterers(motion, np.zeros((n, 3)), rcs, np.arange(-2, -2 - n, -1, dtype=np.int32))
        return Scatterers.join([reflectors, self._faces])


def trihedral_rcs(edge: Float64Array, axes: Float64Array, towards: Float64Array, wavelength: float) -> Float64Array:
    """Cross-section of triangular trihedral corner reflectors that are large against the wavelength.

    With the cosines l <= m <= n between the line of sight and the three inner edges, sigma = 4 pi A^2 / lambda^2 for the area

        A = edge^2 * 4 l m / (l + m + n)                 where l + m <= n,
        A = edge^2 * ((l + m + n) - 2 / (l + m + n))     elsewhere,

    through which rays pass that meet all three faces (Spencer 1944; Knott, Shaeffer and Tuley, *Radar Cross Section*, section 6.3). On the
    axis it is 4 pi edge^4 / (3 lambda^2); outside the octant that the edges span, and so behind, 0: what one or two faces return there is
    left out.

    Parameters
    ----------
    edge : ndarray, shape (n,)
        Lengths of the inner edges [m].
    axes : ndarray, shape (n, 3 edges, 3)
        Unit vectors from the apex along the inner edges.
    towards : ndarray, shape (n, 3)
        From the apex to the radar [m].
    wavelength : float
        Wavelength [m].

    Returns
    -------
    ndarray of float64, shape (n,)
        Cross-sections [m^2]; their phase centre is the apex, whatever the direction.
    """
    distance = np.sqrt((towards**2).sum(-1, keepdims=True))
    cosines = np.einsum("nij,nj->ni", axes, towards / np.maximum(distance, 1e-9))
    low, mid, high = np.sort(cosines, axis=-1).T
    total = np.maximum(low + mid + high, 1.0)  # never less within the octant
    share = np.where(low + mid <= high, 4 * low * mid / total, total - 2 / total)
    area = edge**2 * np.where((low > 0.0) & (distance[:, 0] > 1e-9), share, 0.0)
    return 4 * math.pi * (area / wavelength) ** 2


def _inner_edges(corner: Corner, radar: tuple[float, float]) -> Float64Array:
    """Inner edges of a corner with a horizontal axis, one of them upright above the axis, shape (3, 3)."""
    x, y, _ = corner.position
    heading = math.atan2(radar[1] - y, radar[0] - x) if corner.heading is None else corner.heading
    axis = np.array([math.cos(heading), math.sin(heading), 0.0])
    side, up = np.array([-axis[1], axis[0], 0.0]), np.array([0.0, 0.0, 1.0])
    roll = np.radians([0.0, 120.0, 240.0])[:, None]
    return np.asarray((axis + math.sqrt(2.0) * (np.cos(roll) * up + np.sin(roll) * side)) / math.sqrt(3.0))


@dataclass(frozen=True, eq=False)
class _Face:
    """A rectangle: its middle, its two sides as vectors [m], and its outward normal."""

    middle: Float64Array
    first: Float64Array
    second: Float64Array
    normal: Float64Array

    def tiles(self, rng: np.random.Generator) -> tuple[Float64Array, float]:
        """One point drawn within each tile, shape (n, 3), and the area of a tile.

        Points on a regular grid would add up in phase in some directions, which a rough face does not.
        """
        lengths = np.linalg.norm(self.first), np.linalg.norm(self.second)
        n, m = (max(math.ceil(length / TILE - 1e-9), 1) for length in lengths)
        grid = np.stack(np.meshgrid(np.arange(n), np.arange(m), indexing="ij"), -1).reshape(-1, 2)
        share = (grid + rng.random(grid.shape)) / (n, m) - 0.5
        return self.middle + share @ np.stack([self.first, self.second]), float(lengths[0] * lengths[1]) / (n * m)

    @property
    def triangles(self) -> Float64Array:
        """Its two triangles, shape (2, 3, 3)."""
        a, b = self.first / 2, self.second / 2
        corners = [self.middle - a - b, self.middle + a - b, self.middle + a + b, self.middle - a + b]
        return np.array([[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]])


def _box(thing: Wall | Furniture) -> list[_Face]:
    """Faces of a wall or a piece of furniture; those without area, and an underside that stands on the floor, are left out."""
    if isinstance(thing, Wall):
        (ax, ay), (bx, by) = thing.start, thing.end
        place, heading, base = ((ax + bx) / 2, (ay + by) / 2), math.atan2(by - ay, bx - ax), 0.0
        size = np.array([math.hypot(bx - ax, by - ay), thing.thickness, thing.height])
    else:
        place, heading, base, size = thing.position, thing.heading, thing.base, np.array(thing.size)
    c, s = math.cos(heading), math.sin(heading)
    axes = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    middle = np.array([*place, base + size[2] / 2])
    faces = []
    for axis, sign in _SIDES:
        i, j = (axis + 1) % 3, (axis + 2) % 3
        if size[i] * size[j] > 0.0 and (axis, sign, base) != (2, -1.0, 0.0):
            normal = sign * axes[axis]
            faces.append(_Face(middle + normal * (size[axis] / 2), size[i] * axes[i], size[j] * axes[j], normal))
    return faces


def _rough(scene: Scene) -> Scatterers:
    """Tiles of all walls and furniture, drawn from the scene's seed, and one hull of all their faces."""
    rng = np.random.Generator(np.random.SFC64([scene.seed, zlib.crc32(b"things")]))
    position, normal, rcs, hull = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty(0)], []
    boxes: tuple[Wall | Furniture, ...] = (*scene.walls, *scene.furniture)
    for thing in boxes:
        for face in _box(thing):
            hull.append(face.triangles)
            if thing.diffuse > 0.0:
                places, area = face.tiles(rng)
                position.append(places)
                normal.append(np.broadcast_to(face.normal, places.shape))
                rcs.append(np.full(len(places), area * thing.diffuse))
    sigma = np.concatenate(rcs)
    motion = Motion.still(np.concatenate(position))
    triangles = Triangles(np.concatenate(hull)) if hull else None
    hulls: tuple[Hull, ...] = () if triangles is None else (lambda: triangles,)
    return Scatterers(motion, np.concatenate(normal), sigma, np.full(len(sigma), THING, np.int32), hulls)
