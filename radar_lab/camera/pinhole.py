"""Pinhole cameras with a lens: points to pixels and back, and where a camera stands in the room.

Pixels are (u, v): columns to the right, rows down, the centre of the first pixel at (0, 0), as in OpenCV and ``sensor_msgs/CameraInfo``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError
from radar_core.config import config, knob
from radar_core.types import BoolArray, Float64Array

Lens = Literal["none", "plumb_bob", "rational_polynomial"]
COEFFICIENTS: Mapping[str, tuple[int, ...]] = {"none": (0,), "plumb_bob": (0, 4, 5), "rational_polynomial": (0, 8)}
"""Lens models, and how many coefficients each may have; none: no distortion."""

_STEPS = 50  # of Newton's method; 5 suffice for usual lenses
_CONVERGED = 1e-10  # in units of the focal length: 1e-7 pixels
_FOLD = 0.02  # the lens folds back where a step outwards moves the image by less than this share of the step
_WIDEST = 4.0  # tangent of the largest angle looked at, 76 degrees: no lens of these models is meant for more
_FARTHEST = 1e12  # the same without a lens: its square is still a number
_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # rows: our x, y, z in optical axes


def from_optical(vector: NDArray[np.floating]) -> Float64Array:
    """Vectors of an optical frame (z forward, x right, y down; REP-103), shape (..., 3), in ours (x forward, y left, z up)."""
    return np.asarray(np.asarray(vector, np.float64) @ _OPTICAL.T)


def to_optical(vector: NDArray[np.floating]) -> Float64Array:
    """Vectors of our camera frame (x forward, y left, z up), shape (..., 3), in the optical one (z forward, x right, y down)."""
    return np.asarray(np.asarray(vector, np.float64) @ _OPTICAL)


@config
class CameraMount:
    """Where a camera stands: its frame (x forward, y left, z up, origin at the optical centre) in ``room``."""

    x: float = knob(0.0, unit="m", low=-1e3, high=1e3, doc="forward position of the camera in the room")
    y: float = knob(0.0, unit="m", low=-1e3, high=1e3, doc="left position of the camera in the room")
    z: float = knob(1.2, unit="m", low=-100.0, high=100.0, doc="height of the camera above the floor")
    yaw: float = knob(0.0, unit="rad", low=-2 * math.pi, high=2 * math.pi, doc="view from the room's x towards its y, left positive")
    tilt: float = knob(0.0, unit="rad", low=-math.pi / 2, high=math.pi / 2, doc="view above the horizon, up positive")
    roll: float = knob(0.0, unit="rad", low=-math.pi, high=math.pi, doc="about the view, right side down positive")

    @property
    def rotation(self) -> Float64Array:
        """Rotation matrix, shape (3, 3): a vector of the camera's frame to ``room``; roll first, then tilt, then yaw."""
        cy, sy, ct, st = math.cos(self.yaw), math.sin(self.yaw), math.cos(self.tilt), math.sin(self.tilt)
        cr, sr = math.cos(self.roll), math.sin(self.roll)
        level = np.array([[cy * ct, -sy, -cy * st], [sy * ct, cy, -sy * st], [st, 0.0, ct]])
        return np.asarray(level @ np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]]))

    @property
    def origin(self) -> Float64Array:
        """Position of the optical centre in ``room``, shape (3,) [m]."""
        return np.array([self.x, self.y, self.z])

    def to_room(self, optical: NDArray[np.floating]) -> Float64Array:
        """Points of the optical frame, shape (..., 3) [m], in ``room``."""
        return np.asarray(from_optical(optical) @ self.rotation.T + self.origin)

    def from_room(self, position: NDArray[np.floating]) -> Float64Array:
        """Points of ``room``, shape (..., 3) [m], in the optical frame."""
        return to_optical((np.asarray(position, np.float64) - self.origin) @ self.rotation)


