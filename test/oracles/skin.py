"""Surfaces that follow a skeleton, in numpy: the reference of `radar_sim.bodies.skin`."""

from __future__ import annotations

import numpy as np

from radar_sim.bodies.base import Pose
from radar_sim.bodies.skin import Int32Array
from radar_sim.scatterers import Float64Array


def blend_numpy(
    points: Float64Array, swell: Float64Array, bone: Int32Array, weight: Float64Array, rest: Float64Array, pose: Pose
) -> Float64Array:
    """Do what `blend` does, with numpy."""
    at = points + pose.breath[:, None, None] * swell
    offset = at[:, :, None, :] - rest[bone]
    moved = (pose.rotation[:, bone] @ offset[..., None])[..., 0] + pose.joint[:, bone]
    result: Float64Array = (weight[..., None] * moved).sum(2)
    return result


def turn_numpy(normals: Float64Array, bone: Int32Array, rotation: Float64Array) -> Float64Array:
    """Do what `turn` does, with numpy."""
    turned: Float64Array = (rotation[bone] @ normals[:, :, None])[..., 0]
    return turned


def facets_numpy(vertices: Float64Array, faces: Int32Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Do what `facets` does, with numpy."""
    corner = vertices[:, faces]
    at = corner[len(vertices) // 2]
    across = np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])
    double = np.sqrt((across**2).sum(-1))
    normal = np.divide(across, double[:, None], out=np.zeros_like(across), where=double[:, None] > 0.0)
    return corner.mean(2), normal, 0.5 * double
