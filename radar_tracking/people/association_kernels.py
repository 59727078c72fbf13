"""The sharing out of points among tracks by distance and density, compiled: one call for what is a loop over tracks.

`GroupTrackingWithClustering` does the same for any clustering; a test holds the two equal.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from radar_tracking.clustering.kernels import dbscan

_jit = numba.njit(cache=True, nogil=True)
_NO_WEIGHTS = np.empty(0)


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
