"""Parameters at run time through the services that `ros2 param set` uses: what can change does, and what cannot says why."""

import numpy as np
import pytest
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import TrackArray as TrackArrayMsg
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient

import radar_ros.nodes.driver
import radar_ros.nodes.hand
import radar_ros.nodes.tracking
from radar_core import PointCloud, RadarInfo
from radar_ros import qos
from radar_ros.messages.convert import cloud_to_msg, info_to_msg

STEP = 100_000_000


@pytest.fixture
def setter(ros):
    """Set a parameter of a node as another process would; the result of the service."""

    def call(node, name, value):
        client = AsyncParameterClient(ros.node, node)
        assert ros.spin_until(client.services_are_ready)
        future = client.set_parameters([Parameter(name, value=value)])
        assert ros.spin_until(future.done)
        (result,) = future.result().results
        return result

    return call


def cloud(number, n_points=12):
    """Somebody who walks away at 1 m/s, as a dense cloud."""
    rng = np.random.default_rng(number)
    position = np.array([2.0 + 0.1 * number, 0.3, 1.0]) + rng.normal(0, 0.1, (n_points, 3))
    distance = np.linalg.norm(position, axis=1)
    values = {"x": position[:, 0], "y": position[:, 1], "z": position[:, 2], "range": distance}
    values |= {"azimuth": np.arctan2(position[:, 1], position[:, 0]), "elevation": np.arcsin(position[:, 2] / distance)}
    values |= {"radial_speed": np.full(n_points, 1.0), "snr": np.full(n_points, 20.0)}
    return PointCloud(10**9 + number * STEP, number, "room", **{name: value.astype(np.float32) for name, value in values.items()})


def test_gates_and_thresholds_change_and_the_person_keeps_the_id(ros, setter):
    """Before, between and after: the node works with the new value from the next cloud on, and nobody is lost."""
    tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
    overrides = [Parameter("reliable", value=True), Parameter("tracker", value="group_clustering")]
    node = ros.add(radar_ros.nodes.tracking.make_node(parameter_overrides=overrides))
    clouds = ros.node.create_publisher(PointCloudMsg, "radar/points", qos.sensor(reliable=True))
    infos = ros.node.create_publisher(RadarInfoMsg, "radar/info", qos.LATCHED)
    infos.publish(info_to_msg(RadarInfo(frame_id="room"), 0))
    assert ros.spin_until(lambda: clouds.get_subscription_count() and ros.node.count_publishers("tracks") and node._info.info is not None)

    def walk(numbers):
        for number in numbers:
            clouds.publish(cloud_to_msg(cloud(number)))
            assert ros.spin_until(lambda n=number: tracks and tracks[-1].sequence == n)
        return {track.id for track in tracks[-1].tracks}

    assert walk(range(20)) == {1}
    assert setter("tracking", "association.gate_sigmas", 2.5).successful
    assert setter("tracking", "life.delete_after", 3.5).successful
    assert walk(range(20, 25)) == {1}
    assert node._tracker.config.association.gate_sigmas == 2.5
    assert node._tracker.config.life.delete_after == 3.5
    for name, value in (("background.still_speed", 0.33), ("zones.settle", 9.0), ("tracker", "poisson_bernoulli")):
        refused = setter("tracking", name, value)
        assert not refused.successful
        assert "cannot change while people are tracked" in refused.reason or "thesis's trackers" in refused.reason
    wrong = setter("tracking", "association.gate_sigmas", -1.0)
    assert not wrong.successful
    assert "gate_sigmas" in wrong.reason
    assert walk(range(25, 27)) == {1}


def test_a_hand_that_is_followed_is_not_lost(ros, setter):
    """Its thresholds change while nobody's hand is followed; else the reason comes back."""
    node = ros.add(radar_ros.nodes.hand.make_node())
    assert setter("hand", "split.reach", 0.9).successful
    assert node._tracker.config.split.reach == 0.9
    node._command = (1, True)  # somebody has asked for a hand
    refused = setter("hand", "split.reach", 0.8)
    assert not refused.successful
    assert "a hand is followed" in refused.reason
    assert node._tracker.config.split.reach == 0.9


def test_what_is_read_only_says_why(ros, setter):
    """Which parameter, why, and what to do instead."""
    ros.add(radar_ros.nodes.driver.make_node(parameter_overrides=[Parameter("autostart", value=False)]))
    refused = setter("driver", "scene", "demo")
    assert not refused.successful
    assert refused.reason == "scene cannot change while the node runs, because the source is open; start it anew with -p scene:=..."
    ros.add(radar_ros.nodes.tracking.make_node())
    assert "the node is made with it" in setter("tracking", "reliable", True).reason
