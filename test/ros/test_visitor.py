"""Nodes of commands come and go without leaving anything behind."""

import time

import pytest

from radar_ros.interrupts import Visitor, ros


@pytest.mark.usefixtures("own_domain")
def test_a_visit_leaves_nothing_behind():
    """No service outlives its node: with that of type descriptions each visit cost 0.1 MB, and 6 kB in every other process."""
    with ros():
        stays = Visitor("stays")
        for number in range(5):
            visitor = Visitor(f"visitor_{number}")
            visitor.spin(0.05)
            assert not visitor.node.get_service_names_and_types()
            visitor.close()
        end = time.monotonic() + 10.0
        while len(stays.node.get_node_names()) > 1 and time.monotonic() < end:
            stays.spin(0.1)
        assert stays.node.get_node_names() == ["stays"]
        assert not stays.node.get_service_names_and_types()
        stays.close()
