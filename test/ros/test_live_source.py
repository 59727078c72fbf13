"""What the live page hears of a graph, over real DDS."""

import time

from rcl_interfaces.srv import GetParameters

from radar_app.view.live import LiveSource


def test_a_zones_node_that_hangs_costs_one_question(ros):
    """It is asked again and again and never answers: no question but the last one is kept."""
    asked = []
    ros.node.create_service(GetParameters, "zones/get_parameters", lambda request, answer: asked.append(request) or answer)
    source = LiveSource()
    try:
        end = time.monotonic() + 60.0
        while not source._ask._pending_requests and time.monotonic() < end:
            time.sleep(0.1)  # nobody spins the node of the service
        first = set(source._ask._pending_requests)
        assert first
        while set(source._ask._pending_requests) & first and time.monotonic() < end:
            time.sleep(0.1)
            assert len(source._ask._pending_requests) <= 1
        assert not set(source._ask._pending_requests) & first
        assert ros.spin_until(lambda: asked)
    finally:
        source.close()
