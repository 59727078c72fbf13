"""Recorder node: the graph's topics into a rosbag2 MCAP, from a thread of its own."""

from __future__ import annotations

import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.qos import DurabilityPolicy
from rosbags.interfaces import Qos, QosHistory

from radar_core import ConfigError, DataError
from radar_ros import qos
from radar_ros.bags import RECORDED, TYPES, BagWriter, free_folder, recorded_qos, was_cut_off
from radar_ros.params import declare
from radar_ros.stage import StageNode, run

_FLUSH_AFTER = 0.5  # s: what a crash may cost
_AGAIN = 5.0  # s: a recording that ended because the disk was full begins anew beside, as soon as there is room
_ROOM = 16  # MiB that have to be free for that
_TURN = 0.05  # s: messages are written together, because to wake a thread for each costs more than to write it
_WAITING = 500  # messages between the network and the disk; 2.5 s of everything at 50 Hz


def _each_once(take: Callable[[bytes], None]) -> Callable[[bytes], None]:
    """Leave out a message that says to the byte what one of the last ones said: `qos.subscribe_latched` may bring it twice."""
    last: deque[bytes] = deque(maxlen=qos.LATCHED_EACH.depth)

    def taking(data: bytes) -> None:
        if data not in last:
            last.append(data)
            take(data)

    return taking


class RecorderNode(StageNode):
    """Writes what it hears, as bytes, without looking inside."""

    fixed_because = "the recording has begun"

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
        self._broken, self._tried = False, 0.0  # whether writing failed, and when it was last tried to begin anew
        self._waiting: deque[tuple[str, str, int, bytes]] = deque()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._write, name="recorder", daemon=True)
        self._thread.start()
        for topic in topics:
            name = qos.place(topic)
            resolved = self.resolve_topic_name(name)
            kind, taker = qos.message_class(TYPES[topic]), self._taker(resolved, TYPES[topic], topic)
            profile = qos.for_topic(topic, reliable=True)  # a recording is for looking closely: nothing may be missing
            if profile.durability is DurabilityPolicy.TRANSIENT_LOCAL:
                qos.subscribe_latched(self, kind, name, _each_once(taker), profile=profile, raw=True)
            else:
                self.create_subscription(kind, name, taker, profile, raw=True)
        self.get_logger().info(f"recording {len(topics)} topics into {self._writer.path}")

    def expects_data(self) -> bool:
        """Whoever records waits for what comes: this stage is never stale."""
        return False

    def _folder(self, wanted: Path) -> Path:
        """Return the folder that was asked for; after a crash of ours, one beside it, so that a node that is started again goes on."""
        if not was_cut_off(wanted):
            return wanted
        beside = free_folder(wanted)
        self.get_logger().warning(f"{wanted} was cut off; going on in {beside}. Recover the first part with: handwave repair {wanted}")
        return beside

    def _taker(self, topic: str, msgtype: str, name: str) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            if topic not in self._writer.offered:
                self._writer.offered[topic] = self._offered(topic, name)
            if len(self._waiting) < _WAITING:
                self._waiting.append((topic, msgtype, self.get_clock().now().nanoseconds, data))
                return
            self.dropped += 1
            self.problem("the disk is too slow: messages are lost from the recording; record fewer topics (parameter topics)")

        return take

    def _offered(self, topic: str, name: str) -> list[Qos]:
        """QoS that the publishers of a topic offer; how many messages each keeps does not travel, so that is as we would have it."""
        found, ours = [], recorded_qos(qos.offered(name))
        for publisher in self.get_publishers_info_by_topic(topic):
            known = recorded_qos(publisher.qos_profile)
            if known.history is QosHistory.UNKNOWN:
                known = known._replace(history=ours.history, depth=ours.depth)
            if known not in found:
                found.append(known)
        return found or [ours]

    def _write(self) -> None:
        """Write what comes until told to end; bring it to the file often, because a crash costs what is not there."""
        flushed, ended = time.monotonic(), False
        while not ended:
            ended = self._ending.wait(_TURN)
            for _ in range(len(self._waiting)):  # not more: on a slow disk more come meanwhile, and nothing would be flushed
                self._to_disk(partial(self._writer.write, *self._waiting.popleft()))
                self.processed += not self._broken
                self.dropped += self._broken
            self._begin_anew()
            if time.monotonic() - flushed > _FLUSH_AFTER:
                self._to_disk(self._writer.flush)
                flushed = time.monotonic()

    def _to_disk(self, write: Callable[[], None]) -> None:
        """Write, unless that has failed before: behind a message that is there in part, nothing could be found again."""
        if not self._broken:
            try:
                write()
            except OSError as error:
                self._broken, self._tried = True, time.monotonic()
                self._advice = f"the recording ended ({error}): make room, then recover it with: handwave repair {self._writer.path}"
        if self._broken:
            self.problem(self._advice)

    def _begin_anew(self) -> None:
        """Go on in a folder beside the one that could not be written, where that is possible now."""
        if not self._broken or time.monotonic() - self._tried < _AGAIN:
            return
        self._tried, offered = time.monotonic(), dict(self._writer.offered)
        with suppress(DataError, OSError):
            _require_room(self._writer.path.parent)
            writer = BagWriter(free_folder(self._writer.path))
            self._writer.abandon()
            writer.offered.update(offered)
            self._writer, self._broken = writer, False
            self.get_logger().warning(f"there is room again: the recording goes on in {writer.path}")

    def close(self) -> None:
        """Write what waits and finish the bag."""
        self._ending.set()
        self._thread.join()
        self._to_disk(self._writer.close)


def _require_room(folder: Path) -> None:
    """Raise `OSError` unless so much can be written there that it makes sense to begin a recording."""
    with tempfile.TemporaryFile(dir=folder) as file:
        for _ in range(_ROOM):
            file.write(bytes(1 << 20))
        file.flush()


make_node = RecorderNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
