"""Polar measurements with the range rate, for the extended and the unscented Kalman filter."""

from __future__ import annotations

import numpy as np

from radar_core.types import Float64Array
from radar_tracking.estimators.base import Measurement
from radar_tracking.estimators.measurement_models import (
    PositionModel,
    PreparedMeasurement,
    check_measurement,
    near_sensor,
    range_rate,
    range_rate_jacobian,
    wrap,
)

_CLOSEST = 1e-6  # m: directions from nearer than this are those at this distance
_LEAST = 1e-6  # m: a smaller offset from the sensor counts as this


class PolarModel(PositionModel):
    """Range, azimuth and, in 3-D, elevation, and the range rate where it was measured.

    Where a track, by its prediction or its measurement, is within three standard deviations of the sensor (in 3-D: of the vertical through
    it), polar coordinates are no Gaussian of anything: there the position is used as it is, without the range rate.
    """

    def prepare(self, measurement: Measurement, mean: Float64Array, covariance: Float64Array) -> PreparedMeasurement:
        """Convert position and covariance to polar ones about the sensor, to first order."""
        n, d = check_measurement(measurement, self.dimensions, len(mean))
        offset = measurement.position - measurement.origin
        near = near_sensor(measurement, mean, covariance)
        J = polar_jacobian(offset)
        J[near] = np.eye(d)
        value, noise = np.zeros((n, d + 1)), np.zeros((n, d + 1, d + 1))
        value[:, :d] = np.where(near[:, None], measurement.position, to_polar(offset))
        noise[:, :d, :d] = J @ measurement.covariance @ np.swapaxes(J, -1, -2)
        used = np.ones((n, d + 1), np.bool_)
        used[:, d] = ~near & ~np.isnan(measurement.rate)
        value[:, d] = np.where(used[:, d], measurement.rate, 0.0)
        noise[:, d, d] = np.where(used[:, d], measurement.rate_variance, 1.0)
        return PreparedMeasurement(value, noise, used, measurement.origin, near, np.where(near, 0.0, _log_density(offset)))

    def predict(self, prepared: PreparedMeasurement, states: Float64Array) -> Float64Array:
        """Polar coordinates and range rates of states."""
        d = self.dimensions
        offset = states[..., :d] - prepared.origin[:, None, :]
        expected = np.empty((*states.shape[:-1], d + 1))
        expected[..., :d] = np.where(prepared.near[:, None, None], states[..., :d], to_polar(offset))
        expected[..., d] = range_rate(offset, states[..., d : 2 * d])
        return expected

    def jacobian(self, prepared: PreparedMeasurement, mean: Float64Array) -> Float64Array:
        """Differentiate polar coordinates and the range rate."""
        d = self.dimensions
        offset = mean[:, :d] - prepared.origin
        H = np.zeros((len(mean), d + 1, mean.shape[-1]))
        H[:, :d, :d] = np.where(prepared.near[:, None, None], np.eye(d), polar_jacobian(offset))
        H[:, d, : 2 * d] = range_rate_jacobian(offset, mean[:, d : 2 * d])
        return H

    def difference(self, prepared: PreparedMeasurement, measured: Float64Array, predicted: Float64Array) -> Float64Array:
        """Subtract, the azimuth the short way round."""
        difference = measured - predicted
        difference[..., 1] = np.where(prepared.near[:, None], difference[..., 1], wrap(difference[..., 1]))
        return difference


def to_polar(offset: Float64Array) -> Float64Array:
    """Express positions relative to a sensor, shape (..., d) [m], as (range, azimuth[, elevation]), shape (..., d) [m, rad]."""
    flat = np.hypot(offset[..., 0], offset[..., 1])
    azimuth = np.arctan2(offset[..., 1], offset[..., 0])
    if offset.shape[-1] == 2:
        return np.stack([flat, azimuth], axis=-1)
    return np.stack([np.hypot(flat, offset[..., 2]), azimuth, np.arctan2(offset[..., 2], flat)], axis=-1)


def polar_jacobian(offset: Float64Array) -> Float64Array:
    """Differentiate `to_polar`, shape (..., d, d), rows (range, azimuth[, elevation]).

    At the sensor itself directions have no derivative: within a micrometre it is that at one micrometre, so that covariances made with it
    are finite and huge.
    """
    d = offset.shape[-1]
    near = np.hypot(offset[..., 0], offset[..., 1]) < _CLOSEST
    x, y = np.where(near, _CLOSEST, offset[..., 0]), np.where(near, 0.0, offset[..., 1])
    flat = np.hypot(x, y)
    J = np.zeros((*offset.shape, d))
    J[..., 1, 0], J[..., 1, 1] = -y / flat**2, x / flat**2
    if d == 2:
        J[..., 0, 0], J[..., 0, 1] = x / flat, y / flat
        return J
    z = offset[..., 2]
    r = np.hypot(flat, z)
    J[..., 0, 0], J[..., 0, 1], J[..., 0, 2] = x / r, y / r, z / r
    J[..., 2, 0], J[..., 2, 1], J[..., 2, 2] = -x * z / (r**2 * flat), -y * z / (r**2 * flat), flat / r**2
    return J


def _log_density(offset: Float64Array) -> Float64Array:
    """Logarithm of the determinant of the polar coordinates' derivative: 1 / r, in 3-D 1 / (range r), r on the floor plane."""
    flat = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), _LEAST)
    if offset.shape[1] == 2:
        return np.asarray(-np.log(flat))
    return np.asarray(-np.log(flat) - np.log(np.hypot(flat, offset[:, 2])))
