"""Clustering in polar coordinates: far bodies give fewer points, which spread wider in cross-range; also on a grid of cells."""

from __future__ import annotations

import math
from typing import Any, Final

import numba
import numpy as np

from radar_core.checks import require_finite
from radar_core.types import Float64Array, IndexArray
from radar_tracking.clustering.base import ClusteringConfig, ClusterPoints
from radar_tracking.clustering.density import grow, in_order, occupied, weigh

_LARGEST_CELL: Final[float] = 2.0**50
_jit = numba.njit(cache=True, nogil=True)


def demand(distance: Float64Array, config: ClusteringConfig) -> Float64Array:
    """Neighbours of a core point by its range [m], shape (n_points,), not rounded.

    A body at twice the distance covers half the azimuth cells and gives fewer points: ``min_points`` up to ``reference_range``, then
    falling with ``density_exponent``, not below ``min_points_far``.
    """
    falling = config.min_points * (config.reference_range / np.maximum(distance, config.reference_range)) ** config.density_exponent
    return np.asarray(np.maximum(falling, min(config.min_points, config.min_points_far)))


def require_polar(points: ClusterPoints) -> None:
    """Raise `DataError` unless range and azimuth of all points are known."""
    require_finite("ClusterPoints.range", points.range)
    require_finite("ClusterPoints.azimuth", points.azimuth)


def polar_dbscan(points: ClusterPoints, rate: Float64Array, config: ClusteringConfig, weights: Float64Array) -> IndexArray:
    """DBSCAN with an ellipse for a neighbourhood and a demand that falls with range (Wagner, Feger, Stelzer, EuRAD 2015).

    The half axis in range is ``eps``, in cross-range ``max(eps, angle_reach * range)``. Heights are not looked at.

    Parameters
    ----------
    points : ClusterPoints
        With range and azimuth about the sensor.
    rate : ndarray of float64, shape (n_points,)
        Third axis: range rates times ``rate_weight`` [m].
    config : ClusteringConfig
        Its knobs for "polar".
    weights : ndarray of float64, shape (n_points,) or (0,)
        How many points each one stands for; empty: one.

    Returns
    -------
    ndarray of int64, shape (n_points,)
        Cluster of each point; -1: noise.

    Raises
    ------
    DataError
        When a range or azimuth is not finite.
    """
    require_polar(points)
    need = demand(points.range, config)
    distance, azimuth = np.ascontiguousarray(points.range), np.ascontiguousarray(points.azimuth)
    labels: IndexArray = polar_labels(distance, azimuth, rate, config.eps, config.angle_reach, need, weights)
    return labels


def grid_dbscan(points: ClusterPoints, rate: Float64Array, config: ClusteringConfig) -> IndexArray:
    """DBSCAN on the radar's own grid of range, azimuth and range rate (Kellner et al., IV 2012; Lim et al., 2018).

    Points are counted by cell; two cells are neighbours when they are near on every axis: ``eps`` in range and rate, the wider of ``eps``
    and ``angle_reach`` in azimuth, each at least one cell. Where more than ``max_points`` cells are occupied, cells are made larger.
    Parameters, result and errors as in `polar_dbscan`; clusters count in the order of their first points.
    """
    require_polar(points)
    if len(points) == 0:
        return np.empty(0, np.int64)
    edge = np.array([config.range_cell, config.azimuth_cell, config.rate_cell * (config.rate_weight or 1.0)])
    while True:
        n_around = max(1, round(2 * math.pi / edge[1]))
        cells = _cells(points, rate, edge, n_around)
        first, member, count = occupied(cells)
        if len(first) <= config.max_points:
            break
        edge *= 2
    cells, distance = cells[first], points.range[first]
    reach = _reach(distance, edge, config)
    by_cell: IndexArray = grid_labels(cells, reach, n_around, demand(distance, config), count.astype(np.float64))
    labels = by_cell[member]
    found = labels >= 0
    labels[found] = in_order(labels[found])
    return labels


def _cells(points: ClusterPoints, rate: Float64Array, edge: Float64Array, n_around: int) -> IndexArray:
    """Cell of each point, shape (n_points, 3); azimuth cells count from 0 to ``n_around`` - 1 around the sensor."""
    turn = points.azimuth / (2 * math.pi)
    place = np.stack([points.range / edge[0], (turn - np.floor(turn)) * n_around, rate / edge[2]], axis=-1)
    cells: IndexArray = np.floor(np.clip(place, -_LARGEST_CELL, _LARGEST_CELL)).astype(np.int64)
    cells[:, 1] %= n_around
    return cells


def _reach(distance: Float64Array, edge: Float64Array, config: ClusteringConfig) -> IndexArray:
    """Cells to either side that are near, by axis, shape (n_cells, 3)."""
    closest = config.eps / (2 * math.pi)  # within this distance of the sensor the whole circle is near
    reach = np.empty((len(distance), 3))
    reach[:, 0], reach[:, 2] = config.eps / edge[0], config.eps / edge[2]
    reach[:, 1] = np.maximum(config.eps / np.maximum(distance, closest), config.angle_reach) / edge[1]
    cells: IndexArray = np.maximum(1, np.rint(reach)).astype(np.int64)
    return cells


@_jit
def polar_labels(distance: Any, azimuth: Any, rate: Any, eps: float, angle_reach: float, demand: Any, weights: Any) -> Any:
    """Label points by `polar_dbscan`; ``demand``: neighbours of a core point, by its range."""
    n = len(distance)
    near, core = np.empty((n, n), np.bool_), np.empty(n, np.bool_)
    for i in range(n):
        for j in range(i, n):
            middle = 0.5 * (distance[i] + distance[j])
            turn = azimuth[j] - azimuth[i]
            turn -= 2 * math.pi * np.rint(turn / (2 * math.pi))
            along = (distance[j] - distance[i]) / eps
            across = middle * turn / max(eps, angle_reach * middle)
            faster = (rate[j] - rate[i]) / eps
            near[i, j] = near[j, i] = along * along + across * across + faster * faster <= 1.0
    for i in range(n):
        core[i] = weigh(near[i], weights) >= demand[i]
    return grow(near, core)


@_jit
def grid_labels(cells: Any, reach: Any, n_around: int, demand: Any, weights: Any) -> Any:
    """Label cells by `grid_dbscan`; ``reach``: how many cells away neighbours are, by axis, where the wider reach of the two counts."""
    n = len(cells)
    near, core = np.empty((n, n), np.bool_), np.empty(n, np.bool_)
    for i in range(n):
        for j in range(i, n):
            turn = abs(cells[j, 1] - cells[i, 1])
            turn = min(turn, n_around - turn)
            near[i, j] = near[j, i] = (
                abs(cells[j, 0] - cells[i, 0]) <= max(reach[i, 0], reach[j, 0])
                and turn <= max(reach[i, 1], reach[j, 1])
                and abs(cells[j, 2] - cells[i, 2]) <= max(reach[i, 2], reach[j, 2])
            )
    for i in range(n):
        core[i] = weigh(near[i], weights) >= demand[i]
    return grow(near, core)
