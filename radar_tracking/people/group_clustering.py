"""Group Tracker with Clustering (thesis, 6.2.2): points to the nearest track in whose largest dense cluster they are."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.clustering.density import DENSE_LIMIT, dense
from radar_tracking.clustering.kernels import dbscan
from radar_tracking.people.config import AssociationConfig
from radar_tracking.people.gating import Gating
from radar_tracking.people.owners import Clusters, Owners, block, nearest, nobody
from radar_tracking.people.points import Points

_jit = numba.njit(cache=True, nogil=True)
_NO_WEIGHTS = np.empty(0)


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
    """Give every point to the nearest track in whose main cluster it is.

    Parameters
    ----------
    place : ndarray of float64, shape (n_points, 2)
        Of the points on the floor plane [m].
    distance : ndarray of float64, shape (n_tracks, n_points)
        Of every point from every track; infinite outside the gate.
    size : ndarray of float64, shape (n_tracks, n_points)
        How much each point counts for the size of a cluster.
    eps, min_points : float
        Of the clustering.

    Returns
    -------
    ndarray of int64, shape (n_points,)
        Row of the track of each point, -1: nobody.
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
            labels = dbscan(near[:n_own], eps, min_points, _NO_WEIGHTS)
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
