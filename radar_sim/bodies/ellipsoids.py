"""The usual body: 18 ellipsoids on the skeleton, with points spread over them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core.linalg import canonical_eigh, first_max
from radar_sim.bodies.base import BONES, Pose
from radar_sim.bodies.skin import blend, turn
from radar_sim.bodies.subject import MIRROR, Subject
from radar_sim.scatterers import Ellipsoids, Float64Array, Hull, Motion, Scatterers

PARTS: Final[tuple[str, ...]] = (
    "pelvis", "spine_01", "spine_02", "spine_03", "neck_01", "head",
    "upperarm_l", "lowerarm_l", "hand_l", "upperarm_r", "lowerarm_r", "hand_r",
    "thigh_l", "calf_l", "foot_l", "thigh_r", "calf_r", "foot_r",
)  # fmt: skip
"""Bones that carry an ellipsoid."""
COUNT: Final = 800
"""Points on all ellipsoids together, about: one for 22 cm^2 of skin."""
_BONE = np.array([BONES.index(name) for name in PARTS], np.int32)
_MERGED = {"clavicle_l": "spine_03", "clavicle_r": "spine_03", "ball_l": "foot_l", "ball_r": "foot_r"}
_PART = np.array([PARTS.index(_MERGED.get(name, name)) for name in BONES])
_CHEST = PARTS.index("spine_03")
_FLIP = np.array([1.0, -1.0, 1.0])
_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
_GRID = 96
"""Latitudes and longitudes of the table of areas; the areas of points are then good to 0.1 %."""


@dataclass(frozen=True, eq=False)
class Solids:
    """Ellipsoids of one subject at rest."""

    centre: Float64Array  # middles, shape (18, 3) [m]
    axes: Float64Array  # right-handed unit axes, as columns, shape (18, 3, 3)
    half: Float64Array  # half axes, shape (18, 3) [m]

    @property
    def forward(self) -> int:
        """Which axis of the chest goes from back to front."""
        return int(first_max(np.abs(self.axes[_CHEST, 0])))


def sphere(n: int) -> Float64Array:
    """Fibonacci lattice: n unit vectors, shape (n, 3), each for the same area (Gonzalez 2010)."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / max(n, 1)
    angle = _GOLDEN * np.arange(n)
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], -1)


def stretch(unit: Float64Array, half: Float64Array) -> Float64Array:
    """Area of an ellipsoid's surface over that of the unit sphere there, shape (n,), for half axes (3,) and unit vectors (n, 3)."""
    return np.asarray(half.prod() * np.sqrt(((unit / half) ** 2).sum(-1)))


def spread(half: Float64Array, n: int, twist: float = 0.0) -> tuple[Float64Array, Float64Array]:
    """Lay a Fibonacci lattice on an ellipsoid, warped so that every point stands for the same area.

    Parameters
    ----------
    half : ndarray, shape (3,)
        Half axes [m].
    n : int
        Number of points.
    twist : float
        Turns the lattice about its poles, which lie on the third axis [rad].

    Returns
    -------
    tuple of ndarray of float64
        Unit vectors u, shape (n, 3), of the points ``half * u``, and the area of each, shape (n,) [m^2].
    """
    lattice = sphere(n)
    if n == 0:
        return lattice, np.empty(0)
    z = (np.arange(_GRID) + 0.5) * (2.0 / _GRID) - 1.0
    angle = (np.arange(2 * _GRID) + 0.5) * (math.pi / _GRID)
    flat = np.sqrt(1.0 - z * z)[:, None]
    grid = np.stack(np.broadcast_arrays(flat * np.cos(angle), flat * np.sin(angle), z[:, None]), -1)
    cell = stretch(grid, half) * (4.0 * math.pi / (2 * _GRID * _GRID))
    # first the latitudes, by the area of whole bands; then the longitudes, by the area within the band
    bands = np.concatenate([[0.0], cell.sum(1).cumsum()])
    height = np.interp(0.5 * (lattice[:, 2] + 1.0) * bands[-1], bands, np.linspace(-1.0, 1.0, _GRID + 1))
    row = np.minimum((0.5 * (height + 1.0) * _GRID).astype(np.int64), _GRID - 1)
    turn = np.mod(np.arctan2(lattice[:, 1], lattice[:, 0]) + twist, 2.0 * math.pi) / (2.0 * math.pi)
    edges = np.linspace(0.0, 2.0 * math.pi, 2 * _GRID + 1)
    around = np.concatenate([np.zeros((_GRID, 1)), cell.cumsum(1)], 1)
    longitude = np.array([np.interp(f * around[r, -1], around[r], edges) for f, r in zip(turn, row, strict=True)])
    ring = np.sqrt(1.0 - height * height)
    return np.stack([ring * np.cos(longitude), ring * np.sin(longitude), height], -1), np.full(n, bands[-1] / n)


