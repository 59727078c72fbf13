"""The executor that everything of ours spins on."""

from __future__ import annotations

from typing import Any

from rclpy.executors import SingleThreadedExecutor


def make_executor(context: Any = None) -> Any:
    """Make rclpy's events executor, of a context (None: the usual one); before rclpy 7.1.4, which has none, a single-threaded one.

    A single-threaded executor makes a wait set of everything for each message, which takes several times as long as most of our callbacks.
    The events executor takes no guard conditions: wake it by `create_task`. Spin it with a timeout, else no timer wakes it.
    """
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)
