"""Clusterings by name. Each uses the columns that its method needs, in bounded time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from radar_core.types import Float64Array, IndexArray
from radar_tracking.clustering.base import ClusteringConfig, ClusterPoints
from radar_tracking.clustering.density import cluster, occupied, thin
from radar_tracking.clustering.lloyd import kmeans, spread_centres
from radar_tracking.clustering.polar import grid_dbscan, polar_dbscan, require_polar
from radar_tracking.clustering.reachability import optics


def known_rates(points: ClusterPoints) -> Float64Array:
    """Give points without a range rate that of the nearest point which has one, shape (n_points,) [m/s]; all zero where none has.

    So a point that lacks its rate joins the body it lies in. If it matched any rate, it could tie two bodies together that pass each other.
    """
    missing = np.isnan(points.rate)
    if not missing.any():
        return points.rate
    if missing.all():
        return np.zeros(len(points))
    rate, known = points.rate.copy(), ~missing
    _, nearest = cKDTree(points.position[known]).query(points.position[missing])
    rate[missing] = points.rate[known][nearest]
    return rate


def _rate_axis(points: ClusterPoints, config: ClusteringConfig) -> Float64Array:
    """Range rates as lengths [m], shape (n_points,); zero where they are not used."""
    return np.asarray(config.rate_weight * known_rates(points)) if config.rate_weight > 0 else np.zeros(len(points))


def axes(points: ClusterPoints, config: ClusteringConfig) -> Float64Array:
    """Coordinates between which distances are measured, shape (n_points, d or d + 1) [m]: position, and weighted range rate if any."""
    if config.rate_weight == 0:
        return points.position
    return np.column_stack([points.position, _rate_axis(points, config)])


def _dbscan(points: ClusterPoints, config: ClusteringConfig) -> IndexArray:
    return cluster(axes(points, config), config.eps, config.min_points, config.max_points)


def _optics(points: ClusterPoints, config: ClusteringConfig) -> IndexArray:
    merged, weights, member = thin(axes(points, config), config.eps / 4, config.max_points)
    return optics(merged, config.min_points, config.max_eps, weights).labels(config.eps)[member]


def _kmeans(points: ClusterPoints, config: ClusteringConfig) -> IndexArray:
    """From centres spread over the cloud; there is no noise."""
    if len(points) == 0:
        return np.empty(0, np.int64)
    place = axes(points, config)
    return kmeans(place, spread_centres(place, config.n_clusters), config.max_iterations)[0]


def _grid_dbscan(points: ClusterPoints, config: ClusteringConfig) -> IndexArray:
    return grid_dbscan(points, _rate_axis(points, config), config)


def _polar_dbscan(points: ClusterPoints, config: ClusteringConfig) -> IndexArray:
    require_polar(points)
    rate = _rate_axis(points, config)
    if len(points) <= config.max_points:
        return polar_dbscan(points, rate, config, np.empty(0))
    # One point of each cell stands for all: means of azimuths would be wrong where they wrap.
    _, weights, member = thin(axes(points, config), config.eps / 4, config.max_points)
    first, _, _ = occupied(member[:, None])
    kept = {name: getattr(points, name)[first] for name in ("position", "rate", "range", "azimuth")}
    return polar_dbscan(replace(points, **kept), rate[first], config, weights)[member]


_METHODS: dict[str, Callable[[ClusterPoints, ClusteringConfig], IndexArray]] = {
    "dbscan": _dbscan,
    "optics": _optics,
    "kmeans": _kmeans,
    "grid_dbscan": _grid_dbscan,
    "polar_dbscan": _polar_dbscan,
}


class Clustering:
    """The clustering that a configuration names; without state, so that one serves all clouds."""

    def __init__(self, config: ClusteringConfig) -> None:
        self.config = config

    def labels(self, points: ClusterPoints) -> IndexArray:
        """Cluster of each point, counted from 0, shape (n_points,); -1: noise."""
        return _METHODS[self.config.name](points, self.config)