def fit(subject: Subject) -> Solids:
    """Give each part of the mesh the ellipsoid whose surface has the same centroid and the same second moments.

    A tube of radius r and length L gets half axes of 1.15 r and 0.58 L: neighbours overlap a little, the area seen from the side is that
    of the tube within 5 %. Left and right are fitted together, as mirror images.
    """
    corner = subject.vertices[subject.faces]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.sqrt((across**2).sum(-1))
    pull = np.zeros((len(corner), len(PARTS)))
    rows = np.arange(len(corner))[:, None, None]
    bones = subject.bone[subject.faces]
    np.add.at(pull, (np.broadcast_to(rows, bones.shape), _PART[bones]), subject.weight[subject.faces])
    part = first_max(pull, 1)
    solids = Solids(np.empty((18, 3)), np.empty((18, 3, 3)), np.empty((18, 3)))
    for i, bone in enumerate(_BONE):
        twin = int(_BONE.tolist().index(MIRROR[bone]))
        if twin < i:
            solids.centre[i], solids.half[i] = solids.centre[twin] * _FLIP, solids.half[twin]
            solids.axes[i] = _FLIP[:, None] * solids.axes[twin] * (1.0, 1.0, -1.0)  # a mirror image would be left-handed
            continue
        points = np.concatenate([corner[part == i].reshape(-1, 3), corner[part == twin].reshape(-1, 3) * _FLIP])
        weight = np.repeat(np.concatenate([area[part == i], area[part == twin]]), 3)
        solids.centre[i], covariance = _moments(points, weight)
        values, axes = canonical_eigh(covariance)
        axes[:, 1] *= -1.0  # of all such rules the one that left most points of the published scenes where they were
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        solids.axes[i] = axes
        solids.half[i] = _half_axes(values)
    return solids


def _moments(corner: Float64Array, weight: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Centroid and covariance of triangles: three corners (3 n, 3) of each after one another, weights (3 n,) by their areas."""
    share = weight / weight.sum()
    centroid = share @ corner
    offset = corner - centroid
    middle = offset.reshape(-1, 3, 3).mean(1)
    # over a triangle, the mean of x x^T is (sum over its corners of x x^T + 9 m m^T) / 12, m its middle
    inner = 3.0 * (share[:, None] * offset).T @ offset + 9.0 * (share.reshape(-1, 3).sum(1)[:, None] * middle).T @ middle
    return centroid, inner / 12.0


def _half_axes(moments: Float64Array) -> Float64Array:
    """Half axes (3,) [m] of the ellipsoid whose surface has those second moments along its axes (3,) [m^2]."""
    unit = sphere(2000)
    half = np.sqrt(3.0 * moments)
    for _ in range(60):
        weight = stretch(unit, half)
        got = (weight[:, None] * (unit * half) ** 2).sum(0) / weight.sum()
        half = half * np.sqrt(moments / got)
    return half


@dataclass(frozen=True, eq=False)
class _Points:
    """Points on the ellipsoids of one subject at rest: places, normals, growth with breath, ellipsoid and area of each."""

    place: Float64Array
    normal: Float64Array
    swell: Float64Array
    part: NDArray[np.int32]
    area: Float64Array


def _scatter(solids: Solids, count: int, seed: int | tuple[int, ...]) -> _Points:
    """Spread about ``count`` points evenly over the ellipsoids' union: what lies within another ellipsoid is left out."""
    twist = np.random.default_rng(np.append(np.atleast_1d(seed), 0xB0D)).uniform(0.0, 2.0 * np.pi, len(PARTS))
    area = np.array([stretch(sphere(500), half).mean() for half in solids.half])
    first = _lay(solids, np.round(count * area / area.sum()).astype(np.int64), twist)
    share = len(first.area) / count
    return _lay(solids, np.round(count / share * area / area.sum()).astype(np.int64), twist)


def _lay(solids: Solids, numbers: NDArray[np.int64], twist: Float64Array) -> _Points:
    inverse = np.linalg.inv(solids.axes * solids.half[:, None, :])
    parts = []
    for i, (centre, axes, half) in enumerate(zip(solids.centre, solids.axes, solids.half, strict=True)):
        unit, area = spread(half, int(numbers[i]), twist[i])
        place = centre + (unit * half) @ axes.T
        normal = (unit / half) @ axes.T
        normal /= np.sqrt((normal**2).sum(-1, keepdims=True))
        swell = _swell(solids, unit) if i == _CHEST else np.zeros_like(place)
        depth = (np.einsum("mij,nmj->nmi", inverse, place[:, None] - solids.centre) ** 2).sum(-1)
        depth[:, i] = np.inf
        out = depth.min(1) >= 1.0
        parts.append(_Points(place[out], normal[out], swell[out], np.full(int(out.sum()), i, np.int32), area[out]))
    return _Points(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("place", "normal", "swell", "part", "area")))


