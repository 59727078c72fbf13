"""Messages of nearly the same time, with the interface of ROS's message_filters, for where that package is not installed."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

from rclpy.clock import ROSClock
from rclpy.logging import get_logger
from rclpy.time import Time

from radar_ros.filters import SimpleFilter, TimeSynchronizer
from radar_ros.messages.convert import from_time


def _stamp(msg: Any, node: Any, allow_headerless: bool) -> int | None:
    """Stamp of a message [ns]; without a header, the (node's) time if that is allowed, else None."""
    if hasattr(msg, "header"):
        return from_time(msg.header.stamp)
    if not allow_headerless:
        get_logger("radar_ros.sync").warning(
            "messages without a header are passed over; allow_headerless takes their time of arrival", once=True
        )
        return None
    return int((ROSClock() if node is None else node.get_clock()).now().nanoseconds)


class Cache(SimpleFilter):
    """The last ``cache_size`` messages, in the order of their stamps, to ask for by time."""

    def __init__(self, f: SimpleFilter | None, cache_size: int = 1, allow_headerless: bool = False) -> None:
        super().__init__()
        self.cache_size, self.allow_headerless = cache_size, allow_headerless
        self.cache_msgs: list[Any] = []
        self.cache_times: list[int] = []
        self.node = getattr(f, "node", None)
        if f is not None:
            self.connectInput(f)

    def connectInput(self, f: SimpleFilter) -> None:  # noqa: N802  (message_filters' name)
        """Take messages from another filter."""
        self.incoming_connection = f.registerCallback(self.add)

    def add(self, msg: Any) -> None:
        """Keep a message; the oldest falls out."""
        stamp = _stamp(msg, self.node, self.allow_headerless)
        if stamp is None:
            return
        place = next((i for i in range(len(self.cache_times), 0, -1) if self.cache_times[i - 1] <= stamp), 0)
        self.cache_times.insert(place, stamp)
        self.cache_msgs.insert(place, msg)
        if len(self.cache_msgs) > self.cache_size:
            del self.cache_times[0], self.cache_msgs[0]
        self.signalMessage(msg)

    def getInterval(self, from_stamp: Any, to_stamp: Any) -> list[Any]:  # noqa: N802  (message_filters' name)
        """Messages with stamps in [from_stamp, to_stamp]."""
        low, high = from_stamp.nanoseconds, to_stamp.nanoseconds
        return [m for m, t in zip(self.cache_msgs, self.cache_times, strict=True) if low <= t <= high]

    def getElemAfterTime(self, stamp: Any) -> Any:  # noqa: N802  (message_filters' name)
        """Oldest message at or after a time, or None."""
        return next((m for m, t in zip(self.cache_msgs, self.cache_times, strict=True) if t >= stamp.nanoseconds), None)

    def getElemBeforeTime(self, stamp: Any) -> Any:  # noqa: N802  (message_filters' name)
        """Newest message at or before a time, or None."""
        older = [m for m, t in zip(self.cache_msgs, self.cache_times, strict=True) if t <= stamp.nanoseconds]
        return older[-1] if older else None

    def getOldestTime(self) -> Time | None:  # noqa: N802  (message_filters' name)
        """Stamp of the oldest message, or None."""
        return Time(nanoseconds=self.cache_times[0]) if self.cache_times else None

    def getLastestTime(self) -> Time | None:  # noqa: N802  (message_filters' name, its spelling too)
        """Stamp of the newest message, or None."""
        return Time(nanoseconds=self.cache_times[-1]) if self.cache_times else None

    def getLast(self) -> Any:  # noqa: N802  (message_filters' name)
        """Newest message, or None."""
        return self.cache_msgs[-1] if self.cache_msgs else None


class ApproximateTimeSynchronizer(TimeSynchronizer):
    """Call back with one message of each input when their stamps differ by less than ``slop`` seconds.

    As in message_filters, the message that comes last chooses its partners: the nearest ones, looked through input by input. A set whose
    stamps lie exactly ``slop`` apart is none.

    Parameters
    ----------
    fs : sequence of SimpleFilter
        Inputs.
    queue_size : int
        Messages of each input that wait.
    slop : float
        The stamps within one set differ by less than this [s].
    allow_headerless : bool
        Messages without a header get the time of their arrival.
    """

    def __init__(self, fs: Sequence[SimpleFilter], queue_size: int, slop: float, allow_headerless: bool = False) -> None:
        super().__init__(fs, queue_size)
        self.slop = int(slop * 1e9)
        self.allow_headerless = allow_headerless

    def add(self, msg: Any, my_queue: dict[int, Any], my_queue_index: int | None = None) -> None:
        """Take one message in; fires with the nearest set of partners."""
        stamp = _stamp(msg, self.node, self.allow_headerless)
        if stamp is None:
            return
        with self.lock:
            my_queue[stamp] = msg
            while len(my_queue) > self.queue_size:
                del my_queue[min(my_queue)]
            chosen = self._partners(stamp, my_queue) if stamp in my_queue else None
            if chosen is None:
                return
            messages = [queue.pop(s) for queue, s in zip(self.queues, chosen, strict=True)]
        self.signalMessage(*messages)

    def _partners(self, stamp: int, my_queue: dict[int, Any]) -> tuple[int, ...] | None:
        """One stamp per input for the set of a message that has just come, or None."""
        near: list[list[int]] = []
        for queue in self.queues:
            stamps = [stamp] if queue is my_queue else [s for s in queue if abs(s - stamp) < self.slop]
            near.append(sorted(stamps, key=lambda s: abs(s - stamp)))
        return next((c for c in itertools.product(*near) if max(c) - min(c) < self.slop), None)
