"""Separation of tracks: two bodies do not fit into one place, so tracks that meet cannot pass through each other and swap."""

from __future__ import annotations

import numpy as np

from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.estimators.base import Belief

_SAME = 1e-6  # m: tracks at the very same place have no direction of separation


def separate_tracks(
    belief: Belief, kinematics: tuple[Float64Array, Float64Array], solid: BoolArray, width: float, dimensions: int
) -> Belief:
    """Push tracks apart that are nearer to each other than people can be, and stop their approach.

    When two people stand so near that the radar sees one echo between them, one track takes it and the other coasts; without separation
    the coasting one would run through the other. Of a pair, the track with the larger position variance moves more.

    Parameters
    ----------
    belief : Belief
        All tracks.
    kinematics : tuple of ndarray, shapes (n_tracks, 2 d), (n_tracks, 2 d, 2 d)
        Position and velocity of the same, and their covariance.
    solid : ndarray of bool, shape (n_tracks,)
        Tracks that are people.
    width : float
        Least distance of two people's centres on the floor plane [m].
    dimensions : int
        d.

    Returns
    -------
    Belief
        The same object where nobody is too near.
    """
    rows = np.flatnonzero(solid)
    if len(rows) < 2 or width <= 0:
        return belief
    state, covariance = kinematics
    centre = state[rows, :2]
    step = centre[None] - centre[:, None]
    distance = np.hypot(step[..., 0], step[..., 1])
    near = (distance < width) & (distance > _SAME)
    if not near.any():
        return belief
    pairs = np.argwhere(np.triu(near, 1))
    spread = np.trace(covariance[rows, :2, :2], axis1=1, axis2=2)
    mean = belief.mean.copy()
    for i, j in pairs:
        line = step[i, j] / distance[i, j]
        share = spread[[i, j]] / spread[[i, j]].sum()
        push = (width - distance[i, j]) * line
        velocity = state[rows[[i, j]], dimensions : dimensions + 2]
        closing = max(float((velocity[0] - velocity[1]) @ line), 0.0) * line
        _push(mean, rows[[i, j]], share, push, closing, dimensions)
    return Belief(mean, belief.covariance, belief.weight)


def _push(mean: Float64Array, pair: IndexArray, share: Float64Array, push: Float64Array, closing: Float64Array, d: int) -> None:
    """Move two tracks apart and take out their closing speed, each by its share."""
    for row, sign, part in zip(pair, (-1.0, 1.0), share, strict=True):
        mean[row, :, :2] += sign * part * push
        mean[row, :, d : d + 2] += sign * part * closing
