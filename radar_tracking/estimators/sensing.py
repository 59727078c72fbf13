"""What a filter compares with what was measured: positions, or polar coordinates with the range rate, or positions with velocities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_tracking.estimators.base import Measurement
from radar_tracking.estimators.convert import polar_jacobian, range_rate, range_rate_jacobian, to_polar, wrap
from radar_tracking.estimators.velocity import VelocityMeasurement

Float64Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_NEAR = 3.0  # standard deviations: targets this near to the sensor have no usable direction
_LEAST = 1e-6  # m: an offset from the sensor that is less is none


@dataclass(frozen=True, eq=False)
class Sensed:
    """A measurement of every track as a filter takes it.

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
    used: Mask
    origin: Float64Array
    near: Mask
    log_volume: Float64Array
    axes: Float64Array | None = None


class Sensing(Protocol):
    """How states become measured components."""

    dimensions: int

    def take(self, measurement: Measurement, mean: Float64Array, covariance: Float64Array) -> Sensed:
        """Prepare a measurement for predictions, shapes (n_tracks, n_modes, n_states) and (n_tracks, n_modes, n_states, n_states)."""
        ...

    def expect(self, sensed: Sensed, states: Float64Array) -> Float64Array:
        """Components expected of states, shape (n_tracks, k, n_states): shape (n_tracks, k, m)."""
        ...

    def jacobian(self, sensed: Sensed, mean: Float64Array) -> Float64Array:
        """Differentiate `expect` at one state per track, shape (n_tracks, n_states): shape (n_tracks or 1, m, n_states)."""
        ...

    def difference(self, sensed: Sensed, measured: Float64Array, expected: Float64Array) -> Float64Array:
        """Subtract components, angles the short way round; shape (n_tracks, k, m)."""
        ...


class PositionSensing:
    """Positions only (6.4), converted before: linear.

    Parameters
    ----------
    dimensions : int
        2 or 3.
    """

    def __init__(self, dimensions: int) -> None:
        self.dimensions = dimensions

    def take(self, measurement: Measurement, mean: Float64Array, covariance: Float64Array) -> Sensed:
        """Take the position; the range rate is not used."""
        n, d = check_measurement(measurement, self.dimensions, len(mean))
        no = np.zeros(n, np.bool_)
        return Sensed(measurement.position, measurement.covariance, np.ones((n, d), np.bool_), measurement.origin, no, np.zeros(n))

    def expect(self, sensed: Sensed, states: Float64Array) -> Float64Array:
        """Positions of states."""
        return states[..., : self.dimensions]

    def jacobian(self, sensed: Sensed, mean: Float64Array) -> Float64Array:
        """Pick the positions (6.2), the same for all tracks."""
        return np.eye(self.dimensions, mean.shape[-1])[None]

    def difference(self, sensed: Sensed, measured: Float64Array, expected: Float64Array) -> Float64Array:
        """Subtract positions."""
        return measured - expected


class PolarSensing:
    """Range, azimuth and, in 3-D, elevation, and the range rate where it was measured.

    Where a track, by its prediction or its measurement, is within three standard deviations of the sensor (in 3-D: of the vertical through
    it), polar coordinates are no Gaussian of anything: there the position is used as it is, without the range rate.

    Parameters
    ----------
    dimensions : int
        2 or 3.
    """

    def __init__(self, dimensions: int) -> None:
        self.dimensions = dimensions

    def take(self, measurement: Measurement, mean: Float64Array, covariance: Float64Array) -> Sensed:
        """Convert position and covariance to polar ones about the sensor, to first order."""
        n, d = check_measurement(measurement, self.dimensions, len(mean))
        offset = measurement.position - measurement.origin
        near = _near(measurement, mean, covariance)
        J = polar_jacobian(offset)
        J[near] = np.eye(d)
        value, noise = np.zeros((n, d + 1)), np.zeros((n, d + 1, d + 1))
        value[:, :d] = np.where(near[:, None], measurement.position, to_polar(offset))
        noise[:, :d, :d] = J @ measurement.covariance @ np.swapaxes(J, -1, -2)
        used = np.ones((n, d + 1), np.bool_)
        used[:, d] = ~near & ~np.isnan(measurement.rate)
        value[:, d] = np.where(used[:, d], measurement.rate, 0.0)
        noise[:, d, d] = np.where(used[:, d], measurement.rate_variance, 1.0)
        return Sensed(value, noise, used, measurement.origin, near, np.where(near, 0.0, _log_density(offset)))

    def expect(self, sensed: Sensed, states: Float64Array) -> Float64Array:
        """Polar coordinates and range rates of states."""
        d = self.dimensions
        offset = states[..., :d] - sensed.origin[:, None, :]
        expected = np.empty((*states.shape[:-1], d + 1))
        expected[..., :d] = np.where(sensed.near[:, None, None], states[..., :d], to_polar(offset))
        expected[..., d] = range_rate(offset, states[..., d : 2 * d])
        return expected

    def jacobian(self, sensed: Sensed, mean: Float64Array) -> Float64Array:
        """Differentiate polar coordinates and the range rate."""
        d = self.dimensions
        offset = mean[:, :d] - sensed.origin
        H = np.zeros((len(mean), d + 1, mean.shape[-1]))
        H[:, :d, :d] = np.where(sensed.near[:, None, None], np.eye(d), polar_jacobian(offset))
        H[:, d, : 2 * d] = range_rate_jacobian(offset, mean[:, d : 2 * d])
        return H

    def difference(self, sensed: Sensed, measured: Float64Array, expected: Float64Array) -> Float64Array:
        """Subtract, the azimuth the short way round."""
        difference = measured - expected
        difference[..., 1] = np.where(sensed.near[:, None], difference[..., 1], wrap(difference[..., 1]))
        return difference


