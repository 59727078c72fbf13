"""Association of points with tracks: the three ways of the thesis by name (6.2.2, figures 6.1 and A.23)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numba
import numpy as np
from numpy.typing import NDArray

from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.assignment import assign_tracks, mahalanobis
from radar_tracking.clustering.base import ClusterPoints, dense
from radar_tracking.clustering.density import DENSE_LIMIT, cluster, label_dense
from radar_tracking.clustering.lloyd import kmeans
from radar_tracking.people.config import AssociationConfig, TrackerConfig
from radar_tracking.people.gating import Gating
from radar_tracking.people.points import Points

_jit = numba.njit(cache=True, nogil=True)
_NO_WEIGHTS = np.empty(0)


@dataclass(frozen=True, eq=False)
class Owners:
    """Rows of the tracks that points belong to, -1 for nobody; arrays have shape (n_points,).

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
    """Dense clusters of some of a cloud's points, by the configured method; ``plain``: DBSCAN of positions, with compiled loops."""

    def __init__(self, config: AssociationConfig) -> None:
        self._config = config.clustering
        self.plain = config.clustering.name == "dbscan" and config.clustering.rate_weight == 0
        if not self.plain:
            from radar_tracking.clustering.choose import Clustering  # with all methods, which the default does without

            self._method = Clustering(config.clustering)

    def labels(self, points: Points, index: IndexArray) -> IndexArray:
        """Cluster of each point of ``index``, shape (len(index),); -1: noise."""
        if self.plain:
            config = self._config
            return cluster(points.position[index, :2], config.eps, config.min_points, config.max_points)
        away = points.position[index, :2] - points.origins[points.sensor[index], :2]
        azimuth = np.arctan2(away[:, 1], away[:, 0])
        return self._method.labels(ClusterPoints(points.position[index, :2], points.speed[index], points.distance[index], azimuth))


def nobody(n_points: int) -> IndexArray:
    """Owners of ``n_points`` points that belong to nobody, shape (n_points,)."""
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

    def process(self, points: Points, gating: Gating, rows: IndexArray, open_points: IndexArray) -> Owners:
        """Give points to the nearest track."""
        main = nobody(len(points))
        row = nearest(block(gating.distance, rows, open_points))
        main[open_points] = np.where(row >= 0, rows[row], -1)
        return Owners(main, nobody(len(points)))


def associate(association: Association, points: Points, gating: Gating, confirmed: BoolArray, apart: float = np.inf) -> Owners:
    """Share out a cloud's points: confirmed tracks choose first, tentative ones take what is left.

    Tentative tracks ``apart`` [m] or farther from every confirmed one choose with these: they are no arm, but somebody who was there from
    the beginning too.
    """
    main, limb = nobody(len(points)), nobody(len(points))
    first = confirmed.copy()
    if confirmed.any() and not confirmed.all():
        step = gating.centre[:, None] - gating.centre[confirmed]
        first |= np.hypot(step[..., 0], step[..., 1]).min(axis=1) >= apart
    for group in (first, ~first):
        rows, open_points = np.flatnonzero(group), np.flatnonzero((main < 0) & (limb < 0))
        if len(rows) == 0 or len(open_points) == 0:
            continue
        found = association.process(points, gating, rows, open_points)
        main, limb = np.maximum(main, found.main), np.maximum(limb, found.limb)
    return Owners(main, limb)


def make_association(config: TrackerConfig) -> Association:
    """Make the tracker's way of giving points to tracks."""
    if config.tracker == "group":
        return GroupTracking()
    if config.tracker == "cluster_first":
        return ClusterFirstTrackLater(config.association)
    return GroupTrackingWithClustering(config.association)


