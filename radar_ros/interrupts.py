"""Commands beside a graph: a node of their own, and Ctrl-C, after which a command tidies up, whatever else it is told meanwhile."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

INTERRUPTED = 130
"""Exit status of a command that was told to stop before its end, as shells count it (128 + SIGINT)."""

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class _Shield:
    depth = 0  # of blocks that must not be broken and are being run
    told = False  # whether a signal waits for their end


@contextmanager
def unbroken() -> Iterator[None]:
    """Let a signal that `interruptible` would raise at once wait until the block is done: half a record would spoil a recording."""
    _Shield.depth += 1
    try:
        yield
    finally:
        _Shield.depth -= 1
        if _Shield.told and _Shield.depth == 0:
            _Shield.told = False
            raise KeyboardInterrupt


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise `KeyboardInterrupt` at the first SIGINT, SIGTERM or SIGHUP and ignore the next: nodes are stopped in order."""

    def stop(*_: Any) -> None:
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        if _Shield.depth:
            _Shield.told = True
            return
        raise KeyboardInterrupt

    before = {number: signal.signal(number, stop) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def ros() -> Iterator[None]:
    """Use rclpy without its signal handlers: they would shut it down under the command's feet, which ends in a traceback."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield
    finally:
        rclpy.try_shutdown()


class Visitor:
    """A node of a command, with an executor of its own."""

    def __init__(self, name: str, namespace: str = "") -> None:
        self.node = rclpy.create_node(name, namespace=namespace, start_parameter_services=False)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)

    def spin(self, seconds: float) -> None:
        """Take in what comes for so long."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=left)

    def close(self) -> None:
        """Leave the graph."""
        self.executor.shutdown()
        self.node.destroy_node()
