"""Gaussian filters on one motion model: linearised (KF, EKF) and by sigma points (UKF). They hold no state."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from radar_core.linalg import SingularError, symmetrise
from radar_tracking.estimators import kernels
from radar_tracking.estimators.kinematics import Motion
from radar_tracking.estimators.sensing import Sensed, Sensing

Float64Array = NDArray[np.float64]

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

    def update(self, mean: Float64Array, covariance: Float64Array, sensed: Sensed) -> Updated:
        """Take in one measurement of every track."""
        ...


class LinearisedFilter:
    """Kalman filter with derivatives (EKF); on linear models it is the Kalman filter itself (6.1, 6.2), in Joseph form.

    Parameters
    ----------
    motion : Motion
        Kinematic model.
    sensing : Sensing
        What is measured.
    """

    def __init__(self, motion: Motion, sensing: Sensing) -> None:
        self.motion = motion
        self.sensing = sensing

    def predict(self, mean: Float64Array, covariance: Float64Array, dt: float) -> tuple[Float64Array, Float64Array]:
        """Move on by ``dt`` [s]; shapes (n_tracks, n_states), (n_tracks, n_states, n_states)."""
        motion = self.motion
        return motion.move(mean, dt), kernels.predict(covariance, motion.jacobian(mean, dt), motion.noise(mean, dt))

    def update(self, mean: Float64Array, covariance: Float64Array, sensed: Sensed) -> Updated:
        """Take in one measurement of every track.

        Raises
        ------
        DataError, SingularError
            When something is not finite, or an innovation's covariance is singular.
        """
        expected = self.sensing.expect(sensed, mean[:, None, :])
        residual = self.sensing.difference(sensed, sensed.value[:, None, :], expected)[:, 0]
        found = kernels.correct(mean, covariance, residual, self.sensing.jacobian(sensed, mean), sensed.noise, sensed.used)
        likelihood = log_likelihood(found.nis, found.log_det, sensed)
        return Updated(found.mean, found.covariance, found.nis, likelihood, np.where(sensed.used, residual, 0.0), found.spread)


class SigmaPointFilter:
    """Unscented Kalman filter with scaled sigma points (Julier 2002; Wan and van der Merwe 2000).

    Both covariances are sums of outer products with weights that are not negative, the update's with the gain inside the deviations
    (what Joseph's form is for a linear filter), so that they cannot lose their definiteness.

    Parameters
    ----------
    motion : Motion
        Kinematic model.
    sensing : Sensing
        What is measured.
    spread : float
        Distance of the sigma points in units of the square root of the number of states (alpha), 0.52 to 1: below, the centre's covariance
        weight would be negative.
    """

    def __init__(self, motion: Motion, sensing: Sensing, spread: float = 0.6) -> None:
        self.motion = motion
        self.sensing = sensing
        n = motion.n_states
        self._distance = spread * math.sqrt(n)
        self._mean_weight = np.full(2 * n + 1, 0.5 / (spread**2 * n))
        self._mean_weight[0] = 1.0 - 1.0 / spread**2
        self._weight = self._mean_weight.copy()
        self._weight[0] += 3.0 - spread**2  # 1 - alpha^2 + beta, with beta = 2 for Gaussians

    def predict(self, mean: Float64Array, covariance: Float64Array, dt: float) -> tuple[Float64Array, Float64Array]:
        """Move on by ``dt`` [s]; shapes (n_tracks, n_states), (n_tracks, n_states, n_states)."""
        points = self._points(mean, covariance)
        moved = self.motion.move(points, dt)
        off = moved - moved[:, :1]
        shift = self._mean_weight @ off
        off -= shift[:, None, :]
        return moved[:, 0] + shift, symmetrise(self._outer(off, off) + self.motion.noise(mean, dt))

    def update(self, mean: Float64Array, covariance: Float64Array, sensed: Sensed) -> Updated:
        """Take in one measurement of every track.

        Raises
        ------
        DataError, SingularError
            When something is not finite, or an innovation's covariance is singular.
        """
        points = self._points(mean, covariance)
        expected = self.sensing.expect(sensed, points)
        off = np.where(sensed.used[:, None, :], self.sensing.difference(sensed, expected, expected[:, :1]), 0.0)
        shift = self._mean_weight @ off
        off -= shift[:, None, :]
        residual = self.sensing.difference(sensed, sensed.value[:, None, :], expected[:, :1] + shift[:, None, :])[:, 0]
        residual = np.where(sensed.used, residual, 0.0)
        both = sensed.used[:, :, None] & sensed.used[:, None, :]
        noise = np.where(both, sensed.noise, 0.0)
        S = symmetrise(self._outer(off, off) + noise)
        S += np.where(sensed.used, 0.0, 1.0)[:, :, None] * np.eye(S.shape[-1])
        nis, log_det = kernels.surprise(residual, S)
        deviation = points - mean[:, None, :]
        cross = self._outer(off, deviation)
        scale = 1.0 / np.sqrt(np.diagonal(S, axis1=-2, axis2=-1))[:, :, None]
        gain = scale * np.linalg.solve(S * scale * np.swapaxes(scale, -1, -2), scale * cross)
        left = deviation - off @ gain
        updated = symmetrise(self._outer(left, left) + np.swapaxes(gain, -1, -2) @ noise @ gain)
        moved = mean + (residual[:, None, :] @ gain)[:, 0]
        return Updated(moved, updated, nis, log_likelihood(nis, log_det, sensed), residual, S)

    def _points(self, mean: Float64Array, covariance: Float64Array) -> Float64Array:
        """Sigma points, shape (n_tracks, 2 n_states + 1, n_states), the mean first."""
        try:
            root = self._distance * np.swapaxes(np.linalg.cholesky(covariance), -1, -2)
        except np.linalg.LinAlgError:
            raise SingularError("a track's covariance is not positive definite; start tracks with positive variances") from None
        centre = mean[:, None, :]
        return np.concatenate([centre, centre + root, centre - root], axis=1)

    def _outer(self, left: Float64Array, right: Float64Array) -> Float64Array:
        """Weighted sums of outer products over the sigma points."""
        return np.asarray(np.swapaxes(left, -1, -2) @ (self._weight[:, None] * right))


def log_likelihood(nis: Float64Array, log_det: Float64Array, sensed: Sensed) -> Float64Array:
    """Log densities of measurements given their predictions, shape (n_tracks,), per square or cubic metre (and m/s where rates count)."""
    return np.asarray(-0.5 * (nis + log_det + sensed.used.sum(axis=1) * _LOG_2PI) + sensed.log_volume)
