"""Fusion as a graph of processes starts it, and its recordings."""

import os
import time

import pytest
from fusion_clouds import MOUNTS, START, cloud, info
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import StageStatus as StageStatusMsg
from handwave.msg import TrackArray as TrackArrayMsg
from rclpy.serialization import serialize_message

from radar_app.graph import graph
from radar_app.supervisor import Supervisor
from radar_core import CloudComposite, ConfigError, merge
from radar_ros import qos
from radar_ros.bags import TYPES, BagWriter, typestore
from radar_ros.messages.convert import cloud_to_msg, info_to_msg
from radar_ros.messages.tracks import tracks_to_msg
from radar_ros.offline import process_recording
from radar_tracking import make_tracker
from radar_tracking.fusion.clouds import fused_info


@pytest.mark.long
def test_two_radars_in_processes_of_their_own(ros):
    """Fusion and tracking as `handwave up two_radars` starts them; radars 3 ms apart from here; every topic is connected first."""
    specs = graph(
        "two_radars", parameters={"*": {"reliable": True}}, without=("driver", "baseband", "gestures", "hand", "zones", "visualisation")
    )
    assert {spec.label for spec in specs} == {"fusion", "tracking"}
    lines = []
    clouds = {name: ros.node.create_publisher(PointCloudMsg, f"{name}/radar/points", qos.sensor(reliable=True)) for name in MOUNTS}
    radars = {name: ros.node.create_publisher(RadarInfoMsg, f"{name}/radar/info", qos.LATCHED) for name in MOUNTS}
    fused = ros.collect(PointCloudMsg, "radar/points", qos.sensor(reliable=True))
    tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
    described = ros.collect(RadarInfoMsg, "radar/info", qos.LATCHED)
    known = ros.collect(StageStatusMsg, "stage_status", qos.sensor(reliable=True))
    with Supervisor(specs, domain=int(os.environ["ROS_DOMAIN_ID"]), log=lambda name, line: lines.append(f"{name}: {line}")) as supervisor:
        publishers = (*clouds.values(), *radars.values())
        topics = ("radar/points", "tracks", "radar/info", "stage_status")
        ready = lambda: all(p.get_subscription_count() for p in publishers) and all(map(ros.node.count_publishers, topics))  # noqa: E731
        assert ros.spin_until(ready, 60.0), lines
        for name, publisher in radars.items():
            publisher.publish(info_to_msg(info(name), 0))
        # the tracking node says so (stamp 0) once it knows the fused radar
        assert ros.spin_until(lambda: any(s.stage == "tracking" and s.header.stamp.sec == 0 for s in known), 30.0), lines
        assert described
        ros.spin_until(lambda: False, 0.5)  # a reader knows its writer a moment before the writer knows its reader
        for k in range(20):
            for name, late in (("left", 0), ("right", 3)):
                clouds[name].publish(cloud_to_msg(cloud(name, 20 * k + late, k)))
            time.sleep(0.002)
        assert ros.spin_until(lambda: min(len(tracks), len(fused)) >= 20, 20.0), (len(tracks), len(fused), lines)
        assert not supervisor.crashes
    assert len(fused) == 20
    assert all(len(m.sources) == 2 for m in fused)
    assert [s.dropped for s in known if s.stage == "fusion"][-1] == 0


def test_the_graph_of_two_radars():
    """Drivers and basebands in their namespaces, the rest once; settings for both, for one, and in a namespace of its own."""
    specs = {
        s.label: s for s in graph("two_radars", namespace="lab", parameters={"driver": {"at_end": "loop"}, "left/driver": {"scene": "x"}})
    }
    assert [label for label in specs if "/" in label] == ["left/driver", "left/baseband", "right/driver", "right/baseband"]
    assert specs["left/driver"].namespace == "lab/left"
    assert specs["fusion"].namespace == "lab"
    assert dict(specs["left/driver"].parameters) == {"scene": "x", "at_end": "loop"}
    assert dict(specs["right/driver"].parameters) == {"scene": "two_radars", "at_end": "loop"}
    assert specs["fusion"].parameters["radars"] == ["left", "right"]
    with pytest.raises(ConfigError, match="no node 'up/driver'"):
        graph("two_radars", parameters={"up/driver": {}})
    with pytest.raises(ConfigError, match="no node 'left/driver'"):
        graph("live", parameters={"left/driver": {}})


def test_a_fused_recording_is_processed_like_the_live_clouds(tmp_path):
    """The library over a bag of fused clouds gives the bits that it gives of the clouds themselves: nothing is lost in the message."""
    clouds = [merge([cloud(n, 20 * k + late, k) for n, late in (("left", 0), ("right", 3))], list(MOUNTS.values())) for k in range(25)]
    fused = fused_info([info(name) for name in MOUNTS])
    with BagWriter(tmp_path / "fused") as writer:
        writer.write("/radar/info", TYPES["radar/info"], START, serialize_message(info_to_msg(fused, START)))
        for c in clouds:
            writer.write("/radar/points", TYPES["radar/points"], c.stamp_ns, serialize_message(cloud_to_msg(c)))
    tracker = make_tracker(None, fused)
    for (_, result), c in zip(process_recording(tmp_path / "fused"), clouds, strict=True):
        assert isinstance(result.cloud, CloudComposite)
        expected, got = (canonical(tracks_to_msg(tracks)) for tracks in (tracker.process(c), result.tracks))
        assert got == expected


def canonical(msg):
    """Bytes by rosbags: the middleware leaves whatever was in memory in the bytes between fields."""
    kind = TYPES["tracks"]
    return bytes(typestore().serialize_cdr(typestore().deserialize_cdr(serialize_message(msg), kind), kind))
