"""The unscented Kalman filter."""

from __future__ import annotations

import math

import numpy as np

from radar_core.linalg import SingularError, symmetrise
from radar_core.types import Float64Array
from radar_tracking.estimators.filters import Updated, log_likelihood
from radar_tracking.estimators.kernels import nis_and_log_det
from radar_tracking.estimators.kinematics import Motion
from radar_tracking.estimators.measurement_models import PositionModel, PreparedMeasurement


class UnscentedKalmanFilter:
    """Unscented Kalman filter with scaled sigma points (Julier 2002; Wan and van der Merwe 2000).

    Both covariances are sums of outer products with weights that are not negative, the update's with the gain inside the deviations (what
    Joseph's form is for a linear filter), so that they cannot lose their definiteness. ``spread`` (alpha), 0.52 to 1, is the distance of
    the sigma points in units of the square root of the number of states: below, the centre's covariance weight would be negative.
    """

    def __init__(self, motion: Motion, measurement_model: PositionModel, spread: float = 0.6) -> None:
        self.motion = motion
        self.measurement_model = measurement_model
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

    def update(self, mean: Float64Array, covariance: Float64Array, prepared: PreparedMeasurement) -> Updated:
        """Take in one measurement of every track; errors as of `KalmanFilter.update`."""
        points = self._points(mean, covariance)
        expected = self.measurement_model.predict(prepared, points)
        off = np.where(prepared.used[:, None, :], self.measurement_model.difference(prepared, expected, expected[:, :1]), 0.0)
        shift = self._mean_weight @ off
        off -= shift[:, None, :]
        residual = self.measurement_model.difference(prepared, prepared.value[:, None, :], expected[:, :1] + shift[:, None, :])[:, 0]
        residual = np.where(prepared.used, residual, 0.0)
        both = prepared.used[:, :, None] & prepared.used[:, None, :]
        noise = np.where(both, prepared.noise, 0.0)
        S = symmetrise(self._outer(off, off) + noise)
        S += np.where(prepared.used, 0.0, 1.0)[:, :, None] * np.eye(S.shape[-1])
        nis, log_det = nis_and_log_det(residual, S)
        deviation = points - mean[:, None, :]
        cross = self._outer(off, deviation)
        scale = 1.0 / np.sqrt(np.diagonal(S, axis1=-2, axis2=-1))[:, :, None]
        gain = scale * np.linalg.solve(S * scale * np.swapaxes(scale, -1, -2), scale * cross)
        left = deviation - off @ gain
        updated = symmetrise(self._outer(left, left) + np.swapaxes(gain, -1, -2) @ noise @ gain)
        moved = mean + (residual[:, None, :] @ gain)[:, 0]
        return Updated(moved, updated, nis, log_likelihood(nis, log_det, prepared), residual, S)

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
