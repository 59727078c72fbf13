"""What every association gives, and what several of them need: owners of points, clusters, the nearest track."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.clustering.density import cluster
from radar_tracking.people.config import AssociationConfig
from radar_tracking.people.gating import Gating
from radar_tracking.people.points import Points


@dataclass(frozen=True, eq=False)
class Owners:
    """Whose each point is: rows of the tracks, -1 for nobody; arrays have shape (n_points,).

    Attributes
    ----------
    main : ndarray of int64
        Points that measure where the track is.
    limb : ndarray of int64
        Points that belong to the track but do not move it: hands of stretched arms.
    """

    main: IndexArray
    limb: IndexArray

    @property
    def free(self) -> BoolArray:
        """Points of nobody."""
        return (self.main < 0) & (self.limb < 0)


class Association(Protocol):
    """Gives points to tracks."""

    def process(self, points: Points, gating: Gating, rows: IndexArray, open_points: IndexArray) -> Owners:
        """Share out ``open_points`` among the tracks of ``rows``; everything else belongs to nobody."""
        ...


class Clusters:
    """Dense clusters of some of a cloud's points, by the method that the configuration names.

    Attributes
    ----------
    plain : bool
        Whether it is DBSCAN of positions, for which there are compiled loops.
    """

    def __init__(self, config: AssociationConfig) -> None:
        self._config = config.clustering
        self.plain = config.clustering.name == "dbscan" and config.clustering.rate_weight == 0
        if not self.plain:
            from radar_tracking.clustering.base import ClusterPoints
            from radar_tracking.clustering.choose import make_clustering

            self._points, self._method = ClusterPoints, make_clustering(config.clustering)

    def labels(self, points: Points, index: IndexArray) -> IndexArray:
        """Cluster of each point of ``index``, shape (len(index),); -1: noise."""
        if self.plain:
            config = self._config
            return cluster(points.position[index, :2], config.eps, config.min_points, config.max_points)
        away = points.position[index, :2] - points.origins[points.sensor[index], :2]
        azimuth = np.arctan2(away[:, 1], away[:, 0])
        return self._method.labels(self._points(points.position[index, :2], points.speed[index], points.distance[index], azimuth))


def nobody(n_points: int) -> IndexArray:
    """Nobody's points."""
    return np.full(n_points, -1, np.int64)


def block(matrix: NDArray[Any], rows: IndexArray, columns: IndexArray) -> NDArray[Any]:
    """Cut rows and columns out of a matrix; twice `take` is four times as fast as one index of both."""
    return matrix.take(rows, axis=0).take(columns, axis=1)


def nearest(distance: Float64Array) -> IndexArray:
    """Row of the nearest track of each point, -1 where none is within the gate."""
    row = distance.argmin(axis=0)
    return np.where(np.isfinite(distance[row, np.arange(distance.shape[1])]), row, -1)
