"""How tracks see points: distances, the gate, and how much each point looks like a torso, for every track and point at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_tracking.assignment import mahalanobis
from radar_tracking.people.config import AssociationConfig
from radar_tracking.people.points import Points
from radar_tracking.people.track_table import Roster

Float64Array = NDArray[np.float64]
_SHOULDER = 0.1  # m: heights are sure to this
_FAR_BELOW = 1.0  # m: ten times as sure
_LEAST = 1e-3  # weight of a point that is no torso for sure
_BEHIND = 0.1  # m: what is farther behind the torso than that counts less and less, too
_SHORT = 1e-9  # m: a track at the very place of the sensor has no line of sight


@dataclass(frozen=True, eq=False)
class Sight:
    """Tracks against points; every matrix has shape (n_tracks, n_points).

    Attributes
    ----------
    centre : ndarray of float64, shape (n_tracks, 2)
        Predicted centres on the floor plane [m].
    covariance : ndarray of float64, shape (n_tracks, 2, 2)
        Of the same, with the bodies' dispersion [m^2].
    plane : ndarray of float64
        Distance on the floor plane from what is seen of the track to the point [m].
    distance : ndarray of float64
        What the gate measures: `plane`, or standard deviations; infinite outside the gate.
    near : ndarray of float64
        How much the point counts as body by its place, 0..1.
    torso : ndarray of float64
        How much it counts as torso by its range and range rate, 0..1: arms reach towards the radar and move faster than the body.
    beyond : ndarray of float64
        Distance of the point from its sensor beyond that of the track's centre [m].
    behind : ndarray of bool
        Whether the point lies too far behind the torso to be of the same body.
    slip : ndarray of float64
        Range rate of the point beyond what the track's velocity says [m/s]; NaN: not measured.
    """

    centre: Float64Array
    covariance: Float64Array
    plane: Float64Array
    distance: Float64Array
    near: Float64Array
    torso: Float64Array
    beyond: Float64Array
    behind: NDArray[np.bool_]
    slip: Float64Array


def look(roster: Roster, kinematics: tuple[Float64Array, Float64Array], points: Points, config: AssociationConfig) -> Sight:
    """Compare all tracks with all points.

    Parameters
    ----------
    roster : Roster
        The tracks.
    kinematics : tuple of ndarray, shapes (n_tracks, 6), (n_tracks, 6, 6)
        Predicted position and velocity, and their covariance.
    points : Points
        Of this cloud.
    config : AssociationConfig
        Gate and arms.
    """
    mean, covariance = kinematics
    centre = mean[:, :2]
    away = centre[:, None, :] - points.origins[None, :, :2]  # (track, sensor, xy)
    far = np.maximum(np.hypot(away[..., 0], away[..., 1]), _SHORT)
    sight = away / far[..., None]
    rate = (sight * mean[:, None, 3:5]).sum(-1)
    seen = centre[:, None, :] + roster["surface"][:, None, None] * sight
    if len(points.origins) > 1:  # of each point's own sensor
        far, rate, seen = far[:, points.sensor], rate[:, points.sensor], seen[:, points.sensor]
    step_x, step_y = points.position[:, 0] - seen[..., 0], points.position[:, 1] - seen[..., 1]
    square = step_x * step_x + step_y * step_y
    plane = np.sqrt(square)
    inside = plane <= config.gate
    body = covariance[:, :2, :2] + roster["dispersion"]
    distance = plane
    if config.method == "mahalanobis":
        distance = mahalanobis(centre, body, points.plane)
        inside &= distance <= config.gate_sigmas
    distance = np.where(inside, distance, np.inf)
    near = np.exp(np.maximum(-0.5 * square / config.body_radius**2, -12.5))
    beyond, slip = points.distance - far, points.speed - rate
    reference = torso_reference(roster["surface"], beyond, inside, points, config)
    weight = torso(roster, beyond - reference, slip, config) * below(points, config)
    return Sight(centre, body, plane, distance, near, weight, beyond, beyond > reference + config.body_depth, slip)


def below(points: Points, config: AssociationConfig) -> Float64Array:
    """How much each point counts as torso by its height, shape (n_points,): what is above the shoulders is a raised arm, or a head."""
    above = points.position[:, 2] - config.arm_height
    if not (above > -_FAR_BELOW).any():
        return np.ones(len(points))
    above = np.nan_to_num(above, nan=-np.inf)
    return np.asarray(_LEAST + (1.0 - _LEAST) / (1.0 + np.exp(np.clip(2.0 * above / _SHOULDER, -50.0, 50.0))))


def torso_reference(
    surface: Float64Array, beyond: Float64Array, inside: NDArray[np.bool_], points: Points, config: AssociationConfig
) -> Float64Array:
    """Where each track's torso is, from its centre along the line of sight, shape (n_tracks, 1) [m].

    It is where it was, or at the farthest point that may be torso: a little behind, or up to an arm's length behind if it echoes more
    strongly than anything else of the track (for its range). What is far behind and weak is a reflection, or somebody else.
    """
    beyond_surface = beyond - surface[:, None]
    square = points.distance * points.distance
    echo = np.where(np.isfinite(points.power), points.power, 1.0) * square * square
    strongest = np.where(inside & (beyond_surface < config.torso_depth), echo, 0.0).max(axis=1, initial=0.0, keepdims=True)
    strong = (beyond_surface < config.arm_length) & (echo >= config.torso_echo * strongest)
    possible = inside & ((beyond_surface < config.torso_depth) | strong)
    farthest = np.where(possible, beyond, -np.inf).max(axis=1, initial=-np.inf, keepdims=True)
    return np.asarray(np.maximum(surface[:, None], farthest))


def torso(roster: Roster, before: Float64Array, slip: Float64Array, config: AssociationConfig) -> Float64Array:
    """How much each point counts as torso, shape (n_tracks, n_points), 0..1; ``before`` [m] is negative before the torso. See `Sight`."""
    behind = np.clip(before - config.torso_depth, 0.0, 5 * _BEHIND) / _BEHIND
    depth = np.clip(before, -5 * config.arm_depth, 0.0) / config.arm_depth - behind
    excess = (slip - roster["slip"][:, None]) / config.arm_speed
    square = np.where(np.isnan(excess), 0.0, np.minimum(excess * excess, 100.0))
    return np.asarray(np.exp(depth) / (1.0 + square))
