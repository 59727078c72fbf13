"""Visualisation node: tracks, gestures, the hand and zones as markers for rviz, and the points in the colours of their tracks."""

from __future__ import annotations

import colorsys
import math
import time
from typing import Any

import handwave.msg
import numpy as np
import rclpy
from geometry_msgs.msg import Point, Vector3
from numpy.typing import NDArray
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from radar_core import ConfigError, DataError, PointCloud
from radar_ros import qos
from radar_ros.messages.convert import cloud_from_msg, from_time, points_to_cloud2, unpack
from radar_ros.params import declare
from radar_ros.stage import StageNode, run
from radar_ros.sync import SimpleFilter, Subscriber, TimeSynchronizer

_HEIGHT = 1.7  # m: of the cylinder that stands for a person; the few points of a body do not tell how tall it is
_WIDTH = 0.4  # m: of a cylinder whose track's extent is not known
_WIDTHS = (0.25, 1.0)  # m: people are not thinner, and arms held out not a wider body
_NOBODY = 0x909090
_ZONES = {"boundaries": (0.9, 0.9, 0.9), "entries": (0.3, 0.8, 0.4)}  # colours of the outlines
_LIFETIME = 10  # intervals between two arrays, and at least 1 s: after that a viewer takes away what a node that died has left
_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("snr", "<f4"), ("radial_speed", "<f4"), ("track_id", "<i4"), ("rgb", "<u4")])


class VisualisationNode(StageNode):
    """Publishes one cylinder and one text per person and a sphere for the hand; namespace and id are stable, gone tracks are deleted.

    Each cloud's points go out in the colours of their tracks, in the frame of the cloud. Clouds are subscribed to while somebody listens.
    """

    gives_way = 5

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("visualisation", **kwargs)
        rate = float(declare(self, "rate", 10.0, "markers per second", unit="Hz", low=0.5, high=100.0))
        shown = float(declare(self, "gesture_time", 1.5, "how long a gesture's name is shown", unit="s", low=0.1, high=60.0))
        self._keep_ns, self._interval_ns, self._next_ns = round(1e9 * shown), round(1e9 / rate), 0
        self._lifetime = Duration(seconds=max(1.0, _LIFETIME / rate)).to_msg()
        self._shown: set[int] = set()
        self._hand_shown = False
        self._gestures: dict[int, tuple[int, str]] = {}
        self._hand: Any = None
        self._zones = [outline for name in _ZONES for outline in self._outlines(name)]
        self._markers = self.create_publisher(MarkerArray, "tracks/markers", qos.RESULT)
        self._clouds = SimpleFilter()
        self._clouds_in: Any = None
        heard = PublisherEventCallbacks(matched=self._heard)
        self._labelled = self.create_publisher(PointCloud2, "tracks/points2", qos.stream_out(), event_callbacks=heard)
        tracks = Subscriber(self, handwave.msg.TrackArray, "tracks", qos_profile=qos.RESULT)
        tracks.registerCallback(self._take)
        self._pairs = TimeSynchronizer([self._clouds, tracks], 10)
        self._pairs.registerCallback(self._label)
        self.create_subscription(handwave.msg.Gesture, "gestures", self._gesture, qos.RESULT)
        self.create_subscription(handwave.msg.HandTrack, "hand", self._take_hand, qos.RESULT)

    def _outlines(self, name: str) -> list[Marker]:
        """Outlines of the boxes of a zone parameter, on the floor."""
        doc = "boxes to draw: x_low, x_high, y_low, y_high of each, one after the other, as the tracking node has them"
        values = [float(value) for value in declare(self, f"zones.{name}", [], doc, unit="m")]
        if len(values) % 4:
            raise ConfigError(f"parameter zones.{name} of node {self.get_name()} has {len(values)} numbers; every box needs four: {doc}")
        result = []
        for number, (x_low, x_high, y_low, y_high) in enumerate(np.reshape(values, (-1, 4)).tolist()):
            marker = Marker(ns=name, id=number, type=Marker.LINE_STRIP, action=Marker.ADD)
            corners = ((x_low, y_low), (x_high, y_low), (x_high, y_high), (x_low, y_high), (x_low, y_low))
            marker.points = [Point(x=x, y=y) for x, y in corners]
            marker.scale.x = 0.03
            marker.color = ColorRGBA(**dict(zip("rgb", _ZONES[name], strict=True)), a=0.8)
            result.append(marker)
        return result

    def _heard(self, matched: Any) -> None:
        """Somebody began or ceased to listen to the labelled points."""
        if matched.current_count and self._clouds_in is None:
            take = self._clouds.signalMessage
            self._clouds_in = self.create_subscription(handwave.msg.PointCloud, "radar/points", take, qos.sensor(reliable=self.reliable))
        elif not matched.current_count and self._clouds_in is not None:
            self.destroy_subscription(self._clouds_in)
            self._clouds_in = None

    def _label(self, cloud_msg: Any, tracks_msg: Any) -> None:
        self._labelled.publish(labelled_cloud2(cloud_from_msg(cloud_msg), unpack(tracks_msg.point_track_id, np.int32)))

    def _gesture(self, msg: Any) -> None:
        if msg.label != handwave.msg.Gesture.RANDOM:
            self._gestures[msg.track_id] = (from_time(msg.header.stamp), msg.name)

    def _take_hand(self, msg: Any) -> None:
        self._hand = msg if msg.active else None

    def _take(self, msg: Any) -> None:
        started = time.monotonic_ns()
        self.count_gap(msg.sequence, msg.every)
        stamp = from_time(msg.header.stamp)
        if 0 <= self._next_ns - stamp < 10 * self._interval_ns:
            return
        self._next_ns = stamp + self._interval_ns
        markers: list[Marker] = []
        people = {track.id: track for track in msg.tracks if track.status != handwave.msg.Track.TENTATIVE}
        for number, track in people.items():
            markers += [self._body(msg.header, number, track), self._text(msg.header, stamp, number, track)]
        gone = ((name, number) for number in self._shown - set(people) for name in ("people", "names"))
        markers += [Marker(header=msg.header, ns=name, id=number, action=Marker.DELETE) for name, number in gone]
        self._shown = set(people)
        self._gestures = {n: g for n, g in self._gestures.items() if abs(stamp - g[0]) <= self._keep_ns}
        markers += self._hand_markers(msg.header)
        for outline in self._zones:  # with every array, because a viewer may join at any time
            outline.header = msg.header
        markers += self._zones
        for marker in markers:
            marker.lifetime = self._lifetime
        self._markers.publish(MarkerArray(markers=markers))
        self.finish(stamp, msg.sequence, started)

    def close(self) -> None:
        """Take away what is shown: it would stay for as long as it lives."""
        if rclpy.ok():
            self._markers.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))

    def _body(self, header: Any, number: int, track: Any) -> Marker:
        marker = Marker(header=header, ns="people", id=number, type=Marker.CYLINDER, action=Marker.ADD)
        x, y, _ = track.position
        marker.pose.position = Point(x=x, y=y, z=_HEIGHT / 2)
        marker.scale = Vector3(x=_width(track.extent[0]), y=_width(track.extent[1]), z=_HEIGHT)
        marker.color = _colour(number, 0.35 if track.status == handwave.msg.Track.COASTING else 0.7)
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


