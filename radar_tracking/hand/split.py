"""Which of a person's points are the hand: the split into two clusters when it is looked for, and the gate while it is followed."""

from __future__ import annotations

import numpy as np

from radar_core.linalg import symmetrise
from radar_core.types import BoolArray, Float64Array
from radar_tracking.clustering.lloyd import kmeans
from radar_tracking.hand.candidates import Candidates, outward
from radar_tracking.hand.config import SplitConfig
from radar_tracking.mahalanobis import mahalanobis

_FAST = 5.0  # m/s: faster counts no more


def is_body(points: Candidates, config: SplitConfig) -> BoolArray:
    """Slow points near the body's axis or behind it: the guard against a hand that falls into the body."""
    inside = (points.axis < config.body_radius) | (points.ahead < config.torso_depth)
    return np.asarray(inside & (points.speed < config.body_speed))


def split(points: Candidates, body: Float64Array, config: SplitConfig) -> BoolArray:
    """Split a person's points by 2-means of position and radial speed (7.3).

    Parameters
    ----------
    points : Candidates
        Of the person.
    body : ndarray of float64, shape (3,)
        Where the person is [m]; the first cluster starts there, the second at the point that is farthest out, nearest to its radar and
        fastest together.
    config : SplitConfig
        Knobs.

    Returns
    -------
    ndarray of bool, shape (n,)
        The hand; none when the second cluster has too few points that are no body.
    """
    none = np.zeros(len(points), np.bool_)
    if not len(points):
        return none
    position, speed = points.position, config.speed_scale * np.minimum(points.speed, _FAST)
    z = np.where(np.isfinite(position[:, 2]), position[:, 2], body[2])
    feature = np.column_stack([position[:, :2], z, speed])
    seed = int((points.axis + points.ahead + speed).argmax())
    labels, _ = kmeans(feature, np.stack([np.append(body, 0.0), feature[seed]]))
    found = (labels == 1) & points.owned & ~is_body(points, config)
    return found if np.count_nonzero(found) >= config.find_points else none


def gate(
    points: Candidates, body: Float64Array, mean: Float64Array, covariance: Float64Array, extent: float, rests: bool, config: SplitConfig
) -> BoolArray:
    """Pick the points near the predicted hand that are no body; those without z are compared on the floor plane.

    Parameters
    ----------
    points : Candidates
        Of the person.
    body : ndarray of float64, shape (3,)
        Where the person is [m].
    mean, covariance : ndarray of float64, shapes (3,), (3, 3)
        Where the hand is predicted [m].
    extent : float
        How far a point may be from the hand that it belongs to, beside its own error [m].
    rests : bool
        Whether the hand rested: what is seen farther in along the arm is forearm.
    config : SplitConfig
        Knobs.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    own = np.zeros(len(points), np.bool_)
    if not len(points):
        return own
    position = points.position
    measured = np.isfinite(position[:, 2])
    spread = extent**2 + float(np.median(points.error[:, 1])) ** 2
    for mask, d in ((measured, 3), (~measured, 2)):
        if mask.any():
            apart = np.linalg.norm(position[mask, :d] - mean[:d], axis=1)
            expected = symmetrise(covariance[:d, :d]) + spread * np.eye(d)
            sigmas = mahalanobis(mean[None, :d], expected[None], position[mask, :d])[0]
            own[mask] = (apart <= config.gate) & (sigmas <= config.gate_sigmas)
    nearer = np.hypot(*(position[:, :2] - mean[:2]).T) / config.hand_radius <= points.axis / config.body_radius
    own &= nearer & ~is_body(points, config)
    if rests:
        own &= outward(position, body, mean) > float(outward(mean[None], body, mean)[0]) - config.inward
    return np.asarray(own)
