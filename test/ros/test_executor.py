"""The executor of all nodes: timers and messages without a wait set, woken from other threads; and where there is no events executor."""

import io
import sys
import threading
import time

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import String

from radar_ros.executor import make_executor


@pytest.fixture
def node():
    """A node of a context of its own."""
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node("of_an_executor", context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


def works(executor, node):
    """Whether timers made late, messages, and tasks from another thread are all served."""
    executor.add_node(node)
    said = []
    publisher = node.create_publisher(String, "said", 10)
    node.create_subscription(String, "said", lambda msg: said.append(msg.data), 10)
    node.create_timer(0.02, lambda: publisher.publish(String(data="timer")))
    thread = threading.Thread(target=lambda: executor.create_task(said.append, "task"))
    thread.start()
    end = time.monotonic() + 20.0
    while {"timer", "task"} - set(said) and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    thread.join()
    return {"timer", "task"} <= set(said)


def test_it_is_the_events_executor(node):
    """And it serves all that our nodes ask of it."""
    executor = make_executor(node.context)
    assert not isinstance(executor, SingleThreadedExecutor)
    assert works(executor, node)


@pytest.mark.parametrize("why", ["no file", "no stderr", "old rclpy"])
def test_another_one_where_there_is_none(node, monkeypatch, why):
    """In a notebook, in a program without stderr, and with an rclpy that has none."""
    if why == "old rclpy":
        monkeypatch.setitem(sys.modules, "rclpy.experimental.events_executor", None)
    else:
        monkeypatch.setattr(sys, "stderr", io.StringIO() if why == "no file" else None)
    executor = make_executor(node.context)
    assert isinstance(executor, SingleThreadedExecutor)
    assert works(executor, node)
    executor.shutdown()
