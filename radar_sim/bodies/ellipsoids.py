"""The usual body: 18 ellipsoids on the skeleton, with points spread over them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core.linalg import canonical_eigh, first_max
from radar_sim.bodies.base import BONES, Pose
from radar_sim.bodies.lattice import sphere, spread, stretch
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


@dataclass(frozen=True, eq=False)
class Solids:
    """Ellipsoids of one subject at rest.

    Attributes
    ----------
    centre : ndarray, shape (18, 3)
        Middles [m].
    axes : ndarray, shape (18, 3, 3)
        Right-handed unit axes, as columns.
    half : ndarray, shape (18, 3)
        Half axes [m].
    """

    centre: Float64Array
    axes: Float64Array
    half: Float64Array

    @property
    def forward(self) -> int:
        """Which axis of the chest goes from back to front."""
        return int(first_max(np.abs(self.axes[_CHEST, 0])))


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

    Attributes
    ----------
    solids : Solids
        The ellipsoids at rest.
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
