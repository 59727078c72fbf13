"""Nodes of commands come and go without leaving anything behind."""

import time

import psutil

from radar_ros.interrupts import Visitor, ros


def test_a_visit_leaves_nothing_behind():
    """Neither a service that outlives its node, nor memory."""
    process = psutil.Process()
    with ros():
        stays = Visitor("stays")
        for number in range(60):
            visitor = Visitor(f"visitor_{number}")
            visitor.spin(0.02)
            assert not visitor.node.get_service_names_and_types()
            visitor.close()
            if number == 20:
                before = process.memory_info().rss
        end = time.monotonic() + 10.0
        while len(stays.node.get_node_names()) > 1 and time.monotonic() < end:
            stays.spin(0.1)
        assert stays.node.get_node_names() == ["stays"]
        assert not stays.node.get_service_names_and_types()
        stays.close()
    assert process.memory_info().rss - before < 1.5e6  # with the service of type descriptions: 4 MB
