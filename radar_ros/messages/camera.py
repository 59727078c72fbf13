"""A camera's calibration, the joints it saw, and residuals of hand tracks, to and from ROS messages."""

from __future__ import annotations

from typing import Any

import numpy as np
from handwave.msg import HandResidual as HandResidualMsg
from handwave.msg import JointTruth as JointTruthMsg

from radar_core import ConfigError, DataError
from radar_lab.camera.pinhole import COEFFICIENTS, CameraModel
from radar_lab.camera.residual import Residual
from radar_lab.camera.truth import PARTS, JointTruth
from radar_ros.messages.convert import from_time, header, pack, unpack


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
    lens = "none" if plain else msg.distortion_model
    if lens not in COEFFICIENTS:
        known = ", ".join(name for name in COEFFICIENTS if name != "none")
        raise ConfigError(
            f"camera_info has the lens {lens!r}; known are {known}: rectify the images (image_proc) and use their camera_info"
        )
    k = msg.k
    return CameraModel(
        width=msg.width,
        height=msg.height,
        fx=float(k[0]),
        fy=float(k[4]),
        cx=float(k[2]),
        cy=float(k[5]),
        lens=lens,
        distortion=() if plain else tuple(float(value) for value in msg.d),
    )


def joints_to_msg(truth: JointTruth) -> JointTruthMsg:
    """Put the joints that a camera saw into a message."""
    return JointTruthMsg(
        header=header(truth.stamp_ns, truth.frame_id),
        sequence=truth.sequence,
        name=list(truth.names),
        position=pack(truth.position, "d"),
        velocity=pack(truth.velocity, "d"),
        covariance=pack(truth.covariance, "d"),
        common=pack(truth.common, "d"),
        part_std=pack(truth.part_std, "d"),
        pixel=pack(truth.pixel, "d"),
        confidence=pack(truth.confidence, "d"),
    )


def joints_from_msg(msg: Any) -> JointTruth:
    """Take the joints that a camera saw out of a message; why one was not seen does not travel.

    Raises
    ------
    DataError
        When an array does not fit the number of joints.
    """
    n = len(msg.name)
    shapes = {"position": (n, 3), "velocity": (n, 3), "covariance": (n, 3, 3), "common": (n, 3, 3), "part_std": (n, len(PARTS))}
    shapes |= {"pixel": (n, 2), "confidence": (n,)}
    arrays = {}
    for name, shape in shapes.items():
        values = unpack(getattr(msg, name), np.float64)
        if values.size != int(np.prod(shape)):
            raise DataError(f"camera/joints has {values.size} numbers in {name} for {n} joints; expected {int(np.prod(shape))}")
        arrays[name] = values.reshape(shape)
    seen = np.isfinite(arrays["position"]).all(-1).tolist()
    return JointTruth(
        stamp_ns=from_time(msg.header.stamp),
        sequence=msg.sequence,
        frame_id=msg.header.frame_id,
        names=tuple(msg.name),
        reason=tuple("" if there else "not seen" for there in seen),
        **arrays,
    )


def residual_to_msg(found: Residual, reference: str) -> HandResidualMsg:
    """Put the residual of a hand track into a message; ``reference`` is the reference's name."""
    return HandResidualMsg(
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
