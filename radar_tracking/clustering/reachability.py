"""OPTICS: points in the order of their reachability, clusters at any distance, and the division of a merged cluster."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from scipy.optimize import linear_sum_assignment

from radar_core import DataError
from radar_core.checks import require_finite
from radar_core.types import Float64Array, IndexArray
from radar_tracking.clustering.base import dense
from radar_tracking.clustering.density import columns_of, squared_distances
from radar_tracking.clustering.lloyd import kmeans, require_centres

_jit = numba.njit(cache=True, nogil=True)
_ROUNDING = 1e15  # distances are rounded to 1e-15, so that those which differ by rounding alone tie


@dataclass(frozen=True, eq=False)
class Optics:
    """Points in the order of their reachability; ``reachability[ordering]`` is the reachability plot.

    Attributes
    ----------
    ordering : ndarray of int64, shape (n_points,)
        Points as visited.
    reachability : ndarray of float64, shape (n_points,)
        Distance over which each point was reached; inf: nobody reached it, a new start.
    core_distance : ndarray of float64, shape (n_points,)
        Distance within which it has enough neighbours; inf: beyond ``max_eps``.
    predecessor : ndarray of int64, shape (n_points,)
        Point that reached it; -1: none.
    """

    ordering: IndexArray
    reachability: Float64Array
    core_distance: Float64Array
    predecessor: IndexArray

    def labels(self, eps: float) -> IndexArray:
        """Cut the plot at ``eps``: clusters as of DBSCAN, but for some of its border points (Ankerst et al. 1999, section 3.3).

        Parameters
        ----------
        eps : float
            At most the ``max_eps`` of `optics`.

        Returns
        -------
        ndarray of int64, shape (n_points,)
            Clusters in the order of the plot; -1: noise.
        """
        core = self.core_distance <= eps
        apart = self.reachability > eps
        labels = np.empty(len(self.ordering), np.int64)
        labels[self.ordering] = np.cumsum((apart & core)[self.ordering]) - 1
        labels[apart & ~core] = -1
        return labels


def optics(points: Float64Array, min_points: int, max_eps: float = math.inf, weights: Float64Array | None = None) -> Optics:
    """Order points so that clusters of any density are valleys of the reachability (Ankerst et al., SIGMOD 1999).

    Order, distances and predecessors are those of scikit-learn's ``OPTICS``.

    Parameters
    ----------
    points : ndarray of float64, shape (n_points, n_dimensions)
        Finite coordinates.
    min_points : int
        Neighbours of a core point, itself included.
    max_eps : float
        Distance up to which neighbours are looked for; in the unit of ``points``.
    weights : ndarray of float64, shape (n_points,), or None
        How many points each one stands for, 1 or more; None: one.

    Returns
    -------
    Optics
        Order and distances.

    Raises
    ------
    DataError
        When a coordinate is not finite.
    """
    points = dense(points)
    require_finite("points", points)
    known = np.ones(len(points)) if weights is None else dense(weights)
    core = core_distances(points, int(min_points), float(max_eps), known)
    ordering, reachability, predecessor = order(points, core, float(max_eps))
    return Optics(ordering, reachability, core, predecessor)


def split(
    points: Float64Array, k: int, centres: Float64Array, *, min_points: int = 3, min_share: float = 0.3
) -> tuple[IndexArray, Float64Array]:
    """Split one merged cluster into ``k`` at the largest peaks of its reachability plot (after Wagner, Feger, Stelzer 2018).

    A peak ends one dense region and starts the next: the link between a point and the one that reached it is cut, the longest links first,
    where enough points stay on both sides. Where density shows no ``k`` bodies, k-means from the given centres decides.

    Parameters
    ----------
    points : ndarray of float64, shape (n_points, n_dimensions)
        Finite coordinates of the merged cluster.
    k : int
        Number of bodies in it.
    centres : ndarray of float64, shape (k, n_dimensions)
        Where they are expected; parts get the numbers of the centres that they fit best in sum.
    min_points : int
        Neighbours of a core point, itself included: the more, the smoother the plot.
    min_share : float
        Each part has at least this share of the mean part's points, and at least one point.

    Returns
    -------
    labels : ndarray of int64, shape (n_points,)
        Centre of each point.
    centres : ndarray of float64, shape (k, n_dimensions)
        Means of the parts; an empty part keeps its centre.

    Raises
    ------
    DataError
        When there are not ``k`` centres, shapes do not fit, or a coordinate is not finite.
    """
    points, centres = dense(points), dense(centres)
    require_centres(points, centres)
    if len(centres) != k:
        raise DataError(f"{len(centres)} centres were given for {k} parts; give one for each")
    parts, made = _cut(optics(points, min_points), k, max(1, math.ceil(min_share * len(points) / k)))
    if made < k:
        return kmeans(points, centres)
    means = np.stack([np.bincount(parts, axis, k) / np.bincount(parts, minlength=k) for axis in points.T], axis=-1)
    _, place = linear_sum_assignment(((means[:, None] - centres) ** 2).sum(axis=-1))
    ordered = np.empty_like(means)
    ordered[place] = means
    return place[parts].astype(np.int64), ordered


def _cut(plot: Optics, k: int, least: int) -> tuple[IndexArray, int]:
    """Parts of at least ``least`` points and their number; 0 when some points are too far from the others to be in the tree."""
    if np.count_nonzero(plot.predecessor < 0) != 1:
        return np.empty(0, np.int64), 0
    visited = plot.ordering[1:]
    candidates = visited[np.argsort(-plot.reachability[visited], kind="stable")]
    parts, made = cut(plot.ordering, plot.predecessor, candidates, k, least)
    return parts, int(made)


@_jit
def _rounded(value: float) -> float:
    return float(np.rint(value * _ROUNDING) / _ROUNDING)


@_jit
def core_distances(points: Any, min_points: int, max_eps: float, weights: Any) -> Any:
    """Find the distance within which each point has neighbours of weight ``min_points``, itself included; inf: beyond ``max_eps``."""
    n = len(points)
    columns = columns_of(points)
    squared, core = np.empty(n), np.full(n, np.inf)
    nearest, weight = np.empty(min_points), np.empty(min_points)
    for i in range(n):
        squared_distances(columns, i, squared)
        size = 0
        for j in range(n):
            if size == min_points and not squared[j] < nearest[size - 1]:
                continue
            place = min(size, min_points - 1)
            while place > 0 and nearest[place - 1] > squared[j]:
                nearest[place], weight[place] = nearest[place - 1], weight[place - 1]
                place -= 1
            nearest[place], weight[place] = squared[j], weights[j]
            size = min(size + 1, min_points)
        total = 0.0
        for k in range(size):
            total += weight[k]
            if total >= min_points:
                distance = math.sqrt(nearest[k])
                if distance <= max_eps:
                    core[i] = _rounded(distance)
                break
    return core


@_jit
def order(points: Any, core: Any, max_eps: float) -> Any:
    """Visit the points by smallest reachability, the first on ties: ordering, reachability, predecessor."""
    n = len(points)
    columns = columns_of(points)
    squared, reachability = np.empty(n), np.full(n, np.inf)
    predecessor, ordering = np.full(n, -1, np.int64), np.empty(n, np.int64)
    done = np.zeros(n, np.bool_)
    limit = max_eps * max_eps
    for step in range(n):
        best, point = np.inf, -1
        for j in range(n):
            if not done[j] and (point < 0 or reachability[j] < best):
                best, point = reachability[j], j
        done[point], ordering[step] = True, point
        if core[point] == np.inf:
            continue
        squared_distances(columns, point, squared)
        for j in range(n):
            if not done[j] and squared[j] <= limit:
                reach = _rounded(max(math.sqrt(squared[j]), core[point]))
                if reach < reachability[j]:
                    reachability[j], predecessor[j] = reach, point
    return ordering, reachability, predecessor


@_jit
def cut(ordering: Any, predecessor: Any, candidates: Any, n_parts: int, least: int) -> Any:
    """Cut the tree of predecessors at ``candidates``, the best first, into parts of at least ``least`` points: labels, parts made."""
    n = len(ordering)
    labels, below = np.zeros(n, np.int64), np.zeros(n, np.bool_)
    sizes = np.zeros(n_parts, np.int64)
    sizes[0], made = n, 1
    for point in candidates:
        if made == n_parts:
            break
        below[:] = False
        part, size = labels[point], 0
        for later in ordering:
            if labels[later] != part:
                continue
            if later == point or (predecessor[later] >= 0 and below[predecessor[later]]):
                below[later] = True
                size += 1
        if size < least or sizes[part] - size < least:
            continue
        for k in range(n):
            if below[k]:
                labels[k] = made
        sizes[part] -= size
        sizes[made] = size
        made += 1
    return labels, made
