"""Presence node: radar/frame to who is there, breath, and the gestures that one channel tells; needs no angle."""

from __future__ import annotations

import math
import time
from typing import Any

import handwave.msg
from std_msgs.msg import Bool, Float32

from radar_core import RadarInfo
from radar_gestures.one_channel import ChannelGestureConfig, ChannelGestures
from radar_ros import qos
from radar_ros.messages.convert import frame_from_msg
from radar_ros.messages.gestures import gesture_to_msg
from radar_ros.params import declare, declare_config
from radar_ros.stage import InfoKeeper, StageNode, run
from radar_tracking.presence import PresenceConfig, PresenceDetector


class PresenceNode(StageNode):
    """Says of every frame whether somebody is there, how far away, how they breathe, and which gesture has ended."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("presence", **kwargs)
        self._config = declare_config(self, PresenceConfig)
        self._gestures = ChannelGestures(declare_config(self, ChannelGestureConfig, "gestures."))
        text = "publish push, pull and wave on gestures; off beside the gestures node"
        self._naming = bool(declare(self, "gestures_on", True, text))
        self._present = self.create_publisher(Bool, "presence", qos.RESULT)
        self._distance = self.create_publisher(Float32, "presence/distance", qos.RESULT)
        self._breathing = self.create_publisher(Float32, "presence/breathing", qos.RESULT)
        self._named = self.create_publisher(handwave.msg.Gesture, "gestures", qos.RESULT)
        self._told: dict[str, Any] = {}
        self._info = InfoKeeper(self, self._configure)
        self.create_subscription(handwave.msg.RadarFrame, "radar/frame", self._take, qos.sensor(reliable=self.reliable))

    def _configure(self, info: RadarInfo) -> None:
        self._detector = PresenceDetector(self._config, info)
        self._gestures.reset()

    def _take(self, msg: Any) -> None:
        started = time.monotonic_ns()
        self.count_gap(msg.sequence)
        info = self._info.usable()
        if info is None:
            return
        frame = frame_from_msg(msg)
        if self.went_back(frame.stamp_ns):
            self._configure(info)
        found = self._detector.process(frame)
        self._present.publish(Bool(data=found.present))
        self._distance.publish(Float32(data=found.distance))
        self._breathing.publish(Float32(data=found.breathing))
        gesture = self._gestures.process(found)
        if gesture is not None and self._naming:
            self._named.publish(gesture_to_msg(gesture))
        self._told = {"present": found.present, "moving": found.moving, "still": found.still, "level_db": f"{found.level:.1f}"}
        self._told |= {name: f"{value:.2f}" for name, value in (("distance_m", found.distance), ("breathing_hz", found.breathing))}
        self.finish(found.stamp_ns, found.sequence, started)

    def extra_diagnostics(self) -> tuple[dict[str, Any], list[str]]:
        """Say what the last frame told."""
        return {name: "unknown" if value == f"{math.nan}" else value for name, value in self._told.items()}, []


make_node = PresenceNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
