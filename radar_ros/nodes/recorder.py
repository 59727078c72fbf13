"""Recorder node: the graph's topics into a rosbag2 MCAP, from a thread of its own."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from radar_core import ConfigError
from radar_ros import qos
from radar_ros.bags import RECORDED, TYPES, BagWriter, free_folder, was_cut_off
from radar_ros.params import declare
from radar_ros.stage import StageNode, run

_FLUSH_AFTER = 0.5  # s: what a crash may cost
_WAITING = 500  # messages between the network and the disk; 2.5 s of everything at 50 Hz


class RecorderNode(StageNode):
    """Writes what it hears, as bytes, without looking inside."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("recorder", **kwargs)
        path = str(declare(self, "bag", "", "folder of the new bag; must not exist yet, or hold a recording that a crash cut off"))
        topics = list(declare(self, "topics", list(RECORDED), "what to record, names within the namespace"))
        if not path:
            raise ConfigError(f"node {self.get_name()} needs the parameter bag: the folder to record into, e.g. -p bag:=my_recording")
        unknown = [topic for topic in topics if topic not in TYPES]
        if unknown:
            raise ConfigError(f"cannot record {', '.join(unknown)}; topics: {', '.join(TYPES)}")
        self._writer = BagWriter(self._folder(Path(path)))
        self._broken = False
        self._queue: queue.Queue[tuple[str, str, int, bytes] | None] = queue.Queue(_WAITING)
        self._thread = threading.Thread(target=self._write, name="recorder", daemon=True)
        self._thread.start()
        for topic in topics:
            name = "/tf_static" if topic == "tf_static" else topic
            resolved = self.resolve_topic_name(name)
            profile = qos.for_topic(topic, reliable=True)  # a recording is for looking closely: nothing may be missing
            self.create_subscription(qos.message_class(TYPES[topic]), name, self._taker(resolved, TYPES[topic]), profile, raw=True)
        self.get_logger().info(f"recording {len(topics)} topics into {self._writer.path}")

    def _folder(self, wanted: Path) -> Path:
        """Return the folder that was asked for; after a crash of ours, one beside it, so that a node that is started again goes on."""
        if not was_cut_off(wanted):
            return wanted
        beside = free_folder(wanted)
        self.get_logger().warning(f"{wanted} was cut off; going on in {beside}. Recover the first part with: handwave repair {wanted}")
        return beside

    def _taker(self, topic: str, msgtype: str) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            try:
                self._queue.put_nowait((topic, msgtype, self.get_clock().now().nanoseconds, data))
            except queue.Full:
                self.dropped += 1
                self.problem("the disk is too slow: messages are lost from the recording; record fewer topics (parameter topics)")

        return take

    def _write(self) -> None:
        """Write what comes until told to end; bring it to the file often, because a crash costs what is not there."""
        flushed = time.monotonic()
        while True:
            with suppress(queue.Empty):
                item = self._queue.get(timeout=_FLUSH_AFTER)
                if item is None:
                    return
                self._to_disk(partial(self._writer.write, *item))
                self.processed += not self._broken
                self.dropped += self._broken
            if time.monotonic() - flushed > _FLUSH_AFTER:
                self._to_disk(self._writer.flush)
                flushed = time.monotonic()

    def _to_disk(self, write: Callable[[], None]) -> None:
        """Write, unless that has failed before: behind a message that is there in part, nothing could be found again."""
        if not self._broken:
            try:
                write()
            except OSError as error:
                self._broken = True
                self._advice = f"the recording ended ({error}): make room, then recover it with: handwave repair {self._writer.path}"
        if self._broken:
            self.problem(self._advice)

    def close(self) -> None:
        """Write what waits and finish the bag."""
        self._queue.put(None)
        self._thread.join()
        self._to_disk(self._writer.close)


make_node = RecorderNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
