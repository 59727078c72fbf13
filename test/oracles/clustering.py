"""Inner loops of clustering in plain numpy: what the compiled ones of `radar_tracking.clustering` must equal, function by function."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radar_core.types import Float64Array, IndexArray

MaskArray = NDArray[np.bool_]


def grow(near: MaskArray, core: MaskArray) -> IndexArray:
    """Connect core points and give border points to the first cluster that reaches them (Ester et al., KDD 1996).

    Parameters
    ----------
    near : ndarray of bool, shape (n_points, n_points)
        Who is whose neighbour; symmetric.
    core : ndarray of bool, shape (n_points,)
        Who has enough neighbours.

    Returns
    -------
    ndarray of int64, shape (n_points,)
        Clusters in the order of their first core point; -1: noise.
    """
    labels = np.full(len(core), -1, np.int64)
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


def _enough(near: MaskArray, weights: Float64Array, demand: float | Float64Array) -> MaskArray:
    """Points whose neighbours weigh at least ``demand``; empty ``weights``: whose neighbours are at least as many."""
    return np.asarray((near @ weights if len(weights) else near.sum(axis=1)) >= demand)


def squared_distances(points: Float64Array) -> Float64Array:
    """Of every point to every other, shape (n_points, n_points); summed axis by axis."""
    squared = np.zeros((len(points), len(points)))
    for axis in points.T:
        step = axis[:, None] - axis
        squared += step * step
    return squared


def dbscan(points: Float64Array, eps: float, min_points: float, weights: Float64Array) -> IndexArray:
    """DBSCAN; see `radar_tracking.clustering.dbscan`. Empty ``weights``: all one. Empty result: a coordinate is not finite."""
    if not np.isfinite(points).all():
        return np.empty(0, np.int64)
    near = squared_distances(points) <= eps * eps
    return grow(near, _enough(near, weights, min_points))


def polar(
    distance: Float64Array,
    azimuth: Float64Array,
    rate: Float64Array,
    eps: float,
    angle_reach: float,
    demand: Float64Array,
    weights: Float64Array,
) -> IndexArray:
    """DBSCAN with neighbourhoods that are ellipses in range and cross-range (Wagner, Feger, Stelzer 2015).

    Parameters
    ----------
    distance, azimuth, rate : ndarray of float64, shape (n_points,)
        Range [m], azimuth [rad], range rate times its weight [m].
    eps : float
        Half axis of the ellipse in range and rate, and the least one in cross-range [m].
    angle_reach : float
        Half axis in azimuth, where it is more than ``eps`` [rad].
    demand : ndarray of float64, shape (n_points,)
        Neighbours of a core point, by its range.
    weights : ndarray of float64, shape (n_points,) or (0,)
        How many points each one stands for; empty: one.

    Returns
    -------
    ndarray of int64, shape (n_points,)
        Cluster of each point; -1: noise.
    """
    middle = 0.5 * (distance[:, None] + distance)
    turn = azimuth - azimuth[:, None]
    turn -= 2 * np.pi * np.rint(turn / (2 * np.pi))
    along = (distance - distance[:, None]) / eps
    across = middle * turn / np.maximum(eps, angle_reach * middle)
    faster = (rate - rate[:, None]) / eps
    near = along * along + across * across + faster * faster <= 1.0
    return grow(near, _enough(near, weights, demand))


def grid(cells: IndexArray, reach: IndexArray, n_around: int, demand: Float64Array, weights: Float64Array) -> IndexArray:
    """DBSCAN on the cells of a grid of range, azimuth and range rate (Kellner, Klappstein, Dietmayer 2012; Lim et al. 2018).

    Parameters
    ----------
    cells : ndarray of int64, shape (n_cells, 3)
        Occupied cells: (range, azimuth, rate).
    reach : ndarray of int64, shape (n_cells, 3)
        How many cells away neighbours are, by axis; the wider reach of the two counts.
    n_around : int
        Azimuth cells in a full turn.
    demand : ndarray of float64, shape (n_cells,)
        Points in the neighbourhood of a core cell.
    weights : ndarray of float64, shape (n_cells,)
        Points in each cell.

    Returns
    -------
    ndarray of int64, shape (n_cells,)
        Cluster of each cell; -1: noise.
    """
    apart = np.abs(cells[:, None] - cells)
    apart[..., 1] = np.minimum(apart[..., 1], n_around - apart[..., 1])
    near = (apart <= np.maximum(reach[:, None], reach)).all(axis=-1)
    return grow(near, _enough(near, weights, demand))


def _rounded(values: Float64Array) -> Float64Array:
    """Round to 1e-15, so that distances which differ by rounding alone tie."""
    return np.asarray(np.rint(values * 1e15) / 1e15)


def core_distances(points: Float64Array, min_points: int, max_eps: float, weights: Float64Array) -> Float64Array:
    """Distance within which each point has neighbours of weight ``min_points``, itself included; inf: beyond ``max_eps``."""
    distance = np.sqrt(squared_distances(points))
    core = np.full(len(points), np.inf)
    for i, row in enumerate(distance):
        nearest = np.argsort(row, kind="stable")
        enough = np.flatnonzero(np.cumsum(weights[nearest]) >= min_points)
        if len(enough) and row[nearest[enough[0]]] <= max_eps:
            core[i] = _rounded(row[nearest[enough[0]]])
    return core


def order(points: Float64Array, core: Float64Array, max_eps: float) -> tuple[IndexArray, Float64Array, IndexArray]:
    """Visit the points by smallest reachability, the first on ties (Ankerst et al., SIGMOD 1999): ordering, reachability, predecessor."""
    squared = squared_distances(points)
    n = len(points)
    reachability, predecessor = np.full(n, np.inf), np.full(n, -1, np.int64)
    ordering, left = np.empty(n, np.int64), np.ones(n, bool)
    for step in range(n):
        candidates = np.flatnonzero(left)
        point = candidates[reachability[candidates].argmin()]
        left[point], ordering[step] = False, point
        if np.isinf(core[point]):
            continue
        reach = _rounded(np.maximum(np.sqrt(squared[point]), core[point]))
        better = left & (squared[point] <= max_eps * max_eps) & (reach < reachability)
        reachability[better], predecessor[better] = reach[better], point
    return ordering, reachability, predecessor


def cut(ordering: IndexArray, predecessor: IndexArray, candidates: IndexArray, n_parts: int, least: int) -> tuple[IndexArray, int]:
    """Cut the tree of predecessors until it has ``n_parts`` parts of at least ``least`` points each.

    Parameters
    ----------
    ordering, predecessor : ndarray of int64, shape (n_points,)
        Of `order`.
    candidates : ndarray of int64, shape (n_candidates,)
        Points whose link to their predecessor may be cut, the best first.
    n_parts, least : int
        Wanted number of parts; least size of each.

    Returns
    -------
    labels : ndarray of int64, shape (n_points,)
        Part of each point.
    made : int
        Number of parts; fewer than wanted where no further cut leaves enough points on both sides.
    """
    labels, made = np.zeros(len(ordering), np.int64), 1
    for point in candidates:
        if made == n_parts:
            break
        below = np.zeros(len(ordering), bool)
        for later in ordering[labels[ordering] == labels[point]]:
            below[later] = later == point or (predecessor[later] >= 0 and below[predecessor[later]])
        if least <= below.sum() <= (labels == labels[point]).sum() - least:
            labels[below] = made
            made += 1
    return labels, made


def lloyd(points: Float64Array, centres: Float64Array, max_iterations: int) -> tuple[IndexArray, Float64Array]:
    """K-means from given centres (Lloyd 1982); see `radar_tracking.clustering.kmeans`."""
    centres, labels = centres.copy(), np.full(len(points), -1, np.int64)
    for _ in range(max_iterations):
        squared = np.zeros((len(points), len(centres)))
        for axis, at in zip(points.T, centres.T, strict=True):
            squared += (axis[:, None] - at) ** 2
        nearest = squared.argmin(axis=1)
        if np.array_equal(nearest, labels):
            break
        labels = nearest
        for k in range(len(centres)):
            own = labels == k
            if own.any():
                centres[k] = points[own].mean(axis=0)
    return labels, centres