def labelled_cloud2(cloud: PointCloud, track_id: NDArray[np.int32]) -> PointCloud2:
    """Make a PointCloud2 whose points carry their track, and its colour: the same as that of the track's cylinder.

    Parameters
    ----------
    cloud : PointCloud
        In any frame; the result is in the same.
    track_id : ndarray of int32, shape (n_points,)
        Track each point belongs to; -1: none, grey.

    Returns
    -------
    sensor_msgs.msg.PointCloud2
        Fields x y z snr radial_speed track_id rgb, 28 bytes a point.

    Raises
    ------
    DataError
        When there is not one track per point.
    """
    if len(track_id) != len(cloud):
        said = f"the tracks of cloud {cloud.sequence} speak of {len(track_id)} points"
        raise DataError(f"{said}, but it has {len(cloud)}; are there two tracking nodes?")
    points = np.empty(len(cloud), _POINT)
    for name in ("x", "y", "z", "snr", "radial_speed"):
        points[name] = getattr(cloud, name)
    points["track_id"] = track_id
    ids, place = np.unique(track_id, return_inverse=True)
    points["rgb"] = np.array([_packed(number) for number in ids.tolist()], np.uint32)[place]
    return points_to_cloud2(cloud.stamp_ns, cloud.frame_id, points)


def _packed(number: int) -> int:
    """Colour of a track as 0x00RRGGBB; grey for no track."""
    if number < 0:
        return _NOBODY
    r, g, b = (round(255 * part) for part in _rgb(number))
    return r << 16 | g << 8 | b


def _width(spread: float) -> float:
    """Width of a body whose points have that standard deviation [m]: a disc is four times as wide."""
    return min(max(4.0 * float(spread), _WIDTHS[0]), _WIDTHS[1]) if math.isfinite(spread) else _WIDTH


def _rgb(number: int) -> tuple[float, float, float]:
    """Colour of a track: the golden ratio keeps neighbours apart."""
    return colorsys.hsv_to_rgb((number * 0.618034) % 1.0, 0.75, 0.95)


def _colour(number: int, alpha: float) -> ColorRGBA:
    r, g, b = _rgb(number)
    return ColorRGBA(r=r, g=g, b=b, a=alpha)


make_node = VisualisationNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
