"""Polar coordinates and range rates of positions, with their derivatives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]

_CLOSEST = 1e-6  # m: directions from nearer than this are those at this distance


def to_polar(offset: Float64Array) -> Float64Array:
    """Express positions relative to a sensor as range, azimuth and, in 3-D, elevation.

    Parameters
    ----------
    offset : ndarray of float64, shape (..., d)
        Positions less the sensor's [m].

    Returns
    -------
    ndarray of float64, shape (..., d)
        (range, azimuth[, elevation]) [m, rad].
    """
    flat = np.hypot(offset[..., 0], offset[..., 1])
    azimuth = np.arctan2(offset[..., 1], offset[..., 0])
    if offset.shape[-1] == 2:
        return np.stack([flat, azimuth], axis=-1)
    return np.stack([np.hypot(flat, offset[..., 2]), azimuth, np.arctan2(offset[..., 2], flat)], axis=-1)


def polar_jacobian(offset: Float64Array) -> Float64Array:
    """Differentiate `to_polar`.

    At the sensor itself directions have no derivative: within a micrometre it is that at one micrometre, so that covariances made with it
    are finite and huge.

    Parameters
    ----------
    offset : ndarray of float64, shape (..., d)
        Positions less the sensor's [m].

    Returns
    -------
    ndarray of float64, shape (..., d, d)
        Rows (range, azimuth[, elevation]).
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
