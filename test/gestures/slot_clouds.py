"""People and their points in small clouds, and the slots that these make; shared by tests of networks on streams."""

from __future__ import annotations

import numpy as np

from radar_core import PointCloud, RadarInfo
from radar_gestures.stream.slots import SLOT_NS, SlotStreams
from radar_tracking.tracks import Track, TrackedCloud, Tracks, TrackStatus

INFO = RadarInfo()
STEP = 20_000_000  # ns


def person(track_id=1, position=(2.0, 0.0, 1.0), velocity=(0.0, 0.0, 0.0), status=TrackStatus.CONFIRMED):
    return Track(track_id, status, 1.0, 0.0, 6, np.array(position), np.array(velocity), np.full(3, 0.2), np.eye(6))


def tracked(stamp_ns, people, points):
    """Points (owner, x, y, z, range rate, SNR) in ``room``."""
    rows = np.array(points, np.float64).reshape(-1, 6)
    x, y, z, speed, snr = rows[:, 1:].T.astype(np.float32).copy()
    cloud = PointCloud(stamp_ns, stamp_ns // STEP, "room", x, y, z, radial_speed=speed, snr=snr)
    return TrackedCloud(cloud, Tracks(stamp_ns, cloud.sequence, "room", tuple(people), rows[:, 0].astype(np.int32)))


def one_slot(people, points, info=INFO):
    """The features of a slot that holds one cloud."""
    streams = SlotStreams(info)
    assert not streams.process(tracked(0, people, points))
    (slot,) = streams.process(tracked(SLOT_NS, people, []))
    return slot.features
