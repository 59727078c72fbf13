"""K-means from given centres."""

from __future__ import annotations

import numpy as np

from radar_core import DataError
from radar_core.checks import require_finite
from radar_tracking.clustering import kernels
from radar_tracking.clustering.base import Float64Array, LabelArray
from radar_tracking.clustering.density import dense


def kmeans(points: Float64Array, centres: Float64Array, max_iterations: int = 20) -> tuple[LabelArray, Float64Array]:
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
    labels, moved = kernels.lloyd(points, centres, max_iterations)
    return labels, moved


def require_centres(points: Float64Array, centres: Float64Array) -> None:
    """Raise `DataError` unless there is a centre, centres have as many coordinates as points, and all are finite."""
    if points.ndim != 2 or centres.ndim != 2 or points.shape[1] != centres.shape[1] or len(centres) == 0:
        raise DataError(f"points {points.shape} and centres {centres.shape} do not fit; give (n, d) and (k, d) with k of at least 1")
    require_finite("points", points)
    require_finite("centres", centres)


def spread_centres(points: Float64Array, k: int) -> Float64Array:
    """Choose starting centres without chance: the point farthest from the mean, then always the farthest from those (Gonzalez 1985).

    Parameters
    ----------
    points : ndarray of float64, shape (n_points, n_dimensions)
        At least one.
    k : int
        Wanted number; fewer come back where fewer points differ.

    Returns
    -------
    ndarray of float64, shape (at most k, n_dimensions)
        Points of the cloud.
    """
    gap = ((points - points.mean(axis=0)) ** 2).sum(axis=1)
    chosen = [points[gap.argmax()]]
    gap = ((points - chosen[0]) ** 2).sum(axis=1)
    while len(chosen) < k and gap.max() > 0:
        chosen.append(points[gap.argmax()])
        gap = np.minimum(gap, ((points - chosen[-1]) ** 2).sum(axis=1))
    return np.array(chosen)
