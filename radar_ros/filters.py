"""Time synchronisation with the interface of ROS's message_filters, for where that package is not installed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

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

    Parameters
    ----------
    fs : sequence of SimpleFilter
        Inputs.
    queue_size : int
        Messages of each input that wait for their partners; the oldest stamp falls out.
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
        with self.lock:
            stamp = from_time(msg.header.stamp)
            my_queue[stamp] = msg
            while len(my_queue) > self.queue_size:
                del my_queue[min(my_queue)]
            if all(stamp in queue for queue in self.queues):
                messages = [queue.pop(stamp) for queue in self.queues]
            else:
                return
        self.signalMessage(*messages)
