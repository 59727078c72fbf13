"""A node that falls ill when it is told to: it hangs, fails, wants too much memory, hears nothing any more, crashes or ends."""

from __future__ import annotations

import os
import signal
import threading
import time
from typing import Any

import handwave.msg
from std_msgs.msg import String

from radar_ros import qos
from radar_ros.messages.convert import from_time
from radar_ros.stage import StageNode, run


class PatientNode(StageNode):
    """Does nothing but what `benchmarks.faults` tells it on the topic ``illness``."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("patient", **kwargs)
        self._lock = threading.Lock()
        self.create_subscription(String, "illness", self._take, qos.COMMAND)
        self._tracks = self.create_subscription(handwave.msg.TrackArray, "tracks", self._work, qos.RESULT)

    def _work(self, msg: Any) -> None:
        self.finish(from_time(msg.header.stamp), msg.sequence, time.monotonic_ns())

    def _take(self, msg: Any) -> None:
        if msg.data == "deadlock":
            self._lock.acquire()
            self._lock.acquire()
        while msg.data == "loop":
            pass
        if msg.data == "fails":
            raise KeyError("a fault of this program")
        if msg.data in ("memory", "gigabyte"):
            bytearray(1 << (44 if msg.data == "memory" else 30))
        if msg.data == "deaf":
            self.destroy_subscription(self._tracks)
        if msg.data == "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        if msg.data == "exit":
            os._exit(7)


make_node = PatientNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
