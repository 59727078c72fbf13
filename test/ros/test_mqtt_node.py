"""The MQTT node over real DDS, and over a real broker to a house that does what Home Assistant documents."""

import itertools
import json
import math
import os
import signal
import subprocess
import sys
import time

import paho.mqtt.client
import pytest
from handwave.msg import Gesture as GestureMsg
from handwave.msg import Zone
from home_assistant import House, wait_for
from mosquitto_broker import Broker, missing
from mqtt_room import Room
from std_msgs.msg import UInt32

from radar_ros import qos

pytestmark = pytest.mark.skipif(bool(missing()), reason=missing())


@pytest.fixture
def broker(tmp_path):
    found = Broker(tmp_path).start()
    yield found
    found.kill()


@pytest.fixture
def room(ros, broker):
    return Room(ros, broker)


@pytest.fixture
def house(broker):
    found = House(broker.port)
    yield found
    found.close()


def test_what_a_house_finds(room, house):
    """Every component passes the published schema; the room is one device; each gesture has its trigger; nothing else is there."""
    assert room.until(lambda: house.has("device_automation", "push_pull") and house.has("binary_sensor", "radar"))
    kinds = sorted(kind for kind, _ in house.entities.values())
    assert kinds == sorted(["binary_sensor"] * 3 + ["sensor"] * 2 + ["event"] + ["device_automation"] * 9)
    assert {given["device"]["identifiers"][0] for _, given in house.entities.values()} == {"handwave_living_room"}
    assert {given["device"]["name"] for _, given in house.entities.values()} == {"Living room"}
    unique = [given["unique_id"] for kind, given in house.entities.values() if kind != "device_automation"]
    assert len(set(unique)) == len(unique) == 6
    assert "random" not in house.find("event", "gesture")["event_types"]


def test_presence_follows_the_count_and_ends_with_the_data(room, house):
    """Unavailable before any data, then right, unavailable again when the data stops, and back."""
    assert room.until(lambda: house.has("sensor", "people"))
    assert house.state("binary_sensor", "occupancy") == "unavailable"
    room.people = 2
    assert room.until(lambda: house.state("sensor", "people") == "2")
    assert room.until(lambda: house.state("binary_sensor", "occupancy") == "ON")
    room.people = 0
    assert room.until(lambda: (house.state("sensor", "people"), house.state("binary_sensor", "occupancy")) == ("0", "OFF"))
    assert house.state("binary_sensor", "radar") == "online"
    room.people = None
    assert room.until(lambda: house.state("binary_sensor", "occupancy") == "unavailable")
    assert house.state("binary_sensor", "radar") == "offline"  # this one says so rather than being unavailable
    room.people = 1
    assert room.until(lambda: house.state("binary_sensor", "occupancy") == "ON")


def test_a_gesture_triggers_once(room, house):
    """One trigger and one event each; what is no gesture does neither."""
    room.people = 1
    assert room.until(lambda: house.state("event", "gesture") == "unknown" and len(house.entities) == 15)
    room.gesture("random", label=GestureMsg.RANDOM)
    room.gesture("swipe_up")
    room.gesture("pull", label=GestureMsg.PULL, confidence=0.75, track=7)
    assert room.until(lambda: len(house.triggered) >= 2)
    room.wait(0.3)
    assert house.triggered == ["swipe_up", "pull"]
    where = {"zones": ["Sofa"], "position": [2.0, -0.5, 1.13]}
    assert house.events[1] == {"event_type": "pull", "confidence": 0.75, "person": 7, **where}
    room.gesture("pull", label=GestureMsg.PULL, position=(math.nan,) * 3)
    assert room.until(lambda: len(house.events) == 3)
    assert "position" not in house.events[2]


@pytest.mark.long
def test_the_hand_is_a_number_that_comes_not_too_often(room, house):
    """At most hand_rate values a second, the last one always, and active only while there is one."""
    room.people = 1
    assert room.until(lambda: house.state("binary_sensor", "hand_active") == "OFF")
    started = time.monotonic()
    for step in range(51):
        room.hand(step / 50)
        room.wait(0.02)
    took = time.monotonic() - started
    assert room.until(lambda: house.state("binary_sensor", "hand_active") == "ON")
    room.hand(0.42)
    room.hand(0.42, active=False)
    assert room.until(lambda: house.state("binary_sensor", "hand_active") == "OFF")
    assert room.until(lambda: house.state("sensor", "hand") == "42")
    values = [payload for _, topic, payload in house.log if topic == "handwave/living_room/hand"]
    assert 3 <= len(values) <= 5.0 * took + 4
    assert all(one != other for one, other in itertools.pairwise(values))  # the same again is not said again


