"""Gating: distances of points from tracks, the gate, and how much each point looks like a torso, for all pairs at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radar_core.types import BoolArray, Float64Array
from radar_tracking.people.config import AssociationConfig
from radar_tracking.people.points import Points
from radar_tracking.people.track_table import TrackTable

_SHOULDER = 0.1  # m: heights are sure to this
_FAR_BELOW = 1.0  # m: ten times as sure
_LEAST = 1e-3  # weight of a point that is no torso for sure
_BEHIND = 0.1  # m: points farther behind the torso than that count less and less, too
_SHORT = 1e-9  # m: a track at the very place of the sensor has no line of sight


@dataclass(frozen=True, eq=False)
class Gating:
    """Tracks against points; every matrix has shape (n_tracks, n_points).

    Attributes
    ----------
    centre : ndarray of float64, shape (n_tracks, 2)
        Predicted centres on the floor plane [m].
    covariance : ndarray of float64, shape (n_tracks, 2, 2)
        Of the centres, plus the bodies' dispersion [m^2].
    plane : ndarray of float64
        Distance on the floor plane from the track's visible surface to the point [m].
    distance : ndarray of float64
        What the gate measures: `plane`, or standard deviations; infinite outside the gate.
    near : ndarray of float64
        How much the point counts as body by its place, 0..1.
    torso : ndarray of float64
        How much it counts as torso by its range and range rate, 0..1: arms reach towards the radar and move faster than the body.
    beyond : ndarray of float64
        Distance of the point from its sensor minus that of the track's centre [m].
    behind : ndarray of bool
        Whether the point lies too far behind the torso to be of the same body.
    doppler_residual : ndarray of float64
        Range rate of the point minus that of the track's velocity [m/s]; NaN: not measured.
    """

    centre: Float64Array
    covariance: Float64Array
    plane: Float64Array
    distance: Float64Array
    near: Float64Array
    torso: Float64Array
    beyond: Float64Array
    behind: BoolArray
    doppler_residual: Float64Array


def gate_points(table: TrackTable, kinematics: tuple[Float64Array, Float64Array], points: Points, config: AssociationConfig) -> Gating:
    """Compare all tracks with all points of a cloud.

    ``kinematics`` are predicted position and velocity, shape (n_tracks, 6), and their covariance, shape (n_tracks, 6, 6).
    """
    mean, covariance = kinematics
    centre = mean[:, :2]
    away = centre[:, None, :] - points.origins[None, :, :2]  # (track, sensor, xy)
    far = np.maximum(np.hypot(away[..., 0], away[..., 1]), _SHORT)
    line = away / far[..., None]
    rate = (line * mean[:, None, 3:5]).sum(-1)
    seen = centre[:, None, :] + table.surface[:, None, None] * line
    if len(points.origins) > 1:  # of each point's own sensor
        far, rate, seen = far[:, points.sensor], rate[:, points.sensor], seen[:, points.sensor]
    step_x, step_y = points.position[:, 0] - seen[..., 0], points.position[:, 1] - seen[..., 1]
    square = step_x * step_x + step_y * step_y
    plane = np.sqrt(square)
    inside = plane <= config.gate
    body = covariance[:, :2, :2] + table.dispersion
    distance = plane
    if config.method == "mahalanobis":
        from radar_tracking.assignment import mahalanobis

        distance = mahalanobis(centre, body, points.plane)
        inside &= distance <= config.gate_sigmas
    distance = np.where(inside, distance, np.inf)
    near = np.exp(np.maximum(-0.5 * square / config.body_radius**2, -12.5))
    beyond, residual = points.distance - far, points.speed - rate
    reference = torso_reference(table.surface, beyond, inside, points, config)
    weight = torso_weight(table, beyond - reference, residual, config) * below(points, config)
    return Gating(centre, body, plane, distance, near, weight, beyond, beyond > reference + config.body_depth, residual)


def below(points: Points, config: AssociationConfig) -> Float64Array:
    """How much each point counts as torso by its height, shape (n_points,): what is above the shoulders is a raised arm, or a head."""
    above = points.position[:, 2] - config.arm_height
    if not (above > -_FAR_BELOW).any():
        return np.ones(len(points))
    above = np.nan_to_num(above, nan=-np.inf)
    return np.asarray(_LEAST + (1.0 - _LEAST) / (1.0 + np.exp(np.clip(2.0 * above / _SHOULDER, -50.0, 50.0))))


def torso_reference(
    surface: Float64Array, beyond: Float64Array, inside: BoolArray, points: Points, config: AssociationConfig
) -> Float64Array:
    """Offset of each track's torso from its centre along the line of sight, shape (n_tracks, 1) [m].

    The torso is where it was, or at the farthest point that may be torso: a little behind, or up to an arm's length behind if that echo is
    nearly as strong as the track's strongest one (for its range). Points far behind and weak are a reflection, or somebody else.
    """
    beyond_surface = beyond - surface[:, None]
    square = points.distance * points.distance
    echo = np.where(np.isfinite(points.power), points.power, 1.0) * square * square
    strongest = np.where(inside & (beyond_surface < config.torso_depth), echo, 0.0).max(axis=1, initial=0.0, keepdims=True)
    strong = (beyond_surface < config.arm_length) & (echo >= config.torso_echo * strongest)
    possible = inside & ((beyond_surface < config.torso_depth) | strong)
    farthest = np.where(possible, beyond, -np.inf).max(axis=1, initial=-np.inf, keepdims=True)
    return np.asarray(np.maximum(surface[:, None], farthest))


def torso_weight(table: TrackTable, before: Float64Array, residual: Float64Array, config: AssociationConfig) -> Float64Array:
    """How much each point counts as torso, shape (n_tracks, n_points), 0..1; ``before`` [m] is negative before the torso."""
    behind = np.clip(before - config.torso_depth, 0.0, 5 * _BEHIND) / _BEHIND
    depth = np.clip(before, -5 * config.arm_depth, 0.0) / config.arm_depth - behind
    excess = (residual - table.doppler_residual[:, None]) / config.arm_speed
    square = np.where(np.isnan(excess), 0.0, np.minimum(excess * excess, 100.0))
    return np.asarray(np.exp(depth) / (1.0 + square))
