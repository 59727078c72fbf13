"""Readings of a source, handed to the driver node's thread as soon as they are there."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from radar_driver.live import Reader
from radar_driver.sources import Reading, Source


class Feed:
    """Reads a source in a thread, and calls back in the node's.

    Parameters
    ----------
    node : rclpy.lifecycle.LifecycleNode
        With the stage's plumbing.
    source : Source
        Powered up.
    publish : callable
        Takes a reading, and when the node began with it on CLOCK_MONOTONIC [ns].
    """

    def __init__(self, node: Any, source: Source, publish: Callable[[Reading, int], None]) -> None:
        self._node, self._source, self._publish = node, source, publish
        self._guard = node.create_guard_condition(self._arrived)
        self._reader = Reader(source, self._guard.trigger)
        self._running = False
        self._told = ""

    def start(self) -> None:
        """Let the source send; a `DeviceError` says why it does not."""
        self._running = True
        self._reader.start()

    def stop(self) -> None:
        """Let it be silent; its thread has ended when this returns. May be called twice."""
        self._running = False
        self._reader.stop()

    def close(self) -> None:
        """Stop, for good."""
        self.stop()
        self._node.destroy_guard_condition(self._guard)

    def _arrived(self) -> None:
        started, problem = time.monotonic_ns(), self._reader.problem
        if problem:
            self._node.problem(problem)
        elif self._told:
            self._node.get_logger().info("the device sends again")
        self._told = problem
        reading = self._reader.take()
        if reading is not None and self._running:
            self._publish(reading, started)

    def figures(self) -> tuple[dict[str, Any], list[str]]:
        """Give the source's report and the reader's counts, for diagnostics; and what to warn of."""
        values = {**self._source.report(), "replaced": self._reader.replaced, **self._reader.counts}
        warnings = [str(value) for key, value in values.items() if key.endswith("advice")]
        return values, warnings + ([self._reader.problem] if self._reader.problem else [])
