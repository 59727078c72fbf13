"""Joints in the room from an RGB-D camera, with everything known about their errors: a reference for what the radar says."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Literal

import numpy as np

from radar_core import ConfigError, DataError
from radar_core.config import config, knob
from radar_core.linalg import symmetrise
from radar_core.types import Float64Array
from radar_lab.camera.depth import DepthConfig, DepthReader
from radar_lab.camera.markers import MarkerConfig, MarkerFinder
from radar_lab.camera.mediapipe_pose import MediapipeConfig, MediapipePose
from radar_lab.camera.pinhole import CameraModel, CameraMount, from_optical
from radar_lab.camera.pose import Keypoints, PoseEstimator, RgbdFrame
from radar_lab.camera.residual import ReferenceSample

PARTS = ("pixel", "depth", "skin", "latency", "mount")
"""What makes up the error of a joint; see `JointTruth.part_std`."""
_COMMON = (2, 3, 4)  # those that stay the same from frame to frame: they do not average out
_SECOND = 1e-9
_LEAST = 3  # places that a velocity is made of


@config
class PoseConfig:
    """Which estimator finds the joints."""

    estimator: Literal["markers", "mediapipe"] = knob(
        "markers",
        doc="markers: coloured markers that the person wears; mediapipe: a person without markers (pip install 'handwave[camera]')",
    )
    markers: MarkerConfig = MarkerConfig()
    mediapipe: MediapipeConfig = MediapipeConfig()


def make_estimator(config: PoseConfig) -> PoseEstimator:
    """Make the estimator that a configuration names. Raises `ConfigError` when what it needs is not installed, or there is no model."""
    return MediapipePose(config.mediapipe) if config.estimator == "mediapipe" else MarkerFinder(config.markers)


@config
class CameraTruthConfig:
    """Where the camera stands, how joints are found, and how large the errors are."""

    mount: CameraMount = CameraMount()
    pose: PoseConfig = PoseConfig()
    depth: DepthConfig = DepthConfig()
    position_std: float = knob(
        0.01, unit="m", low=0.0, high=10.0, doc="of the camera's place in the room, each coordinate (extrinsic calibration)"
    )
    angle_std: float = knob(0.005, unit="rad", low=0.0, high=1.0, doc="of the camera's direction, about each axis (extrinsic calibration)")
    latency: float = knob(0.0, unit="s", low=-1.0, high=2.0, doc="an image shows what was this long before its stamp; it is corrected")
    latency_std: float = knob(
        0.005, unit="s", low=0.0, high=1.0, doc="standard deviation of the latency: times the speed, an error of place"
    )
    below_skin: tuple[float, ...] = knob(
        (0.03,),
        unit="m",
        low=-0.5,
        high=0.5,
        doc="how far a joint lies behind the surface that the camera sees; one for all, or one for each",
    )
    below_skin_std: float = knob(0.005, unit="m", low=0.0, high=0.5, doc="standard deviation of that")
    min_confidence: float = knob(0.5, low=0.0, high=1.0, doc="joints that the pose estimator is less sure of are left out")
    velocity_window: float = knob(0.2, unit="s", low=0.02, high=5.0, doc="a joint's velocity is the slope of its places in this time")
    assumed_speed: float = knob(1.0, unit="m/s", low=0.0, high=10.0, doc="speed that the latency is multiplied with while none is known")


@dataclass(frozen=True, eq=False)
class JointTruth:
    """Joints of one person in ``room``; arrays have one entry (row) per joint, NaN where it was not seen."""

    stamp_ns: int  # when the light was seen: the image's stamp less the known latency [ns]
    sequence: int  # of the frame
    frame_id: str  # always ``room``
    names: tuple[str, ...]  # of n joints
    # Shape (n, 3) [m], [m/s]; the velocity is NaN too while the joint has not been seen for long enough.
    position: Float64Array
    velocity: Float64Array
    covariance: Float64Array  # of the position, all errors together, shape (n, 3, 3) [m^2]
    common: Float64Array  # that part of it which is the same from frame to frame: skin, latency, mount; shape (n, 3, 3) [m^2]
    # Root mean square length of each error of `PARTS` [m]: pixel noise, depth noise, depth below the skin, latency times speed, place and
    # direction of the camera. Their squares add up to the trace of the covariance; shape (n, 5)
    part_std: Float64Array
    pixel: Float64Array  # where the joint was found in the image, shape (n, 2) = (u, v)
    confidence: Float64Array  # of the pose estimator, 0 to 1, shape (n,)
    reason: tuple[str, ...]  # why a joint was not seen; empty: it was


class CameraTruth:
    """Turn RGB-D frames into joints in the room.

    A joint is where the pose estimator's pixel meets the nearest surface, and `below_skin` behind it. Its covariance carries pixel noise
    and depth noise through the pinhole model, what lies between skin and joint, the latency's uncertainty times the velocity, and that of
    the camera's place and direction, to first order.

    Parameters
    ----------
    camera : CameraModel
        Of both images.
    config : CameraTruthConfig or None
        None: all defaults. `ConfigError` is raised when `below_skin` does not fit the joints.
    estimator : PoseEstimator or None
        None: the one that the configuration names.
    """

    def __init__(self, camera: CameraModel, config: CameraTruthConfig | None = None, estimator: PoseEstimator | None = None) -> None:
        self.camera = camera
        self.config = config or CameraTruthConfig()
        self.estimator: PoseEstimator = estimator if estimator is not None else make_estimator(self.config.pose)
        self._depth = DepthReader(self.config.depth)
        n = len(self.estimator.names)
        if len(self.config.below_skin) not in (1, n):
            raise ConfigError(
                f"CameraTruthConfig.below_skin has {len(self.config.below_skin)} entries for {n} joints "
                f"({', '.join(self.estimator.names)}); give one, or one for each",
                key=("below_skin",),
            )
        self._below = np.broadcast_to(np.array(self.config.below_skin), n)
        self._latency_ns = round(self.config.latency / _SECOND)
        self.reset()

    def reset(self) -> None:
        """Forget where joints were. For a new recording."""
        self._stamp_ns: int | None = None
        self._seen: list[deque[tuple[int, Float64Array]]] = [deque() for _ in self.estimator.names]

    def close(self) -> None:
        """Let go of the pose estimator."""
        self.estimator.close()

    def process(self, frame: RgbdFrame) -> JointTruth:
        """Find the joints of one frame.

        Raises `DataError` when the images are not of the camera's size, or the frame is not newer than the one before.
        """
        shape = (self.camera.height, self.camera.width)
        if frame.depth.shape != shape:
            raise DataError(f"images are {frame.depth.shape} (height, width), but the camera's info says {shape}; are both of one camera?")
        if self._stamp_ns is not None and frame.stamp_ns <= self._stamp_ns:
            raise DataError(f"frame {frame.sequence} is not newer than the one before; reset() before another recording")
        self._stamp_ns = frame.stamp_ns
        found = self.estimator.process(frame.colour)
        sure = found.confidence >= self.config.min_confidence
        pixel = np.where(sure[:, None], found.pixel, np.nan)
        depths = self._depth.process(frame.depth, pixel, found.label)
        reasons = tuple(_reason(found, i, bool(sure[i]), text) for i, text in enumerate(depths.reason))
        position, parts = self._place(pixel, found.pixel_std, depths.depth, depths.std)
        stamp_ns = frame.stamp_ns - self._latency_ns
        velocity = self._velocities(stamp_ns, position)
        parts = np.concatenate([parts, self._latency(velocity)[:, None], self._mounting(position)[:, None]], 1)
        parts[~np.isfinite(position).all(-1)] = np.nan
        return JointTruth(
            stamp_ns=stamp_ns,
            sequence=frame.sequence,
            frame_id="room",
            names=found.names,
            position=position,
            velocity=velocity,
            covariance=symmetrise(parts.sum(1)),
            common=symmetrise(parts[:, _COMMON].sum(1)),
            part_std=np.sqrt(np.trace(parts, axis1=-2, axis2=-1)),
            pixel=found.pixel,
            confidence=found.confidence,
            reason=reasons,
        )

    def _place(
        self, pixel: Float64Array, pixel_std: Float64Array, depth: Float64Array, depth_std: Float64Array
    ) -> tuple[Float64Array, Float64Array]:
        """Positions (n, 3) in ``room``, and their covariances by pixel, depth and skin (n, 3, 3, 3)."""
        ray = self.camera.rays(pixel)
        length = np.sqrt((ray**2).sum(-1, keepdims=True))
        behind = depth + self._below / length[:, 0]  # along the ray, the joint is that far behind the surface; its depth grows by less
        turn = self.config.mount.rotation
        slope = turn @ from_optical(np.swapaxes(self.camera.sensitivity(pixel, behind), -1, -2)).swapaxes(-1, -2)
        across = slope[:, :, :2] * pixel_std[:, None, None]
        along = slope[:, :, 2:] * depth_std[:, None, None]
        skin = slope[:, :, 2:] / length[:, :, None] * self.config.below_skin_std
        parts = np.stack([side @ np.swapaxes(side, -1, -2) for side in (across, along, skin)], 1)
        return self.config.mount.to_room(ray * behind[:, None]), parts

    def _latency(self, velocity: Float64Array) -> Float64Array:
        """Covariance (n, 3, 3) of where a joint is because it is not known when it was seen."""
        known = np.isfinite(velocity).all(-1)
        moved = velocity[:, :, None] * velocity[:, None, :]
        moved[~known] = np.eye(3) * (self.config.assumed_speed**2 / 3.0)
        return np.asarray(moved * self.config.latency_std**2)

    def _mounting(self, position: Float64Array) -> Float64Array:
        """Covariance (n, 3, 3) by place and direction of the camera: a small turn w moves a point at d by w x d."""
        d = position - self.config.mount.origin
        square = (d**2).sum(-1)[:, None, None] * np.eye(3) - d[:, :, None] * d[:, None, :]
        return np.asarray(np.eye(3) * self.config.position_std**2 + square * self.config.angle_std**2)

    def _velocities(self, stamp_ns: int, position: Float64Array) -> Float64Array:
        """Slopes (n, 3) of each joint's latest places [m/s]; NaN while there are too few."""
        velocity = np.full(position.shape, np.nan)
        window_ns = round(self.config.velocity_window / _SECOND)
        for i, (seen, place) in enumerate(zip(self._seen, position, strict=True)):
            while seen and stamp_ns - seen[0][0] > window_ns:
                seen.popleft()
            if np.isfinite(place).all():
                seen.append((stamp_ns, place))
                velocity[i] = _slope(seen, stamp_ns)
        return velocity


def _slope(seen: deque[tuple[int, Float64Array]], stamp_ns: int) -> Float64Array:
    """Least-squares slope of places over time, shape (3,) [m/s]; NaN: too few."""
    if len(seen) < _LEAST:
        return np.full(3, np.nan)
    time = np.array([(stamp - stamp_ns) * _SECOND for stamp, _ in seen])
    time -= time.mean()
    return np.asarray(time @ np.stack([place for _, place in seen]) / (time @ time))


def _reason(found: Keypoints, i: int, sure: bool, depth: str) -> str:
    if not np.isfinite(found.pixel[i]).all():
        return "not found in the image"
    return depth if sure else f"confidence {found.confidence[i]:.2f} is too low"


def reference_of(truth: JointTruth, joint: str) -> ReferenceSample | None:
    """Take one joint as the reference of a hand track; None: it was not seen. Raises `DataError` when there is no such joint."""
    if joint not in truth.names:
        raise DataError(f"the camera's joints are {', '.join(truth.names)}; there is no {joint!r} (parameter joint)")
    i = truth.names.index(joint)
    if not np.isfinite(truth.position[i]).all():
        return None
    return ReferenceSample(truth.stamp_ns, truth.position[i], truth.covariance[i], truth.common[i], truth.part_std[i])