class VelocitySensing:
    """Positions with velocities, as MMVelEst needs (7.3.1): which of its two filters works is which components were measured.

    Components: position, velocity, range rate. The velocity counts along the axes for which the measurement, a `VelocityMeasurement`, has
    one; where it has none at all but a range rate, that is the velocity's one known component (one row of equation 7.4).

    Parameters
    ----------
    dimensions : int
        2 or 3.
    """

    def __init__(self, dimensions: int) -> None:
        self.dimensions = dimensions

    def take(self, measurement: Measurement, mean: Float64Array, covariance: Float64Array) -> Sensed:
        """Choose the components of every track."""
        n, d = check_measurement(measurement, self.dimensions, len(mean))
        m = 2 * d + 1
        value, noise, used = np.zeros((n, m)), np.zeros((n, m, m)), np.zeros((n, m), np.bool_)
        noise[:, range(d, m), range(d, m)] = 1.0
        value[:, :d], noise[:, :d, :d], used[:, :d] = measurement.position, measurement.covariance, True
        told: Mask = np.zeros((n, d), np.bool_)
        axes = None
        if isinstance(measurement, VelocityMeasurement):
            told, axes = ~np.isnan(measurement.velocity), measurement.velocity_axes
            used[:, d : 2 * d] = told
            value[:, d : 2 * d] = np.where(told, measurement.velocity, 0.0)
            both = told[:, :, None] & told[:, None, :]
            noise[:, d : 2 * d, d : 2 * d] = np.where(both, measurement.velocity_covariance, np.eye(d))
        single = ~told.any(axis=1) & ~np.isnan(measurement.rate) & ~_near(measurement, mean, covariance)
        used[:, -1] = single
        value[single, -1], noise[single, -1, -1] = measurement.rate[single], measurement.rate_variance[single]
        return Sensed(value, noise, used, measurement.origin, np.zeros(n, np.bool_), np.zeros(n), axes)

    def expect(self, sensed: Sensed, states: Float64Array) -> Float64Array:
        """Positions, velocities and range rates of states."""
        d = self.dimensions
        velocity = states[..., d : 2 * d]
        rate = range_rate(states[..., :d] - sensed.origin[:, None, :], velocity)
        if sensed.axes is not None:
            velocity = velocity @ np.swapaxes(sensed.axes, -1, -2)
        return np.concatenate([states[..., :d], velocity, rate[..., None]], axis=-1)

    def jacobian(self, sensed: Sensed, mean: Float64Array) -> Float64Array:
        """Pick positions and velocities, and differentiate the range rate."""
        d = self.dimensions
        H = np.zeros((len(mean), 2 * d + 1, mean.shape[-1]))
        H[:, range(2 * d), range(2 * d)] = 1.0
        if sensed.axes is not None:
            H[:, d : 2 * d, d : 2 * d] = sensed.axes
        H[:, -1, : 2 * d] = range_rate_jacobian(mean[:, :d] - sensed.origin, mean[:, d : 2 * d])
        return H

    def difference(self, sensed: Sensed, measured: Float64Array, expected: Float64Array) -> Float64Array:
        """Subtract components."""
        return measured - expected


def check_measurement(measurement: Measurement, dimensions: int, n_tracks: int | None = None) -> tuple[int, int]:
    """Return the measurement's number of tracks and dimensions.

    Raises
    ------
    DataError
        When they are not those of the estimator and of the belief, or a position or covariance is not finite.
    """
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


def _log_density(offset: Float64Array) -> Float64Array:
    """Logarithm of the determinant of the polar coordinates' derivative: 1 / r, in 3-D 1 / (range r), r on the floor plane."""
    flat = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), _LEAST)
    if offset.shape[1] == 2:
        return np.asarray(-np.log(flat))
    return np.asarray(-np.log(flat) - np.log(np.hypot(flat, offset[:, 2])))


def _near(measurement: Measurement, mean: Float64Array, covariance: Float64Array) -> Mask:
    """Tracks that any mode's prediction, or the measurement, places too near to the sensor for polar coordinates; all modes alike."""
    d = measurement.position.shape[1]
    flat = mean[:, :, :2] - measurement.origin[:, None, :2]
    offset = measurement.position[:, :2] - measurement.origin[:, :2]
    variance = np.trace(covariance[:, :, :d, :d], axis1=-2, axis2=-1).max(axis=1) + np.trace(measurement.covariance, axis1=-2, axis2=-1)
    least = np.minimum((flat**2).sum(axis=-1).min(axis=1), (offset**2).sum(axis=-1))
    return np.asarray(least < np.maximum(_NEAR**2 * variance / d, _LEAST**2))
