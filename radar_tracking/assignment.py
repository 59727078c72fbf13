"""Which measurement belongs to which track: the Hungarian method (Kuhn 1955; thesis, 6.2.2)."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import linear_sum_assignment

from radar_core import DataError
from radar_core.checks import require_shape
from radar_core.types import Float64Array, IndexArray


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
