"""Tracks, hand tracks and what a camera says of them, to and from ROS messages."""

from __future__ import annotations

from typing import Any

import numpy as np
from handwave.msg import HandResidual as HandResidualMsg
from handwave.msg import HandTrack as HandTrackMsg
from handwave.msg import JointTruth as JointTruthMsg
from handwave.msg import Track as TrackMsg
from handwave.msg import TrackArray as TrackArrayMsg

from radar_core import ConfigError, DataError
from radar_lab.camera.pinhole import COEFFICIENTS, CameraModel
from radar_lab.camera.residual import Residual
from radar_lab.camera.truth import PARTS, JointTruth
from radar_ros.messages.convert import from_time, header, pack, stride, unpack
from radar_tracking.tracks import Deleted, HandTrack, Reason, Track, Tracks, TrackStatus


def track_to_msg(track: Track) -> TrackMsg:
    """Put one track into a message."""
    return TrackMsg(
        id=track.id,
        status=int(track.status),
        age_s=float(track.age),
        unseen_s=float(track.unseen),
        n_points=track.n_points,
        position=track.position,
        velocity=track.velocity,
        extent=track.extent,
        covariance=track.covariance.ravel(),
        nis=float(track.nis),
        dof=track.dof,
    )


def track_from_msg(msg: Any) -> Track:
    """Take one track out of a message."""
    return Track(
        id=msg.id,
        status=TrackStatus(msg.status),
        age=msg.age_s,
        unseen=msg.unseen_s,
        n_points=msg.n_points,
        position=np.array(msg.position),
        velocity=np.array(msg.velocity),
        extent=np.array(msg.extent),
        covariance=np.array(msg.covariance).reshape(6, 6),
        nis=msg.nis,
        dof=msg.dof,
    )


def tracks_to_msg(tracks: Tracks) -> TrackArrayMsg:
    """Put all tracks of one cloud into a message."""
    return TrackArrayMsg(
        header=header(tracks.stamp_ns, tracks.frame_id),
        sequence=tracks.sequence,
        every=tracks.every,
        tracks=[track_to_msg(track) for track in tracks.tracks],
        point_track_id=pack(tracks.point_track_id, "i"),
        deleted_id=[track.id for track in tracks.deleted],
        deleted_reason=[int(track.reason) for track in tracks.deleted],
        deleted_confirmed=[track.confirmed for track in tracks.deleted],
    )


def tracks_from_msg(msg: Any) -> Tracks:
    """Take all tracks of one cloud out of a message."""
    tracks = tuple(track_from_msg(track) for track in msg.tracks)
    ended = zip(msg.deleted_id, msg.deleted_reason, msg.deleted_confirmed, strict=True)
    deleted = tuple(Deleted(int(number), Reason(reason), bool(confirmed)) for number, reason, confirmed in ended)
    owner = unpack(msg.point_track_id, np.int32)
    return Tracks(from_time(msg.header.stamp), msg.sequence, msg.header.frame_id, tracks, owner, deleted, stride(msg))


def hand_to_msg(hand: HandTrack) -> HandTrackMsg:
    """Put a hand track into a message."""
    return HandTrackMsg(
        header=header(hand.stamp_ns, hand.frame_id),
        sequence=hand.sequence,
        parent_id=hand.parent_id,
        active=hand.active,
        n_points=hand.n_points,
        unseen_s=float(hand.unseen),
        position=hand.position,
        velocity=hand.velocity,
        covariance=hand.covariance.ravel(),
        value=float(hand.value),
        velocity_rank=hand.velocity_rank,
        velocity_condition=float(hand.velocity_condition),
        outliers=hand.outliers,
    )


def hand_from_msg(msg: Any) -> HandTrack:
    """Take a hand track out of a message."""
    return HandTrack(
        stamp_ns=from_time(msg.header.stamp),
        sequence=msg.sequence,
        frame_id=msg.header.frame_id,
        parent_id=msg.parent_id,
        active=msg.active,
        n_points=msg.n_points,
        unseen=msg.unseen_s,
        position=np.array(msg.position),
        velocity=np.array(msg.velocity),
        covariance=np.array(msg.covariance).reshape(6, 6),
        value=msg.value,
        velocity_rank=msg.velocity_rank,
        velocity_condition=msg.velocity_condition,
        outliers=msg.outliers,
    )


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
