"""Real rclpy for the tests of nodes and plumbing."""

import gc
import time

import pytest
import rclpy
from ros_domains import next_domain

from radar_ros.executor import make_executor


class Ros:
    """A context with one node for the test, and one executor for all nodes of it."""

    def __init__(self):
        rclpy.init(args=[])
        self.node = rclpy.create_node("tester")
        self.executor = make_executor()
        self.nodes = []
        self.add(self.node)

    def add(self, node):
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def spin_until(self, wanted, timeout=15.0):
        end = time.monotonic() + timeout
        while not wanted():
            if time.monotonic() > end:
                return False
            self.executor.spin_once(timeout_sec=0.05)
        return True

    def collect(self, msg_type, topic, profile=10):
        received = []
        self.node.create_subscription(msg_type, topic, received.append, profile)
        return received

    def connect(self, *topics):
        """Spin until every publisher and every reader of these topics, among the nodes here, know each other; False: they never did.

        That a reader is in the graph does not yet mean that a publisher sends to it.
        """
        return all(self.spin_until(lambda: self._connected(topic)) for topic in topics)  # noqa: B023  (it is called at once)

    def _connected(self, topic):
        name = topic if topic.startswith("/") else f"/{topic}"
        senders = [one for node in self.nodes for one in node.publishers if one.topic_name == name]
        readers = [one for node in self.nodes for one in node.subscriptions if one.topic_name == name]
        known = all(one.get_subscription_count() >= len(readers) for one in senders)
        return bool(senders and readers) and known and all(one.get_publisher_count() >= len(senders) for one in readers)

    def report(self, node, diagnostics):
        """End a node's period and return level, message and values of the diagnostics that come."""
        diagnostics.clear()
        node._diagnose()
        assert self.spin_until(lambda: diagnostics)
        (status,) = diagnostics[0].status
        return status.level, status.message, {v.key: v.value for v in status.values}

    def close(self):
        for node in self.nodes:
            getattr(node, "close", lambda: None)()
            self.executor.remove_node(node)
        self.executor.spin_once(timeout_sec=0.0)  # it lets go of what they were called back for
        self.executor.shutdown()
        for node in self.nodes:
            node.destroy_node()
        rclpy.try_shutdown()
        gc.collect()  # a node that is still held is seen by the graphs of later tests


@pytest.fixture
def own_domain(monkeypatch):
    """A domain per test: nodes that were killed with SIGKILL, or that Python still holds, stay visible to others."""
    monkeypatch.setenv("ROS_DOMAIN_ID", next_domain())


@pytest.fixture
def ros(own_domain):
    """A ROS context of its own in a domain of its own, closed afterwards."""
    context = Ros()
    yield context
    context.close()
