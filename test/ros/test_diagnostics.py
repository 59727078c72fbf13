"""Diagnostics where aggregators look, with names and ids by their convention; the aggregator's configuration has a group for each."""

import time
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import TrackArray as TrackArrayMsg
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file
from visualization_msgs.msg import Marker, MarkerArray

import radar_ros.nodes.visualisation
from radar_app.graph import NODES
from radar_core import RadarInfo
from radar_ros import qos
from radar_ros.messages.convert import info_to_msg
from radar_ros.stage import InfoKeeper, StageNode

AGGREGATOR = Path(__file__).resolve().parents[2] / "config" / "diagnostics.yaml"


def analyzers():
    """Groups of the aggregator's configuration, read by ROS's own reader: what each looks for in a name."""
    values = {
        name: Parameter.from_parameter_msg(p).value for name, p in parameter_dict_from_yaml_file(str(AGGREGATOR), use_wildcard=True).items()
    }
    groups = {name.removesuffix(".type") for name in values if name.endswith(".type")}
    assert {values[f"{group}.type"] for group in groups} == {"diagnostic_aggregator/GenericAnalyzer"}
    assert all(values[f"{group}.path"] and values[f"{group}.timeout"] > 2.0 for group in groups)
    return {group: tuple(values[f"{group}.contains"]) for group in groups}


@pytest.mark.parametrize("name", [*NODES, "left/driver", "hall/left/baseband"])
def test_the_aggregator_takes_each_node_in_one_group(name):
    """By the rule of its analyzers: those whose text the name contains. `hand: ` must not take `hand_evaluation: `."""
    status = f"{name}: processing"
    assert len([group for group, texts in analyzers().items() if any(text in status for text in texts)]) == 1


@pytest.mark.long
def test_a_node_in_a_namespace_reports_to_everybody(ros):
    """On /diagnostics, named with its namespace, for the radar whose data it works on; stale until it has had any."""
    reports = ros.collect(DiagnosticArray, "/diagnostics", 10)
    node = ros.add(StageNode("tracking", namespace="hall"))
    keeper = InfoKeeper(node, lambda info: None)
    assert ros.spin_until(lambda: reports)
    (status,) = reports[-1].status
    assert (status.name, status.hardware_id, status.level) == ("hall/tracking: processing", "none", DiagnosticStatus.STALE)
    assert status.message == "no data yet"
    radar = ros.node.create_publisher(RadarInfoMsg, "/hall/radar/info", qos.LATCHED)
    radar.publish(info_to_msg(RadarInfo(frame_id="hall/radar"), 0))
    assert ros.spin_until(lambda: keeper.info is not None)
    node.finish(10, 1, time.monotonic_ns())
    count = len(reports)
    assert ros.spin_until(lambda: len(reports) > count)
    (status,) = reports[-1].status
    assert (status.hardware_id, status.level, status.message) == ("hall/radar", DiagnosticStatus.OK, "running")


def test_markers_end_with_their_node(ros):
    """Each lives for so long that the next array comes in time and no longer; a node that ends takes all away at once."""
    markers = ros.collect(MarkerArray, "tracks/markers", qos.RESULT)
    node = ros.add(radar_ros.nodes.visualisation.make_node(parameter_overrides=[Parameter("zones.entries", value=[0.0, 1.0, 0.0, 1.0])]))
    tracks = ros.node.create_publisher(TrackArrayMsg, "tracks", qos.RESULT)
    assert ros.spin_until(lambda: tracks.get_subscription_count() and ros.node.count_publishers("tracks/markers"))
    told = TrackArrayMsg()
    told.header.stamp.sec = 5
    tracks.publish(told)
    assert ros.spin_until(lambda: markers)
    assert {(m.lifetime.sec, m.lifetime.nanosec) for m in markers[0].markers} == {(1, 0)}
    node.close()
    assert ros.spin_until(lambda: len(markers) == 2)
    assert [m.action for m in markers[1].markers] == [Marker.DELETEALL]