def test_a_hand_that_is_lost_without_a_word_is_not_active(room, house):
    """The hand node died: a lamp must not hang on the last value's word for ever."""
    room.people = 1
    room.hand(0.5)
    assert room.until(lambda: house.state("binary_sensor", "hand_active") == "ON")
    assert room.until(lambda: house.state("binary_sensor", "hand_active") == "OFF")
    assert house.state("sensor", "people") == "1"


@pytest.mark.long
def test_a_broker_that_dies_and_comes_back_empty(room, broker, tmp_path):
    """Everything is there again within 5 s; a gesture of meanwhile never comes late."""
    room.people = 1
    house = House(broker.port)
    assert room.until(lambda: house.state("binary_sensor", "occupancy") == "ON")
    house.close()
    broker.kill()
    assert room.until(lambda: not room.node._link.connected)
    room.gesture("push", label=GestureMsg.PUSH)
    room.people = 2
    room.wait(1.0)
    assert room.node.dropped == 1
    broker.start()
    house = House(broker.port)
    took = room.until(lambda: house.state("sensor", "people") == "2" and len(house.entities) == 15)
    assert took is not None
    assert took < 5.0
    room.gesture("swipe_up")
    assert room.until(lambda: house.triggered)
    room.wait(0.3)
    assert house.triggered == ["swipe_up"]
    assert house.removed == []
    house.close()


def test_what_an_earlier_version_left_is_taken_away(room, house, broker):
    """A retained configuration of this room's that is of no use now; those of others stay."""
    client = paho.mqtt.client.Client(paho.mqtt.client.CallbackAPIVersion.VERSION2)
    client.connect("127.0.0.1", broker.port)
    client.loop_start()
    room.people = 1
    assert room.until(lambda: len(house.entities) == 15)
    theirs, ours = "homeassistant/sensor/handwave_kitchen/people/config", "homeassistant/sensor/handwave_living_room/old/config"
    payload = house.find("sensor", "people")
    for topic in (theirs, ours):
        client.publish(topic, json.dumps(payload), qos=1, retain=True).wait_for_publish(5.0)
    client.loop_stop()
    assert room.until(lambda: len(house.entities) == 17)
    broker_side = room.node._link  # a new connection, as after a start
    room.ros.executor.remove_node(room.node)
    room.ros.nodes.remove(room.node)
    room.node.close()
    room.node.destroy_node()
    assert not broker_side._thread.is_alive()
    again = Room(room.ros, broker)
    assert again.until(lambda: len(house.entities) == 16)
    assert theirs in house.entities
    assert ours not in house.entities
    assert house.removed == [ours]


def test_the_end_says_offline_at_once(room, house):
    """A clean end does not wait for the broker to miss us."""
    room.people = 1
    assert room.until(lambda: house.state("binary_sensor", "occupancy") == "ON")
    room.node.close()
    assert wait_for(lambda: house.states["handwave/living_room/status"] == "offline", 2.0)
    assert not room.node._link._thread.is_alive()


def test_zones_are_entities_of_their_own(room, house):
    """Presence after the delays, the count, unknown and unavailable; no fan; and zones that come and go."""
    room.people = 3
    sofa, desk, fan = ("Sofa", Zone.OCCUPIED, 2), ("Schreibtisch Öl", Zone.EMPTY, 0), ("fan", Zone.OCCUPIED, 1, Zone.EXCLUSION)
    room.tell_zones(sofa, desk, fan, people=2)
    assert room.until(lambda: house.state("sensor", "zone_sofa_people") == "2")
    assert room.until(lambda: house.state("binary_sensor", "zone_sofa_occupancy") == "ON")
    assert room.until(lambda: house.state("binary_sensor", "zone_schreibtisch_ol_occupancy") == "OFF")
    assert house.find("sensor", "zone_schreibtisch_ol_people")["name"] == "Schreibtisch Öl people"
    assert not house.has("sensor", "zone_fan_people")
    room.wait(0.3)
    assert house.state("sensor", "people") == "2"  # the room's boundary, not everybody that is tracked
    room.tell_zones(("Sofa", Zone.UNKNOWN, 0), desk)
    assert room.until(lambda: house.state("sensor", "zone_sofa_people") == "None")
    assert house.state("binary_sensor", "zone_sofa_occupancy") == "None"
    room.tell_zones(sofa, ("Bed", Zone.OCCUPIED, 1))  # another file
    assert room.until(lambda: house.state("sensor", "zone_bed_people") == "1")
    assert room.until(lambda: not house.has("sensor", "zone_schreibtisch_ol_people"))
    assert "handwave/living_room/zone/schreibtisch_ol/people" not in {t for t, payload in house.states.items() if payload}
    room.tell_zones(sofa, stale=True)
    assert room.until(lambda: house.state("sensor", "zone_sofa_people") == "unavailable")


