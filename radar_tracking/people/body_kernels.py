"""The measurement of bodies, compiled: sums over a few points each cost more in calls of numpy than in arithmetic.

A numpy oracle is in the tests.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np

from radar_core.types import Float64Array, IndexArray

_jit = numba.njit(cache=True, nogil=True)
_SHORT = 1e-9  # m


class Centres(NamedTuple):
    """Weighted means of points, one row per track.

    Attributes
    ----------
    place, variance : ndarray of float64, shape (n_tracks, 3)
        Of the visible surface [m], and how sure that is along each axis [m^2]; NaN heights where none is measured.
    away : ndarray of float64, shape (n_tracks, 2)
        Mean of the unit vectors on the floor plane from the sensors to the points.
    best : ndarray of int64, shape (n_tracks,)
        The sensor that sees most of the body.
    rate, rate_variance : ndarray of float64, shape (n_tracks,)
        Mean of the range rates that it measures, and of that their spread alone says [m/s, m^2/s^2]; NaN where none is measured.
    """

    place: Float64Array
    variance: Float64Array
    away: Float64Array
    best: IndexArray
    rate: Float64Array
    rate_variance: Float64Array


@_jit
def centre(position: Any, cross: Any, speed: Any, sensor: Any, origins: Any, group: Any, weight: Any, n: int) -> Any:
    """Average the points of each group; arguments are the columns of `Points`, the group of each point, its weight, and how many groups.

    Returns
    -------
    tuple
        The fields of `Centres`.
    """
    # written out in loops: expressions of whole arrays take seconds to compile
    m, n_sensors = len(group), len(origins)
    share, column = np.empty(m), np.empty(m)
    total, effective, noise = np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(m):
        total[group[i]] += weight[i]
    for i in range(m):
        share[i] = weight[i] / total[group[i]]
        effective[group[i]] += share[i] * share[i]
        noise[group[i]] += share[i] * cross[i] ** 2
    place, variance = np.empty((n, 3)), np.empty((n, 3))
    for axis in range(3):
        for i in range(m):
            column[i] = position[i, axis]
        mean, square = _moments(group, share, column, n)
        for k in range(n):
            place[k, axis] = mean[k]
            variance[k, axis] = (noise[k] + square[k]) * effective[k]
    away, seen = np.zeros((n, 2)), np.zeros((n, n_sensors))
    for i in range(m):
        x, y = position[i, 0] - origins[sensor[i], 0], position[i, 1] - origins[sensor[i], 1]
        length = max(math.hypot(x, y), _SHORT)
        away[group[i], 0] += share[i] * (x / length)
        away[group[i], 1] += share[i] * (y / length)
        seen[group[i], sensor[i]] += share[i]
    best = _largest(seen)
    fewer = np.zeros(n)
    for i in range(m):
        same = sensor[i] == best[group[i]]
        column[i] = speed[i] if same else math.nan
        fewer[group[i]] += share[i] ** 2 if same else 0.0
    rate, square = _moments(group, share, column, n)
    for k in range(n):
        square[k] *= fewer[k] / seen[k, best[k]] ** 2
    return place, variance, away, best, rate, square


@_jit
def _largest(seen: Any) -> Any:
    """Column of the largest entry of each row, the first of equal ones."""
    best = np.zeros(len(seen), np.int64)
    for k in range(len(seen)):
        for s in range(1, seen.shape[1]):
            if seen[k, s] > seen[k, best[k]]:
                best[k] = s
    return best


@_jit
def _moments(group: Any, share: Any, value: Any, n: int) -> Any:
    """Weighted mean, and mean square about it, of the finite values of each group; NaN where there is none."""
    total, mean, square = np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(len(group)):
        if math.isfinite(value[i]):
            total[group[i]] += share[i]
            mean[group[i]] += share[i] * value[i]
    for k in range(n):
        mean[k] = mean[k] / total[k] if total[k] > 0.0 else math.nan
    for i in range(len(group)):
        if math.isfinite(value[i]):
            square[group[i]] += share[i] * (value[i] - mean[group[i]]) ** 2
    for k in range(n):
        square[k] = square[k] / total[k] if total[k] > 0.0 else math.nan
    return mean, square
