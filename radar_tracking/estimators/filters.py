"""Kalman filters on one motion model, linear and extended. They hold no state."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from radar_core.types import Float64Array
from radar_tracking.estimators import kernels
from radar_tracking.estimators.kinematics import Motion
from radar_tracking.estimators.measurement_models import MeasurementModel, PreparedMeasurement

_LOG_2PI = math.log(2 * math.pi)


@dataclass(frozen=True, eq=False)
class Updated:
    """What a filter's update gives.

    Attributes
    ----------
    mean, covariance : ndarray of float64, shapes (n_tracks, n_states), (n_tracks, n_states, n_states)
        Updated.
    nis, log_likelihood : ndarray of float64, shape (n_tracks,)
        As in `Innovation`.
    residual, spread : ndarray of float64, shapes (n_tracks, m), (n_tracks, m, m)
        Innovation and its covariance; 0 and 1 where nothing was measured.
    """

    mean: Float64Array
    covariance: Float64Array
    nis: Float64Array
    log_likelihood: Float64Array
    residual: Float64Array
    spread: Float64Array


class GaussianFilter(Protocol):
    """Predicts and updates a batch of Gaussians."""

    motion: Motion

    def predict(self, mean: Float64Array, covariance: Float64Array, dt: float) -> tuple[Float64Array, Float64Array]:
        """Move on by ``dt`` [s]; shapes (n_tracks, n_states), (n_tracks, n_states, n_states)."""
        ...

    def update(self, mean: Float64Array, covariance: Float64Array, prepared: PreparedMeasurement) -> Updated:
        """Take in one measurement of every track."""
        ...


class KalmanFilter:
    """Kalman filter in Joseph form (6.1, 6.2), for measurements that are linear in the state.

    Parameters
    ----------
    motion : Motion
        Kinematic model.
    measurement_model : MeasurementModel
        What is measured.
    """

    def __init__(self, motion: Motion, measurement_model: MeasurementModel) -> None:
        self.motion = motion
        self.measurement_model = measurement_model

    def predict(self, mean: Float64Array, covariance: Float64Array, dt: float) -> tuple[Float64Array, Float64Array]:
        """Move on by ``dt`` [s]; shapes (n_tracks, n_states), (n_tracks, n_states, n_states)."""
        motion = self.motion
        return motion.move(mean, dt), kernels.predict(covariance, motion.jacobian(mean, dt), motion.noise(mean, dt))

    def update(self, mean: Float64Array, covariance: Float64Array, prepared: PreparedMeasurement) -> Updated:
        """Take in one measurement of every track.

        Raises
        ------
        DataError, SingularError
            When something is not finite, or an innovation's covariance is singular.
        """
        expected = self.measurement_model.predict(prepared, mean[:, None, :])
        residual = self.measurement_model.difference(prepared, prepared.value[:, None, :], expected)[:, 0]
        found = kernels.correct(mean, covariance, residual, self.measurement_model.jacobian(prepared, mean), prepared.noise, prepared.used)
        likelihood = log_likelihood(found.nis, found.log_det, prepared)
        return Updated(found.mean, found.covariance, found.nis, likelihood, np.where(prepared.used, residual, 0.0), found.spread)


class ExtendedKalmanFilter(KalmanFilter):
    """The same equations with the derivatives of a curved measurement model at the predicted state, to first order."""


def log_likelihood(nis: Float64Array, log_det: Float64Array, prepared: PreparedMeasurement) -> Float64Array:
    """Log densities of measurements given their predictions, shape (n_tracks,), per square or cubic metre (and m/s where rates count)."""
    return np.asarray(-0.5 * (nis + log_det + prepared.used.sum(axis=1) * _LOG_2PI) + prepared.log_volume)
