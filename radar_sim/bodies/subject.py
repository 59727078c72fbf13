"""Subjects: the shape of one person, from the parametric mesh, with arms of human length."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core.paths import find_config
from radar_sim.bodies.base import BONES
from radar_sim.people import Person
from radar_sim.scatterers import Float64Array

UPPER_ARM, FOREARM, HALF_HAND = 0.186, 0.146, 0.054
"""Lengths over stature (Drillis and Contini 1966)."""
MIRROR: Final[tuple[int, ...]] = tuple(
    BONES.index(name[:-2] + {"_l": "_r", "_r": "_l"}[name[-2:]]) if name[-2:] in ("_l", "_r") else i for i, name in enumerate(BONES)
)
"""The bone at the other side of each bone; itself in the middle."""
_FLIP = np.array([1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class _Shape:
    """The mesh's file, facing +x."""

    mean: Float64Array  # vertices, then heads, then tails of the bones, of the mean body, shape (n_point, 3) [m]
    basis: Float64Array  # what each shape component adds, shape (n_component, n_point, 3) [m]
    coef: Float64Array  # components of the corner bodies, shape (n_corner, n_component)
    corner: NDArray[np.int8]  # sex (0 female), age (0 young adult), muscle, weight, height (0..2) of each, shape (n_corner, 5)
    faces: NDArray[np.int32]
    bone: NDArray[np.int32]
    weight: Float64Array


@cache
def _shape() -> _Shape:
    with np.load(find_config("human_6000f", "bodies", ".npz"), allow_pickle=False) as file:
        data = {name: file[name] for name in file.files}
    ends = [np.concatenate([data[a], data[b][..., 0, :], data[b][..., 1, :]], -2) for a, b in (("mean", "jmean"), ("basis", "jbasis"))]
    # The file's body faces -y; turned left by 90 degrees it faces +x.
    mean, basis = (np.stack([-x[..., 1], x[..., 0], x[..., 2]], -1).astype(np.float64) for x in ends)
    weight = data["w"].astype(np.float64)
    weight /= weight.sum(1, keepdims=True)
    coef, faces, bone = data["coef"].astype(np.float64), data["faces"].astype(np.int32), data["widx"].astype(np.int32)
    return _Shape(mean, basis, coef, data["corners"], faces, bone, weight)


@dataclass(frozen=True, eq=False)
class Subject:
    """The shape of one person at rest: feet on z = 0, pelvis above the origin, facing +x, arms half raised."""

    stature: float  # height of the top of the head [m]
    joint: Float64Array  # head of every bone, shape (22, 3) [m]
    hand: Float64Array  # middle of the left and of the right hand, on the line through elbow and wrist, shape (2, 3) [m]
    vertices: Float64Array  # skin, shape (n_vertex, 3) [m]
    faces: NDArray[np.int32]  # vertices of each triangle, anticlockwise seen from outside, shape (n_face, 3)
    bone: NDArray[np.int32]  # bones that move each vertex, shape (n_vertex, 4)
    weight: Float64Array  # by how much; rows sum to 1, shape (n_vertex, 4)

    @classmethod
    def of(cls, person: Person) -> Subject:
        """Shape a young adult of the person's sex and build, scaled to their height, with arms of the lengths of Drillis and Contini."""
        shape = _shape()
        n_vertex = len(shape.weight)
        points = np.tensordot(_coefficients(shape, person), shape.basis, 1) + shape.mean
        low = points[:n_vertex, 2].min()
        points = (points - (0.0, 0.0, low)) * (person.height / (points[:n_vertex, 2].max() - low))
        vertices, joint = points[:n_vertex], points[n_vertex : n_vertex + len(BONES)]
        # Both sides of the body are the same in the corner bodies, up to the file's rounding.
        joint = 0.5 * (joint + joint[list(MIRROR)] * _FLIP)
        moved, linear, hand = _arms(joint, vertices, shape, person.height)
        offset = vertices[:, None, :] - joint[shape.bone]
        blended = (linear[shape.bone] @ offset[..., None])[..., 0] + moved[shape.bone]
        skin = (shape.weight[..., None] * blended).sum(1)
        return cls(person.height, moved, hand, skin, shape.faces, shape.bone, shape.weight)

    @property
    def normals(self) -> Float64Array:
        """Outward unit normals of the skin at its vertices, shape (n_vertex, 3)."""
        corner = self.vertices[self.faces]
        across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        total = np.zeros_like(self.vertices)
        for k in range(3):
            np.add.at(total, self.faces[:, k], across)
        return np.asarray(total / np.maximum(np.sqrt((total**2).sum(-1, keepdims=True)), 1e-12))


