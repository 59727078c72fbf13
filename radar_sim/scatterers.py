"""What echoes during one frame: `Scatterers` in the room, then `Echoes` as the radar sees them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]
THING = -1
"""Owner of a scatterer of walls, furniture or clutter. The k-th of points and then corners is the owner ``-2 - k``."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Where points are during one frame: each on a parabola in time about the middle of the acquisition; shapes (n, 3)."""

    position: Float64Array  # in the middle of the acquisition [m]
    velocity: Float64Array  # [m/s]
    acceleration: Float64Array  # [m/s^2]

    def __len__(self) -> int:
        return len(self.position)

    @classmethod
    def through(cls, places: Float64Array, span: float) -> Motion:
        """Lay the parabola through places at start, middle and end, shape (3, n, 3) [m], of a stretch of time [s]."""
        start, middle, end = places
        return cls(middle, (end - start) / span, (start - 2 * middle + end) * (4 / span**2))

    @classmethod
    def still(cls, position: Float64Array) -> Motion:
        """Points that stand still, shape (n, 3) [m]."""
        return cls(position, np.zeros_like(position), np.zeros_like(position))

    def at(self, since: float) -> Float64Array:
        """Positions ``since`` seconds after the middle, shape (n, 3) [m]."""
        return self.position + since * (self.velocity + (0.5 * since) * self.acceleration)

    def select(self, index: NDArray[np.generic]) -> Motion:
        """Keep the points that a mask or an index array picks."""
        return Motion(self.position[index], self.velocity[index], self.acceleration[index])

    def turned(self, rotation: Float64Array, origin: Float64Array) -> Motion:
        """Seen from a frame with that origin (3,) [m], whose axes are the columns of ``rotation`` (3, 3)."""
        return Motion((self.position - origin) @ rotation, self.velocity @ rotation, self.acceleration @ rotation)

    @classmethod
    def join(cls, parts: Sequence[Motion]) -> Motion:
        """Put several after one another."""
        if not parts:
            return cls.still(np.empty((0, 3)))
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("position", "velocity", "acceleration")))


@dataclass(frozen=True, eq=False)
class Ellipsoids:
    """Solid ellipsoids in ``room``: ``centre + axes @ (unit ball)``; shapes (m, 3) [m] and (m, 3, 3)."""

    centre: Float64Array
    axes: Float64Array


@dataclass(frozen=True, eq=False)
class Triangles:
    """Opaque triangles in ``room``: corners, shape (m, 3, 3) = (triangle, corner, xyz) [m]."""

    corner: Float64Array


Hull = Callable[[], Ellipsoids | Triangles]
"""What something hides with, in the middle of a frame; called only when a scene names occlusion."""


@dataclass(frozen=True, eq=False)
class Scatterers:
    """Surface elements and points, in ``room``.

    Attributes
    ----------
    motion : Motion
        Of n scatterers.
    normal : ndarray of float64, shape (n, 3)
        Outward unit normals in the middle of the frame; zeros: it echoes alike in all directions.
    rcs : ndarray of float64, shape (n,)
        Radar cross-section seen along the normal [m^2]: a facet's area times its reflectivity. Seen at an angle of incidence, a facet has
        ``rcs * max(0, cos(incidence))``; summed without phase over a sphere that gives its pi a^2.
    owner : ndarray of int32, shape (n,)
        Index of the person in the scene; negative: a thing, see `THING`.
    hulls : tuple of Hull
        What bodies and things hide with.
    """

    motion: Motion
    normal: Float64Array
    rcs: Float64Array
    owner: NDArray[np.int32]
    hulls: tuple[Hull, ...] = ()

    def __len__(self) -> int:
        return len(self.rcs)

    def select(self, index: NDArray[np.generic]) -> Scatterers:
        """Keep what a mask or an index array picks."""
        return Scatterers(self.motion.select(index), self.normal[index], self.rcs[index], self.owner[index], self.hulls)

    @classmethod
    def join(cls, parts: Sequence[Scatterers]) -> Scatterers:
        """Put several after one another."""
        motion = Motion.join([p.motion for p in parts])
        if not parts:
            return cls(motion, np.empty((0, 3)), np.empty(0), np.empty(0, np.int32))
        normal, rcs = (np.concatenate([getattr(p, name) for p in parts]) for name in ("normal", "rcs"))
        owner = np.concatenate([p.owner for p in parts])
        return cls(motion, normal, rcs, owner, tuple(hull for p in parts for hull in p.hulls))

    def towards(self, origin: Float64Array) -> Float64Array:
        """Cross-sections towards a place (3,) of the room: facets by the cosine of incidence, 0 from behind; shape (n,) [m^2]."""
        towards = origin - self.motion.position
        distance = np.sqrt((towards**2).sum(-1))
        cosine = (towards * self.normal).sum(-1) / np.maximum(distance, 1e-9)
        sided = (self.normal != 0).any(-1)
        return np.where(sided, self.rcs * np.maximum(cosine, 0.0), self.rcs)


