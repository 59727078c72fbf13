"""Coordinates: x forward (boresight), y left, z up; azimuth from x towards y, elevation up (REP-103)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def spherical_to_cartesian(distance: ArrayLike, azimuth: ArrayLike, elevation: ArrayLike) -> NDArray[Any]:
    """Convert range [m], azimuth [rad] and elevation [rad] to positions, shape (..., 3) = (x, y, z) [m]."""
    r, az, el = np.broadcast_arrays(distance, azimuth, elevation)
    ground = r * np.cos(el)
    return np.stack([ground * np.cos(az), ground * np.sin(az), r * np.sin(el)], axis=-1)


def cartesian_to_spherical(position: ArrayLike) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Convert positions, shape (..., 3) [m], to range [m], azimuth [rad] and elevation [rad]; the origin gives zeros."""
    p = np.asarray(position)
    ground = np.hypot(p[..., 0], p[..., 1])
    return np.hypot(ground, p[..., 2]), np.arctan2(p[..., 1], p[..., 0]), np.arctan2(p[..., 2], ground)


def direction(azimuth: ArrayLike, elevation: ArrayLike) -> NDArray[Any]:
    """Return unit vectors, shape (..., 3), towards azimuth and elevation [rad]."""
    return spherical_to_cartesian(1.0, azimuth, elevation)
