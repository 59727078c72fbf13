"""Tracks and hand tracks to and from ROS messages."""

from __future__ import annotations

from typing import Any

import numpy as np
from handwave.msg import HandTrack as HandTrackMsg
from handwave.msg import Track as TrackMsg
from handwave.msg import TrackArray as TrackArrayMsg

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
    return Tracks(
        stamp_ns=from_time(msg.header.stamp),
        sequence=msg.sequence,
        frame_id=msg.header.frame_id,
        tracks=tracks,
        point_track_id=unpack(msg.point_track_id, np.int32),
        deleted=deleted,
        every=stride(msg),
    )


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
