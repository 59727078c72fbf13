"""Tracking node: radar/points to tracks."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import TrackArray as TrackArrayMsg
from std_msgs.msg import UInt32

from radar_core import HandwaveError, RadarInfo
from radar_ros import qos
from radar_ros.convert import cloud_from_msg
from radar_ros.params import declare_config
from radar_ros.stage import InfoKeeper, StageNode, run
from radar_tracking import PeopleTracker, TrackerConfig
from radar_tracking.messages import tracks_to_msg


class TrackingNode(StageNode):
    """Follows people through point clouds."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("tracking", **kwargs)
        self._tracker = PeopleTracker(declare_config(self, TrackerConfig))
        self._tracks = self.create_publisher(TrackArrayMsg, "tracks", qos.RESULT)
        self._count = self.create_publisher(UInt32, "people_count", qos.RESULT)
        self._info = InfoKeeper(self, self._configure)
        self.create_subscription(PointCloudMsg, "radar/points", self._take, qos.sensor(reliable=self.reliable))

    def _configure(self, info: RadarInfo) -> None:
        self.get_logger().info(f"clouds come from {info.frame_id}, mounted {info.mount.z:g} m above the floor")

    def _take(self, msg: Any) -> None:
        started = time.monotonic_ns()
        self.count_gap(msg.sequence)
        info = self._info.info
        if not self._info.usable() or info is None:
            self.dropped += 1
            return
        try:
            cloud = cloud_from_msg(msg).to_room(info.mount)
            if self.went_back(cloud.stamp_ns):
                self._tracker.reset()
            tracks = self._tracker.process(cloud)
        except HandwaveError as error:
            self.dropped += 1
            self.problem(str(error))
            return
        self._tracks.publish(tracks_to_msg(tracks))
        self.finish(tracks.stamp_ns, tracks.sequence, started)
        self._count.publish(UInt32(data=tracks.people_count))


def make_node(**kwargs: Any) -> TrackingNode:
    """Make the node; ``kwargs`` go to rclpy's Node."""
    return TrackingNode(**kwargs)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until it is told to stop."""
    return run(make_node, argv)


if __name__ == "__main__":
    raise SystemExit(main())