@pytest.mark.long
def test_zones_that_fall_silent_are_unavailable_and_the_room_goes_on(room, house):
    """The zones node died: the room's people are those that are tracked."""
    room.people = 3
    room.tell_zones(("Sofa", Zone.OCCUPIED, 1), people=1)
    assert room.until(lambda: house.state("sensor", "zone_sofa_people") == "1")
    assert room.until(lambda: house.state("sensor", "zone_sofa_people") == "unavailable")
    assert room.until(lambda: house.state("sensor", "people") == "3")


def test_zones_of_an_earlier_run_stay_until_it_is_known_which_there_are(room, house, broker):
    """What a house knows about an entity must not be lost because the zones come a little later than we do."""
    room.people = 1
    room.tell_zones(("Sofa", Zone.OCCUPIED, 1), ("Bed", Zone.OCCUPIED, 1))
    assert room.until(lambda: house.has("sensor", "zone_sofa_people") and house.has("sensor", "zone_bed_people"))
    room.ros.executor.remove_node(room.node)
    room.ros.nodes.remove(room.node)
    room.node.close()
    room.node.destroy_node()
    room.ros.node.destroy_publisher(room.zones)
    again = Room(room.ros, broker)
    assert again.until(lambda: again.node._link.connected)
    again.wait(1.0)
    assert house.removed == []
    again.tell_zones(("Sofa", Zone.OCCUPIED, 1))
    assert again.until(lambda: len(house.removed) == 2)
    assert house.has("sensor", "zone_sofa_people")
    assert not house.has("sensor", "zone_bed_people")


def test_two_rooms_are_two_devices(ros, broker, house):
    """Entities, states and availability of one say nothing about the other."""
    one, two = Room(ros, broker), Room(ros, broker, room="Küche", stale_after=30.0)
    one.people = 1
    assert one.until(lambda: len(house.entities) == 30)
    assert len({given["device"]["name"] for _, given in house.entities.values()}) == 2
    assert "handwave/kuche/people" in {given.get("state_topic") for _, given in house.entities.values()}
    assert one.until(lambda: house.states.get("handwave/kuche/people") == "1")
    one.node.close()
    assert wait_for(lambda: house.states["handwave/living_room/status"] == "offline", 2.0)
    assert house.states["handwave/kuche/status"] == "online"
    two.node.close()


def process(port, *more):
    """A node of its own, as a graph starts it."""
    line = [sys.executable, "-m", "radar_ros.nodes.mqtt", "--ros-args", "-p", f"port:={port}", "-p", "room:=Hall", *more]
    return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_node_that_is_killed_is_offline_within_five_seconds(ros, broker, house, number):
    """By its last will, or by its own last word; it ends with status 0 where it can."""
    counts = ros.node.create_publisher(UInt32, "people_count", qos.RESULT)
    found = process(broker.port)
    try:

        def there():
            counts.publish(UInt32(data=1))
            return house.state("binary_sensor", "occupancy") == "ON"

        assert ros.spin_until(there, 20.0)
        found.send_signal(number)
        took = wait_for(lambda: house.state("binary_sensor", "occupancy") == "unavailable", 10.0)
        assert took is not None
        assert took < 5.0
        found.wait(5.0)
        assert found.returncode == (0 if number == signal.SIGTERM else -9)
    finally:
        found.kill()
        output, _ = found.communicate()
    assert "Traceback" not in output


@pytest.mark.long
def test_a_machine_that_hangs_goes_offline(ros, broker, house):
    """Nothing closes the connection: the broker misses the pings. Mosquitto looks every 5 s whether 1.5 times the keep-alive has passed."""
    counts = ros.node.create_publisher(UInt32, "people_count", qos.RESULT)
    found = process(broker.port, "-p", "keep_alive:=1")
    try:

        def there():
            counts.publish(UInt32(data=1))
            return house.state("binary_sensor", "occupancy") == "ON"

        assert ros.spin_until(there, 20.0)
        os.kill(found.pid, signal.SIGSTOP)
        took = wait_for(lambda: house.state("binary_sensor", "occupancy") == "unavailable", 20.0)
        assert took is not None
        assert took < 1.5 + 5.0 + 2.0
    finally:
        found.kill()
        found.communicate()
