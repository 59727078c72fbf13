"""Clusterings by name: each makes of a cloud what its method looks at, and bounds its time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from radar_core.types import Float64Array, IndexArray
from radar_tracking.clustering.base import Clustering, ClusteringConfig, ClusterPoints
from radar_tracking.clustering.density import cluster, occupied, thin
from radar_tracking.clustering.lloyd import kmeans, spread_centres
from radar_tracking.clustering.polar import grid_dbscan, polar_dbscan, require_polar
from radar_tracking.clustering.reachability import optics

_NONE = np.empty(0)


def known_rates(points: ClusterPoints) -> Float64Array:
    """Give points without a range rate that of the nearest point which has one; all zero where none has.

    So a point that lacks its rate joins the body it lies in and cannot tie two bodies together that pass each other at different rates,
    as it could if it matched any rate.

    Parameters
    ----------
    points : ClusterPoints
        With or without rates.

    Returns
    -------
    ndarray of float64, shape (n_points,)
        Finite range rates [m/s].
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
    """Coordinates between which distances are measured: position, and the range rate times its weight where that is not zero.

    Parameters
    ----------
    points : ClusterPoints
        The cloud.
    config : ClusteringConfig
        For ``rate_weight``.

    Returns
    -------
    ndarray of float64, shape (n_points, d or d + 1)
        All in metres.
    """
    if config.rate_weight == 0:
        return points.position
    return np.column_stack([points.position, _rate_axis(points, config)])


class Dbscan:
    """DBSCAN of position and range rate (`dbscan`)."""

    def __init__(self, config: ClusteringConfig) -> None:
        self.config = config

    def labels(self, points: ClusterPoints) -> IndexArray:
        """Cluster of each point, shape (n_points,); -1: noise."""
        return cluster(axes(points, self.config), self.config.eps, self.config.min_points, self.config.max_points)


class OpticsClustering:
    """OPTICS of position and range rate, cut at ``eps`` (`optics`)."""

    def __init__(self, config: ClusteringConfig) -> None:
        self.config = config

    def labels(self, points: ClusterPoints) -> IndexArray:
        """Cluster of each point, shape (n_points,); -1: noise."""
        config = self.config
        merged, weights, member = thin(axes(points, config), config.eps / 4, config.max_points)
        return optics(merged, config.min_points, config.max_eps, weights).labels(config.eps)[member]


class KMeans:
    """K-means of position and range rate from centres spread over the cloud (`kmeans`); there is no noise."""

    def __init__(self, config: ClusteringConfig) -> None:
        self.config = config

    def labels(self, points: ClusterPoints) -> IndexArray:
        """Cluster of each point, shape (n_points,)."""
        if len(points) == 0:
            return np.empty(0, np.int64)
        place = axes(points, self.config)
        return kmeans(place, spread_centres(place, self.config.n_clusters), self.config.max_iterations)[0]


class GridDbscan:
    """DBSCAN on cells of range, azimuth and range rate (`grid_dbscan`)."""

    def __init__(self, config: ClusteringConfig) -> None:
        self.config = config

    def labels(self, points: ClusterPoints) -> IndexArray:
        """Cluster of each point, shape (n_points,); -1: noise."""
        return grid_dbscan(points, _rate_axis(points, self.config), self.config)


class PolarDbscan:
    """DBSCAN in range, cross-range and range rate with a density that falls with range (`polar_dbscan`)."""

    def __init__(self, config: ClusteringConfig) -> None:
        self.config = config

    def labels(self, points: ClusterPoints) -> IndexArray:
        """Cluster of each point, shape (n_points,); -1: noise."""
        require_polar(points)
        rate = _rate_axis(points, self.config)
        if len(points) <= self.config.max_points:
            return polar_dbscan(points, rate, self.config, _NONE)
        # One point of each cell stands for all: means of azimuths would be wrong where they wrap.
        _, weights, member = thin(axes(points, self.config), self.config.eps / 4, self.config.max_points)
        first, _, _ = occupied(member[:, None])
        kept = {name: getattr(points, name)[first] for name in ("position", "rate", "range", "azimuth")}
        return polar_dbscan(replace(points, **kept), rate[first], self.config, weights)[member]


_METHODS: dict[str, Callable[[ClusteringConfig], Clustering]] = {
    "dbscan": Dbscan,
    "optics": OpticsClustering,
    "kmeans": KMeans,
    "grid_dbscan": GridDbscan,
    "polar_dbscan": PolarDbscan,
}


def make_clustering(config: ClusteringConfig) -> Clustering:
    """Make the clustering that a configuration names.

    Parameters
    ----------
    config : ClusteringConfig
        Which method, and its knobs.

    Returns
    -------
    Clustering
        Without state; one serves all clouds.
    """
    return _METHODS[config.name](config)
