"""The executor that everything of ours spins on."""

from __future__ import annotations

import contextlib
from typing import Any

from rclpy.executors import SingleThreadedExecutor


def make_executor(context: Any = None) -> Any:
    """Make rclpy's events executor for a context (None: the usual one), or a single-threaded one where there is none.

    A single-threaded executor makes a wait set of everything for each message, which takes longer than most of our callbacks. The events
    executor takes no guard conditions: wake it by `create_task`. Spin it with a timeout, else no timer wakes it.
    """
    # It is there from rclpy 7.1.4 on. It switches faulthandler on, which refuses a stderr that is no file, as in a notebook.
    with contextlib.suppress(ImportError, OSError, RuntimeError):
        from rclpy.experimental.events_executor import EventsExecutor

        return EventsExecutor(context=context)
    return SingleThreadedExecutor(context=context)