@config
class CameraModel:
    """A camera as ``sensor_msgs/CameraInfo`` describes it: matrix K, distortion_model and D, for images that are not rectified."""

    width: int = knob(640, unit="px", low=1, high=1 << 16, doc="columns of the image")
    height: int = knob(480, unit="px", low=1, high=1 << 16, doc="rows of the image")
    fx: float = knob(600.0, unit="px", low=1e-3, high=1e6, doc="focal length across")
    fy: float = knob(600.0, unit="px", low=1e-3, high=1e6, doc="focal length down")
    cx: float = knob(319.5, unit="px", low=-1e6, high=1e6, doc="column where the optical axis meets the image")
    cy: float = knob(239.5, unit="px", low=-1e6, high=1e6, doc="row where the optical axis meets the image")
    lens: Lens = knob("none", doc="distortion model; none: a rectified image")
    distortion: tuple[float, ...] = knob((), doc="plumb_bob: k1 k2 p1 p2 [k3]; rational_polynomial: k1 k2 p1 p2 k3 k4 k5 k6")

    def validate(self) -> None:
        """Raise `ConfigError` when the number of coefficients is wrong, or the distortion cannot be undone within the image."""
        allowed = COEFFICIENTS[self.lens]
        if len(self.distortion) not in allowed:
            raise ConfigError(
                f"CameraModel.distortion has {len(self.distortion)} coefficients; {self.lens} takes {' or '.join(map(str, allowed))}",
                key=("distortion",),
            )
        u, v = np.meshgrid(np.linspace(0.0, self.width - 1.0, 5), np.linspace(0.0, self.height - 1.0, 5))
        if not np.isfinite(self.rays(np.stack([u, v], -1))).all():
            raise ConfigError(
                f"CameraModel: the distortion {self.distortion} ({self.lens}) folds back within the image of {self.width} x {self.height}; "
                "check the coefficients and their order, or rectify the images (image_proc) and use lens: none",
                key=("distortion",),
            )

    @cached_property
    def _k(self) -> tuple[float, ...]:
        """All coefficients k1 k2 p1 p2 k3 k4 k5 k6."""
        return (*self.distortion, *(0.0,) * (8 - len(self.distortion)))

    @cached_property
    def _limit(self) -> float:
        """Largest distance from the axis, in units of the focal length, up to which the lens does not fold back."""
        if not any(self._k):
            return _FARTHEST
        r = np.linspace(0.0, _WIDEST, 4001)
        radial, slope = self._radial(r * r)
        bad = np.flatnonzero(~((radial + 2 * r * r * slope > _FOLD) & (radial > _FOLD)))
        return float(r[bad[0]]) if len(bad) else _WIDEST

    def _radial(self, r2: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Radial factor and its derivative by the squared distance."""
        k1, k2, _, _, k3, k4, k5, k6 = self._k
        over, over_slope = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), k1 + r2 * (2 * k2 + 3 * r2 * k3)
        under, under_slope = 1 + r2 * (k4 + r2 * (k5 + r2 * k6)), k4 + r2 * (2 * k5 + 3 * r2 * k6)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # a pole lies beyond the limit, where NaN is said
            return over / under, (over_slope * under - over * under_slope) / under**2

    def _distort(self, at: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Where the lens images directions, shape (n, 2) in units of the focal length, and the derivative, shape (n, 2, 2)."""
        _, _, p1, p2 = self._k[:4]
        x, y = at[:, 0], at[:, 1]
        r2 = x * x + y * y
        radial, slope = self._radial(r2)
        image = np.stack([x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], -1)
        cross = 2 * (x * y * slope + p1 * x + p2 * y)
        derivative = np.empty((len(at), 2, 2))
        derivative[:, 0, 0] = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
        derivative[:, 1, 1] = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
        derivative[:, 0, 1] = derivative[:, 1, 0] = cross
        return image, derivative

    def project(self, optical: NDArray[np.floating]) -> Float64Array:
        """Image points (u, v), shape (..., 2), of points in the optical frame (x right, y down, z forward), shape (..., 3) [m].

        They may lie outside the image; NaN for what is not in front of the camera or beyond what the lens is described for.
        """
        points = np.asarray(optical, np.float64)
        flat = points.reshape(-1, 3)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            at = flat[:, :2] / flat[:, 2:]
            inside = (flat[:, 2] > 0) & (np.hypot(at[:, 0], at[:, 1]) < self._limit)
        pixel = np.full((len(flat), 2), np.nan)
        pixel[inside] = self._distort(at[inside])[0] * (self.fx, self.fy) + (self.cx, self.cy)
        return pixel.reshape(*points.shape[:-1], 2)

    def rays(self, pixel: NDArray[np.floating]) -> Float64Array:
        """Directions of pixels (u, v), shape (..., 2), in or outside the image: in the optical frame, with z = 1, shape (..., 3).

        NaN where the lens is not described.
        """
        pixels = np.asarray(pixel, np.float64)
        flat = self._undistort((pixels.reshape(-1, 2) - (self.cx, self.cy)) / (self.fx, self.fy))
        return np.concatenate([flat, np.ones((len(flat), 1))], -1).reshape(*pixels.shape[:-1], 3)

    def unproject(self, pixel: NDArray[np.floating], depth: NDArray[np.floating]) -> Float64Array:
        """Points in the optical frame, shape (..., 3) [m], of pixels (..., 2) and their depths along the optical axis, shape (...) [m]."""
        return self.rays(pixel) * np.asarray(depth, np.float64)[..., None]

    def sensitivity(self, pixel: NDArray[np.floating], depth: NDArray[np.floating]) -> Float64Array:
        """Differentiate `unproject` at pixels, shape (n, 2) = (u, v), and depths along the optical axis, shape (n,).

        Gives an array of shape (n, 3, 3): rows x, y, z of the optical frame; columns u, v [m/px], depth [1].
        """
        ray = self.rays(pixel)
        derivative = np.zeros((len(ray), 3, 3))
        known = np.isfinite(ray).all(-1) & np.isfinite(np.asarray(depth, np.float64))
        derivative[~known] = np.nan
        lens = self._distort(ray[known, :2])[1]
        scale = np.asarray(depth, np.float64)[known, None, None]
        derivative[known, :2, :2] = np.linalg.solve(lens, np.tile(np.diag([1 / self.fx, 1 / self.fy]), (len(lens), 1, 1))) * scale
        derivative[known, :, 2] = ray[known]
        return derivative

    def inside(self, pixel: NDArray[np.floating]) -> BoolArray:
        """Which pixels, shape (..., 2), lie in the image, shape (...); NaN does not."""
        u, v = pixel[..., 0], pixel[..., 1]
        return np.asarray((u > -0.5) & (u < self.width - 0.5) & (v > -0.5) & (v < self.height - 0.5))

    def _undistort(self, image: Float64Array) -> Float64Array:
        """Undo the lens, shape (n, 2); NaN for NaN, and where there is nothing to find within the lens's limit."""
        if not any(self._k):
            return image
        known = np.isfinite(image).all(-1)
        found = np.full(image.shape, np.nan)
        found[known] = self._newton(image[known])
        return found

    def _newton(self, image: Float64Array) -> Float64Array:
        """Solve for the directions, shape (n, 2), that the lens images at finite places (n, 2); NaN where that fails."""
        limit = self._limit
        at = image * np.minimum(1.0, 0.9 * limit / np.maximum(np.hypot(image[:, 0], image[:, 1]), 1e-12))[:, None]
        for _ in range(_STEPS):
            reached, derivative = self._distort(at)
            error = reached - image
            if not (np.abs(error) > _CONVERGED).any():
                break
            regular = np.abs(np.linalg.det(derivative)) > 1e-9
            step = np.zeros_like(at)
            step[regular] = np.linalg.solve(derivative[regular], error[regular, :, None])[..., 0]
            at = at - step
            at *= np.minimum(1.0, limit / np.maximum(np.hypot(at[:, 0], at[:, 1]), 1e-12))[:, None]
        at[~(np.abs(self._distort(at)[0] - image).max(-1) < 1e-7)] = np.nan
        return at