def _swell(solids: Solids, unit: Float64Array) -> Float64Array:
    """Where points of the chest go per metre of breath: the front by all of it, the back not at all, so that it stays an ellipsoid."""
    forward, sign = _forward(solids)
    return 0.5 * (1.0 + sign * unit[:, solids.forward, None]) * forward


def _forward(solids: Solids) -> tuple[Float64Array, float]:
    """Find the unit vector (3,) from the back to the front of the chest, and whether its axis points along (1) or against it (-1)."""
    axis = solids.axes[_CHEST, :, solids.forward]
    sign = float(np.sign(axis[0]))
    return sign * axis, sign


class EllipsoidBody:
    """A person as 18 solid ellipsoids, each fixed to a bone, that echo from about 800 points of their surfaces.

    Each point stands for the same area; its normal is the ellipsoid's in closed form. Points that lie within another ellipsoid at rest
    are left out.

    Parameters
    ----------
    subject : Subject
        Whose body.
    reflectivity : float
        Share of the power that skin and clothes reflect.
    seed : int or tuple of int
        Turns the lattices of points about the ellipsoids' long axes, so that no two people echo alike.
    """

    def __init__(self, subject: Subject, reflectivity: float, seed: int | tuple[int, ...] = 0) -> None:
        self.solids = solids = fit(subject)
        self._rest = subject.joint
        self._points = points = _scatter(solids, COUNT, seed)
        self._bone = _BONE[points.part][:, None]
        self._weight = np.ones((len(points.part), 1))
        self._rcs = points.area * reflectivity
        forward, sign = _forward(solids)
        self._grow = 0.5 * forward
        self._widen = np.zeros((3, 3))
        self._widen[:, solids.forward] = 0.5 * sign * forward

    def surface(self, pose: Pose, span: float, owner: int) -> Scatterers:
        """Surface elements of the whole body, both sides of it, seen or not: see `radar_sim.bodies.base.Body`."""
        points = self._points
        places = blend(points.place, points.swell, self._bone, self._weight, self._rest, pose)
        normal = turn(points.normal, self._bone[:, 0], pose.rotation[len(pose.rotation) // 2])
        owners = np.full(len(normal), owner, np.int32)
        return Scatterers(Motion.through(places, span), normal, self._rcs, owners, (self.hull(pose),))

    def hull(self, pose: Pose) -> Hull:
        """Return what the body hides with, in the middle of the frame; not computed before it is called."""
        return lambda: self.ellipsoids(pose, len(pose.joint) // 2)

    def ellipsoids(self, pose: Pose, index: int = 0) -> Ellipsoids:
        """Place the ellipsoids in ``room``, at one of the pose's times."""
        solids, breath = self.solids, pose.breath[index]
        rotation = pose.rotation[index][_BONE]
        centre, axes = solids.centre.copy(), solids.axes * solids.half[:, None, :]
        centre[_CHEST] += breath * self._grow
        axes[_CHEST] += breath * self._widen
        offset = (rotation @ (centre - self._rest[_BONE])[:, :, None])[..., 0]
        return Ellipsoids(pose.joint[index][_BONE] + offset, rotation @ axes)
