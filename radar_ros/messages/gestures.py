"""Gestures to and from ROS messages."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from handwave.msg import Gesture as GestureMsg
from handwave.msg import GestureMaps as GestureMapsMsg

from radar_core import DataError
from radar_gestures.maps import FeatureMaps
from radar_gestures.recognizer import Gesture
from radar_gestures.stage import TrackEvent
from radar_ros.messages.convert import from_time, header, pack, to_time, unpack

_MAPS: Final[tuple[str, ...]] = ("speed", "micro_doppler", "azimuth", "elevation", "distance")


def gesture_to_msg(gesture: Gesture) -> GestureMsg:
    """Put a gesture into a message."""
    return GestureMsg(
        header=header(gesture.stamp_ns, gesture.frame_id),
        track_id=gesture.track_id,
        label=gesture.label,
        name=gesture.name,
        confidence=float(gesture.confidence),
        known=bool(gesture.known),
        probabilities=pack(gesture.probabilities, "d"),
        start=to_time(gesture.start_ns),
        end=to_time(gesture.end_ns),
        latency_s=gesture.latency,
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
        known=msg.known,
    )


def maps_to_msg(found: TrackEvent, maps: FeatureMaps, stamp_ns: int) -> GestureMapsMsg:
    """Put the maps of an event that was decided at ``stamp_ns`` into a message."""
    return GestureMapsMsg(
        header=header(stamp_ns, "room"),
        track_id=found.track_id,
        start=to_time(found.event.start_ns),
        end=to_time(found.event.end_ns),
        stamp_ns=pack(maps.stamp_ns, "q"),
        **{name: pack(getattr(maps, name), "f") for name in _MAPS},
    )


def maps_from_msg(msg: Any) -> FeatureMaps:
    """Take feature maps out of a message.

    Raises
    ------
    DataError
        When an array is not as long as the clouds and gates ask for.
    """
    stamps, arrays = unpack(msg.stamp_ns, np.int64), {name: unpack(getattr(msg, name), np.float32) for name in _MAPS}
    shape = len(stamps), len(arrays["speed"])
    for name in _MAPS[1:]:
        if arrays[name].size != shape[0] * shape[1]:
            raise DataError(
                f"gestures/maps of track {msg.track_id}: {name} has {arrays[name].size} values, but there are {shape[0]} clouds and "
                f"{shape[1]} gates; whatever sent it is broken or of another version"
            )
        arrays[name] = arrays[name].reshape(shape)
    return FeatureMaps(stamps, **arrays)