def _coefficients(shape: _Shape, person: Person) -> Float64Array:
    """Interpolate between corner bodies: muscle and weight by build, height level by stature as far as the levels reach."""
    sex = ("female", "male").index(person.sex)
    weight = _between(2.0 * person.build)
    muscle = _between(max(2.0 * person.build, 1.0))  # slim, not starved: body-mass indices from 19 to 30
    levels = [_mix(shape, {(sex, 0, m, w, h): a * b for m, a in muscle for w, b in weight}) for h in range(3)]
    n_vertex = len(shape.weight)
    statures = [float(np.ptp((np.tensordot(level, shape.basis[..., 2], 1) + shape.mean[:, 2])[:n_vertex])) for level in levels]
    at = float(np.interp(person.height, statures, [0.0, 1.0, 2.0]))
    return np.asarray(sum((a * levels[h] for h, a in _between(at)), np.zeros(shape.coef.shape[1])))


def _between(at: float) -> list[tuple[int, float]]:
    """Neighbouring whole levels, 0..2, and their shares."""
    low = min(int(at), 1)
    return [(low, 1.0 - (at - low)), (low + 1, at - low)]


def _mix(shape: _Shape, shares: dict[tuple[int, ...], float]) -> Float64Array:
    total = np.zeros(shape.coef.shape[1])
    for labels, share in shares.items():
        total += share * shape.coef[int(np.flatnonzero((shape.corner == labels).all(1))[0])]
    return total


def _arms(joint: Float64Array, vertices: Float64Array, shape: _Shape, stature: float) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Stretch the arms along their bones; size the hands and turn them into line with the forearms.

    Gives new heads of the bones (22, 3), what to multiply offsets from the old heads by (22, 3, 3), and the middles of the hands (2, 3).
    """
    moved, linear = joint.copy(), np.tile(np.eye(3), (len(BONES), 1, 1))
    middle = np.empty((2, 3))
    main = shape.bone[np.arange(len(shape.bone)), shape.weight.argmax(1)]
    for i, side in enumerate("lr"):
        upper, lower, hand = (BONES.index(f"{name}_{side}") for name in ("upperarm", "lowerarm", "hand"))
        for bone, child, share in ((upper, lower, UPPER_ARM), (lower, hand, FOREARM)):
            along = joint[child] - joint[bone]
            length = float(np.sqrt(along @ along))
            along = along / length
            linear[bone] += (share * stature / length - 1.0) * np.outer(along, along)
            moved[child] = moved[bone] + share * stature * along
        palm = vertices[main == hand] - joint[hand]
        towards = palm.mean(0)
        towards /= np.sqrt(towards @ towards)
        size = 2 * HALF_HAND * stature / float((palm @ towards).max())
        linear[hand] = size * between(towards, along)
        middle[i] = moved[hand] + HALF_HAND * stature * along
    return moved, linear, middle


def between(start: Float64Array, end: Float64Array) -> Float64Array:
    """Smallest rotation that takes one unit vector (3,) to another that is not its opposite; shape (3, 3)."""
    k = np.cross(start, end)
    cross = np.array([[0.0, -k[2], k[1]], [k[2], 0.0, -k[0]], [-k[1], k[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + start @ end))
