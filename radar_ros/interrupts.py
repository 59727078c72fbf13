"""Commands beside a graph: rclpy without its signal handlers, and a node of their own."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from radar_ros.executor import make_executor
from radar_ros.signals import unbroken

_PULSE = 0.1  # s: Python sees a signal only between two waits of the executor


@contextmanager
def ros() -> Iterator[None]:
    """Use rclpy without its signal handlers: they would shut it down under the command's feet, which ends in a traceback."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield
    finally:
        rclpy.try_shutdown()


class Visitor:
    """A node of a command, with an executor of its own.

    It offers no services. That of type descriptions outlives its node in rclpy, so that this process grew by 0.1 MB with each visit, and
    every other one of the graph by 6 kB.
    """

    def __init__(self, name: str, namespace: str = "") -> None:
        without = [Parameter("start_type_description_service", value=False)]
        self.node = rclpy.create_node(name, namespace=namespace, start_parameter_services=False, parameter_overrides=without)
        self.executor = make_executor()
        self.executor.add_node(self.node)

    def spin(self, seconds: float) -> None:
        """Take in what comes for so long."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            with unbroken():  # a Ctrl-C within a callback would be logged with its traceback by rclpy
                self.executor.spin_once(timeout_sec=min(left, _PULSE))

    def close(self) -> None:
        """Leave the graph."""
        self.executor.remove_node(self.node)
        self.executor.spin_once(timeout_sec=0.0)  # it lets go of the node
        self.executor.shutdown()
        self.node.destroy_node()
