"""Recorder node: the graph's topics into a rosbag2 MCAP, from a thread of its own."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from radar_core import ConfigError
from radar_ros import qos
from radar_ros.bags import TYPES, BagWriter
from radar_ros.params import declare
from radar_ros.stage import StageNode, run

_FLUSH_AFTER = 0.5  # s: what a crash may cost
_WAITING = 500  # messages between the network and the disk; 2.5 s of everything at 50 Hz


class RecorderNode(StageNode):
    """Writes what it hears, as bytes, without looking inside."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("recorder", **kwargs)
        path = str(declare(self, "bag", "", "folder of the new bag; must not exist yet"))
        topics = list(declare(self, "topics", list(TYPES), "what to record, names within the namespace"))
        if not path:
            raise ConfigError(f"node {self.get_name()} needs the parameter bag: the folder to record into, e.g. -p bag:=my_recording")
        unknown = [topic for topic in topics if topic not in TYPES]
        if unknown:
            raise ConfigError(f"cannot record {', '.join(unknown)}; topics: {', '.join(TYPES)}")
        self._writer = BagWriter(Path(path))
        self._queue: queue.Queue[tuple[str, str, int, bytes] | None] = queue.Queue(_WAITING)
        self._thread = threading.Thread(target=self._write, name="recorder", daemon=True)
        self._thread.start()
        for topic in topics:
            name = "/tf_static" if topic == "tf_static" else topic
            resolved = self.resolve_topic_name(name)
            profile = qos.for_topic(topic, reliable=True)  # a recording is for looking closely: nothing may be missing
            self.create_subscription(qos.message_class(TYPES[topic]), name, self._taker(resolved, TYPES[topic]), profile, raw=True)
        self.get_logger().info(f"recording {len(topics)} topics into {path}")

    def _taker(self, topic: str, msgtype: str) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            try:
                self._queue.put_nowait((topic, msgtype, self.get_clock().now().nanoseconds, data))
                self.processed += 1
            except queue.Full:
                self.dropped += 1
                self.problem("the disk is too slow: messages are lost from the recording; record fewer topics (parameter topics)")

        return take

    def _write(self) -> None:
        """Write what comes until told to end; bring it to the file often, because a crash costs what is not there."""
        flushed = time.monotonic()
        while True:
            try:
                item = self._queue.get(timeout=_FLUSH_AFTER)
                if item is None:
                    return
                self._writer.write(*item)
            except queue.Empty:
                pass
            except OSError as error:
                self.problem(f"cannot write the recording ({error}); is the disk full?")
            if time.monotonic() - flushed > _FLUSH_AFTER:
                self._writer.flush()
                flushed = time.monotonic()

    def close(self) -> None:
        """Write what waits and finish the bag."""
        self._queue.put(None)
        self._thread.join()
        self._writer.close()


def make_node(**kwargs: Any) -> RecorderNode:
    """Make the node; ``kwargs`` go to rclpy's Node."""
    return RecorderNode(**kwargs)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until it is told to stop."""
    return run(make_node, argv)


if __name__ == "__main__":
    raise SystemExit(main())
