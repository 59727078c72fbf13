"""Points that may be a person's hand, and which of them are: by two clusters to find the hand, by a gate to follow it."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from radar_core.linalg import symmetrise
from radar_core.types import BoolArray, Float32Array, Float64Array, IndexArray
from radar_tracking.assignment import mahalanobis
from radar_tracking.clustering.lloyd import kmeans
from radar_tracking.hand.config import HandConfig, SplitConfig
from radar_tracking.people.points import sensors_of
from radar_tracking.tracks import TrackedCloud

_MAX_POINTS = 500  # a hand has a handful of points; more than this of one person only cost time
_SHOULDER = 0.2  # m: above the middle of what is seen of the body
_LEAST = 1e-6  # m: a point at the very place of its sensor has no line of sight
_FASTEST = 100.0  # m/s: what is faster is no measurement of a hand
_HIGHEST = 5.0  # m: what is farther above or below the middle of the body is no hand of it
_FAST = 5.0  # m/s: faster counts no more


@dataclass(frozen=True, eq=False)
class Candidates:
    """Points that may be the hand; every array has one entry (row) per point.

    Attributes
    ----------
    position : ndarray of float64, shape (n, 3)
        In ``room`` [m]; z may be NaN.
    direction : ndarray of float64, shape (n, 3)
        Unit vectors from the sensor that saw each to the point; horizontal where z is NaN.
    sensor : ndarray of int64, shape (n,)
        Which sensor saw it: an index into the sources of the cloud.
    rate, rate_std : ndarray of float64, shape (n,)
        Range rate, receding positive, and its error [m/s]; NaN: not measured.
    amplitude : ndarray of float64, shape (n,)
        Relative to the median of the points, within 10 dB of it.
    error : ndarray of float64, shape (n, 3)
        Standard deviations along the line of sight, across it on the floor plane, and up [m].
    axis : ndarray of float64, shape (n,)
        Horizontal distance from the body's axis [m].
    ahead : ndarray of float64, shape (n,)
        How much nearer to its sensor than the body's axis, on the floor plane [m].
    owned : ndarray of bool, shape (n,)
        Whether the point is the person's; otherwise nobody's.
    """

    position: Float64Array
    direction: Float64Array
    sensor: IndexArray
    rate: Float64Array
    rate_std: Float64Array
    amplitude: Float64Array
    error: Float64Array
    axis: Float64Array
    ahead: Float64Array
    owned: BoolArray

    def __len__(self) -> int:
        return len(self.axis)

    def select(self, index: NDArray[np.generic]) -> Candidates:
        """Keep the points that a mask or an index array picks."""
        return Candidates(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    @property
    def speed(self) -> Float64Array:
        """Magnitude of the range rate, shape (n,) [m/s]; infinite where none was measured, because only slow points count as body."""
        return np.where(np.isnan(self.rate), np.inf, np.abs(self.rate))


def candidates(tracked: TrackedCloud, parent: int, body: Float64Array, origin: Float64Array, config: HandConfig) -> Candidates:
    """Pick the points that may be the hand: the own ones of the person with the track ``parent``, and nobody's, within reach.

    ``body``, shape (3,) [m], is where the person is, ``origin``, shape (3,) [m], where the sensor stands, for clouds that do not say it.
    """
    cloud, owner = tracked.cloud, tracked.tracks.point_track_id
    position = cloud.position.astype(np.float64)
    axis = np.hypot(position[:, 0] - body[0], position[:, 1] - body[1])
    usable = ((owner == parent) | (owner == -1)) & (axis <= config.split.reach)  # NaN compares False
    usable &= ~(np.abs(cloud.z - body[2]) > _HIGHEST)  # NaN stays: not measured
    index = np.flatnonzero(usable)[:_MAX_POINTS]
    position, owned = position[index], owner[index] == parent
    origins, sensor = sensors_of(cloud, origin)
    sensor = sensor[index]
    away = np.nan_to_num(position) - origins[sensor]
    away[np.isnan(position[:, 2]), 2] = 0.0
    far = np.maximum(np.linalg.norm(away, axis=1), _LEAST)
    distance = _known(cloud.range[index], far)
    ahead = np.linalg.norm(body[:2] - origins[:, :2], axis=1)[sensor] - np.hypot(away[:, 0], away[:, 1])
    rate = cloud.radial_speed[index].astype(np.float64)
    rate[~(np.abs(rate) <= _FASTEST)] = np.nan
    angles = (np.clip(_known(std[index], config.angle_std), 0.0, 1.0) for std in (cloud.azimuth_std, cloud.elevation_std))
    error = np.stack([_known(cloud.range_std[index], 0.0), *angles])
    error[1:] *= distance
    return Candidates(
        position, away / far[:, None], sensor, rate, np.clip(_known(cloud.radial_speed_std[index], config.rate_std), 1e-3, 10.0),
        _amplitude(cloud.snr[index].astype(np.float64)), error.T, axis[index], ahead, owned,
    )  # fmt: skip


def outward(position: Float64Array, body: Float64Array, hand: Float64Array) -> Float64Array:
    """How far out along the arm points, shape (n, 3) [m], are, shape (n,) [m], counted from the shoulder.

    Points without z are taken to be as high as the hand; the shoulder is above the middle of the body, shape (3,) both [m].
    """
    shoulder = body + np.array([0.0, 0.0, _SHOULDER])
    arm = hand - shoulder
    away = np.where(np.isnan(position), hand, position) - shoulder
    return np.asarray(away @ arm / max(float(np.linalg.norm(arm)), 1e-3))


def _known(value: Float32Array, other: Float64Array | float) -> Float64Array:
    """Values that are finite, and ``other`` for the rest."""
    return np.asarray(np.where(np.isfinite(value), value, other), np.float64)


def _amplitude(snr: Float64Array) -> Float64Array:
    known = np.isfinite(snr)
    level = float(np.median(snr[known])) if known.any() else 0.0
    return np.asarray(10 ** (np.clip(np.where(known, snr, level) - level, -10.0, 10.0) / 20))


def is_body(points: Candidates, config: SplitConfig) -> BoolArray:
    """Slow points near the body's axis or behind it; they keep the hand track from moving into the body."""
    inside = (points.axis < config.body_radius) | (points.ahead < config.torso_depth)
    return np.asarray(inside & (points.speed < config.body_speed))


def split(points: Candidates, body: Float64Array, config: SplitConfig) -> BoolArray:
    """Split a person's points by 2-means of position and radial speed (7.3): mask of the hand, shape (n,).

    The first cluster starts at ``body``, shape (3,) [m], the second at the point that is farthest out, nearest to its radar and fastest
    together. No point is the hand when the second cluster has too few that are no body.
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
    """Pick the points near the predicted hand that are no body, shape (n,); those without z are compared on the floor plane.

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
