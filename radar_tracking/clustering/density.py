"""DBSCAN of a few to a few thousand points in bounded time."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_core.checks import require_finite
from radar_core.types import Float64Array, IndexArray
from radar_tracking.clustering import kernels

DENSE_LIMIT: Final[int] = 2000
"""Up to here the compiled loop over all pairs is faster than a tree; it needs a byte for each pair."""
_NO_WEIGHTS: Final[Float64Array] = np.empty(0)


def dense(points: NDArray[Any]) -> Float64Array:
    """Points as the compiled loops want them: float64, row by row in memory."""
    return np.ascontiguousarray(points, np.float64)


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
        from radar_tracking.clustering.large import dbscan_tree

        return dbscan_tree(points, eps, min_points, weights)
    known = _NO_WEIGHTS if weights is None else dense(weights)
    labels: IndexArray = kernels.dbscan(dense(points), float(eps), float(min_points), known)
    if len(labels) < n:
        require_finite("points", points)
        raise DataError("points has coordinates so far apart that their distance overflows float64; give metres")
    return labels


def cluster(points: Float64Array, eps: float, min_points: float, max_points: int) -> IndexArray:
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

    Raises
    ------
    DataError
        When a coordinate is not finite.
    """
    if len(points) <= max_points:
        return dbscan(points, eps, min_points)
    from radar_tracking.clustering.large import thin

    require_finite("points", points)
    merged, weights, member = thin(points, eps / 4, max_points)
    return dbscan(merged, eps, min_points, weights)[member]
