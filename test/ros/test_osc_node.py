"""The OSC node over real DDS and real UDP."""

import socket

import numpy as np
import pytest
from handwave.msg import Gesture as GestureMsg
from handwave.msg import HandTrack as HandTrackMsg
from pythonosc.osc_packet import OscPacket
from rclpy.parameter import Parameter
from std_msgs.msg import UInt32

import radar_ros.nodes.osc
from radar_core import ConfigError
from radar_ros import qos


class Instrument:
    """Listens on a port of its own; one entry per datagram, a list of (address, arguments)."""

    def __init__(self):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.port = self._socket.getsockname()[1]
        self.heard = []

    def listen(self):
        """Take in what has come; returns all that ever came."""
        while True:
            try:
                data = self._socket.recv(65536)
            except BlockingIOError:
                return self.heard
            self.heard.append([(m.message.address, m.message.params) for m in OscPacket(data).messages])

    def close(self):
        self._socket.close()


@pytest.fixture
def instrument():
    found = Instrument()
    yield found
    found.close()


def node(ros, **parameters):
    return ros.add(radar_ros.nodes.osc.make_node(parameter_overrides=[Parameter(k, value=v) for k, v in parameters.items()]))


def publisher(ros, kind, topic):
    found = ros.node.create_publisher(kind, topic, qos.RESULT)
    assert ros.spin_until(found.get_subscription_count)
    return found


def test_a_hand_is_one_bundle(ros, instrument):
    """Value, place and velocity come together, as single precision; its end is one message."""
    node(ros, port=instrument.port)
    hands = publisher(ros, HandTrackMsg, "hand")
    hands.publish(HandTrackMsg(active=True, value=0.25, position=[2.0, -0.5, 1.25], velocity=[0.1, 0.2, -0.3]))
    hands.publish(HandTrackMsg(active=False, value=0.25))
    assert ros.spin_until(lambda: len(instrument.listen()) == 2)
    first = dict(instrument.heard[0])
    assert first["/handwave/hand/active"] == [1]
    assert first["/handwave/hand/value"] == [0.25]
    assert first["/handwave/hand/position"] == [2.0, -0.5, 1.25]
    assert np.allclose(first["/handwave/hand/velocity"], [0.1, 0.2, -0.3], atol=1e-6)
    assert instrument.heard[1] == [("/handwave/hand/active", [0])]


def test_gestures_and_people(ros, instrument):
    """A gesture under its own address and under one for all; what is no gesture makes no sound; people only when they change."""
    node(ros, port=instrument.port, prefix="/stage/left")
    gestures, counts = publisher(ros, GestureMsg, "gestures"), publisher(ros, UInt32, "people_count")
    gestures.publish(GestureMsg(name="random", label=GestureMsg.RANDOM))
    gestures.publish(GestureMsg(name="push", label=GestureMsg.PUSH, confidence=0.5, track_id=4))
    assert ros.spin_until(lambda: len(instrument.listen()) == 1)
    for people in (2, 2, 3):
        counts.publish(UInt32(data=people))
        ros.spin_until(lambda: False, 0.1)
    assert ros.spin_until(lambda: len(instrument.listen()) == 4)
    ros.spin_until(lambda: False, 0.2)
    assert instrument.listen() == [
        [("/stage/left/gesture", ["push", 0.5, 4]), ("/stage/left/gesture/push", [0.5])],
        [("/stage/left/data", [1])],
        [("/stage/left/people", [2])],
        [("/stage/left/people", [3])],
    ]


def test_no_note_is_held_when_nothing_comes_any_more(ros, instrument):
    """Stale: the hand is gone and people are not known; the next number ends it."""
    node(ros, port=instrument.port, stale_after=0.4)
    counts, hands = publisher(ros, UInt32, "people_count"), publisher(ros, HandTrackMsg, "hand")
    counts.publish(UInt32(data=1))
    hands.publish(HandTrackMsg(active=True, value=0.5))
    assert ros.spin_until(lambda: len(instrument.listen()) == 4)
    assert sorted(instrument.heard[3]) == [("/handwave/data", [0]), ("/handwave/hand/active", [0])]
    counts.publish(UInt32(data=1))
    assert ros.spin_until(lambda: len(instrument.listen()) == 6)
    assert instrument.heard[4:] == [[("/handwave/data", [1])], [("/handwave/people", [1])]]


def test_the_namespace_tells_rooms_apart(ros, instrument):
    """Without a prefix, /handwave and the namespace."""
    found = radar_ros.nodes.osc.make_node(namespace="hall", parameter_overrides=[Parameter("port", value=instrument.port)])
    ros.add(found)
    counts = publisher(ros, UInt32, "hall/people_count")
    counts.publish(UInt32(data=1))
    assert ros.spin_until(lambda: len(instrument.listen()) == 2)
    assert instrument.heard[1] == [("/handwave/hall/people", [1])]


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"prefix": "radar"}, "prefix is 'radar'"),
        ({"prefix": "/a b"}, "prefix is '/a b'"),
        ({"host": "no.such.host.invalid"}, "is not known"),
    ],
)
def test_settings_that_make_no_sense(ros, parameters, message):
    """One line that names the parameter."""
    with pytest.raises(ConfigError, match=message):
        radar_ros.nodes.osc.make_node(parameter_overrides=[Parameter(k, value=v) for k, v in parameters.items()])
