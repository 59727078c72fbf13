"""Time synchronisation with the interface of ROS's message_filters, for where that package is not installed."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.clock import ROSClock
from rclpy.logging import get_logger

from radar_ros.messages.convert import from_time


class SimpleFilter:
    """Something that passes messages on to callbacks."""

    def __init__(self) -> None:
        self.callbacks: dict[int, tuple[Callable[..., Any], tuple[Any, ...]]] = {}

    def registerCallback(self, cb: Callable[..., Any], *args: Any) -> int:  # noqa: N802  (message_filters' name)
        """Call ``cb(message, *args)`` for every message; returns a number for the connection."""
        connection = len(self.callbacks)
        self.callbacks[connection] = (cb, args)
        return connection

    def signalMessage(self, *msg: Any) -> None:  # noqa: N802  (message_filters' name)
        """Pass a message on."""
        for callback, args in self.callbacks.values():
            callback(*(msg + args))


class Subscriber(SimpleFilter):
    """A ROS subscription as a source; same arguments as ``node.create_subscription`` without the callback."""

    def __init__(self, node: Any, msg_type: Any, topic: str, qos_profile: Any = 10, **kwargs: Any) -> None:
        super().__init__()
        self.node, self.topic = node, topic
        self.sub = node.create_subscription(msg_type, topic, self.callback, qos_profile, **kwargs)

    def callback(self, msg: Any) -> None:
        """Take a message in."""
        self.signalMessage(msg)

    def getTopic(self) -> str:  # noqa: N802  (message_filters' name)
        """Topic it subscribes to."""
        return self.topic


class TimeSynchronizer(SimpleFilter):
    """Call back with one message of each input when their stamps are equal.

    So many messages (``queue_size``) of each input wait for their partners; the oldest stamp falls out.
    """

    def __init__(self, fs: Sequence[SimpleFilter], queue_size: int) -> None:
        super().__init__()
        self.queue_size = queue_size
        self.lock = threading.Lock()
        self.connectInput(fs)

    def connectInput(self, fs: Sequence[SimpleFilter]) -> None:  # noqa: N802  (message_filters' name)
        """Take messages from other filters."""
        self.queues: list[dict[int, Any]] = [{} for _ in fs]
        self.node = next((f.node for f in fs if hasattr(f, "node")), None)
        self.input_connections = [f.registerCallback(self.add, q, i) for i, (f, q) in enumerate(zip(fs, self.queues, strict=True))]

    def add(self, msg: Any, my_queue: dict[int, Any], my_queue_index: int | None = None) -> None:
        """Take one message in; fires when its partners are there."""
        stamp = self._stamp(msg)
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

    def _stamp(self, msg: Any) -> int | None:
        """Stamp of a message [ns]; None: it is passed over."""
        return from_time(msg.header.stamp)

    def _partners(self, stamp: int, my_queue: dict[int, Any]) -> tuple[int, ...] | None:
        """One stamp per input for the set of a message that has just come, or None."""
        return (stamp,) * len(self.queues) if all(stamp in queue for queue in self.queues) else None


class ApproximateTimeSynchronizer(TimeSynchronizer):
    """Call back with one message of each input when their stamps differ by less than ``slop`` seconds.

    As in message_filters, the message that comes last chooses its partners: the nearest ones, looked through input by input. A set whose
    stamps lie exactly ``slop`` apart is none. With ``allow_headerless``, messages without a header get the time of their arrival.
    """

    def __init__(self, fs: Sequence[SimpleFilter], queue_size: int, slop: float, allow_headerless: bool = False) -> None:
        super().__init__(fs, queue_size)
        self.slop = int(slop * 1e9)
        self.allow_headerless = allow_headerless

    def _stamp(self, msg: Any) -> int | None:
        if hasattr(msg, "header"):
            return from_time(msg.header.stamp)
        if self.allow_headerless:
            return int((ROSClock() if self.node is None else self.node.get_clock()).now().nanoseconds)
        text = "messages without a header are passed over; allow_headerless takes their time of arrival"
        get_logger("radar_ros.sync").warning(text, once=True)
        return None

    def _partners(self, stamp: int, my_queue: dict[int, Any]) -> tuple[int, ...] | None:
        near: list[list[int]] = []
        for queue in self.queues:
            stamps = [stamp] if queue is my_queue else [s for s in queue if abs(s - stamp) < self.slop]
            near.append(sorted(stamps, key=lambda s: abs(s - stamp)))
        return next((c for c in itertools.product(*near) if max(c) - min(c) < self.slop), None)
