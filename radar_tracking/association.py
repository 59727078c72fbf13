"""Which point belongs to which track: the thesis's Group Tracker with Clustering (6.2.2, figure 6.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radar_tracking.clustering import cluster
from radar_tracking.kalman import mahalanobis2
from radar_tracking.people_config import AssociationConfig

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]


def plane_distance(points: Float64Array, centres: Float64Array) -> Float64Array:
    """Distances in the floor plane, shape (n_tracks, n_points) [m], of points (n_points, 2) from centres (n_tracks, 2)."""
    return np.hypot(points[None, :, 0] - centres[:, None, 0], points[None, :, 1] - centres[:, None, 1])


def nearness(distance: Float64Array, radius: float) -> Float64Array:
    """How much a point counts as body, 0..1: falls off beyond ``radius``, so that an arm or a neighbour cannot drag the centroid."""
    return np.asarray(np.exp(-0.5 * np.minimum(distance / radius, 5.0) ** 2))


def gate(points: Float64Array, mean: Float64Array, covariance: Float64Array, config: AssociationConfig) -> Float64Array:
    """Distance of every point from every predicted track, infinite outside the gate.

    Parameters
    ----------
    points : ndarray of float64, shape (n_points, 2)
        On the floor plane [m].
    mean : ndarray of float64, shape (n_tracks, 6)
        Predicted states.
    covariance : ndarray of float64, shape (n_tracks, 6, 6)
        Of the same.
    config : AssociationConfig
        Says how to measure.

    Returns
    -------
    ndarray of float64, shape (n_tracks, n_points)
        [m], or standard deviations for method ``mahalanobis``.
    """
    distance = plane_distance(points, mean[:, :2])
    inside = distance <= config.gate
    if config.method == "mahalanobis":
        body = np.eye(2) * config.body_radius**2
        distance = np.sqrt(np.maximum(mahalanobis2(mean[:, :2], covariance[:, :2, :2], points, body), 0.0))
        inside &= distance <= config.gate_sigmas
    return np.where(inside, distance, np.inf)


def main_cluster(points: Float64Array, weights: Float64Array, config: AssociationConfig) -> NDArray[np.bool_]:
    """Points of the cluster with the largest sum of weights, shape (n_points,); none when there is no dense region of any weight."""
    labels = cluster(points, config.eps, config.min_points, config.max_points)
    clustered = labels >= 0
    if not clustered.any():
        return clustered
    size = np.bincount(labels[clustered], weights[clustered])
    return np.asarray(labels == int(size.argmax())) if size.max() > 0 else np.zeros(len(points), bool)


def assign(points: Float64Array, distance: Float64Array, plane: Float64Array, torso: Float64Array, config: AssociationConfig) -> IndexArray:
    """Give each point to the nearest track in whose largest cluster it lies.

    A point that is not in the main cluster of its nearest track is free for the next one, which takes it if it is dense with points that
    were nearest to it from the start: somebody else's arm alone is no body. "Largest" counts points by their `nearness` and by how much
    they look like a torso, so that the body's cluster wins over the hand's even where it has fewer points.

    Parameters
    ----------
    points : ndarray of float64, shape (n_points, 2)
        On the floor plane [m].
    distance : ndarray of float64, shape (n_tracks, n_points)
        Of `gate`.
    plane : ndarray of float64, shape (n_tracks, n_points)
        Of `plane_distance`.
    torso : ndarray of float64, shape (n_tracks, n_points)
        0..1; see `PeopleTracker`.
    config : AssociationConfig
        Clustering.

    Returns
    -------
    ndarray of int64, shape (n_points,)
        Row of the track, or -1.
    """
    n_tracks, n_points = distance.shape
    owner = np.full(n_points, -1, np.int64)
    if n_tracks == 0 or n_points == 0:
        return owner
    open_distance = distance.copy()
    first = distance.argmin(axis=0)
    for _ in range(n_tracks + 1):
        nearest = open_distance.argmin(axis=0)
        owner = np.where(np.isfinite(open_distance[nearest, np.arange(n_points)]), nearest, -1)
        freed = False
        for track in np.unique(owner[owner >= 0]):
            own = np.flatnonzero(owner == track)
            weight = nearness(plane[track, own], 2 * config.body_radius) * torso[track, own] * (first[own] == track)
            kept = main_cluster(points[own], weight, config)
            open_distance[track, own[~kept]] = np.inf
            owner[own[~kept]] = -1
            freed |= not kept.all()
        if not freed:
            break
    return owner


def add_limbs(points: Float64Array, owner: IndexArray, plane: Float64Array, config: AssociationConfig) -> IndexArray:
    """Give clusters that nobody's main cluster took to the nearest track within reach: hands of stretched arms.

    Parameters
    ----------
    points : ndarray of float64, shape (n_points, 2)
        On the floor plane [m].
    owner : ndarray of int64, shape (n_points,)
        Of `assign`.
    plane : ndarray of float64, shape (n_tracks, n_points)
        Of `plane_distance`.
    config : AssociationConfig
        Reach and clustering.

    Returns
    -------
    ndarray of int64, shape (n_points,)
        Row of the track that each point of ``owner`` -1 belongs to as a limb; -1 for all others.
    """
    limb = np.full(len(points), -1, np.int64)
    free = np.flatnonzero(owner < 0)
    if len(free) == 0 or len(plane) == 0:
        return limb
    near = plane[:, free].argmin(axis=0)
    near[plane[near, free] > config.reach] = -1
    labels = cluster(points[free], config.eps, config.min_points, config.max_points)
    limb[free] = np.where(labels >= 0, near, -1)
    return limb
