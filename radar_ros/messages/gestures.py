"""Gestures to and from ROS messages."""

from __future__ import annotations

from typing import Any, Final

import handwave.msg
import numpy as np

from radar_core import GESTURES, DataError
from radar_gestures.gesture import Gesture
from radar_gestures.maps import FeatureMaps
from radar_gestures.stage import TrackEvent
from radar_ros.messages.convert import from_fields, from_time, header, pack, pack_all, to_fields, to_time, unpack, unpack_all

_MAPS: Final = dict.fromkeys(("speed", "micro_doppler", "azimuth", "elevation", "distance"), "f")
_GESTURE: Final = {name: name for name in ("track_id", "label", "name", "confidence", "known")}
_ARRAYS: Final = {"probabilities": "d", "features": "d"}


def gesture_to_msg(gesture: Gesture) -> handwave.msg.Gesture:
    """Put a gesture into a message."""
    return handwave.msg.Gesture(
        header=header(gesture.stamp_ns, gesture.frame_id),
        start=to_time(gesture.start_ns),
        end=to_time(gesture.end_ns),
        latency_s=gesture.latency,
        position=gesture.position,
        zones=list(gesture.zones),
        labels=list(gesture.labels),
        **to_fields(gesture, _GESTURE),
        **pack_all(gesture, _ARRAYS),
    )


def gesture_from_msg(msg: Any) -> Gesture:
    """Take a gesture out of a message."""
    return Gesture(
        stamp_ns=from_time(msg.header.stamp),
        frame_id=msg.header.frame_id,
        start_ns=from_time(msg.start),
        end_ns=from_time(msg.end),
        position=np.array(msg.position),
        zones=tuple(msg.zones),
        **from_fields(msg, _GESTURE),
        **unpack_all(msg, _ARRAYS),
        labels=tuple(msg.labels) or GESTURES,
    )


def maps_to_msg(found: TrackEvent, maps: FeatureMaps, stamp_ns: int) -> handwave.msg.GestureMaps:
    """Put the maps of an event that was decided at ``stamp_ns`` into a message."""
    return handwave.msg.GestureMaps(
        header=header(stamp_ns, "room"),
        track_id=found.track_id,
        start=to_time(found.event.start_ns),
        end=to_time(found.event.end_ns),
        stamp_ns=pack(maps.stamp_ns, "q"),
        **pack_all(maps, _MAPS),
    )


def maps_from_msg(msg: Any) -> FeatureMaps:
    """Take feature maps out of a message.

    Raises
    ------
    DataError
        When an array is not as long as the clouds and gates ask for.
    """
    stamps, arrays = unpack(msg.stamp_ns, np.int64), unpack_all(msg, _MAPS)
    speed = arrays.pop("speed")
    for name, values in arrays.items():
        if values.size != len(stamps) * len(speed):
            raise DataError(
                f"gestures/maps of track {msg.track_id}: {name} has {values.size} values, but there are {len(stamps)} clouds and "
                f"{len(speed)} gates; whatever sent it is broken or of another version"
            )
        arrays[name] = values.reshape(len(stamps), len(speed))
    return FeatureMaps(stamps, speed, **arrays)
