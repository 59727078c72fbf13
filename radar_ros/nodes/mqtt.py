"""MQTT node: people, gestures and the hand of one room for Home Assistant and other smart homes."""

from __future__ import annotations

import math
import time
from typing import Any

import handwave.msg
from rclpy.clock import Clock, ClockType
from std_msgs.msg import UInt32

from radar_core.config import config, knob
from radar_ros import qos
from radar_ros.home.broker import BrokerConfig, Link, read_password
from radar_ros.home.entities import OFFLINE, ONLINE, UNKNOWN, Room, gesture_event, on_off, slugs
from radar_ros.params import declare_config
from radar_ros.stage import StageNode, run

_ZONES_GONE = 3.0  # s without zones; they come once a second at least
_SHOWN = (handwave.msg.Zone.COUNTING, handwave.msg.Zone.ENTRANCE)  # what excludes a fan, or bounds the room, is no place to be in
_PRESENCE = {handwave.msg.Zone.EMPTY: on_off(False), handwave.msg.Zone.OCCUPIED: on_off(True)}
_TICK = 0.1  # s: how often the node looks at the connection, and whether data has become old


@config
class MqttConfig(BrokerConfig):
    """How a room appears in a smart home, and the broker that tells it."""

    room: str = knob("", doc="name of the room; empty: the namespace, else Handwave")
    base: str = knob("handwave", doc="first level of the topics of states")
    discovery_prefix: str = knob("homeassistant", doc="first level of the discovery topics; the smart home's setting")
    hand_rate: float = knob(5.0, doc="most values of the hand per second", unit="Hz", low=0.1, high=50.0)


