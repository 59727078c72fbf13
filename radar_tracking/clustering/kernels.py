"""Inner loops of DBSCAN, compiled, and what the loops of the other methods share; numpy oracles are in the tests."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

_jit = numba.njit(cache=True, nogil=True)


@_jit
def columns_of(points: Any) -> Any:
    """Coordinates axis by axis, so that the inner loops run over neighbours in memory."""
    n, d = points.shape
    columns = np.empty((d, n))
    for axis in range(d):
        for i in range(n):
            columns[axis, i] = points[i, axis]
    return columns


@_jit
def squared_distances(columns: Any, i: int, squared: Any) -> None:
    """Squared distances of point ``i`` to all points, into ``squared``."""
    d, n = columns.shape
    squared[:] = 0.0
    for axis in range(d):
        column = columns[axis]
        here = column[i]
        for j in range(n):
            step = column[j] - here
            squared[j] += step * step


@_jit
def weigh(near: Any, weights: Any) -> float:
    """Total weight of the neighbours of one point; no weights: their number."""
    if len(weights) == 0:
        number = 0
        for j in range(len(near)):
            number += near[j]
        return float(number)
    total = 0.0
    for j in range(len(near)):
        if near[j]:
            total += weights[j]
    return total


@_jit
def grow(near: Any, core: Any) -> Any:
    """Connect core points, and give border points to the first cluster that reaches them (Ester et al., KDD 1996).

    Parameters
    ----------
    near : ndarray of bool, shape (n_points, n_points)
        Which points are neighbours; symmetric.
    core : ndarray of bool, shape (n_points,)
        Which points have enough neighbours.

    Returns
    -------
    ndarray of int64, shape (n_points,)
        Clusters in the order of their first core point; -1: noise.
    """
    n = len(core)
    labels = np.full(n, -1, np.int64)
    left, stack = np.arange(n), np.empty(n, np.int64)
    n_left, label = n, 0
    for seed in range(n):
        if not core[seed] or labels[seed] >= 0:
            continue
        stack[0], size = seed, 1
        while size > 0:
            size -= 1
            row = near[stack[size]]
            kept = 0
            for k in range(n_left):
                point = left[k]
                if row[point]:
                    labels[point] = label
                    if core[point] and point != seed:
                        stack[size] = point
                        size += 1
                else:
                    left[kept] = point
                    kept += 1
            n_left = kept
        label += 1
    return labels


@_jit
def dbscan(points: Any, eps: float, min_points: float, weights: Any) -> Any:
    """DBSCAN by all pairs; see `radar_tracking.clustering.dbscan`. Empty ``weights``: all one. Empty result: a coordinate is not finite."""
    n = len(points)
    columns = columns_of(points)
    near, core, squared = np.empty((n, n), np.bool_), np.empty(n, np.bool_), np.empty(n)
    limit = eps * eps
    for i in range(n):
        squared_distances(columns, i, squared)
        row = near[i]
        for j in range(n):
            row[j] = squared[j] <= limit
        if not row[i]:  # its distance to itself is not a number
            return np.empty(0, np.int64)
        core[i] = weigh(row, weights) >= min_points
    return grow(near, core)
