"""What a graph says, as lines of JSON and as lines for people."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from radar_app.watching.people import Comings, gesture_words, is_gesture, is_person
from radar_core import GESTURES
from radar_ros.messages.convert import from_time
from radar_tracking.zones.area import KINDS
from radar_tracking.zones.result import Presence

STATUS: Final = ("tentative", "confirmed", "coasting")
"""Words for the status of a track, by its number."""


def _head(kind: str, space: str, msg: Any) -> dict[str, Any]:
    return {"type": kind, "namespace": space, "time": from_time(msg.header.stamp) * 1e-9}


def gesture_record(space: str, msg: Any) -> dict[str, Any]:
    """Make a gesture a record: times in seconds of the graph's clock, confidence 0 to 1, place in metres."""
    start, end = from_time(msg.start) * 1e-9, from_time(msg.end) * 1e-9
    about = {"person": msg.track_id, "gesture": msg.name, "confidence": msg.confidence, "known": msg.known, "start": start, "end": end}
    labels = list(msg.labels) or list(GESTURES)
    sure = dict(zip(labels, msg.probabilities, strict=False)) if len(labels) == len(msg.probabilities) else {}
    return {**_head("gesture", space, msg), **about, "position": msg.position, "zones": list(msg.zones), "probabilities": sure}


def people_record(space: str, msg: Any) -> dict[str, Any]:
    """Make the people of one message of tracks a record: places in metres, velocities in metres per second."""
    people = [
        {
            "person": track.id,
            "status": STATUS[track.status],
            "position": track.position,
            "velocity": track.velocity,
            "points": track.n_points,
            "unseen": track.unseen_s,
            "age": track.age_s,
        }
        for track in msg.tracks
        if is_person(track)
    ]
    return {**_head("people", space, msg), "count": len(people), "people": people}


def hand_record(space: str, msg: Any) -> dict[str, Any]:
    """Make a hand a record: its control value is 0 to 1; ``active`` is false in the message that ends it."""
    about = {"person": msg.parent_id, "active": msg.active, "value": msg.value, "position": msg.position, "velocity": msg.velocity}
    return {**_head("hand", space, msg), **about}


def zones_record(space: str, msg: Any) -> dict[str, Any]:
    """Make the state of all zones a record; ``presence`` is empty, occupied or unknown."""
    return {**_head("zones", space, msg), "stale": msg.stale, "zones": [_zone(zone) for zone in (msg.room, *msg.zones)]}


def _zone(zone: Any) -> dict[str, Any]:
    return {
        "name": zone.name,
        "kind": KINDS[zone.kind] if zone.kind < len(KINDS) else str(zone.kind),
        "presence": _presence(zone),
        "count": zone.count,
        "people": list(zone.track_id),
        "dwell": zone.dwell_s,
    }


def _presence(zone: Any) -> str:
    return Presence(zone.presence).name.lower() if zone.presence in list(Presence) else "unknown"


RECORDS: Final[dict[str, tuple[str, Callable[[str, Any], dict[str, Any]]]]] = {
    "gestures": ("gestures", gesture_record),
    "people": ("tracks", people_record),
    "hand": ("hand", hand_record),
    "zones": ("zones", zones_record),
}
"""What can be listened to: topic, and what makes a record of its messages."""


class Words:
    """Make of what comes the lines that a person reads, who wants to know what changes and not what stays."""

    def __init__(self) -> None:
        self._comings: dict[str, Comings] = {}
        self._hands: dict[str, int] = {}
        self._zones: dict[tuple[str, str], str] = {}

    def process(self, what: str, space: str, msg: Any) -> list[str]:
        """Take a message of one of `RECORDS`; returns lines, none where nothing changed."""
        if what == "gestures":
            lines = [gesture_words(msg)] if is_gesture(msg) else []
        elif what == "people":
            lines = [coming.words for coming in self._comings.setdefault(space, Comings()).process(msg)]
        elif what == "hand":
            lines = self._hand(space, msg)
        else:
            lines = self._zone(space, msg)
        where = "" if space == "/" else f"{space.strip('/')}: "
        return [where + line for line in lines]

    def _hand(self, space: str, msg: Any) -> list[str]:
        tenth = round(msg.value * 10) if msg.active else -1
        if self._hands.get(space, -1) == tenth:
            return []
        self._hands[space] = tenth
        return [f"hand of person {msg.parent_id} at {msg.value:.0%}" if msg.active else "hand: not followed any more"]

    def _zone(self, space: str, msg: Any) -> list[str]:
        lines = []
        for zone in (msg.room, *msg.zones):
            said = f"{_presence(zone)}, {zone.count} {'person' if zone.count == 1 else 'people'}"
            if self._zones.get((space, zone.name)) != said:
                self._zones[space, zone.name] = said
                lines.append(f"zone {zone.name}: {said}")
        return lines
