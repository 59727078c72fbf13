"""Kalman filters on one motion model, linear and extended, and one of them as an estimator. They hold no state."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from radar_core import DataError
from radar_core.linalg import symmetrise
from radar_core.types import Float64Array
from radar_tracking.estimators import kernels
from radar_tracking.estimators.base import Belief, Innovation, Measurement
from radar_tracking.estimators.kinematics import Motion
from radar_tracking.estimators.measurement_models import PositionModel, PreparedMeasurement, check_measurement

_LOG_2PI = math.log(2 * math.pi)


@dataclass(frozen=True, eq=False)
class Updated:
    """Result of a filter's update.

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
    """Kalman filter in Joseph form (6.1, 6.2) on one kinematic model, for measurements that are linear in the state."""

    def __init__(self, motion: Motion, measurement_model: PositionModel) -> None:
        self.motion = motion
        self.measurement_model = measurement_model

    def predict(self, mean: Float64Array, covariance: Float64Array, dt: float) -> tuple[Float64Array, Float64Array]:
        """Move on by ``dt`` [s]; shapes (n_tracks, n_states), (n_tracks, n_states, n_states)."""
        motion = self.motion
        return motion.move(mean, dt), kernels.predict(covariance, motion.jacobian(mean, dt), motion.noise(mean, dt))

    def update(self, mean: Float64Array, covariance: Float64Array, prepared: PreparedMeasurement) -> Updated:
        """Take in one measurement of every track; `DataError` where something is not finite, `SingularError` as `kernels.correct`."""
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


class SingleModel:
    """One Gaussian filter on one motion model as an `Estimator`.

    ``prior``: standard deviations, of new tracks, of the states behind position and velocity.
    """

    def __init__(self, model: GaussianFilter, measurement_model: PositionModel, prior: Sequence[float] = ()) -> None:
        self.dimensions = measurement_model.dimensions
        self._filter = model
        self._measurement_model = measurement_model
        self._prior = np.asarray(prior, np.float64)

    def start(self, measurement: Measurement, speed_std: float) -> Belief:
        """Start tracks at rest at the measured positions, with a velocity known to within ``speed_std`` [m/s]."""
        mean, covariance = start_at(measurement, self.dimensions, speed_std, self._prior)
        return Belief(mean[:, None], covariance[:, None], np.ones((len(mean), 1)))

    def predict(self, belief: Belief, dt: float) -> Belief:
        """Move all tracks on by ``dt`` [s]; `DataError` where that is negative or not finite."""
        check_step(dt)
        mean, covariance = self._filter.predict(belief.mean[:, 0], belief.covariance[:, 0], dt)
        return Belief(mean[:, None], covariance[:, None], belief.weight)

    def update(self, belief: Belief, measurement: Measurement) -> tuple[Belief, Innovation]:
        """Take in one measurement of every track; `DataError` and `SingularError` as `KalmanFilter.update`, and where shapes do not fit."""
        prepared = self._measurement_model.prepare(measurement, belief.mean, belief.covariance)
        found = self._filter.update(belief.mean[:, 0], belief.covariance[:, 0], prepared)
        return (
            Belief(found.mean[:, None], found.covariance[:, None], belief.weight),
            Innovation(found.nis, prepared.used.sum(axis=1), found.log_likelihood),
        )

    def kinematics(self, belief: Belief) -> tuple[Float64Array, Float64Array]:
        """Mean and covariance of (position, velocity), shapes (n_tracks, 2 d) and (n_tracks, 2 d, 2 d)."""
        d = 2 * self.dimensions
        return belief.mean[:, 0, :d].copy(), belief.covariance[:, 0, :d, :d].copy()


def start_at(measurement: Measurement, dimensions: int, speed_std: float, prior: Float64Array) -> tuple[Float64Array, Float64Array]:
    """States at rest at the measured positions, and their covariances."""
    n, d = check_measurement(measurement, dimensions)
    if not (math.isfinite(speed_std) and speed_std > 0):
        raise DataError(f"speed_std is {speed_std}; a new track's velocity needs a positive standard deviation [m/s]")
    size = 2 * d + len(prior)
    mean, covariance = np.zeros((n, size)), np.zeros((n, size, size))
    mean[:, :d] = measurement.position
    covariance[:, range(size), range(size)] = np.concatenate([np.zeros(d), np.full(d, speed_std), prior]) ** 2
    covariance[:, :d, :d] = symmetrise(measurement.covariance)
    return mean, covariance


def check_step(dt: float) -> None:
    """Raise `DataError` unless a time step is finite and not negative."""
    if not (math.isfinite(dt) and dt >= 0):
        raise DataError(f"cannot predict by {dt} s; time steps are finite and not negative")
