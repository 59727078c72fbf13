"""Triangles and balls into a colour image and a depth image: a z-buffer, compiled."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from radar_lab.camera.pinhole import CameraModel

Float64Array = NDArray[np.float64]
_jit = numba.njit(cache=True, nogil=True)
_NEAR = 0.05  # m: triangles with a corner nearer than this are left out


def draw_triangles(
    camera: CameraModel, corner: Float64Array, faces: NDArray[np.int32], shade: Float64Array, colour: Float64Array, depth: Float64Array
) -> None:
    """Draw triangles into both images, the nearest in front.

    Parameters
    ----------
    camera : CameraModel
        Who looks.
    corner : ndarray, shape (n_corner, 3)
        In the optical frame [m].
    faces : ndarray of int32, shape (n_face, 3)
        Corners of each triangle, anticlockwise seen from outside; those that look away are left out.
    shade : ndarray, shape (n_face, 3)
        Red, green, blue, 0 to 255.
    colour : ndarray, shape (height, width, 3)
        Is drawn into.
    depth : ndarray, shape (height, width)
        Is drawn into [m]; infinity: nothing there yet.
    """
    pixel = camera.project(corner)
    usable = np.isfinite(pixel).all(-1) & (corner[:, 2] > _NEAR)
    a, b, c = (corner[faces[:, k]] for k in range(3))
    facing = (np.cross(b - a, c - a) * a).sum(-1) < 0
    kept = np.flatnonzero(facing & usable[faces].all(-1))
    _fill(pixel, corner[:, 2].copy(), faces[kept], shade[kept], colour, depth)


@_jit
def _fill(pixel: Any, z: Any, faces: Any, shade: Any, colour: Any, depth: Any) -> None:
    height, width = depth.shape
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        u0, v0, u1, v1, u2, v2 = pixel[i, 0], pixel[i, 1], pixel[j, 0], pixel[j, 1], pixel[k, 0], pixel[k, 1]
        area = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
        if abs(area) < 1e-12:
            continue
        left, right = max(0, math.ceil(min(u0, u1, u2))), min(width - 1, math.floor(max(u0, u1, u2)))
        top, bottom = max(0, math.ceil(min(v0, v1, v2))), min(height - 1, math.floor(max(v0, v1, v2)))
        for v in range(top, bottom + 1):
            for u in range(left, right + 1):
                w0 = ((u1 - u) * (v2 - v) - (u2 - u) * (v1 - v)) / area
                w1 = ((u2 - u) * (v0 - v) - (u0 - u) * (v2 - v)) / area
                w2 = 1.0 - w0 - w1
                if w0 < 0.0 or w1 < 0.0 or w2 < 0.0:
                    continue
                here = 1.0 / (w0 / z[i] + w1 / z[j] + w2 / z[k])  # 1 / depth is linear in the image, depth is not
                if here < depth[v, u]:
                    depth[v, u] = here
                    for channel in range(3):
                        colour[v, u, channel] = shade[f, channel]


def draw_ball(
    ray: Float64Array, centre: Float64Array, radius: float, shade: Float64Array, colour: Float64Array, depth: Float64Array
) -> None:
    """Draw a ball into both images.

    Parameters
    ----------
    ray : ndarray, shape (height, width, 3)
        Direction of every pixel in the optical frame, with z = 1.
    centre : ndarray, shape (3,)
        In the optical frame [m].
    radius : float
        Of the ball [m].
    shade : ndarray, shape (3,)
        Red, green, blue, 0 to 255.
    colour, depth : ndarray, shapes (height, width, 3), (height, width)
        As in `draw_triangles`.
    """
    along = ray @ centre
    square = (ray**2).sum(-1)
    root = along**2 - square * (centre @ centre - radius**2)
    near = np.full(depth.shape, np.inf)
    hit = root >= 0
    near[hit] = (along[hit] - np.sqrt(root[hit])) / square[hit]
    front = hit & (near > _NEAR) & (near < depth)
    depth[front] = near[front]
    normal = (ray[front] * near[front][:, None] - centre) / radius
    light = 0.6 + 0.4 * np.clip(-normal[:, 2], 0.0, 1.0)
    colour[front] = shade * light[:, None]
