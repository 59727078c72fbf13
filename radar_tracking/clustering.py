"""Clustering of a few to a few thousand points: DBSCAN and k-means, in numpy and scipy."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

Float64Array = NDArray[np.float64]
LabelArray = NDArray[np.int64]

_DENSE_LIMIT: Final[int] = 250
"""Up to here the full matrix of distances is faster than a tree."""


def dbscan(points: Float64Array, eps: float, min_points: float, weights: Float64Array | None = None) -> LabelArray:
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
    """
    n = len(points)
    if n == 0:
        return np.empty(0, np.int64)
    if n <= _DENSE_LIMIT:
        return _dbscan_dense(points, eps, min_points, weights)
    return _dbscan_tree(points, eps, min_points, weights)


def _dbscan_dense(points: Float64Array, eps: float, min_points: float, weights: Float64Array | None) -> LabelArray:
    """By the matrix of distances: cheapest for the usual tens of points."""
    n = len(points)
    squared = np.zeros((n, n))
    for axis in points.T:
        step = axis[:, None] - axis
        squared += step * step
    near = squared <= eps * eps
    count = near.sum(axis=1) if weights is None else near @ weights
    core = count >= min_points
    labels = np.full(n, -1, np.int64)
    label = 0
    for seed in np.flatnonzero(core):
        if labels[seed] >= 0:
            continue
        frontier = np.array([seed])
        while len(frontier):
            reached = near[frontier].any(axis=0) & (labels < 0)
            labels[reached] = label
            frontier = np.flatnonzero(reached & core)
        label += 1
    return labels


def _dbscan_tree(points: Float64Array, eps: float, min_points: float, weights: Float64Array | None) -> LabelArray:
    """By a k-d tree and connected components: for hundreds of points and more."""
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
        _, start, inverse = np.unique(component[cores], return_index=True, return_inverse=True)
        rank = np.empty(len(start), np.int64)
        rank[np.argsort(start, kind="stable")] = np.arange(len(start))
        labels[cores] = rank[inverse]
    for border, source in ((first, second), (second, first)):
        use = ~core[border] & core[source]
        np.minimum.at(labels, border[use], labels[source[use]])
    labels[labels == n] = -1
    return labels


def thin(points: Float64Array, cell: float, max_points: int) -> tuple[Float64Array, Float64Array, LabelArray]:
    """Merge points that share a grid cell until at most ``max_points`` are left, so that clustering stays bounded in time.

    Parameters
    ----------
    points : ndarray of float64, shape (n_points, n_dimensions)
        Finite coordinates, of magnitudes below 1e6 cells.
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
    while True:
        key = np.floor(points / cell).astype(np.int64)
        key -= key.min(axis=0)
        flat = np.ravel_multi_index(tuple(key.T), tuple(int(k) + 1 for k in key.max(axis=0)))
        _, member, count = np.unique(flat, return_inverse=True, return_counts=True)
        if len(count) <= max_points:
            break
        cell *= 2
    merged = np.stack([np.bincount(member, axis) / count for axis in points.T], axis=-1)
    return merged, count.astype(np.float64), member


def cluster(points: Float64Array, eps: float, min_points: float, max_points: int) -> LabelArray:
    """DBSCAN in bounded time: above ``max_points`` on a grid of ``eps / 4`` or coarser.

    Parameters
    ----------
    points : ndarray of float64, shape (n_points, n_dimensions)
        Finite coordinates.
    eps, min_points : float
        See `dbscan`.
    max_points : int
        See `thin`.

    Returns
    -------
    ndarray of int64, shape (n_points,)
        Cluster of each point; -1: noise.
    """
    if len(points) <= max_points:
        return dbscan(points, eps, min_points)
    merged, weights, member = thin(points, eps / 4, max_points)
    return dbscan(merged, eps, min_points, weights)[member]


def kmeans(points: Float64Array, centres: Float64Array, max_iterations: int = 20) -> tuple[LabelArray, Float64Array]:
    """Lloyd's k-means from given centres (Lloyd 1982; thesis, 7.3).

    Parameters
    ----------
    points : ndarray of float64, shape (n_points, n_dimensions)
        Finite coordinates.
    centres : ndarray of float64, shape (k, n_dimensions)
        Where to start; given, not drawn, so that the result is repeatable.
    max_iterations : int
        Stop here if it has not converged.

    Returns
    -------
    labels : ndarray of int64, shape (n_points,)
        Nearest centre of each point; the first on a tie.
    centres : ndarray of float64, shape (k, n_dimensions)
        Means of the clusters; an empty cluster keeps its centre.
    """
    centres = np.array(centres, np.float64)
    labels = np.full(len(points), -1, np.int64)
    for _ in range(max_iterations):
        distance = ((points[:, None, :] - centres[None, :, :]) ** 2).sum(axis=-1)
        nearest = distance.argmin(axis=1)
        if np.array_equal(nearest, labels):
            break
        labels = nearest
        for k in range(len(centres)):
            own = labels == k
            if own.any():
                centres[k] = points[own].mean(axis=0)
    return labels, centres
