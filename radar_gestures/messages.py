"""Gestures to and from ROS messages."""

from __future__ import annotations

from typing import Any

import numpy as np
from handwave.msg import Gesture as GestureMsg

from radar_gestures.recognizer import Gesture
from radar_ros.convert import from_time, header, pack, to_time, unpack


def gesture_to_msg(gesture: Gesture) -> GestureMsg:
    """Put a gesture into a message."""
    return GestureMsg(
        header=header(gesture.stamp_ns, gesture.frame_id),
        track_id=gesture.track_id,
        label=gesture.label,
        name=gesture.name,
        confidence=float(gesture.confidence),
        probabilities=pack(gesture.probabilities, "d"),
        start=to_time(gesture.start_ns),
        end=to_time(gesture.end_ns),
        features=pack(gesture.features, "d"),
    )


def gesture_from_msg(msg: Any) -> Gesture:
    """Take a gesture out of a message."""
    return Gesture(
        stamp_ns=from_time(msg.header.stamp),
        frame_id=msg.header.frame_id,
        track_id=msg.track_id,
        label=msg.label,
        name=msg.name,
        confidence=msg.confidence,
        probabilities=unpack(msg.probabilities, np.float64),
        start_ns=from_time(msg.start),
        end_ns=from_time(msg.end),
        features=unpack(msg.features, np.float64),
    )
