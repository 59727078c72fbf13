"""Tracks and hand tracks to and from ROS messages."""

from __future__ import annotations

from typing import Any, Final

import handwave.msg
import numpy as np

from radar_ros.messages.convert import from_fields, from_time, header, pack, stride, to_fields, unpack
from radar_tracking.tracks import Deleted, HandTrack, Reason, Track, Tracks, TrackStatus

_TRACK: Final = {name: name for name in ("id", "n_points", "nis", "dof")} | {"age": "age_s", "unseen": "unseen_s"}
_HAND: Final = {name: name for name in ("sequence", "parent_id", "active", "n_points", "value", "velocity_rank", "velocity_condition")} | {
    "outliers": "outliers",
    "unseen": "unseen_s",
}


def track_to_msg(track: Track) -> handwave.msg.Track:
    """Put one track into a message."""
    vectors = {"position": track.position, "velocity": track.velocity, "extent": track.extent, "covariance": track.covariance.ravel()}
    return handwave.msg.Track(status=int(track.status), **vectors, **to_fields(track, _TRACK))


def track_from_msg(msg: Any) -> Track:
    """Take one track out of a message."""
    vectors: dict[str, Any] = {name: np.array(getattr(msg, name)) for name in ("position", "velocity", "extent")}
    covariance = np.array(msg.covariance).reshape(6, 6)
    return Track(status=TrackStatus(msg.status), covariance=covariance, **vectors, **from_fields(msg, _TRACK))


def tracks_to_msg(tracks: Tracks) -> handwave.msg.TrackArray:
    """Put all tracks of one cloud into a message."""
    return handwave.msg.TrackArray(
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
    ended = zip(msg.deleted_id, msg.deleted_reason, msg.deleted_confirmed, strict=True)
    return Tracks(
        stamp_ns=from_time(msg.header.stamp),
        sequence=msg.sequence,
        frame_id=msg.header.frame_id,
        tracks=tuple(track_from_msg(track) for track in msg.tracks),
        point_track_id=unpack(msg.point_track_id, np.int32),
        deleted=tuple(Deleted(int(number), Reason(reason), bool(confirmed)) for number, reason, confirmed in ended),
        every=stride(msg),
    )


def hand_to_msg(hand: HandTrack) -> handwave.msg.HandTrack:
    """Put a hand track into a message."""
    vectors = {"position": hand.position, "velocity": hand.velocity, "covariance": hand.covariance.ravel()}
    return handwave.msg.HandTrack(header=header(hand.stamp_ns, hand.frame_id), **vectors, **to_fields(hand, _HAND))


def hand_from_msg(msg: Any) -> HandTrack:
    """Take a hand track out of a message."""
    vectors: dict[str, Any] = {name: np.array(getattr(msg, name)) for name in ("position", "velocity")}
    vectors["covariance"] = np.array(msg.covariance).reshape(6, 6)
    return HandTrack(stamp_ns=from_time(msg.header.stamp), frame_id=msg.header.frame_id, **vectors, **from_fields(msg, _HAND))