class MqttNode(StageNode):
    """Tells a broker what the graph finds: states that are retained, gestures as they happen, and whether to believe either."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("mqtt", **kwargs)
        self._config = broker = declare_config(self, MqttConfig)
        name = self._config.room or self.get_namespace().strip("/").replace("_", " ").replace("/", " ").strip().capitalize() or "Handwave"
        self._room = Room(name, self._config.base, self._config.discovery_prefix)
        self._address = broker.address
        password, advice = read_password(broker)
        for text in filter(None, (advice, _unencrypted(broker, password))):
            self.get_logger().warning(text)
        room = self._room
        self._link = Link(broker, password, room.node, (room.status, OFFLINE), room.all_configurations)
        self._zones_heard = -1e9  # when zones came that were not stale, on CLOCK_MONOTONIC [s]
        self._zones: dict[str, str] | None = None  # names of zones and the keys of their topics; None: zones never came
        self._hand_heard = self._hand_said = -1e9  # when a hand came, when its value was said
        self._hand: int | None = None  # value that was not said yet [%]
        self._lost = 0  # gestures that there was no connection for
        self._wanted: set[str] = set()  # discovery topics
        self._earlier: set[str] = set()  # those that an earlier run left; of zones nothing is taken away until it is known which there are
        self._discover()
        self._link.keep(room.status, ONLINE)
        self._link.keep(room.data, OFFLINE)
        self._link.keep(room.zones, OFFLINE)
        self._link.keep(room.topic("hand", "active"), on_off(False))
        self.create_subscription(UInt32, "people_count", self._count, qos.NEWEST)
        self.create_subscription(handwave.msg.ZoneArray, "zones", self._take_zones, qos.LATCHED)
        self.create_subscription(handwave.msg.Gesture, "gestures", self._gesture, qos.RESULT)
        self.create_subscription(handwave.msg.HandTrack, "hand", self._take_hand, qos.RESULT)
        # Of its own clock: with simulated time nothing would notice that /clock stands still because all the others are gone.
        self.create_timer(_TICK, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._link.start()

    def _discover(self) -> None:
        """Say which entities there are, and take away those that there are no more."""
        found = self._room.discovery(tuple(self._zones or ()))
        for topic in self._wanted - set(found):
            self._link.keep(topic, "")
        self._wanted = set(found)
        for topic, payload in found.items():
            self._link.keep(topic, payload)

    def _count(self, msg: Any) -> None:
        self.hear()
        if time.monotonic() - self._zones_heard > _ZONES_GONE:  # zones know better who is in the room
            self._link.keep(self._room.topic("people"), str(msg.data))
            self._link.keep(self._room.topic("occupancy"), on_off(msg.data > 0))
        self._link.keep(self._room.data, ONLINE)
        self.processed += 1

    def on_stale(self) -> None:
        """Nobody knows any longer who is there."""
        self._link.keep(self._room.data, OFFLINE)

    def _take_zones(self, msg: Any) -> None:
        room, shown = self._room, [zone for zone in msg.zones if zone.kind in _SHOWN]
        zones = slugs(zone.name for zone in shown)
        if zones != self._zones:
            for key in set((self._zones or {}).values()) - set(zones.values()):
                for what in ("occupancy", "people"):
                    self._link.keep(room.zone_topic(key, what), "")
            self._zones = zones
            self._discover()
        if msg.stale:
            self._zones_heard = -1e9
            self._link.keep(room.zones, OFFLINE)
            return
        self._zones_heard = time.monotonic()
        self._keep_zone(msg.room, room.topic("occupancy"), room.topic("people"))
        for zone in shown:
            key = zones[zone.name]
            self._keep_zone(zone, room.zone_topic(key, "occupancy"), room.zone_topic(key, "people"))
        self._link.keep(room.zones, ONLINE)

    def _keep_zone(self, zone: Any, occupancy: str, people: str) -> None:
        known = _PRESENCE.get(zone.presence)
        self._link.keep(occupancy, known or UNKNOWN)
        self._link.keep(people, str(zone.count) if known else UNKNOWN)

    def _gesture(self, msg: Any) -> None:
        if msg.label == handwave.msg.Gesture.RANDOM:
            return
        where: dict[str, Any] = {"zones": list(msg.zones)}
        if all(map(math.isfinite, msg.position)):
            where["position"] = [round(float(x), 2) for x in msg.position]
        if self._link.tell(self._room.topic("gesture"), gesture_event(msg.name, msg.confidence, msg.track_id, **where)):
            self.processed += 1
        else:  # never late: who performed it has long done something else
            self._lost += 1
            self.dropped += 1
            self.caution(f"the gesture {msg.name} was not told: there is no connection to the MQTT broker {self._address}")

    def _take_hand(self, msg: Any) -> None:
        self._hand_heard = time.monotonic()
        if msg.active:
            self._hand = round(100 * min(max(msg.value, 0.0), 1.0))
        self._link.keep(self._room.topic("hand", "active"), on_off(msg.active))
        self._say_hand(last=not msg.active)

    def _say_hand(self, *, last: bool = False) -> None:
        """Tell the hand's value, not too often; the last one always."""
        now = time.monotonic()
        if self._hand is not None and (last or now - self._hand_said >= 1.0 / self._config.hand_rate):
            self._link.keep(self._room.topic("hand"), str(self._hand))
            self._hand, self._hand_said = None, now

    def _tick(self) -> None:
        now = time.monotonic()
        if now - self._zones_heard > _ZONES_GONE:
            self._link.keep(self._room.zones, OFFLINE)
        if now - self._hand_heard > (self.silence.after or math.inf):
            self._link.keep(self._room.topic("hand", "active"), on_off(False))
        self._say_hand()
        while not self._link.said.empty():
            bad, text = self._link.said.get()
            if bad:
                self.problem(text)
            else:
                self.get_logger().info(text)
        while not self._link.received.empty():
            topic, payload = self._link.received.get()
            if payload and topic not in self._wanted:
                self._earlier.add(topic)
        for topic in [t for t in self._earlier if self._zones is not None or not self._room.is_zone(t)]:
            self._earlier.remove(topic)
            if topic not in self._wanted:
                self._link.keep(topic, "")

    def extra_diagnostics(self) -> tuple[dict[str, Any], list[str]]:
        """Whether there is a broker, and what was lost without one."""
        up = self._link.connected
        values = {"broker": self._address, "connected": up, "connections": self._link.connections, "gestures_lost": self._lost}
        return values, [] if up else [f"no connection to the MQTT broker {self._address}"]

    def close(self) -> None:
        """Say goodbye, and end the connection."""
        self._link.close()


def _unencrypted(broker: BrokerConfig, password: str | None) -> str:
    """Say what is unwise about a password without TLS; empty: nothing."""
    if password is None or broker.tls or broker.host in ("localhost", "127.0.0.1", "::1"):
        return ""
    return f"the password for {broker.address} crosses the network unencrypted; the parameter tls encrypts it"


make_node = MqttNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
