"""A camera's calibration, the joints it saw, and residuals of hand tracks, to and from ROS messages."""

from __future__ import annotations

import math
from typing import Any, Final

import handwave.msg
import numpy as np

from radar_core import ConfigError, DataError
from radar_lab.camera.pinhole import COEFFICIENTS, CameraModel
from radar_lab.camera.residual import Residual
from radar_lab.camera.truth import PARTS, JointTruth
from radar_ros.messages.convert import from_time, header, pack_all, unpack

_SHAPES: Final = {"position": (3,), "velocity": (3,), "covariance": (3, 3), "common": (3, 3), "part_std": (len(PARTS),), "pixel": (2,)}
_JOINTS: Final[dict[str, tuple[int, ...]]] = {**_SHAPES, "confidence": ()}
"""Arrays of a message of joints, and the shape that each has for one joint."""


def camera_from_msg(msg: Any) -> CameraModel:
    """Read a ``sensor_msgs/CameraInfo``: matrix K and distortion of the image as it comes, not of a rectified one.

    Raises
    ------
    ConfigError
        When the camera is not calibrated, sends a part of its image, or has a lens that is not known here.
    """
    if not (msg.k[0] > 0 and msg.k[4] > 0):
        raise ConfigError("camera_info says that the camera is not calibrated (K is zero); calibrate it, e.g. with camera_calibration")
    roi = msg.roi
    if max(msg.binning_x, msg.binning_y) > 1 or roi.x_offset or roi.y_offset or (roi.width and roi.width != msg.width):
        raise ConfigError("camera_info has binning or a region of interest; have the driver send the whole image as it is calibrated")
    plain = not any(msg.d)
    lens: Any = "none" if plain else msg.distortion_model
    if lens not in COEFFICIENTS:
        known = ", ".join(name for name in COEFFICIENTS if name != "none")
        raise ConfigError(f"camera_info has the lens {lens!r}; known are {known}: rectify the images (image_proc), use their camera_info")
    fx, _, cx, _, fy, cy = map(float, msg.k[:6])
    distortion = () if plain else tuple(float(value) for value in msg.d)
    return CameraModel(width=msg.width, height=msg.height, fx=fx, fy=fy, cx=cx, cy=cy, lens=lens, distortion=distortion)


def joints_to_msg(truth: JointTruth) -> handwave.msg.JointTruth:
    """Put the joints that a camera saw into a message."""
    arrays = pack_all(truth, dict.fromkeys(_JOINTS, "d"))
    return handwave.msg.JointTruth(header=header(truth.stamp_ns, truth.frame_id), sequence=truth.sequence, name=list(truth.names), **arrays)


def joints_from_msg(msg: Any) -> JointTruth:
    """Take the joints that a camera saw out of a message; why one was not seen does not travel.

    Raises
    ------
    DataError
        When an array does not fit the number of joints.
    """
    n, arrays = len(msg.name), {}
    for name, shape in _JOINTS.items():
        values, size = unpack(getattr(msg, name), np.float64), n * math.prod(shape)
        if values.size != size:
            raise DataError(f"camera/joints has {values.size} numbers in {name} for {n} joints; expected {size}")
        arrays[name] = values.reshape(n, *shape)
    seen = np.isfinite(arrays["position"]).all(-1).tolist()
    return JointTruth(
        stamp_ns=from_time(msg.header.stamp),
        sequence=msg.sequence,
        frame_id=msg.header.frame_id,
        names=tuple(msg.name),
        reason=tuple("" if there else "not seen" for there in seen),
        **arrays,
    )


def residual_to_msg(found: Residual, reference: str) -> handwave.msg.HandResidual:
    """Put the residual of a hand track into a message; ``reference`` is the reference's name."""
    return handwave.msg.HandResidual(
        header=header(found.sample.stamp_ns, "room"),
        track=found.sample.track,
        reference=reference,
        position=found.sample.position,
        reference_position=found.reference,
        residual=found.residual,
        distance=float(np.sqrt((found.residual**2).sum())),
        covariance=found.sample.covariance.ravel(),
        reference_covariance=found.covariance.ravel(),
        reference_std=float(np.sqrt(max(np.trace(found.covariance), 0.0))),
    )
