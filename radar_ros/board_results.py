"""What boards find themselves, as topics: tracks of boards without points, and beside ours the tracks, gestures and presence of others."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import handwave.msg
from std_msgs.msg import Bool, UInt32

from radar_core import GESTURES, RadarInfo
from radar_driver.targets import Targets
from radar_ros import qos
from radar_ros.messages.convert import header
from radar_ros.messages.tracks import tracks_to_msg
from radar_ros.params import declare_config
from radar_tracking.targets import TargetConfig, TargetTracker

NO_POINTS = "the board gives targets, not points: people are tracked; gestures and the hand are off, because they need points"


class BoardResults:
    """Publishes targets through a driver node: on ``tracks`` where the board gives nothing else, else on ``board/tracks`` and so on."""

    def __init__(self, node: Any, *, alone: bool) -> None:
        self._node, self._alone = node, alone
        self._config = declare_config(node, TargetConfig, "targets.")
        self._tracker = TargetTracker(self._config)
        self._stamp = 0
        place = "" if alone else "board/"
        self._tracks = node.create_publisher(handwave.msg.TrackArray, f"{place}tracks", qos.RESULT)
        self._count = node.create_publisher(UInt32, f"{place}people_count", qos.RESULT)
        if not alone:
            self._gestures = node.create_publisher(handwave.msg.Gesture, "board/gestures", qos.RESULT)
            self._present = node.create_publisher(Bool, "board/presence", qos.RESULT)

    def start(self, info: RadarInfo) -> None:
        """Begin with a board that stands there."""
        self._tracker = TargetTracker(self._config, info.mount)
        if self._alone:
            self._node.get_logger().warning(f"{NO_POINTS} (docs/how-to/boards-targets.md)")

    def publish(self, targets: Targets, stamp_ns: int) -> None:
        """Publish one report, stamped with the node's clock [ns]."""
        if stamp_ns < self._stamp:
            self._tracker.reset()
        self._stamp = stamp_ns
        targets = replace(targets, stamp_ns=stamp_ns)
        if targets.has_targets:
            tracks = self._tracker.process(targets)
            self._tracks.publish(tracks_to_msg(tracks))
            self._count.publish(UInt32(data=tracks.people_count))
        if targets.present is not None and not self._alone:
            self._present.publish(Bool(data=targets.present))
        if targets.gesture and not self._alone:
            self._gestures.publish(gesture_message(targets))


def gesture_message(targets: Targets) -> Any:
    """Put a board's gesture into a message: its own name, our label where we know the same gesture; times and features are not known."""
    label = GESTURES.index(targets.gesture) if targets.gesture in GESTURES else 0
    head = header(targets.stamp_ns, "room")
    confidence = targets.gestures.get(targets.gesture, float("nan"))
    shares = [targets.gestures.get(name, 0.0) for name in GESTURES]
    message = handwave.msg.Gesture(header=head, track_id=0, label=label, name=targets.gesture, confidence=confidence, known=True)
    message.probabilities, message.latency_s = shares, float("nan")
    message.start = message.end = head.stamp
    return message
