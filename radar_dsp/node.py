"""Baseband node: radar/frame to radar/points."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarFrame as RadarFrameMsg
from sensor_msgs.msg import PointCloud2

from radar_core import HandwaveError, RadarInfo
from radar_dsp import Baseband, BasebandConfig
from radar_ros import qos
from radar_ros.convert import cloud_to_cloud2, cloud_to_msg, frame_from_msg
from radar_ros.params import declare_config
from radar_ros.stage import InfoKeeper, StageNode, run


class BasebandNode(StageNode):
    """Turns raw frames into point clouds."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("baseband", **kwargs)
        self._config = declare_config(self, BasebandConfig)
        self._baseband: Baseband | None = None
        self._points = self.create_publisher(PointCloudMsg, "radar/points", qos.stream_out())
        self._points2 = self.create_publisher(PointCloud2, "radar/points2", qos.stream_out())
        self._info = InfoKeeper(self, self._configure)
        self.create_subscription(RadarFrameMsg, "radar/frame", self._take, qos.frames_in(reliable=self.reliable))

    def _configure(self, info: RadarInfo) -> None:
        if info.waveform.n_sample > 0:
            self._baseband = Baseband(self._config, info)

    def _take(self, msg: Any) -> None:
        started = time.monotonic_ns()
        self.count_gap(msg.sequence)
        if not self._info.usable():
            self.dropped += 1
            return
        if self._baseband is None:
            self.problem("raw frames come, but radar/info says that this source gives no frames (n_sample = 0)")
            return
        try:
            cloud = self._baseband.process(frame_from_msg(msg))
        except HandwaveError as error:
            self.dropped += 1
            self.problem(str(error))
            return
        self._points.publish(cloud_to_msg(cloud))
        self.finish(cloud.stamp_ns, cloud.sequence, started)
        if self._points2.get_subscription_count():
            self._points2.publish(cloud_to_cloud2(cloud))


def make_node(**kwargs: Any) -> BasebandNode:
    """Make the node; ``kwargs`` go to rclpy's Node."""
    return BasebandNode(**kwargs)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until it is told to stop."""
    return run(make_node, argv)


if __name__ == "__main__":
    raise SystemExit(main())
