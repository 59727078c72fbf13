"""A radar of clouds alone, for `benchmarks.ptp`: all that are started take their frames at the same moments, each stamps by its own clock.

Frames are taken between whole multiples of their interval on ROS's steady clock, which nobody sets, and are counted by it: clouds of one
moment have the same sequence, whatever the system clocks of their radars say.
"""

from __future__ import annotations

import time
from typing import Any, Final

import handwave.msg
import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from radar_core import PointCloud, Pose, RadarInfo
from radar_ros import qos
from radar_ros.messages.convert import cloud_to_msg, info_to_msg
from radar_ros.stage import StageNode, run

INTERVAL: Final = 0.02
"""Time from frame to frame [s], as that of the default waveform."""
_NS: Final = round(INTERVAL * 1e9)
_POINTS: Final = 20  # as of one person
_SIDE: Final = 0.8  # m: the radars stand so far left and right of the middle


class ClockedRadarNode(StageNode):
    """Publishes ``radar/info`` once and a cloud of somebody who stands still every frame."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("radar", **kwargs)
        name = self.get_namespace().strip("/")
        self._info = RadarInfo(frame_id=f"{name}/radar", mount=Pose(y=_SIDE if name == "left" else -_SIDE))
        self._sequence = -1
        rng = np.random.default_rng(5)
        position = np.array([2.5, 0.2, 0.0]) - [0.0, self._info.mount.y, 0.0] + rng.normal(0.0, 0.1, (_POINTS, 3))
        x, y, z = position.T
        distance = np.linalg.norm(position, axis=1)
        values = {"x": x, "y": y, "z": z, "range": distance, "azimuth": np.arctan2(y, x), "elevation": np.arcsin(z / distance)}
        values |= {"radial_speed": np.zeros(_POINTS), "snr": np.full(_POINTS, 20.0)}
        self._values = {key: value.astype(np.float32) for key, value in values.items()}
        self._points = self.create_publisher(handwave.msg.PointCloud, "radar/points", qos.stream_out())
        self._infos = self.create_publisher(handwave.msg.RadarInfo, "radar/info", qos.LATCHED)
        self._infos.publish(info_to_msg(self._info, self.get_clock().now().nanoseconds))
        self.ready()
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        time.sleep((_NS // 2 - self._steady.now().nanoseconds) % _NS * 1e-9)
        self.create_timer(INTERVAL, self._measure, clock=self._steady)

    def _measure(self) -> None:
        started = time.monotonic_ns()
        sequence, stamp = self._steady.now().nanoseconds // _NS, self.get_clock().now().nanoseconds
        if sequence == self._sequence:
            return
        self._sequence = sequence
        self._points.publish(cloud_to_msg(PointCloud(stamp, sequence, self._info.frame_id, **self._values)))
        self.finish(stamp, sequence, started)


make_node = ClockedRadarNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
