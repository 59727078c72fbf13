"""Constant-velocity Kalman filter on converted position measurements (thesis, 6.2.1), for one state or a stack of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radar_core.linalg import solve_spd, symmetrise

Float64Array = NDArray[np.float64]


def predict(mean: Float64Array, covariance: Float64Array, dt: float, noise: float | Float64Array) -> tuple[Float64Array, Float64Array]:
    """Move states on by ``dt`` (6.1) with white acceleration of a spectral density, so that nothing depends on the frame rate.

    Parameters
    ----------
    mean : ndarray of float64, shape (..., 6)
        (x, y, z, vx, vy, vz) [m, m/s].
    covariance : ndarray of float64, shape (..., 6, 6)
        Of the same.
    dt : float
        Not negative [s].
    noise : float or ndarray of float64, shape (3,)
        Spectral density of the acceleration, of every axis or of each [m^2/s^3].

    Returns
    -------
    mean, covariance : ndarray of float64, shapes (..., 6), (..., 6, 6)
        Predicted.
    """
    F = np.eye(6)
    F[[0, 1, 2], [3, 4, 5]] = dt
    Q = np.zeros((6, 6))
    for i, density in enumerate(np.broadcast_to(noise, 3)):
        Q[i, i], Q[i + 3, i + 3] = density * dt**3 / 3, density * dt
        Q[i, i + 3] = Q[i + 3, i] = density * dt**2 / 2
    return mean @ F.T, symmetrise(F @ covariance @ F.T + Q)


def update(
    mean: Float64Array, covariance: Float64Array, position: Float64Array, position_covariance: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Take in position measurements (6.2); Joseph form, and a solve where textbooks invert.

    Parameters
    ----------
    mean : ndarray of float64, shape (..., 6)
        Predicted states.
    covariance : ndarray of float64, shape (..., 6, 6)
        Of the same.
    position : ndarray of float64, shape (..., 3)
        Measured (x, y, z) [m].
    position_covariance : ndarray of float64, shape (..., 3, 3)
        Of the measurement [m^2]; positive definite.

    Returns
    -------
    mean, covariance : ndarray of float64, shapes (..., 6), (..., 6, 6)
        Updated; the covariance is symmetric and positive definite.

    Raises
    ------
    SingularError
        When the innovation's covariance is singular.
    """
    S = symmetrise(covariance[..., :3, :3] + position_covariance)
    gain = np.swapaxes(solve_spd(S, covariance[..., :3, :]), -1, -2)
    innovation = position - mean[..., :3]
    mean = mean + (gain @ innovation[..., None])[..., 0]
    keep = np.broadcast_to(np.eye(6), covariance.shape).copy()
    keep[..., :, :3] -= gain
    joseph = keep @ covariance @ np.swapaxes(keep, -1, -2) + gain @ position_covariance @ np.swapaxes(gain, -1, -2)
    return mean, symmetrise(joseph)


def mahalanobis2(mean: Float64Array, covariance: Float64Array, points: Float64Array, point_covariance: Float64Array) -> Float64Array:
    """Squared Mahalanobis distances of points from predicted positions, in as many dimensions as the points have.

    Parameters
    ----------
    mean : ndarray of float64, shape (n_tracks, d)
        Predicted positions [m].
    covariance : ndarray of float64, shape (n_tracks, d, d)
        Of the same [m^2].
    points : ndarray of float64, shape (n_points, d)
        Measured positions [m].
    point_covariance : ndarray of float64, shape (d, d)
        Of every point about its track: measurement and the body's size [m^2].

    Returns
    -------
    ndarray of float64, shape (n_tracks, n_points)
        Squared distances.
    """
    difference = points[None, :, :] - mean[:, None, :]
    solved = np.swapaxes(solve_spd(covariance + point_covariance, np.swapaxes(difference, -1, -2)), -1, -2)
    return np.asarray((difference * solved).sum(axis=-1))
