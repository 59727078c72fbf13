"""Coordinates, x forward (boresight), y left, z up; azimuth from x towards y, elevation up (REP-103). And where a sensor stands."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_core.config import config, knob


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


@config
class Pose:
    """Mount of a sensor: its frame's origin and orientation in ``room`` (z = 0 on the floor)."""

    x: float = knob(0.0, unit="m", low=-1e3, high=1e3, doc="forward position of the sensor in the room")
    y: float = knob(0.0, unit="m", low=-1e3, high=1e3, doc="left position of the sensor in the room")
    z: float = knob(1.2, unit="m", low=-100.0, high=100.0, doc="height of the sensor above the floor")
    yaw: float = knob(0.0, unit="rad", low=-2 * math.pi, high=2 * math.pi, doc="boresight from the room's x towards its y, left positive")
    tilt: float = knob(0.0, unit="rad", low=-math.pi / 2, high=math.pi / 2, doc="boresight above the horizon, up positive")

    @property
    def rotation(self) -> NDArray[np.float64]:
        """Rotation matrix, shape (3, 3): a vector of the sensor frame to ``room``."""
        cy, sy, ct, st = math.cos(self.yaw), math.sin(self.yaw), math.cos(self.tilt), math.sin(self.tilt)
        return np.array([[cy * ct, -sy, -cy * st], [sy * ct, cy, -sy * st], [st, 0.0, ct]])

    @property
    def origin(self) -> NDArray[np.float64]:
        """Position of the sensor in ``room``, shape (3,) [m]."""
        return np.array([self.x, self.y, self.z])

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """Orientation as x, y, z, w, for tf: yaw about z, then -tilt about the sensor's y."""
        cy, sy = math.cos(self.yaw / 2), math.sin(self.yaw / 2)
        ct, st = math.cos(-self.tilt / 2), math.sin(-self.tilt / 2)
        return (-sy * st, cy * st, sy * ct, cy * ct)

    def to_room(self, position: NDArray[np.floating]) -> NDArray[np.float64]:
        """Positions of the sensor frame, shape (..., 3) [m], in ``room``."""
        return np.asarray(position, np.float64) @ self.rotation.T + self.origin

    def from_room(self, position: NDArray[np.floating]) -> NDArray[np.float64]:
        """Positions of ``room``, shape (..., 3) [m], in the sensor frame."""
        return (np.asarray(position, np.float64) - self.origin) @ self.rotation
