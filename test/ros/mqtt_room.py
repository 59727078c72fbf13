"""What feeds an MQTT node, and how long it waits for data."""

import time

from handwave.msg import Gesture as GestureMsg
from handwave.msg import HandTrack as HandTrackMsg
from handwave.msg import Zone, ZoneArray
from rclpy.parameter import Parameter
from std_msgs.msg import UInt32

import radar_ros.nodes.mqtt
from radar_ros import qos

STALE = 0.6  # s


class Room:
    """What feeds a node, and the house that sees it."""

    def __init__(self, ros, broker, **parameters):
        self.ros, self.broker = ros, broker
        given = {"port": broker.port, "room": "Living room", "stale_after": STALE, **parameters}
        self.node = ros.add(radar_ros.nodes.mqtt.make_node(parameter_overrides=[Parameter(k, value=v) for k, v in given.items()]))
        self.counts = ros.node.create_publisher(UInt32, "people_count", qos.RESULT)
        self.gestures = ros.node.create_publisher(GestureMsg, "gestures", qos.RESULT)
        self.hands = ros.node.create_publisher(HandTrackMsg, "hand", qos.RESULT)
        self.zones = ros.node.create_publisher(ZoneArray, "zones", qos.LATCHED)
        publishers = (self.counts, self.gestures, self.hands, self.zones)
        assert ros.spin_until(lambda: all(p.get_subscription_count() for p in publishers))
        self.people = None  # said again and again, as a tracker does
        self._said = 0.0

    def until(self, wanted, timeout=8.0):
        """Spin, and say how many people there are ten times a second; returns how long it took [s], None: it did not come."""
        started = time.monotonic()

        def step():
            if self.people is not None and time.monotonic() - self._said > 0.1:
                self._said = time.monotonic()
                self.counts.publish(UInt32(data=self.people))
            return wanted()

        return time.monotonic() - started if self.ros.spin_until(step, timeout) else None

    def wait(self, seconds):
        self.until(lambda: False, seconds)

    def gesture(self, name, label=GestureMsg.SWIPE_UP, confidence=0.9, track=3, position=(2.0, -0.5, 1.1251)):
        whose = {"track_id": track, "position": position, "zones": ["Sofa"]}
        self.gestures.publish(GestureMsg(name=name, label=label, confidence=confidence, **whose))

    def tell_zones(self, *zones, stale=False, people=0):
        """Zones as (name, presence, count) or (name, presence, count, kind), and everybody."""
        known = Zone.UNKNOWN if stale else int(people > 0)
        room = Zone(name="room", kind=Zone.BOUNDARY, presence=known, count=people)
        parts = [Zone(name=name, presence=presence, count=count, kind=(*kind, Zone.COUNTING)[0]) for name, presence, count, *kind in zones]
        self.zones.publish(ZoneArray(stale=stale, room=room, zones=parts))

    def hand(self, value, active=True):
        self.hands.publish(HandTrackMsg(value=value, active=active, parent_id=3))
