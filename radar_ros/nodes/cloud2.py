"""Cloud node: any ``sensor_msgs/PointCloud2`` of a radar as ``radar/points``, with ``radar/info`` and tf as the driver gives them."""

from __future__ import annotations

import time
from typing import Any, Final

import handwave.msg
from sensor_msgs.msg import PointCloud2

from radar_core import RadarInfo
from radar_driver.foreign import ForeignConfig, foreign_cloud
from radar_ros import qos
from radar_ros.announce import Announcer, in_namespace
from radar_ros.messages.convert import cloud_to_msg, from_time
from radar_ros.messages.pointcloud2 import read_fields
from radar_ros.params import declare, declare_config
from radar_ros.stage import StageNode, run

_QUIET: Final = 4.0  # s without a cloud: worth a word


class Cloud2Node(StageNode):
    """Takes somebody else's clouds; what cannot be used is dropped, counted, and logged once."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("cloud2", **kwargs)
        self._config = declare_config(self, ForeignConfig)
        topic = str(declare(self, "topic", "points", "topic of the clouds (sensor_msgs/PointCloud2), e.g. /ti_mmwave/radar_scan_pcl"))
        self._info: RadarInfo | None = None
        self._count = 0
        self._refused_points = 0
        self._theirs = ""
        self._heard = time.monotonic()
        self._points = self.create_publisher(handwave.msg.PointCloud, "radar/points", qos.stream_out())
        self._announcer = Announcer(self)
        if self._config.frame_id:
            self._describe(self._config.frame_id)
        # Best effort: other people's drivers often offer no more, and a reader that asks for more gets nothing.
        self._subscription = self.create_subscription(PointCloud2, topic, self._take, qos.sensor(reliable=self.reliable))
        self._topic = self._subscription.topic_name

    def _describe(self, frame_id: str) -> None:
        self._info = self._config.info(in_namespace(self, frame_id))
        self.frame_interval = self._config.frame_interval
        self._announcer.start(self._info)

    def _take(self, msg: Any) -> None:
        started, head = time.monotonic_ns(), msg.header
        self._heard = time.monotonic()
        values = read_fields(msg, self._config.names, self._topic)
        if self._info is None:
            self._describe(head.frame_id or "radar")
        assert self._info is not None
        if self._theirs and head.frame_id != self._theirs:
            self.caution(f"{self._topic}: clouds come in the frames {self._theirs!r} and {head.frame_id!r}; all count as one radar's")
        self._theirs = self._theirs or head.frame_id
        said = from_time(head.stamp)
        stamp = said if self._config.stamp == "message" and said > 0 else self.get_clock().now().nanoseconds
        stamp = max(stamp - round(self._config.latency * 1e9), 1)
        cloud, refused = foreign_cloud(values, self._config, stamp, self._count, self._info.frame_id)
        self._count += 1
        self._refused_points += refused
        self._points.publish(cloud_to_msg(cloud))
        self.finish(cloud.stamp_ns, cloud.sequence, started)

    def extra_diagnostics(self) -> tuple[dict[str, Any], list[str]]:
        """Points that were left out since the start; silence."""
        quiet = time.monotonic() - self._heard
        found = self.count_publishers(self._topic)
        reason = "nobody publishes it: is the radar's driver running, and the topic right?" if not found else "its publisher is silent"
        warnings = [f"no cloud on {self._topic} for {quiet:.0f} s: {reason}"] if quiet > _QUIET else []
        return {"points_without_position": self._refused_points, "topic": self._topic}, warnings


make_node = Cloud2Node
if __name__ == "__main__":
    raise SystemExit(run(make_node))
