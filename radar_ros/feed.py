"""What the driver node does with a device that sends by itself: readings to messages, on the node's clock."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from radar_core import PointCloud, RadarFrame, RadarInfo
from radar_driver.live import LiveSource, Reader


class LiveFeed:
    """Publishes the newest reading of a device as soon as it is there.

    Parameters
    ----------
    node : rclpy.lifecycle.LifecycleNode
        With the stage's plumbing.
    source : LiveSource
        Powered up.
    info : RadarInfo
        As the node tells it: its frame_id becomes the data's.
    publish : callable
        Sends a frame or a cloud, stamped with the node's clock.
    """

    def __init__(self, node: Any, source: LiveSource, info: RadarInfo, publish: Callable[[RadarFrame | PointCloud], None]) -> None:
        self._node, self._source, self._info, self._publish = node, source, info, publish
        self._guard = node.create_guard_condition(self._arrived)
        self._reader = Reader(source, self._guard.trigger)
        self._told = ""

    def start(self) -> None:
        """Let the device send; a `DeviceError` says why it does not."""
        self._reader.start()

    def stop(self) -> None:
        """Let it be silent; its thread has ended when this returns."""
        self._reader.stop()
        self._node.destroy_guard_condition(self._guard)

    def _arrived(self) -> None:
        started = time.monotonic_ns()
        self._tell(self._reader.problem)
        reading = self._reader.take()
        if reading is None:
            return
        data = reading.data
        stamp = data.stamp_ns + self._node.get_clock().now().nanoseconds - time.monotonic_ns()
        self._node.count_gap(data.sequence, data.every if isinstance(data, PointCloud) else 1)
        self._publish(replace(data, stamp_ns=max(stamp, 0), frame_id=self._info.frame_id))
        self._node.finish(stamp, data.sequence, started)

    def _tell(self, problem: str) -> None:
        if problem:
            self._node.problem(problem)
        elif self._told:
            self._node.get_logger().info("the device sends again")
        self._told = problem

    def figures(self) -> tuple[dict[str, Any], list[str]]:
        """Give the device's report and the reader's counts, for diagnostics; and what to warn of."""
        values = {**self._source.report(), "replaced": self._reader.replaced, **self._reader.counts}
        warnings = [str(value) for key, value in values.items() if key.endswith("advice")]
        return values, warnings + ([self._reader.problem] if self._reader.problem else [])
