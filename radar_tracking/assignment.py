"""Assignment of measurements to tracks: Mahalanobis distances, and the Hungarian method (Kuhn 1955; thesis, 6.2.2)."""

from __future__ import annotations

import math

import numba
import numpy as np

from radar_core import DataError
from radar_core.checks import require_shape
from radar_core.linalg import SingularError
from radar_core.types import Float64Array, IndexArray

_LEAST_PIVOT = 1e-12  # of a covariance's diagonal: what is left of an axis once the others are known; less is rounding
_jit = numba.njit(cache=True, nogil=True)


def mahalanobis(
    mean: Float64Array, covariance: Float64Array, points: Float64Array, point_covariance: Float64Array | None = None
) -> Float64Array:
    """Mahalanobis distance of every measurement from every predicted place.

    Parameters
    ----------
    mean : ndarray of float64, shape (n_tracks, d)
        Predicted places in ``room`` [m].
    covariance : ndarray of float64, shape (n_tracks, d, d)
        Of the same [m^2].
    points : ndarray of float64, shape (n_points, d)
        Measured places in ``room`` [m].
    point_covariance : ndarray of float64, shape (d, d) or (n_points, d, d), or None
        Of all measurements, or of each [m^2]; None: zero, ``covariance`` has it all. With the track's it must be positive definite.

    Returns
    -------
    ndarray of float64, shape (n_tracks, n_points)
        Distances in standard deviations; infinite where the square is beyond what a number holds.

    Raises
    ------
    DataError
        When shapes disagree.
    SingularError
        When the sum of both covariances is not positive definite, or so nearly that the distance would be rounding.
    """
    each = _check(mean, covariance, points, point_covariance)
    if len(mean) == 0 or len(points) == 0:
        return np.zeros((len(mean), len(points)))
    distance, singular = _kernel(*(np.ascontiguousarray(a) for a in (mean, covariance, points, each)))
    if singular >= 0:
        both = f"the covariance of track {singular} plus that of a measurement"
        raise SingularError(f"{both} is not positive definite; distances would be rounding errors")
    return np.asarray(distance)


def _check(mean: Float64Array, covariance: Float64Array, points: Float64Array, point_covariance: Float64Array | None) -> Float64Array:
    """Refuse shapes that do not belong together (the kernel would read beyond its arrays); covariances of one or of each point."""
    require_shape("mean", mean, (None, None))
    n, d = mean.shape
    require_shape("covariance", covariance, (n, d, d))
    require_shape("points", points, (None, d))
    if point_covariance is None:
        return np.zeros((1, d, d))
    if point_covariance.ndim == 2:
        require_shape("point_covariance", point_covariance, (d, d))
        return point_covariance[None]
    require_shape("point_covariance", point_covariance, (len(points), d, d))
    return point_covariance


@_jit
def _factor(a: Float64Array, b: Float64Array, lower: Float64Array) -> bool:
    """Cholesky factor of a + b into ``lower``; False: not positive definite."""
    d = len(a)
    for i in range(d):
        for j in range(i + 1):
            value = 0.5 * (a[i, j] + a[j, i]) + 0.5 * (b[i, j] + b[j, i])
            whole = value
            for k in range(j):
                value -= lower[i, k] * lower[j, k]
            if i == j:
                if not value > _LEAST_PIVOT * whole:  # NaN too
                    return False
                lower[i, i] = math.sqrt(value)
            else:
                lower[i, j] = value / lower[j, j]
    return True


@_jit
def _kernel(mean: Float64Array, covariance: Float64Array, points: Float64Array, each: Float64Array) -> tuple[Float64Array, int]:
    """Distances, and the first track whose covariance fails (-1: none)."""
    n, d = mean.shape
    m = len(points)
    distance = np.empty((n, m))
    lower = np.zeros((d, d))
    whitened = np.empty(d)
    for t in range(n):
        for p in range(m):
            if (p == 0 or len(each) > 1) and not _factor(covariance[t], each[min(p, len(each) - 1)], lower):
                return distance, t
            total = 0.0
            for i in range(d):
                value = points[p, i] - mean[t, i]
                for k in range(i):
                    value -= lower[i, k] * whitened[k]
                whitened[i] = value / lower[i, i]
                total += whitened[i] * whitened[i]
            distance[t, p] = math.sqrt(total)
    return distance, -1


def assign_tracks(cost: Float64Array, gate: float) -> IndexArray:
    """Pair tracks with measurements so that the sum of costs is least, where a track that gets none costs as much as the gate.

    Parameters
    ----------
    cost : ndarray of float64, shape (n_tracks, n_measurements)
        Of every pair, e.g. a Mahalanobis distance; infinite: this pair is not allowed.
    gate : float
        Pairs that cost more than this are not made, those that cost exactly this may be; in the unit of ``cost``. Infinite: as many pairs
        as are allowed at all, and of those the cheapest.

    Returns
    -------
    ndarray of int64, shape (n_pairs, 2)
        Track and measurement of each pair, tracks ascending; each occurs at most once. Of several best solutions always the same one.

    Raises
    ------
    DataError
        When a cost is NaN or minus infinity, or the gate is.
    """
    require_shape("cost", cost, (None, None))
    if not gate > -math.inf:
        raise DataError(f"gate is {gate}; give a number, or plus infinity for no gate")
    if cost.size == 0:
        return np.empty((0, 2), np.int64)
    if not cost.min() > -math.inf:  # NaN compares false
        raise DataError(f"cost holds {cost.min()}; costs are numbers, or plus infinity for pairs that must not be made")
    from scipy.optimize import linear_sum_assignment  # slow to import; the default tracker does without

    # A pair at the gate is as good as none: with costs cut there, the best full assignment holds the best gated one, whatever the shape.
    rows, columns = linear_sum_assignment(_without_gate(cost) if gate == math.inf else np.minimum(cost, gate))
    keep = (cost[rows, columns] <= gate) & (cost[rows, columns] < math.inf)
    return np.stack([rows[keep], columns[keep]], axis=-1).astype(np.int64, copy=False)


def _without_gate(cost: Float64Array) -> Float64Array:
    """Costs from 0 to 1 for allowed pairs, and for the others one that no better choice of the rest is worth."""
    allowed = cost < math.inf
    if not allowed.any():
        return np.zeros(cost.shape)
    low, high = cost[allowed].min(), cost[allowed].max()
    half = max(0.5 * high - 0.5 * low, np.finfo(np.float64).tiny)  # halves: the whole may be beyond what a number holds
    return np.asarray(np.where(allowed, (0.5 * np.where(allowed, cost, low) - 0.5 * low) / half, 1.0 + min(cost.shape)))
