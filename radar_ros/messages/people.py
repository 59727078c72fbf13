"""People as messages of other packages: `vision_msgs` detections and the bodies of REP-155 (`hri_msgs`), where those are installed."""

from __future__ import annotations

import importlib
import math
from typing import Any, Final

import numpy as np
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from tf2_msgs.msg import TFMessage

from radar_tracking.tracks import Track, Tracks

_HEIGHT: Final = 1.7  # m: of a person's box; the few points of a body do not tell how tall it is
_WIDTH: Final = 0.5  # m: of one whose extent is not known
_WALKS: Final = 0.3  # m/s: from here on somebody is taken to face where they walk


def messages_of(package: str) -> Any:
    """Give the messages of a package; None where it is not installed."""
    try:
        return importlib.import_module(f"{package}.msg")
    except ImportError:
        return None


def people_of(tracks: Tracks) -> list[Track]:
    """Those tracks that are people: confirmed, seen by this cloud or not."""
    return list(tracks.people)


def body_id(track: Track) -> str:
    """Name of a body as REP-155 wants it: short, unique in a run, and fit for topics and frames."""
    return f"{track.id:05d}"


def detections_to_msg(vision: Any, tracks: Tracks, header: Any) -> Any:
    """Make a `vision_msgs/Detection3DArray`: class ``person``, a box on the floor, the track's id and covariance.

    Parameters
    ----------
    vision : module
        ``vision_msgs.msg``.
    tracks : Tracks
        In ``room``.
    header : std_msgs.msg.Header
        Of the tracks.
    """
    result = vision.Detection3DArray()
    result.header = header
    for track in people_of(tracks):
        found, guess = vision.Detection3D(), vision.ObjectHypothesisWithPose()
        found.header, found.id = header, str(track.id)
        guess.hypothesis.class_id, guess.hypothesis.score = "person", 1.0
        guess.pose.pose.position.x, guess.pose.pose.position.y, guess.pose.pose.position.z = (float(value) for value in track.position)
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = np.nan_to_num(np.asarray(track.covariance)[:3, :3])
        guess.pose.covariance = covariance.ravel()
        found.results = [guess]
        center, size = found.bbox.center.position, found.bbox.size
        center.x, center.y, center.z = float(track.position[0]), float(track.position[1]), _HEIGHT / 2
        size.x, size.y = (4.0 * float(spread) if math.isfinite(spread) else _WIDTH for spread in track.extent[:2])
        size.z = _HEIGHT
        result.detections = [*result.detections, found]
    return result


def bodies_to_msg(hri: Any, tracks: Tracks, header: Any) -> Any:
    """Make the `hri_msgs/IdsList` of ``/humans/bodies/tracked``; ``hri`` is ``hri_msgs.msg``."""
    result = hri.IdsList()
    result.header, result.ids = header, [body_id(track) for track in people_of(tracks)]
    return result


def body_frames(tracks: Tracks, header: Any) -> TFMessage:
    """Make the frames ``body_<id>`` of REP-155: where the body is, x along its walk; along the room's x while it stands."""
    transforms = []
    for track in people_of(tracks):
        speed = math.hypot(track.velocity[0], track.velocity[1])
        yaw = math.atan2(track.velocity[1], track.velocity[0]) if speed >= _WALKS else 0.0
        transform = TransformStamped(header=header, child_frame_id=f"body_{body_id(track)}")
        transform.transform.translation = Vector3(**dict(zip("xyz", map(float, track.position), strict=True)))
        transform.transform.rotation = Quaternion(z=math.sin(yaw / 2), w=math.cos(yaw / 2))
        transforms.append(transform)
    return TFMessage(transforms=transforms)
