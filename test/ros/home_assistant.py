"""A smart home that does with discovery what Home Assistant says it does, over a real broker.

Sources, all public: https://www.home-assistant.io/integrations/mqtt/#mqtt-discovery, .../binary_sensor.mqtt/, .../sensor.mqtt/,
.../event.mqtt/, .../device_trigger.mqtt/, and schemas.py, event.py and device_trigger.py in
https://github.com/home-assistant/core/tree/dev/homeassistant/components/mqtt
"""

import json
import re
import threading
import time

import paho.mqtt.client as mqtt

_AVAILABILITY = {"availability", "availability_mode", "availability_topic", "availability_template"}
_AVAILABILITY |= {"payload_available", "payload_not_available"}
_LOOK = {"name", "icon", "device", "origin", "unique_id", "enabled_by_default", "entity_category"}
COMMON = _AVAILABILITY | _LOOK | {"encoding", "qos", "state_topic", "value_template", "json_attributes_template", "json_attributes_topic"}
REQUIRED = {
    "binary_sensor": {"state_topic"},
    "sensor": {"state_topic"},
    "event": {"state_topic", "event_types"},
    "device_automation": {"automation_type", "topic", "type", "subtype", "device"},
}
"""Keys without which Home Assistant refuses a component."""

OPTIONAL = {
    "binary_sensor": COMMON | {"device_class", "expire_after", "force_update", "off_delay", "payload_on", "payload_off"},
    "sensor": COMMON
    | {"device_class", "expire_after", "force_update", "last_reset_value_template", "state_class", "suggested_display_precision"}
    | {"unit_of_measurement", "options"},
    "event": COMMON | {"device_class"},
    "device_automation": {"payload", "qos", "value_template", "origin"},
}
"""Keys that it reads; it leaves out all others without a word, typing mistakes included."""

DEVICE = {"identifiers", "connections", "manufacturer", "model", "model_id", "name", "hw_version", "serial_number", "sw_version"}
DEVICE |= {"via_device", "suggested_area", "configuration_url"}
ORIGIN = {"name", "sw_version", "support_url"}
CLASSES = {"binary_sensor": {"occupancy", "connectivity", "presence"}, "sensor": {"duration"}, "event": {"button"}}
TOPIC = re.compile(r"(?P<prefix>[^/]+)/(?P<component>\w+)/(?:(?P<node>[a-zA-Z0-9_-]+)/)?(?P<object>[a-zA-Z0-9_-]+)/config")


def check(topic, payload):
    """Refuse what Home Assistant would refuse or leave out; returns component and configuration."""
    match = TOPIC.fullmatch(topic)
    assert match, f"no discovery topic: {topic}"
    component, given = match["component"], json.loads(payload)
    assert component in REQUIRED, component
    assert REQUIRED[component] <= set(given), (topic, REQUIRED[component] - set(given))
    unknown = set(given) - REQUIRED[component] - OPTIONAL[component]
    assert not unknown, (topic, unknown)
    assert set(given["device"]) <= DEVICE
    assert given["device"].get("identifiers") or given["device"].get("connections")
    assert "name" in given["origin"]
    assert set(given["origin"]) <= ORIGIN
    assert given.get("state_class") in (None, "measurement", "total", "total_increasing")
    assert given.get("entity_category") in (None, "diagnostic", "config")
    assert given.get("availability_mode") in (None, "all", "any", "latest")
    assert given.get("device_class") in {None, *CLASSES.get(component, ())}
    for entry in given.get("availability", ()):
        assert set(entry) <= {"topic", "payload_available", "payload_not_available", "value_template"}
        assert "topic" in entry
    assert not {"availability", "availability_topic"} <= set(given)  # one excludes the other
    if "entity_category" in given:
        assert "unique_id" in given
    if component == "device_automation":
        assert given["automation_type"] == "trigger"
    return component, given


class House:
    """Discovers devices, follows their states and availability, and counts what triggers.

    Attributes
    ----------
    entities : dict
        Configuration of each entity and trigger by discovery topic.
    states : dict
        Last payload by topic.
    triggered, events : list
        Subtypes of device triggers, and event payloads, as they came.
    log : list of (float, str, str)
        Time on CLOCK_MONOTONIC, topic and payload of everything that came.
    """

    def __init__(self, port, **login):
        self.entities, self.states, self.triggered, self.events, self.log = {}, {}, [], [], []
        self.removed = []
        self._lock = threading.Lock()
        self._client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2, client_id="house")
        if login:
            self._client.username_pw_set(login["user"], login["password"])
        self._client.on_connect = lambda client, *_: client.subscribe("#")
        self._client.on_message = self._take
        self._client.reconnect_delay_set(1, 1)
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()

    def _take(self, _client, _data, message):
        topic, payload = message.topic, message.payload.decode()
        with self._lock:
            self.log.append((time.monotonic(), topic, payload))
            if topic.endswith("/config"):
                self._discover(topic, payload)
                return
            self.states[topic] = payload
            for place, (component, given) in self.entities.items():
                if not message.retain and component == "device_automation" and given["topic"] == topic:
                    self._trigger(given, payload)
                if not message.retain and component == "event" and given["state_topic"] == topic:
                    assert json.loads(payload)["event_type"] in given["event_types"], place
                    self.events.append(json.loads(payload))

    def _discover(self, topic, payload):
        if payload:
            self.entities[topic] = check(topic, payload)
        else:
            self.removed.append(topic)
            self.entities.pop(topic, None)

    def _trigger(self, given, payload):
        field = re.fullmatch(r"\{\{ value_json\.(\w+) \}\}", given["value_template"])[1]
        if json.loads(payload)[field] == given["payload"]:
            self.triggered.append(given["subtype"])

    def find(self, component, key):
        """Configuration of an entity."""
        with self._lock:
            return next(given for topic, (kind, given) in self.entities.items() if kind == component and topic.split("/")[-2] == key)

    def has(self, component, key):
        with self._lock:
            return any(kind == component and topic.split("/")[-2] == key for topic, (kind, _) in self.entities.items())

    def available(self, component, key):
        """Whether an entity is available, as availability_mode all says."""
        return all(self.states.get(a["topic"]) == a["payload_available"] for a in self.find(component, key)["availability"])

    def state(self, component, key):
        """What the entity's page shows."""
        if not self.has(component, key) or not self.available(component, key):
            return "unavailable"
        return self.states.get(self.find(component, key)["state_topic"], "unknown")

    def close(self):
        self._client.disconnect()
        self._client.loop_stop()


def wait_for(wanted, timeout=10.0):
    """Wait until it is so; returns how long it took [s], None: it did not come."""
    started = time.monotonic()
    while time.monotonic() - started < timeout:
        if wanted():
            return time.monotonic() - started
        time.sleep(0.02)
    return None
