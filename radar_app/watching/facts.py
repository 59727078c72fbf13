"""What a graph sees at one moment, as records of plain values: radars, people, zones, hands, and the last gesture."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any, Final

from rich.text import Text

from radar_app.watching.health import Health
from radar_app.watching.lines import RECORDS
from radar_app.watching.listener import Listener
from radar_app.watching.people import place
from radar_core import HandwaveError, RadarInfo
from radar_ros.messages.convert import info_from_msg
from radar_tracking.fusion.clouds import sensors

_LINES: Final = 4  # people, and zones, that have a line of their own on the screen


class Facts:
    """Hears what a graph sees; the newest of everything, by namespace."""

    def __init__(self, listener: Listener) -> None:
        self._radars: dict[str, RadarInfo] = {}
        self._last: dict[str, dict[str, dict[str, Any]]] = {what: {} for what in ("people", "hand", "zones")}
        listener.hear_each("radar/info", self._info)
        for what in self._last:
            listener.hear_each(RECORDS[what][0], partial(self._take, what))

    def _info(self, space: str, msg: Any) -> None:
        try:
            self._radars[space] = info_from_msg(msg)
        except (HandwaveError, ValueError):
            return  # the nodes complain; here it is only not told

    def _take(self, what: str, space: str, msg: Any) -> None:
        self._last[what][space] = RECORDS[what][1](space, msg)

    @property
    def counts(self) -> dict[str, int]:
        """How many people are there, by namespace of the tracks."""
        return {space: record["count"] for space, record in self._last["people"].items()}

    def records(self, health: Health) -> dict[str, list[dict[str, Any]]]:
        """Give radars, persons, zones, hands that are followed, and the last gesture of each gesture node."""
        people, zones, hands = (self._last[what].items() for what in ("people", "zones", "hand"))
        return {
            "radars": [_radar(info) for info in sensors(self._radars.values())],
            "persons": [{"namespace": space, **person} for space, record in people for person in record["people"]],
            "zones": [{"namespace": space, **zone} for space, record in zones for zone in record["zones"]],
            "hands": [_plain(record) for _, record in hands if record["active"]],
            "gestures": [found for name in sorted(health.heard) if (found := _gesture(name, health.values(name)))],
        }


def _plain(record: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in record.items() if key not in ("type", "active")}


def _radar(info: RadarInfo) -> dict[str, Any]:
    """Where a radar stands [m], where it looks and how wide [degrees], and how far [m]."""
    mount, reach = info.mount, info.waveform.max_range if info.waveform.n_sample else math.nan
    turned, wide = math.degrees(mount.yaw), math.degrees(info.array.fov_azimuth)
    return {"name": info.frame_id, "position": list(mount.origin), "yaw_deg": turned, "view_deg": wide, "range": reach}


def _gesture(node: str, values: Mapping[str, str]) -> dict[str, Any]:
    """Read the last gesture that a node tells of; empty: none."""
    try:
        return {
            "namespace": f"/{node.rpartition('/')[0]}",
            "gesture": values["last_gesture"],
            "person": int(values["last_gesture_person"]),
            "confidence": float(values["last_gesture_confidence"]),
            "ago": float(values["last_gesture_ago_s"]),
        }
    except (KeyError, ValueError):
        return {}


def screen(facts: Mapping[str, list[dict[str, Any]]]) -> list[Text]:
    """Write what is seen in lines of 80 columns; what belongs to one room of several has its name in front."""
    several = len({each["namespace"] for what in ("persons", "zones") for each in facts[what]}) > 1

    def where(each: Mapping[str, Any]) -> str:
        return f"{each['namespace'].strip('/')}: " if several and each["namespace"] != "/" else ""

    people = [f"{where(each)}person {each['person']}: {place(each['position'])}, {_speed(each):.1f} m/s" for each in facts["persons"]]
    zones = [
        f"{where(each)}zone {each['name']}: {each['presence']}, {each['count']} in it"
        for each in facts["zones"]
        if each["kind"] != "boundary"
    ]
    hands = [f"{where(each)}hand of person {each['person']} at {each['value']:.0%}" for each in facts["hands"]]
    gestures = [
        f"{where(each)}last gesture: {each['gesture'].replace('_', ' ')} of person {each['person']}, {each['confidence']:.0%} sure, "
        f"{each['ago']:.0f} s ago"
        for each in facts["gestures"]
    ]
    return [Text(line, no_wrap=True, overflow="ellipsis") for lines in (people, zones, hands, gestures) for line in _few(lines)]


def _few(lines: list[str]) -> list[str]:
    return lines if len(lines) <= _LINES else [*lines[: _LINES - 1], f"and {len(lines) - _LINES + 1} more: --json has all"]


def _speed(person: Mapping[str, Any]) -> float:
    return math.hypot(person["velocity"][0], person["velocity"][1])
