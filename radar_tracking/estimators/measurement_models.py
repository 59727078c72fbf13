"""Measurement models: the components of a measurement and their prediction from states. Positions, and positions with velocities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radar_core import DataError
from radar_core.types import BoolArray, Float64Array
from radar_tracking.estimators.base import Measurement, VelocityMeasurement

_NEAR = 3.0  # standard deviations: targets this near to the sensor have no usable direction
_LEAST = 1e-6  # m: a smaller offset from the sensor counts as this
_CLOSEST = 1e-6  # m: directions from nearer than this are those at this distance


@dataclass(frozen=True, eq=False)
class PreparedMeasurement:
    """A measurement of every track in the components of a measurement model.

    Attributes
    ----------
    value : ndarray of float64, shape (n_tracks, m)
        Measured components.
    noise : ndarray of float64, shape (n_tracks, m, m)
        Covariances; finite everywhere.
    used : ndarray of bool, shape (n_tracks, m)
        Components that were measured and may be used.
    origin : ndarray of float64, shape (n_tracks, d)
        Where the sensor stands [m].
    near : ndarray of bool, shape (n_tracks,)
        Tracks so near to the sensor that the polar components are replaced by the position.
    log_volume : ndarray of float64, shape (n_tracks,)
        What turns the log density of the components into that per cubic (square) metre, so that all estimators are comparable.
    axes : ndarray of float64, shape (n_tracks, d, d), or None
        Rows along which the velocity was measured; None: it was not.
    """

    value: Float64Array
    noise: Float64Array
    used: BoolArray
    origin: Float64Array
    near: BoolArray
    log_volume: Float64Array
    axes: Float64Array | None = None


class PositionModel:
    """Positions only (6.4), converted before: linear.

    It is the base of all models, which say how states become measured components, in 2 or 3 ``dimensions``.
    """

    def __init__(self, dimensions: int) -> None:
        self.dimensions = dimensions

    def prepare(self, measurement: Measurement, mean: Float64Array, covariance: Float64Array) -> PreparedMeasurement:
        """Select the components of a measurement; here the position, without the range rate.

        Predicted states have shapes (n_tracks, n_modes, n_states) and (n_tracks, n_modes, n_states, n_states).
        """
        n, d = check_measurement(measurement, self.dimensions, len(mean))
        no, all_used = np.zeros(n, np.bool_), np.ones((n, d), np.bool_)
        return PreparedMeasurement(measurement.position, measurement.covariance, all_used, measurement.origin, no, np.zeros(n))

    def predict(self, prepared: PreparedMeasurement, states: Float64Array) -> Float64Array:
        """Components predicted for states, shape (n_tracks, k, n_states): shape (n_tracks, k, m); here positions."""
        return states[..., : self.dimensions]

    def jacobian(self, prepared: PreparedMeasurement, mean: Float64Array) -> Float64Array:
        """Differentiate `predict` at one state per track, shape (n_tracks, n_states): shape (n_tracks or 1, m, n_states) (6.2)."""
        return np.eye(self.dimensions, mean.shape[-1])[None]

    def difference(self, prepared: PreparedMeasurement, measured: Float64Array, predicted: Float64Array) -> Float64Array:
        """Subtract components, angles the short way round; shape (n_tracks, k, m)."""
        return measured - predicted


class VelocityModel(PositionModel):
    """Positions with velocities, for MMVelEst (7.3.1): the measured components decide which of its two filters works.

    Components: position, velocity, range rate. The velocity counts along the axes for which the measurement, a `VelocityMeasurement`, has
    one; where it has none at all but a range rate, that is the velocity's one known component (one row of equation 7.4).
    """

    def prepare(self, measurement: Measurement, mean: Float64Array, covariance: Float64Array) -> PreparedMeasurement:
        """Choose the components of every track."""
        n, d = check_measurement(measurement, self.dimensions, len(mean))
        m = 2 * d + 1
        value, noise, used = np.zeros((n, m)), np.zeros((n, m, m)), np.zeros((n, m), np.bool_)
        noise[:, range(d, m), range(d, m)] = 1.0
        value[:, :d], noise[:, :d, :d], used[:, :d] = measurement.position, measurement.covariance, True
        told: BoolArray = np.zeros((n, d), np.bool_)
        axes = None
        if isinstance(measurement, VelocityMeasurement):
            told, axes = ~np.isnan(measurement.velocity), measurement.velocity_axes
            used[:, d : 2 * d] = told
            value[:, d : 2 * d] = np.where(told, measurement.velocity, 0.0)
            both = told[:, :, None] & told[:, None, :]
            noise[:, d : 2 * d, d : 2 * d] = np.where(both, measurement.velocity_covariance, np.eye(d))
        single = ~told.any(axis=1) & ~np.isnan(measurement.rate) & ~near_sensor(measurement, mean, covariance)
        used[:, -1] = single
        value[single, -1], noise[single, -1, -1] = measurement.rate[single], measurement.rate_variance[single]
        return PreparedMeasurement(value, noise, used, measurement.origin, np.zeros(n, np.bool_), np.zeros(n), axes)

    def predict(self, prepared: PreparedMeasurement, states: Float64Array) -> Float64Array:
        """Positions, velocities and range rates of states."""
        d = self.dimensions
        velocity = states[..., d : 2 * d]
        rate = range_rate(states[..., :d] - prepared.origin[:, None, :], velocity)
        if prepared.axes is not None:
            velocity = velocity @ np.swapaxes(prepared.axes, -1, -2)
        return np.concatenate([states[..., :d], velocity, rate[..., None]], axis=-1)

    def jacobian(self, prepared: PreparedMeasurement, mean: Float64Array) -> Float64Array:
        """Pick positions and velocities, and differentiate the range rate."""
        d = self.dimensions
        H = np.zeros((len(mean), 2 * d + 1, mean.shape[-1]))
        H[:, range(2 * d), range(2 * d)] = 1.0
        if prepared.axes is not None:
            H[:, d : 2 * d, d : 2 * d] = prepared.axes
        H[:, -1, : 2 * d] = range_rate_jacobian(mean[:, :d] - prepared.origin, mean[:, d : 2 * d])
        return H


def check_measurement(measurement: Measurement, dimensions: int, n_tracks: int | None = None) -> tuple[int, int]:
    """Return the number of tracks and dimensions; `DataError` where they are not those of belief and estimator, or not all is finite."""
    n, d = measurement.position.shape
    wanted = n if n_tracks is None else n_tracks
    if d != dimensions or n != wanted:
        raise DataError(f"measurement has shape {(n, d)}, expected {(wanted, dimensions)}: one row per track, one column per dimension")
    for name, shape in (("covariance", (n, d, d)), ("origin", (n, d)), ("rate", (n,)), ("rate_variance", (n,))):
        if getattr(measurement, name).shape != shape:
            raise DataError(f"Measurement.{name} has shape {getattr(measurement, name).shape}, expected {shape}")
    if not (np.isfinite(measurement.position).all() and np.isfinite(measurement.covariance).all()):
        raise DataError("a measured position or its covariance is not finite; only a range rate may be NaN (not measured)")
    return n, d


def near_sensor(measurement: Measurement, mean: Float64Array, covariance: Float64Array) -> BoolArray:
    """Tracks that any mode's prediction, or the measurement, places too near to the sensor for polar coordinates; all modes alike."""
    d = measurement.position.shape[1]
    flat = mean[:, :, :2] - measurement.origin[:, None, :2]
    offset = measurement.position[:, :2] - measurement.origin[:, :2]
    variance = np.trace(covariance[:, :, :d, :d], axis1=-2, axis2=-1).max(axis=1) + np.trace(measurement.covariance, axis1=-2, axis2=-1)
    least = np.minimum((flat**2).sum(axis=-1).min(axis=1), (offset**2).sum(axis=-1))
    return np.asarray(least < np.maximum(_NEAR**2 * variance / d, _LEAST**2))


def range_rate(offset: Float64Array, velocity: Float64Array) -> Float64Array:
    """Range rates, receding positive, shape (...) [m/s], of ``offset`` and ``velocity``, shapes (..., d); zero at the sensor itself."""
    r = np.sqrt((offset**2).sum(axis=-1))
    return np.asarray((offset * velocity).sum(axis=-1) / np.maximum(r, _CLOSEST))


def range_rate_jacobian(offset: Float64Array, velocity: Float64Array) -> Float64Array:
    """Differentiate `range_rate` by (position, velocity), shape (..., 2 d)."""
    r = np.maximum(np.sqrt((offset**2).sum(axis=-1)), _CLOSEST)[..., None]
    direction = offset / r
    across = velocity - direction * (direction * velocity).sum(axis=-1)[..., None]
    return np.concatenate([across / r, direction], axis=-1)


def wrap(angle: Float64Array) -> Float64Array:
    """Angles in -pi..pi, any shape [rad]."""
    return np.asarray(np.mod(angle + np.pi, 2 * np.pi) - np.pi)
