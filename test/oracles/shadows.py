"""What hides what, by brute force with numpy: the reference of `radar_sim.bodies.shadows`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radar_sim.scatterers import Float64Array

_CHUNK = 256


def hidden_by_triangles(points: Float64Array, corners: Float64Array, margin: float) -> NDArray[np.bool_]:
    """Tell which points lie behind a triangle: Moeller and Trumbore (1997), every ray against every triangle.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        From the place that is looked from [m].
    corners : ndarray, shape (m, 3, 3)
        From there [m].
    margin : float
        How far behind a point has to be [m].

    Returns
    -------
    ndarray of bool, shape (n,)
        True: hidden.
    """
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    start = -corners[:, 0]
    across = np.cross(start, first)
    reach = (second * across).sum(-1)
    hidden = np.zeros(len(points), np.bool_)
    for i in range(0, len(points), _CHUNK):
        ray = points[i : i + _CHUNK]
        side = np.cross(ray[:, None], second)
        det = (side * first).sum(-1)
        with np.errstate(divide="ignore", invalid="ignore"):  # a triangle seen edge on hides nothing
            u, v, t = (side * start).sum(-1) / det, (ray @ across.T) / det, reach / det
            distance = np.sqrt((ray**2).sum(-1, keepdims=True))
            hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0) & (t * distance < distance - margin)
        hidden[i : i + _CHUNK] = hit.any(1)
    return hidden


def hidden_by_ellipsoids(points: Float64Array, centre: Float64Array, axes: Float64Array, margin: float) -> NDArray[np.bool_]:
    """Tell which points lie behind an ellipsoid.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        From the place that is looked from [m].
    centre, axes : ndarray, shapes (m, 3), (m, 3, 3)
        Of the ellipsoids ``centre + axes @ (unit ball)``, from there [m].
    margin : float
        How far behind a point has to be [m].

    Returns
    -------
    ndarray of bool, shape (n,)
        True: hidden.
    """
    inverse = np.linalg.inv(axes)
    q = -np.einsum("mij,mj->mi", inverse, centre)
    w = np.einsum("mij,nj->nmi", inverse, points)
    a, b, c = (w * w).sum(-1), (q * w).sum(-1), (q * q).sum(-1) - 1.0
    inner = b * b - a * c
    distance = np.sqrt((points**2).sum(-1, keepdims=True))
    root = -b - np.sqrt(np.maximum(inner, 0.0))
    met = (inner > 0.0) & (b < 0.0) & (c > 0.0) & (root * distance < (distance - margin) * a)
    hidden: NDArray[np.bool_] = met.any(1)
    return hidden
