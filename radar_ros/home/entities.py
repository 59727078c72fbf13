"""What Home Assistant's MQTT discovery is told of a room: one device, its entities, and the topics of their states.

The payloads follow https://www.home-assistant.io/integrations/mqtt/#mqtt-discovery, in the form of one message per entity, which every
version with discovery reads, and other smart homes too.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from radar_core import GESTURES, ConfigError

ONLINE, OFFLINE = "online", "offline"
"""Payloads of the two availability topics."""

UNKNOWN = "None"
"""Payload that makes a sensor unknown."""

_ZONE = "zone_"  # how the keys of entities of zones begin


def slug(name: str) -> str:
    """Make an identifier of a name: letters a to z, digits and underscores; what has none of them gets a number made of the name.

    ``"Living room"`` becomes ``"living_room"``, ``"Küche"`` ``"kuche"``.
    """
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    found = re.sub(r"[^a-z0-9]+", "_", plain.lower()).strip("_")
    return found or f"n{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def slugs(names: Iterable[str]) -> dict[str, str]:
    """Give each name an identifier of its own: a later one that would be equal gets a number made of its name behind it."""
    result: dict[str, str] = {}
    for name in names:
        short = slug(name)
        result[name] = f"{short}_{hashlib.sha256(name.encode()).hexdigest()[:4]}" if short in result.values() else short
    return result


def _json(payload: Mapping[str, Any]) -> str:
    return json.dumps(payload, ensure_ascii=False, separators=(",", ":"))


@dataclass(frozen=True)
class Room:
    """A room as a smart home sees it: one device.

    Attributes
    ----------
    name : str
        For people, in any language.
    base : str
        First level of the topics of states.
    prefix : str
        First level of the discovery topics: what the smart home listens to.
    """

    name: str
    base: str = "handwave"
    prefix: str = "homeassistant"

    def __post_init__(self) -> None:
        if not self.name.strip():
            raise ConfigError("a room needs a name: set the parameter room, e.g. 'Living room'")
        for what, text in (("base", self.base), ("discovery_prefix", self.prefix)):
            if not re.fullmatch(r"[^\s#+/\x00][^\s#+\x00]*(?<!/)", text):
                raise ConfigError(f"{what} is {text!r}; it must be the beginning of an MQTT topic: no blank, no # or +, no / at its ends")

    @property
    def id(self) -> str:
        """Identifier, the same after every start: it names the room's topics and the device."""
        return slug(self.name)

    @property
    def node(self) -> str:
        """Level of the discovery topics that tells this room's entities from all others."""
        return f"{self.base.replace('/', '_')}_{self.id}"

    @property
    def status(self) -> str:
        """Topic of whether this program runs and is connected; the broker says offline here when it does not (last will)."""
        return self.topic("status")

    @property
    def data(self) -> str:
        """Topic of whether the radar gives data."""
        return self.topic("data")

    @property
    def zones(self) -> str:
        """Topic of whether zones are counted."""
        return self.topic("zones")

    @property
    def all_configurations(self) -> str:
        """Filter that matches the discovery topics of this room, those of an earlier run too."""
        return f"{self.prefix}/+/{self.node}/+/config"

    def topic(self, *levels: str) -> str:
        """Topic of a state of this room."""
        return "/".join((self.base, self.id, *levels))

    def configuration(self, component: str, key: str) -> str:
        """Discovery topic of an entity."""
        return f"{self.prefix}/{component}/{self.node}/{key}/config"

    def is_zone(self, configuration: str) -> bool:
        """Whether a discovery topic of this room is about one of its zones."""
        return configuration.split("/")[-2].startswith(_ZONE)

    def zone_topic(self, key: str, what: str) -> str:
        """Topic of a zone's ``occupancy`` or ``people``; `slugs` gives the keys of zones."""
        return self.topic("zone", key, what)

    def discovery(self, zones: Sequence[str] = ()) -> dict[str, str]:
        """Discovery topics with their payloads, for the room and its zones."""
        found = {**self._sensors(), **self._gestures()}
        for name, key in slugs(zones).items():
            found |= self._presence(f"{_ZONE}{key}_occupancy", f"{name} occupancy", self.zone_topic(key, "occupancy"), zone=True)
            found |= self._count(f"{_ZONE}{key}_people", f"{name} people", self.zone_topic(key, "people"), zone=True)
        return found

    def _device(self) -> dict[str, Any]:
        version = importlib.metadata.version("handwave")
        return {
            "device": {
                "identifiers": [self.node],
                "name": self.name,
                "manufacturer": "Handwave",
                "model": "mmWave radar",
                "sw_version": version,
                "suggested_area": self.name,
            },
            "origin": {"name": "Handwave", "sw_version": version},
        }

    def _entity(self, component: str, key: str, name: str, topic: str, *needs: str, **more: Any) -> dict[str, str]:
        """One entity; it is unavailable while this program is away, and while one of the topics that it needs says so."""
        topics = (self.status, *needs)
        payload = {
            "name": name,
            "unique_id": f"{self.node}_{key}",
            "state_topic": topic,
            "availability": [{"topic": t, "payload_available": ONLINE, "payload_not_available": OFFLINE} for t in topics],
            "availability_mode": "all",
            **more,
            **self._device(),
        }
        return {self.configuration(component, key): _json(payload)}

    def _needs(self, zone: bool) -> tuple[str, ...]:
        return (self.data, self.zones) if zone else (self.data,)

    def _presence(self, key: str, name: str, topic: str, *, zone: bool = False) -> dict[str, str]:
        more = {"device_class": "occupancy", "payload_on": "ON", "payload_off": "OFF"}
        return self._entity("binary_sensor", key, name, topic, *self._needs(zone), **more)

    def _count(self, key: str, name: str, topic: str, *, zone: bool = False) -> dict[str, str]:
        more = {"unit_of_measurement": "people", "state_class": "measurement", "icon": "mdi:account-group"}
        return self._entity("sensor", key, name, topic, *self._needs(zone), **more)

    def _sensors(self) -> dict[str, str]:
        link = {"device_class": "connectivity", "payload_on": ONLINE, "payload_off": OFFLINE, "entity_category": "diagnostic"}
        percent = {"unit_of_measurement": "%", "state_class": "measurement", "icon": "mdi:hand-back-right"}
        active = {"payload_on": "ON", "payload_off": "OFF", "icon": "mdi:hand-wave"}
        return {
            **self._presence("occupancy", "Occupancy", self.topic("occupancy")),
            **self._count("people", "People", self.topic("people")),
            **self._entity("sensor", "hand", "Hand", self.topic("hand"), self.data, **percent),
            **self._entity("binary_sensor", "hand_active", "Hand active", self.topic("hand", "active"), self.data, **active),
            **self._entity("binary_sensor", "radar", "Radar", self.data, **link),
        }

    def _gestures(self) -> dict[str, str]:
        """Describe the event entity and one device trigger per gesture; all of them read the one message that a gesture makes."""
        topic, names = self.topic("gesture"), [name for name in GESTURES if name != "random"]
        found = self._entity("event", "gesture", "Gesture", topic, self.data, event_types=names, icon="mdi:gesture")
        for name in names:
            trigger = {
                "automation_type": "trigger",
                "type": "performed",
                "subtype": name,
                "topic": topic,
                "payload": name,
                "value_template": "{{ value_json.event_type }}",
                **self._device(),
            }
            found[self.configuration("device_automation", name)] = _json(trigger)
        return found


def on_off(value: bool) -> str:
    """Payload of a binary sensor."""
    return "ON" if value else "OFF"


def gesture_event(name: str, confidence: float, person: int, **where: Any) -> str:
    """Payload of one gesture: what was performed, how sure that is (0 to 1), the number of the track whose it is, and where."""
    return _json({"event_type": name, "confidence": round(confidence, 3), "person": person, **where})
