"""Visualisation node: tracks, gestures and the hand as markers for rviz."""

from __future__ import annotations

import colorsys
import time
from collections.abc import Sequence
from typing import Any

from geometry_msgs.msg import Point, Vector3
from handwave.msg import Gesture as GestureMsg
from handwave.msg import HandTrack as HandTrackMsg
from handwave.msg import Track as TrackMsg
from handwave.msg import TrackArray as TrackArrayMsg
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from radar_ros import qos
from radar_ros.convert import from_time
from radar_ros.params import declare
from radar_ros.stage import StageNode, run

_HEIGHT = 1.7  # m: of the cylinder that stands for a person


class VisualisationNode(StageNode):
    """Publishes one cylinder and one text per person and a sphere for the hand; namespace and id are stable, gone tracks are deleted."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("visualisation", **kwargs)
        rate = float(declare(self, "rate", 10.0, "markers per second", unit="Hz", low=0.5, high=100.0))
        self._keep_ns = round(
            1e9 * float(declare(self, "gesture_time", 1.5, "how long a gesture's name is shown", unit="s", low=0.1, high=60.0))
        )
        self._interval_ns, self._next_ns = round(1e9 / rate), 0
        self._shown: set[int] = set()
        self._hand_shown = False
        self._gestures: dict[int, tuple[int, str]] = {}
        self._hand: Any = None
        self._markers = self.create_publisher(MarkerArray, "tracks/markers", qos.RESULT)
        self.create_subscription(TrackArrayMsg, "tracks", self._take, qos.RESULT)
        self.create_subscription(GestureMsg, "gestures", self._gesture, qos.RESULT)
        self.create_subscription(HandTrackMsg, "hand", self._take_hand, qos.RESULT)

    def _gesture(self, msg: Any) -> None:
        if msg.label != GestureMsg.RANDOM:
            self._gestures[msg.track_id] = (from_time(msg.header.stamp), msg.name)

    def _take_hand(self, msg: Any) -> None:
        self._hand = msg if msg.active else None

    def _take(self, msg: Any) -> None:
        started = time.monotonic_ns()
        self.count_gap(msg.sequence)
        stamp = from_time(msg.header.stamp)
        if 0 <= self._next_ns - stamp < 10 * self._interval_ns:
            return
        self._next_ns = stamp + self._interval_ns
        markers: list[Marker] = []
        people = {track.id: track for track in msg.tracks if track.status != TrackMsg.TENTATIVE}
        for number, track in people.items():
            markers += [self._body(msg.header, number, track), self._text(msg.header, stamp, number, track)]
        for number in self._shown - set(people):
            for name in ("people", "names"):
                markers.append(Marker(header=msg.header, ns=name, id=number, action=Marker.DELETE))
        self._shown = set(people)
        self._gestures = {n: g for n, g in self._gestures.items() if abs(stamp - g[0]) <= self._keep_ns}
        markers += self._hand_markers(msg.header)
        self._markers.publish(MarkerArray(markers=markers))
        self.finish(stamp, msg.sequence, started)

    def _body(self, header: Any, number: int, track: Any) -> Marker:
        marker = Marker(header=header, ns="people", id=number, type=Marker.CYLINDER, action=Marker.ADD)
        x, y, _ = track.position
        marker.pose.position = Point(x=x, y=y, z=_HEIGHT / 2)
        marker.scale = Vector3(x=0.4, y=0.4, z=_HEIGHT)
        marker.color = _colour(number, 0.35 if track.status == TrackMsg.COASTING else 0.7)
        return marker

    def _text(self, header: Any, stamp: int, number: int, track: Any) -> Marker:
        since, name = self._gestures.get(number, (0, ""))
        marker = Marker(header=header, ns="names", id=number, type=Marker.TEXT_VIEW_FACING, action=Marker.ADD)
        x, y, _ = track.position
        marker.pose.position = Point(x=x, y=y, z=_HEIGHT + 0.25)
        marker.scale.z = 0.2
        marker.color = _colour(number, 1.0)
        marker.text = f"{number} {name}" if 0 <= stamp - since <= self._keep_ns else str(number)
        return marker

    def _hand_markers(self, header: Any) -> list[Marker]:
        if self._hand is None:
            gone = [Marker(header=header, ns="hand", id=0, action=Marker.DELETE)] if self._hand_shown else []
            self._hand_shown = False
            return gone
        marker = Marker(header=header, ns="hand", id=0, type=Marker.SPHERE, action=Marker.ADD)
        marker.pose.position = Point(**dict(zip("xyz", map(float, self._hand.position), strict=True)))
        marker.scale = Vector3(x=0.15, y=0.15, z=0.15)
        marker.color = ColorRGBA(r=1.0, g=0.8, b=0.1, a=1.0)
        self._hand_shown = True
        return [marker]


def _colour(number: int, alpha: float) -> ColorRGBA:
    """Colour of a track: the golden ratio keeps neighbours apart."""
    r, g, b = colorsys.hsv_to_rgb((number * 0.618034) % 1.0, 0.75, 0.95)
    return ColorRGBA(r=r, g=g, b=b, a=alpha)


def make_node(**kwargs: Any) -> VisualisationNode:
    """Make the node; ``kwargs`` go to rclpy's Node."""
    return VisualisationNode(**kwargs)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until it is told to stop."""
    return run(make_node, argv)


if __name__ == "__main__":
    raise SystemExit(main())
