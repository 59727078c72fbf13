"""Which point belongs to which track: the three ways of the thesis (6.2.2, figures 6.1 and A.23)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from radar_tracking.assignment import assign_tracks, mahalanobis
from radar_tracking.clustering import ClusterPoints, cluster, kmeans, make_clustering, split
from radar_tracking.clustering.density import DENSE_LIMIT, dense
from radar_tracking.people.association_kernels import share_out
from radar_tracking.people.config import AssociationConfig, TrackerConfig
from radar_tracking.people.gating import Sight
from radar_tracking.people.points import Points

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]


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
    def free(self) -> NDArray[np.bool_]:
        """Points of nobody."""
        return (self.main < 0) & (self.limb < 0)


class Association(Protocol):
    """Gives points to tracks."""

    def process(self, points: Points, sight: Sight, rows: IndexArray, open_points: IndexArray) -> Owners:
        """Share out ``open_points`` among the tracks of ``rows``; everything else belongs to nobody."""
        ...


class Clusters:
    """Dense clusters of some of a cloud's points, by the method that the configuration names."""

    def __init__(self, config: AssociationConfig) -> None:
        self._config = config.clustering
        self._method = make_clustering(config.clustering)
        self._plain = config.clustering.name == "dbscan" and config.clustering.rate_weight == 0

    def labels(self, points: Points, index: IndexArray) -> IndexArray:
        """Cluster of each point of ``index``, shape (len(index),); -1: noise."""
        if self._plain:
            config = self._config
            return cluster(points.position[index, :2], config.eps, config.min_points, config.max_points)
        away = points.position[index, :2] - points.origins[points.sensor[index], :2]
        azimuth = np.arctan2(away[:, 1], away[:, 0])
        return self._method.labels(ClusterPoints(points.position[index, :2], points.speed[index], points.distance[index], azimuth))


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


class GroupTracking:
    """Group Tracker: every point within the gate belongs to the nearest track."""

    def __init__(self, config: AssociationConfig) -> None:
        self._config = config

    def process(self, points: Points, sight: Sight, rows: IndexArray, open_points: IndexArray) -> Owners:
        """Give points to the nearest track."""
        main = nobody(len(points))
        row = nearest(block(sight.distance, rows, open_points))
        main[open_points] = np.where(row >= 0, rows[row], -1)
        return Owners(main, nobody(len(points)))


class GroupTrackingWithClustering:
    """Group Tracker with Clustering: of a track's points the largest dense cluster stays, the rest are free for the other tracks.

    A point that is not in the main cluster of its nearest track is free for the next one, which takes it if it is dense with points that
    were nearest to it from the start: somebody else's arm alone is no body. What remains dense within `reach` belongs to the nearest
    track as a limb.
    """

    def __init__(self, config: AssociationConfig) -> None:
        self._config = config
        self._clusters = Clusters(config)

    def process(self, points: Points, sight: Sight, rows: IndexArray, open_points: IndexArray) -> Owners:
        """Give points to tracks by distance and density."""
        main, limb = nobody(len(points)), nobody(len(points))
        size = self._size(sight, rows, open_points)
        row = self._assign(points, open_points, block(sight.distance, rows, open_points), size)
        main[open_points] = np.where(row >= 0, rows[row], -1)
        left = open_points[row < 0]
        if len(left):
            plane = np.where(block(sight.behind, rows, left), np.inf, block(sight.plane, rows, left))
            near = plane.argmin(axis=0)
            near[plane[near, np.arange(len(left))] > self._config.reach] = -1
            near[self._clusters.labels(points, left) < 0] = -1
            limb[left] = np.where(near >= 0, rows[near], -1)
        return Owners(main, limb)

    def _size(self, sight: Sight, rows: IndexArray, open_points: IndexArray) -> Float64Array:
        """How much each point counts for the size of a cluster: one, or by how much it looks like a torso, shape (n_rows, n_open)."""
        near = block(sight.near, rows, open_points)
        if self._config.largest == "points":
            return np.ones(near.shape)
        # The fourth root makes the radius twice as large: a body's cluster reaches farther than what measures its centre.
        return np.asarray(np.sqrt(np.sqrt(near)) * block(sight.torso, rows, open_points))

    def _assign(self, points: Points, open_points: IndexArray, distance: Float64Array, size: Float64Array) -> IndexArray:
        """Row (of ``distance``) of each point, -1: nobody."""
        config = self._config.clustering
        if config.name == "dbscan" and config.rate_weight == 0 and len(open_points) <= min(config.max_points, DENSE_LIMIT):
            place = dense(points.plane.take(open_points, axis=0))
            row: IndexArray = share_out(place, dense(distance), dense(size), config.eps, float(config.min_points))
            return row
        return self._assign_by(points, open_points, distance, size)

    def _assign_by(self, points: Points, open_points: IndexArray, distance: Float64Array, size: Float64Array) -> IndexArray:
        """Do what the compiled `share_out` does for plain DBSCAN, by whatever clustering is configured."""
        n_rows = len(distance)
        still = distance.copy()
        first = nearest(distance)
        row = first.copy()
        changed = np.unique(row[row >= 0])
        for _ in range(n_rows + 1):
            lost = []
            for track in changed:
                own = np.flatnonzero(row == track)
                kept = self._main_cluster(points, open_points[own], size[track, own] * (first[own] == track))
                if not kept.all():
                    still[track, own[~kept]] = np.inf
                    lost.append(own[~kept])
            if not lost:
                break
            freed = np.concatenate(lost)
            row[freed] = nearest(still[:, freed])
            changed = np.unique(row[freed][row[freed] >= 0])
        return row

    def _main_cluster(self, points: Points, index: IndexArray, size: Float64Array) -> NDArray[np.bool_]:
        """Points of the largest cluster, shape (len(index),); none where no dense region has any size."""
        labels = self._clusters.labels(points, index)
        clustered = labels >= 0
        if not clustered.any():
            return clustered
        total = np.bincount(labels[clustered], size[clustered])
        return np.asarray(labels == int(total.argmax())) if total.max() > 0 else np.zeros(len(index), bool)


