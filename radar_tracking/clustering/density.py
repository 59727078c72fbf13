"""DBSCAN of a few to many thousand points in bounded time. The loops are compiled; numpy oracles are in the tests."""

from __future__ import annotations

from typing import Any, Final

import numba
import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_core.checks import require_finite
from radar_core.types import Float64Array, IndexArray
from radar_tracking.clustering.base import dense

DENSE_LIMIT: Final[int] = 2000
"""Up to here the compiled loop over all pairs is faster than a tree; it needs a byte for each pair."""
_NO_WEIGHTS: Final[Float64Array] = np.empty(0)
_MOST_CELLS: Final[float] = 2.0**50
_jit = numba.njit(cache=True, nogil=True)


def dbscan(points: Float64Array, eps: float, min_points: float, weights: Float64Array | None = None) -> IndexArray:
    """Density-based clustering (Ester et al., KDD 1996; thesis, 6.2.2).

    Labels are those of scikit-learn's ``DBSCAN``: clusters count from 0 in the order of their first core point; a border point that
    several clusters reach goes to the first of them.

    Parameters
    ----------
    points : ndarray of float64, shape (n_points, n_dimensions)
        Finite coordinates.
    eps : float
        Two points are neighbours up to this distance, the bound included; in the unit of ``points``.
    min_points : float
        A core point has neighbours of at least this total weight, itself included.
    weights : ndarray of float64, shape (n_points,), or None
        How many points each one stands for; None: one.

    Returns
    -------
    ndarray of int64, shape (n_points,)
        Cluster of each point; -1: noise.

    Raises
    ------
    DataError
        When a coordinate is not finite.
    """
    n = len(points)
    if n == 0:
        return np.empty(0, np.int64)
    if n > DENSE_LIMIT:
        return dbscan_tree(points, eps, min_points, weights)
    known = _NO_WEIGHTS if weights is None else dense(weights)
    labels: IndexArray = label_dense(dense(points), float(eps), float(min_points), known)
    if len(labels) < n:
        require_finite("points", points)
        raise DataError("points has coordinates so far apart that their distance overflows float64; give metres")
    return labels


def cluster(points: Float64Array, eps: float, min_points: float, max_points: int) -> IndexArray:
    """Label points by `dbscan` in bounded time, shape (n_points,): above ``max_points``, merged by `thin` on a grid of ``eps / 4``."""
    if len(points) <= max_points:
        return dbscan(points, eps, min_points)
    require_finite("points", points)
    merged, weights, member = thin(points, eps / 4, max_points)
    return dbscan(merged, eps, min_points, weights)[member]


def dbscan_tree(points: Float64Array, eps: float, min_points: float, weights: Float64Array | None) -> IndexArray:
    """By a k-d tree and connected components: for thousands of points."""
    from scipy.sparse import coo_array  # slow to import, and hardly ever needed
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    require_finite("points", points)
    n = len(points)
    pairs = cKDTree(points).query_pairs(eps, output_type="ndarray")
    first, second = pairs[:, 0], pairs[:, 1]
    own = np.ones(n) if weights is None else weights
    count = own + np.bincount(first, own[second], n) + np.bincount(second, own[first], n)
    core = count >= min_points
    inside = core[first] & core[second]
    graph = coo_array((np.ones(np.count_nonzero(inside), np.int8), (first[inside], second[inside])), shape=(n, n))
    component = connected_components(graph, directed=False)[1]
    cores = np.flatnonzero(core)
    labels = np.full(n, n, np.int64)
    if len(cores):
        labels[cores] = in_order(component[cores])
    for border, source in ((first, second), (second, first)):
        use = ~core[border] & core[source]
        np.minimum.at(labels, border[use], labels[source[use]])
    labels[labels == n] = -1
    return labels


def in_order(names: NDArray[Any]) -> IndexArray:
    """Rename groups to 0, 1, ... in the order of their first member, shape (n,)."""
    _, start, inverse = np.unique(names, return_index=True, return_inverse=True)
    rank = np.empty(len(start), np.int64)
    rank[np.argsort(start, kind="stable")] = np.arange(len(start))
    return rank[inverse]


def occupied(keys: IndexArray) -> tuple[IndexArray, IndexArray, IndexArray]:
    """Find the different rows among integer keys, shape (n_points, n_axes), in lexicographic order.

    Returns
    -------
    first, member, count : ndarray of int64, shapes (n_cells,), (n_points,), (n_cells,)
        First point of each cell, cell of each point, and points in each cell.
    """
    keys = keys - keys.min(axis=0)
    sizes = [int(k) + 1 for k in keys.max(axis=0)]
    if np.prod(np.array(sizes, np.float64)) < 2.0**62:
        flat = np.ravel_multi_index(tuple(keys.T), tuple(sizes))
    else:  # far points: number the values that occur, axis by axis, so that no product exceeds the square of the number of points
        flat = np.zeros(len(keys), np.int64)
        for axis in keys.T:
            values, own = np.unique(axis, return_inverse=True)
            flat = np.unique(flat * len(values) + own, return_inverse=True)[1]
    _, first, member, count = np.unique(flat, return_index=True, return_inverse=True, return_counts=True)
    return first, member, count


def thin(points: Float64Array, cell: float, max_points: int) -> tuple[Float64Array, Float64Array, IndexArray]:
    """Merge points that share a grid cell until at most ``max_points`` are left, so that clustering stays bounded in time.

    Parameters
    ----------
    points : ndarray of float64, shape (n_points, n_dimensions)
        Finite coordinates.
    cell : float
        Edge of the finest grid; doubled as often as needed.
    max_points : int
        Most points that may be left.

    Returns
    -------
    merged : ndarray of float64, shape (n_merged, n_dimensions)
        Mean of each cell's points.
    weights : ndarray of float64, shape (n_merged,)
        Number of points in each cell.
    member : ndarray of int64, shape (n_points,)
        Which merged point each point went into.
    """
    n = len(points)
    if n <= max_points:
        return points, np.ones(n), np.arange(n)
    cell = max(cell, float(np.abs(points).max()) / _MOST_CELLS)  # a finer grid than float64 resolves has no cells
    while True:
        _, member, count = occupied(np.floor(points / cell).astype(np.int64))
        if len(count) <= max_points:
            break
        cell *= 2
    merged = np.stack([np.bincount(member, axis) / count for axis in points.T], axis=-1)
    return merged, count.astype(np.float64), member


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

    Which points are neighbours, shape (n_points, n_points), symmetric, and which have enough of them, shape (n_points,), become clusters in
    the order of their first core point, shape (n_points,); -1: noise.
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
def label_dense(points: Any, eps: float, min_points: float, weights: Any) -> Any:
    """Label by `dbscan`, comparing all pairs. Empty ``weights``: all one. Empty result: a coordinate is not finite."""
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
