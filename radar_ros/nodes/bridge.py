"""Bridge node: tracks to the messages of other packages, where those are installed."""

from __future__ import annotations

import time
from typing import Any

import handwave.msg
import numpy as np
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from radar_ros import qos
from radar_ros.messages.people import bodies_to_msg, body_frames, detections_to_msg, messages_of
from radar_ros.messages.tracks import tracks_from_msg
from radar_ros.stage import StageNode, run
from radar_tracking.tracks import Tracks

_BODIES = "/humans/bodies/tracked"  # REP-155 names it so, for everybody


class BridgeNode(StageNode):
    """Publishes people as `vision_msgs` detections and as bodies of REP-155, as far as the packages are installed."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("bridge", **kwargs)
        self._vision, self._hri = messages_of("vision_msgs"), messages_of("hri_msgs")
        for package, found, lost in (("vision_msgs", self._vision, "people/detections"), ("hri_msgs", self._hri, _BODIES)):
            if found is None:
                advice = f"sudo apt-get install ros-$ROS_DISTRO-{package.replace('_', '-')}"
                self.get_logger().warning(f"{package} is not installed, so {lost} is not published: {advice}")
        if self._vision is not None:
            self._detections = self.create_publisher(self._vision.Detection3DArray, "people/detections", qos.RESULT)
        if self._hri is not None:
            self._bodies = self.create_publisher(self._hri.IdsList, _BODIES, qos.RESULT)
            self._frames = self.create_publisher(TFMessage, "/tf", qos.RESULT)
        self.create_subscription(handwave.msg.TrackArray, "tracks", self._take, qos.RESULT)

    def _take(self, msg: Any) -> None:
        started = time.monotonic_ns()
        self.count_gap(msg.sequence, msg.every)
        tracks = tracks_from_msg(msg)
        self._publish(tracks, msg.header)
        if self._hri is not None:
            self._frames.publish(body_frames(tracks, msg.header))
        self.finish(tracks.stamp_ns, tracks.sequence, started)

    def _publish(self, tracks: Tracks, header: Any) -> None:
        if self._vision is not None:
            self._detections.publish(detections_to_msg(self._vision, tracks, header))
        if self._hri is not None:
            self._bodies.publish(bodies_to_msg(self._hri, tracks, header))

    def on_stale(self) -> None:
        """Say that nobody is known any longer."""
        header = Header(stamp=self.get_clock().now().to_msg(), frame_id="room")
        self._publish(Tracks(0, 0, "room", (), np.empty(0, np.int32)), header)


make_node = BridgeNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