class GroupTrackingWithClustering:
    """Group Tracker with Clustering: of a track's points the largest dense cluster stays, the rest are free for the other tracks.

    A point that is not in the main cluster of its nearest track is free for the next one, which takes it if it is dense with points that
    were nearest to it from the start: somebody else's arm alone is no body. What remains dense within `reach` belongs to the nearest
    track as a limb.
    """

    def __init__(self, config: AssociationConfig) -> None:
        self._config = config
        self._clusters = Clusters(config)

    def process(self, points: Points, gating: Gating, rows: IndexArray, open_points: IndexArray) -> Owners:
        """Give points to tracks by distance and density."""
        main, limb = nobody(len(points)), nobody(len(points))
        size = self._size(gating, rows, open_points)
        row = self._assign(points, open_points, block(gating.distance, rows, open_points), size)
        main[open_points] = np.where(row >= 0, rows[row], -1)
        left = open_points[row < 0]
        if len(left):
            plane = np.where(block(gating.behind, rows, left), np.inf, block(gating.plane, rows, left))
            near = plane.argmin(axis=0)
            near[plane[near, np.arange(len(left))] > self._config.reach] = -1
            near[self._clusters.labels(points, left) < 0] = -1
            limb[left] = np.where(near >= 0, rows[near], -1)
        return Owners(main, limb)

    def _size(self, gating: Gating, rows: IndexArray, open_points: IndexArray) -> Float64Array:
        """How much each point counts for the size of a cluster: one, or by how much it looks like a torso, shape (n_rows, n_open)."""
        near = block(gating.near, rows, open_points)
        if self._config.largest == "points":
            return np.ones(near.shape)
        # The fourth root makes the radius twice as large: a body's cluster reaches farther than what measures its centre.
        return np.asarray(np.sqrt(np.sqrt(near)) * block(gating.torso, rows, open_points))

    def _assign(self, points: Points, open_points: IndexArray, distance: Float64Array, size: Float64Array) -> IndexArray:
        """Row (of ``distance``) of each point, -1: nobody."""
        config = self._config.clustering
        if self._clusters.plain and len(open_points) <= min(config.max_points, DENSE_LIMIT):
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

    def _main_cluster(self, points: Points, index: IndexArray, size: Float64Array) -> BoolArray:
        """Points of the largest cluster, shape (len(index),); none where no dense region has any size."""
        labels = self._clusters.labels(points, index)
        clustered = labels >= 0
        if not clustered.any():
            return clustered
        total = np.bincount(labels[clustered], size[clustered])
        return np.asarray(labels == int(total.argmax())) if total.max() > 0 else np.zeros(len(index), bool)


@_jit
def share_out(place: Any, distance: Any, size: Any, eps: float, min_points: float) -> Any:
    """Give every point to the nearest track in whose main cluster it is: the row of each point's track, shape (n_points,), -1: nobody.

    Places on the floor plane have shape (n_points, 2) [m]; distances from every track, infinite outside the gate, and how much each point
    counts for the size of a cluster have shape (n_tracks, n_points). ``eps`` and ``min_points`` are those of the clustering.
    """
    n_tracks, n_points = distance.shape
    left, lost = distance.copy(), np.ones(n_points, np.bool_)
    row = np.empty(n_points, np.int64)
    changed = _give(left, lost, row)
    first = row.copy()
    own, near = np.empty(n_points, np.int64), np.empty((n_points, 2))
    for _ in range(n_tracks + 1):
        lost[:] = False
        for track in range(n_tracks):
            if not changed[track]:
                continue
            n_own = _collect(row, track, place, own, near)
            labels = label_dense(near[:n_own], eps, min_points, _NO_WEIGHTS)
            kept = _largest(labels, own, first, track, size)
            for k in range(n_own):
                if kept < 0 or labels[k] != kept:
                    left[track, own[k]] = math.inf
                    lost[own[k]] = True
        changed = _give(left, lost, row)
        if not changed.any():
            break
    return row


@_jit
def _give(distance: Any, which: Any, row: Any) -> Any:
    """Give some points to the track that is nearest; returns which tracks got any."""
    changed = np.zeros(len(distance), np.bool_)
    for point in range(len(row)):
        if not which[point]:
            continue
        row[point], least = -1, math.inf
        for track in range(len(distance)):
            if distance[track, point] < least:
                row[point], least = track, distance[track, point]
        if row[point] >= 0:
            changed[row[point]] = True
    return changed


@_jit
def _collect(row: Any, track: int, place: Any, own: Any, near: Any) -> int:
    """Put the points of a track into ``own``, and where they are into ``near``; returns how many there are."""
    n_own = 0
    for point in range(len(row)):
        if row[point] == track:
            own[n_own] = point
            near[n_own, 0], near[n_own, 1] = place[point, 0], place[point, 1]
            n_own += 1
    return n_own


@_jit
def _largest(labels: Any, own: Any, first: Any, track: int, size: Any) -> int:
    """Label of the cluster whose points that were nearest to the track from the start are largest together; -1: none has any size."""
    total = np.zeros(len(labels))
    for k in range(len(labels)):
        if labels[k] >= 0 and first[own[k]] == track:
            total[labels[k]] += size[track, own[k]]
    largest, most = -1, 0.0
    for label in range(len(total)):
        if total[label] > most:
            largest, most = label, total[label]
    return largest


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
