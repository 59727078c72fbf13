"""Nodes of commands come and go without leaving anything behind."""

import time

import pytest

from radar_ros.interrupts import Visitor, ros


def _services(node):
    """What visitors offer; killed nodes of other tests may still be in the graph."""
    return [name for name, _ in node.get_service_names_and_types() if "/visitor_" in name]


def _visitors(node):
    return [name for name in node.get_node_names() if name.startswith("visitor_")]


@pytest.mark.usefixtures("own_domain")
def test_a_visit_leaves_nothing_behind():
    """No service outlives its node: with that of type descriptions each visit cost 0.1 MB, and 6 kB in every other process."""
    with ros():
        stays = Visitor("stays")
        for number in range(5):
            visitor = Visitor(f"visitor_{number}")
            visitor.spin(0.05)
            assert _visitors(visitor.node)
            assert not _services(visitor.node)
            visitor.close()
        end = time.monotonic() + 10.0
        while _visitors(stays.node) and time.monotonic() < end:
            stays.spin(0.1)
        assert not _visitors(stays.node)
        assert not _services(stays.node)
        stays.close()