class ClusterFirstTrackLater:
    """Cluster First Track Later: dense clusters of the whole cloud, one for each track at most (Hungarian algorithm).

    With `split`, a cluster that holds the predicted centres of several tracks of which only one could have it is divided among them
    (Wagner et al. 2018; the thesis uses k-means for it).
    """

    def __init__(self, config: AssociationConfig) -> None:
        self._config = config
        self._clusters = Clusters(config)

    def process(self, points: Points, sight: Sight, rows: IndexArray, open_points: IndexArray) -> Owners:
        """Give whole clusters to tracks."""
        main = nobody(len(points))
        labels = self._clusters.labels(points, open_points)
        if self._config.split != "none":
            labels = self._divide(points, sight, rows, open_points, labels)
        n_clusters = int(labels.max(initial=-1)) + 1
        if n_clusters == 0:
            return Owners(main, nobody(len(points)))
        centroid = centroids(points, open_points, labels, n_clusters)
        cost = np.hypot(*np.moveaxis(sight.centre[rows, None] - centroid[None], -1, 0))
        outside = cost > self._config.gate
        if self._config.method == "mahalanobis":
            cost = mahalanobis(sight.centre[rows], sight.covariance[rows], centroid)
            outside |= cost > self._config.gate_sigmas
        track = nobody(n_clusters)
        for row, column in assign_tracks(np.where(outside, np.inf, cost), np.inf):
            track[column] = rows[row]
        main[open_points] = np.where(labels >= 0, track[labels], -1)
        return Owners(main, nobody(len(points)))

    def _divide(self, points: Points, sight: Sight, rows: IndexArray, open_points: IndexArray, labels: IndexArray) -> IndexArray:
        """Split clusters in which several tracks are predicted."""
        labels = labels.copy()
        for label in range(int(labels.max(initial=-1)) + 1):
            own = np.flatnonzero(labels == label)
            place = points.position[open_points[own], :2]
            apart = np.hypot(*np.moveaxis(sight.centre[rows, None] - place[None], -1, 0)).min(axis=1)
            inside = sight.centre[rows[apart <= self._config.clustering.eps]]
            if len(inside) < 2 or len(own) < len(inside):
                continue
            part, _ = split(place, len(inside), inside) if self._config.split == "optics" else kmeans(place, inside)
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


ASSOCIATIONS: Final[dict[str, Callable[[AssociationConfig], Association]]] = {
    "group_clustering": GroupTrackingWithClustering,
    "group": GroupTracking,
    "cluster_first": ClusterFirstTrackLater,
}
"""The thesis's trackers by name."""


def associate(association: Association, points: Points, sight: Sight, confirmed: NDArray[np.bool_], apart: float = np.inf) -> Owners:
    """Share out a cloud's points: confirmed tracks choose first, tentative ones take what is left.

    Tentative tracks ``apart`` [m] or farther from every confirmed one choose with these: they are no arm, but somebody who was there from
    the beginning too.
    """
    main, limb = nobody(len(points)), nobody(len(points))
    first = confirmed.copy()
    if confirmed.any() and not confirmed.all():
        step = sight.centre[:, None] - sight.centre[confirmed]
        first |= np.hypot(step[..., 0], step[..., 1]).min(axis=1) >= apart
    for group in (first, ~first):
        rows, open_points = np.flatnonzero(group), np.flatnonzero((main < 0) & (limb < 0))
        if len(rows) == 0 or len(open_points) == 0:
            continue
        found = association.process(points, sight, rows, open_points)
        main, limb = np.maximum(main, found.main), np.maximum(limb, found.limb)
    return Owners(main, limb)


def make_association(config: TrackerConfig) -> Association:
    """Make the tracker's way of giving points to tracks."""
    return ASSOCIATIONS[config.tracker](config.association)
