"""Cluster First Track Later (thesis, 6.2.2): whole clusters to tracks by the Hungarian algorithm."""

from __future__ import annotations

import numpy as np

from radar_core.types import Float64Array, IndexArray
from radar_tracking.assignment import assign_tracks
from radar_tracking.clustering.lloyd import kmeans
from radar_tracking.mahalanobis import mahalanobis
from radar_tracking.people.config import AssociationConfig
from radar_tracking.people.gating import Gating
from radar_tracking.people.owners import Clusters, Owners, nobody
from radar_tracking.people.points import Points


class ClusterFirstTrackLater:
    """Cluster First Track Later: dense clusters of the whole cloud, one for each track at most (Hungarian algorithm).

    With `split`, a cluster that holds the predicted centres of several tracks of which only one could have it is divided among them
    (Wagner et al. 2018; the thesis uses k-means for it).
    """

    def __init__(self, config: AssociationConfig) -> None:
        self._config = config
        self._clusters = Clusters(config)

    def process(self, points: Points, gating: Gating, rows: IndexArray, open_points: IndexArray) -> Owners:
        """Give whole clusters to tracks."""
        main = nobody(len(points))
        labels = self._clusters.labels(points, open_points)
        if self._config.split != "none":
            labels = self._divide(points, gating, rows, open_points, labels)
        n_clusters = int(labels.max(initial=-1)) + 1
        if n_clusters == 0:
            return Owners(main, nobody(len(points)))
        centroid = centroids(points, open_points, labels, n_clusters)
        cost = np.hypot(*np.moveaxis(gating.centre[rows, None] - centroid[None], -1, 0))
        outside = cost > self._config.gate
        if self._config.method == "mahalanobis":
            cost = mahalanobis(gating.centre[rows], gating.covariance[rows], centroid)
            outside |= cost > self._config.gate_sigmas
        track = nobody(n_clusters)
        for row, column in assign_tracks(np.where(outside, np.inf, cost), np.inf):
            track[column] = rows[row]
        main[open_points] = np.where(labels >= 0, track[labels], -1)
        return Owners(main, nobody(len(points)))

    def _divide(self, points: Points, gating: Gating, rows: IndexArray, open_points: IndexArray, labels: IndexArray) -> IndexArray:
        """Split clusters in which several tracks are predicted."""
        labels = labels.copy()
        for label in range(int(labels.max(initial=-1)) + 1):
            own = np.flatnonzero(labels == label)
            place = points.position[open_points[own], :2]
            apart = np.hypot(*np.moveaxis(gating.centre[rows, None] - place[None], -1, 0)).min(axis=1)
            inside = gating.centre[rows[apart <= self._config.clustering.eps]]
            if len(inside) < 2 or len(own) < len(inside):
                continue
            if self._config.split == "optics":
                from radar_tracking.clustering.reachability import split

                part, _ = split(place, len(inside), inside)
            else:
                part, _ = kmeans(place, inside)
            part = np.unique(part, return_inverse=True)[1]  # a centre may get no point, and every label must occur
            fresh = int(labels.max()) + part
            labels[own] = np.where(part > 0, fresh, label)
        return labels


def centroids(points: Points, index: IndexArray, labels: IndexArray, n_clusters: int) -> Float64Array:
    """Centroids of clusters on the floor plane, weighted by amplitude, shape (n_clusters, 2) [m]; every label occurs."""
    own = index[labels >= 0]
    label, weight = labels[labels >= 0], points.weight[own]
    total = np.bincount(label, weight, n_clusters)
    return np.stack([np.bincount(label, weight * points.position[own, axis], n_clusters) / total for axis in (0, 1)], axis=-1)
