"""Range rates with their derivatives, and angles."""

from __future__ import annotations

import numpy as np

from radar_core.types import Float64Array

_CLOSEST = 1e-6  # m: directions from nearer than this are those at this distance


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