@dataclass(frozen=True, eq=False)
class Echoes:
    """What comes back to the radar during one frame, in its sensor frame.

    An echo goes out along one leg and comes back along another; only a mirror (effect multipath) makes them differ.

    Attributes
    ----------
    out, back : Motion
        Where the echo seems to be, seen from the transmitters and from the receivers; the same object unless legs differ. The path is
        ``abs(out) + abs(back)``.
    strength : ndarray of complex128, shape (n,)
        Amplitude at the receiver's input times the lengths of both legs [V m^2]; the phase is what reflection and receiver add.
    owner : ndarray of int32, shape (n,)
        Index of the person in the scene; negative: a thing, see `THING`.
    source : ndarray of int32, shape (n,)
        Which scatterer each is of, as counted by the scatterers that echo.
    envelope : ndarray of float32, shape (n_chirp, n_tx, n), or None
        Amplitude from chirp to chirp on top; None: constant.
    """

    out: Motion
    back: Motion
    strength: NDArray[np.complex128]
    owner: NDArray[np.int32]
    source: NDArray[np.int32]
    envelope: NDArray[np.float32] | None = None

    def __len__(self) -> int:
        return len(self.strength)

    def select(self, index: NDArray[np.generic]) -> Echoes:
        """Keep what a mask or an index array picks."""
        out = self.out.select(index)
        back = out if self.back is self.out else self.back.select(index)
        envelope = None if self.envelope is None else np.ascontiguousarray(self.envelope[:, :, index])
        return Echoes(out, back, self.strength[index], self.owner[index], self.source[index], envelope)

    @classmethod
    def none(cls) -> Echoes:
        """No echo at all."""
        still, number = Motion.still(np.empty((0, 3))), np.empty(0, np.int32)
        return cls(still, still, np.empty(0, np.complex128), number, number)

    def weakened(self, factor: NDArray[np.number] | float | complex) -> Echoes:
        """Multiply amplitudes by a number or one per echo, shape (n,)."""
        return replace(self, strength=self.strength * factor)

    @property
    def range(self) -> Float64Array:
        """Half the path in the middle of the frame, shape (n,) [m]."""
        out = np.sqrt((self.out.position**2).sum(-1))
        return out if self.back is self.out else np.asarray(0.5 * (out + np.sqrt((self.back.position**2).sum(-1))), np.float64)

    @property
    def range_rate(self) -> Float64Array:
        """Of the middle of the frame, shape (n,) [m/s], receding positive."""
        return 0.5 * (_rate(self.out) + _rate(self.back))


def _rate(leg: Motion) -> Float64Array:
    distance = np.sqrt((leg.position**2).sum(-1))
    return np.asarray((leg.position * leg.velocity).sum(-1) / np.maximum(distance, 1e-9))
