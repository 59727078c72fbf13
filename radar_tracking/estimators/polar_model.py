"""Polar measurements with the range rate, for the extended and the unscented Kalman filter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radar_tracking.estimators.base import Measurement
from radar_tracking.estimators.convert import polar_jacobian, range_rate, range_rate_jacobian, to_polar, wrap
from radar_tracking.estimators.measurement_models import PositionModel, PreparedMeasurement, check_measurement, near_sensor

Float64Array = NDArray[np.float64]

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


def _log_density(offset: Float64Array) -> Float64Array:
    """Logarithm of the determinant of the polar coordinates' derivative: 1 / r, in 3-D 1 / (range r), r on the floor plane."""
    flat = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), _LEAST)
    if offset.shape[1] == 2:
        return np.asarray(-np.log(flat))
    return np.asarray(-np.log(flat) - np.log(np.hypot(flat, offset[:, 2])))
