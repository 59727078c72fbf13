"""K-means from given centres."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from radar_core import DataError
from radar_core.checks import require_finite
from radar_core.types import Float64Array, IndexArray
from radar_tracking.clustering.base import dense

_jit = numba.njit(cache=True, nogil=True)


def kmeans(points: Float64Array, centres: Float64Array, max_iterations: int = 20) -> tuple[IndexArray, Float64Array]:
    """Lloyd's k-means from given centres (Lloyd 1982; thesis, 6.2.2 and 7.3).

    Parameters
    ----------
    points : ndarray of float64, shape (n_points, n_dimensions)
        Finite coordinates.
    centres : ndarray of float64, shape (k, n_dimensions)
        Where to start; given, not drawn, so that the result is repeatable. At least one.
    max_iterations : int
        Stop here if it has not converged.

    Returns
    -------
    labels : ndarray of int64, shape (n_points,)
        Nearest centre of each point; the first on a tie.
    centres : ndarray of float64, shape (k, n_dimensions)
        Means of the clusters; an empty cluster keeps its centre.

    Raises
    ------
    DataError
        When there is no centre, shapes do not fit, or a coordinate is not finite.
    """
    points, centres = dense(points), dense(centres)
    require_centres(points, centres)
    labels, moved = _lloyd(points, centres, max_iterations)
    return labels, moved


def require_centres(points: Float64Array, centres: Float64Array) -> None:
    """Raise `DataError` unless there is a centre, centres have as many coordinates as points, and all are finite."""
    if points.ndim != 2 or centres.ndim != 2 or points.shape[1] != centres.shape[1] or len(centres) == 0:
        raise DataError(f"points {points.shape} and centres {centres.shape} do not fit; give (n, d) and (k, d) with k of at least 1")
    require_finite("points", points)
    require_finite("centres", centres)


def spread_centres(points: Float64Array, k: int) -> Float64Array:
    """Choose starting centres without chance: the point farthest from the mean, then always the farthest from those (Gonzalez 1985).

    Of at least one point, shape (n_points, n_dimensions), at most ``k``: fewer where fewer points differ.
    """
    gap = ((points - points.mean(axis=0)) ** 2).sum(axis=1)
    chosen = [points[gap.argmax()]]
    gap = ((points - chosen[0]) ** 2).sum(axis=1)
    while len(chosen) < k and gap.max() > 0:
        chosen.append(points[gap.argmax()])
        gap = np.minimum(gap, ((points - chosen[-1]) ** 2).sum(axis=1))
    return np.array(chosen)


@_jit
def _lloyd(points: Any, centres: Any, max_iterations: int) -> Any:
    """Assign and average in turn until no label changes: labels, centres."""
    n, d = points.shape
    k = len(centres)
    centres, labels = centres.copy(), np.full(n, -1, np.int64)
    total, number = np.empty((k, d)), np.empty(k)
    for _ in range(max_iterations):
        changed = False
        total[:], number[:] = 0.0, 0.0
        for i in range(n):
            nearest, best = 0, np.inf
            for c in range(k):
                squared = 0.0
                for axis in range(d):
                    step = points[i, axis] - centres[c, axis]
                    squared += step * step
                if squared < best:
                    nearest, best = c, squared
            changed |= labels[i] != nearest
            labels[i] = nearest
            number[nearest] += 1
            for axis in range(d):
                total[nearest, axis] += points[i, axis]
        if not changed:
            break
        for c in range(k):
            if number[c] > 0:
                for axis in range(d):
                    centres[c, axis] = total[c, axis] / number[c]
    return labels, centres
