"""OPTICS: the order of the points by density, clusters at any distance, and the split of a merged cluster."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from radar_core import DataError
from radar_core.checks import require_finite
from radar_tracking.clustering import kernels
from radar_tracking.clustering.base import Float64Array, LabelArray
from radar_tracking.clustering.density import dense
from radar_tracking.clustering.lloyd import kmeans, require_centres


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

    ordering: LabelArray
    reachability: Float64Array
    core_distance: Float64Array
    predecessor: LabelArray

    def labels(self, eps: float) -> LabelArray:
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
    core = kernels.core_distances(points, int(min_points), float(max_eps), known)
    ordering, reachability, predecessor = kernels.order(points, core, float(max_eps))
    return Optics(ordering, reachability, core, predecessor)


def split(
    points: Float64Array, k: int, centres: Float64Array, *, min_points: int = 3, min_share: float = 0.3
) -> tuple[LabelArray, Float64Array]:
    """Split one merged cluster into ``k`` at the largest peaks of its reachability plot (after Wagner, Feger, Stelzer 2018).

    A peak ends one dense region and starts the next: cutting there is cutting the link between a point and the one that reached it.
    Links are cut from the longest on, wherever enough points stay on both sides, so that a stray point is no body. Where density shows no
    ``k`` bodies, k-means from the given centres decides.

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
    number = np.bincount(parts, minlength=k)
    means = np.stack([np.bincount(parts, axis, k) / number for axis in points.T], axis=-1)
    _, place = linear_sum_assignment(((means[:, None] - centres) ** 2).sum(axis=-1))
    ordered = np.empty_like(means)
    ordered[place] = means
    return place[parts].astype(np.int64), ordered


def _cut(plot: Optics, k: int, least: int) -> tuple[LabelArray, int]:
    """Parts of at least ``least`` points and their number; 0 when some points are too far from the others to be in the tree."""
    if np.count_nonzero(plot.predecessor < 0) != 1:
        return np.empty(0, np.int64), 0
    visited = plot.ordering[1:]
    candidates = visited[np.argsort(-plot.reachability[visited], kind="stable")]
    parts, made = kernels.cut(plot.ordering, plot.predecessor, candidates, k, least)
    return parts, int(made)
