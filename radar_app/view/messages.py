"""From ROS messages to what the feed keeps; live and from a bag alike."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

from radar_app.view.feed import Feed
from radar_app.view.records import EventMaps, Level, NodeHealth
from radar_app.watching.reports import reports_from_msg
from radar_core import HandwaveError
from radar_ros.messages.convert import cloud_from_msg, from_time, info_from_msg
from radar_ros.messages.gestures import gesture_from_msg, maps_from_msg
from radar_ros.messages.tracks import hand_from_msg, tracks_from_msg
from radar_ros.messages.zones import areas_from_msg
from radar_tracking.zones import Occupant, Presence, ZoneState, ZoneStates
from radar_tracking.zones.area import Area

_LEVELS: Final[Mapping[int, Level]] = {0: "ok", 1: "warn", 2: "error", 3: "stale"}
_BOUNDARY: Final = 3  # kind of a zone that is a boundary, or the room without one


def zones_from_msg(msg: Any) -> ZoneStates:
    """Take the states of all zones out of a message; a `DataError` says that one of them makes no sense."""
    areas = dict(areas_from_msg(msg))
    room = _zone(msg.room, _room_area(msg.room))
    zones = tuple(_zone(zone, areas[zone.name]) for zone in msg.zones)
    return ZoneStates(from_time(msg.header.stamp), msg.sequence, bool(msg.stale), room, zones)


def _room_area(msg: Any) -> Area | None:
    corners = tuple(zip(msg.polygon[0::2], msg.polygon[1::2], strict=False))
    return Area("boundary", corners, msg.z_low, msg.z_high) if corners else None


def _zone(msg: Any, area: Area | None) -> ZoneState:
    people = tuple(Occupant(int(who), float(dwell)) for who, dwell in zip(msg.track_id, msg.person_dwell_s, strict=False))
    return ZoneState(msg.name, area, Presence(msg.presence), from_time(msg.since), msg.dwell_s, people)


def health_from_msg(msg: Any) -> list[NodeHealth]:
    """Take what nodes say of themselves out of a message of diagnostics."""
    return [
        NodeHealth(
            status.name, _LEVELS.get(_number(status.level), "error"), status.message, {pair.key: pair.value for pair in status.values}
        )
        for status in msg.status
    ]


def _number(level: bytes | int) -> int:
    return level[0] if isinstance(level, bytes) else int(level)


class Taker:
    """Puts messages into a feed; one that makes no sense costs itself only, and is counted.

    Attributes
    ----------
    refused : int
        Messages that made no sense.
    reason : str
        Of the last of them.
    """

    def __init__(self, feed: Feed) -> None:
        self._feed = feed
        self.refused, self.reason = 0, ""

    @property
    def note(self) -> str:
        """What people should know of it; empty: nothing."""
        return f"{self.refused} messages make no sense; the last: {self.reason}" if self.refused else ""

    def take(self, topic: str, msg: Any, place: str = "") -> None:
        """Take in one message, by its topic's name within the namespace; ``place`` is the namespace of its radar."""
        try:
            _TAKE[topic](self._feed, msg, place)
        except (HandwaveError, ValueError, KeyError) as error:
            self.refused += 1
            self.reason = f"{topic}: {error}"


def _cloud(feed: Feed, msg: Any, place: str) -> None:
    cloud = cloud_from_msg(msg)
    if cloud.frame_id != "room":
        info = feed.radars.get(cloud.frame_id)
        if info is None:
            return  # where it stands is not known yet
        cloud = cloud.to_room(info.mount)
    feed.put("clouds", cloud.stamp_ns, cloud)


def _tracks(feed: Feed, msg: Any, place: str) -> None:
    tracks = tracks_from_msg(msg)
    if all(math.isfinite(value) for track in tracks.tracks for value in track.position.tolist()):
        feed.put("tracks", tracks.stamp_ns, tracks)


def _gesture(feed: Feed, msg: Any, place: str) -> None:
    gesture = gesture_from_msg(msg)
    feed.put("gestures", gesture.stamp_ns, gesture)


def _maps(feed: Feed, msg: Any, place: str) -> None:
    stamp = from_time(msg.header.stamp)
    feed.put("maps", stamp, EventMaps(stamp, msg.track_id, from_time(msg.start), from_time(msg.end), maps_from_msg(msg)))


def _hand(feed: Feed, msg: Any, place: str) -> None:
    hand = hand_from_msg(msg)
    feed.put("hand", hand.stamp_ns, hand)


def _zones(feed: Feed, msg: Any, place: str) -> None:
    states = zones_from_msg(msg)
    feed.put("zones", states.stamp_ns, states)


def _status(feed: Feed, msg: Any, place: str) -> None:
    for report in reports_from_msg(msg, place):
        feed.put("status", report.stamp_ns, report)


def _diagnostics(feed: Feed, msg: Any, place: str) -> None:
    for health in health_from_msg(msg):
        feed.put("health", from_time(msg.header.stamp), health)


def _info(feed: Feed, msg: Any, place: str) -> None:
    feed.know(info_from_msg(msg))


_TAKE: Final[Mapping[str, Callable[[Feed, Any, str], None]]] = {
    "radar/points": _cloud,
    "tracks": _tracks,
    "gestures": _gesture,
    "gestures/maps": _maps,
    "hand": _hand,
    "zones": _zones,
    "stage_status": _status,
    "diagnostics": _diagnostics,
    "radar/info": _info,
}
TOPICS: Final = tuple(_TAKE)
"""What is taken in; raw frames are for `spectra`."""
