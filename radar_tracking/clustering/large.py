"""Clustering of thousands of points: DBSCAN by a tree, and thinning, which bounds its time."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from radar_core.checks import require_finite
from radar_core.types import Float64Array, IndexArray

_MOST_CELLS: Final[float] = 2.0**50


def dbscan_tree(points: Float64Array, eps: float, min_points: float, weights: Float64Array | None) -> IndexArray:
    """By a k-d tree and connected components: for thousands of points."""
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
    """Find the different rows among integer keys, in lexicographic order.

    Parameters
    ----------
    keys : ndarray of int64, shape (n_points, n_axes)
        Cell of each point.

    Returns
    -------
    first : ndarray of int64, shape (n_cells,)
        First point of each cell.
    member : ndarray of int64, shape (n_points,)
        Cell of each point.
    count : ndarray of int64, shape (n_cells,)
        Points in each cell.
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
