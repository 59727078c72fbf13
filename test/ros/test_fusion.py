"""Fusion of several radars over real DDS: what is of one moment is fused, what is late or alone is counted, a dead radar stops nobody."""

import re
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from fusion_clouds import MOUNTS, MS, START, cloud, info
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import StageStatus as StageStatusMsg
from handwave.msg import TrackArray as TrackArrayMsg
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2

import radar_ros.nodes.fusion
import radar_ros.nodes.tracking
from radar_core import CloudComposite, ConfigError, Pose, merge
from radar_ros import qos
from radar_ros.messages.convert import cloud_from_msg, cloud_to_msg, info_from_msg, info_to_msg, to_time


def dropped(f):
    """Dropped clouds by reason; together they are the stage's count."""
    found = {reason: f.counts[reason] for reason in radar_ros.nodes.fusion._REASONS if f.counts[reason]}
    assert sum(found.values()) == f.node.dropped
    return found


@pytest.fixture
def fusion(ros):
    """A fusion node, started with parameters; two radars that publish; everything connected before anything is said."""

    def start(infos=("left", "right"), **parameters):
        overrides = [Parameter(name, value=value) for name, value in {"reliable": True, **parameters}.items()]
        node = ros.add(radar_ros.nodes.fusion.make_node(parameter_overrides=overrides))
        problems = []
        node.problem = node.caution = problems.append
        # These fast, small tests must not lose a message to a short queue: 100 deep and reliable.
        fused = ros.collect(PointCloudMsg, "radar/points", qos.sensor(reliable=True))
        status = ros.collect(StageStatusMsg, "stage_status", qos.sensor(reliable=True))
        described = ros.collect(RadarInfoMsg, "radar/info", qos.LATCHED)
        clouds = {name: ros.node.create_publisher(PointCloudMsg, f"{name}/radar/points", qos.sensor(reliable=True)) for name in MOUNTS}
        radars = {name: ros.node.create_publisher(RadarInfoMsg, f"{name}/radar/info", qos.LATCHED) for name in MOUNTS}
        readers = (*clouds.values(), *radars.values())
        writers = [node._points, node._announcer._infos, node.reports.publisher]
        assert ros.spin_until(lambda: all(p.get_subscription_count() for p in (*readers, *writers)))
        for name in infos:
            radars[name].publish(info_to_msg(info(name), 0))
        assert ros.spin_until(lambda: all(node._radars[name].info is not None for name in infos))

        def send(name, ms, sequence=0, every=1, **kwargs):
            """Publish a cloud and wait until the node has looked at it: topics keep no order among each other."""
            before = node._counts[f"{name}.clouds"]
            clouds[name].publish(cloud_to_msg(replace(cloud(name, ms, sequence, **kwargs), every=every)))
            assert ros.spin_until(lambda: node._counts[f"{name}.clouds"] > before)

        def settled(count):
            """Wait for so many fused clouds, and a moment for one too many."""
            assert ros.spin_until(lambda: len(fused) >= count)
            ros.spin_until(lambda: False, 0.15)
            assert len(fused) == count
            return [cloud_from_msg(m) for m in fused]

        return SimpleNamespace(
            node=node, send=send, settled=settled, status=status, described=described, problems=problems, radars=radars, counts=node._counts
        )

    return start


def test_clouds_3_ms_apart_are_fused(ros, fusion):
    """Each pair is one composite in the room: the library's merge, bit for bit, with a running count and both sensors named."""
    f = fusion()
    for k in range(5):
        f.send("left", 20 * k, 7 + k)
        f.send("right", 20 * k + 3, 40 + k)
    for k, got in enumerate(f.settled(5)):
        parts = [cloud("left", 20 * k, 7 + k), cloud("right", 20 * k + 3, 40 + k)]
        expected = merge(parts, list(MOUNTS.values()))
        assert isinstance(got, CloudComposite)
        assert (got.frame_id, got.sequence, got.stamp_ns) == ("room", k, START + (20 * k + 3) * MS)
        assert got.sources == expected.sources
        assert got.position.tobytes() == expected.position.tobytes()
        assert got.sensor.tobytes() == expected.sensor.tobytes()
    assert f.node.dropped == 0
    assert [s.sequence for s in f.status if s.header.stamp.sec] == list(range(5))
    assert f.status[-1].stage == "fusion"


def test_clouds_60_ms_apart_are_not_fused(fusion):
    """At 10 Hz nothing is nearer than 40 ms: no cloud goes out, every one is counted once no partner can come any more."""
    f = fusion()
    for k in range(6):
        f.send("left", 100 * k, k)
        f.send("right", 100 * k + 60, k)
    assert f.settled(0) == []
    # all but those that still wait: the newest of the right radar
    assert (f.counts["unmatched"], f.node.dropped) == (11, 11)


def test_late_clouds_are_counted(fusion):
    """What is older than what went out already is dropped, whoever sends it; time never goes back."""
    f = fusion()
    for k in range(3):
        f.send("left", 20 * k, k)
        f.send("right", 20 * k + 3, k)
    f.send("left", 0, 3)
    f.send("right", 3, 4)  # one cloud was lost before this one
    f.send("left", 40, 4)  # once more what was used
    f.send("left", 60, 5)
    f.send("right", 63, 5)
    got = f.settled(4)
    assert np.all(np.diff([c.stamp_ns for c in got]) > 0)
    assert dropped(f) == {"late": 3, "lost": 1}
    assert f.status[-1].dropped == 4


def test_a_lost_partner_costs_one_cloud(fusion):
    """The cloud without a partner is given up; the next pair is fused."""
    f = fusion()
    for k in range(4):
        f.send("left", 20 * k, k)
        if k != 1:
            f.send("right", 20 * k + 3, k)
    assert len(f.settled(3)) == 3
    assert dropped(f) == {"unmatched": 1, "lost": 1}


def test_frames_left_out_on_purpose_are_not_lost(fusion):
    """Both radars send every third frame; the fused clouds count anew and leave nothing out. What did not come is lost, frames are not."""
    f = fusion()
    for k in (0, 1, 2, 4):
        f.send("left", 60 * k, 3 * k, 3)
        f.send("right", 60 * k + 3, 3 * k, 3)
    assert [(c.sequence, c.every, [s.every for s in c.sources]) for c in f.settled(4)] == [(k, 1, [3, 3]) for k in range(4)]
    assert dropped(f) == {"lost": 2}  # one of each radar


def test_a_radar_that_falls_silent_stops_nobody(ros, fusion):
    """After ``solo_after`` the other goes on alone, the diagnostics name the silent one, and once it is back both are fused."""
    f = fusion(solo_after=0.2)
    diagnostics = ros.collect(DiagnosticArray, "diagnostics", 10)
    f.send("left", 0, 0)
    f.send("right", 3, 0)
    for k in range(1, 21):
        f.send("left", 20 * k, k)
    got = f.settled(11)
    # 203 ms after the last of the right one, at 220 ms, waiting ends; the nine clouds until 200 ms have waited in vain
    assert [c.stamp_ns for c in got[1:]] == [START + 20 * k * MS for k in range(11, 21)]
    assert all(len(c.sources) == 1 and c.sources[0].frame_id == "left/radar" for c in got[1:])
    assert f.counts["unmatched"] == 10
    assert any("right is silent" in p for p in f.problems)
    told = []
    for k in range(21, 120):  # the left one goes on; diagnostics come once a second
        f.send("left", 20 * k, k)
        ros.spin_until(lambda: False, 0.02)
        told = [s for a in diagnostics for s in a.status if s.name == "fusion: processing" and "right is silent: no cloud for" in s.message]
        if told:
            break
    assert told[-1].level == DiagnosticStatus.WARN
    assert "left" not in told[-1].message
    assert {"late", "unmatched", "without_info", "lost", "broken", "left.clouds", "right.clouds"} <= {v.key for v in told[-1].values}
    alone = 11 + k - 20
    f.settled(alone)
    f.send("right", 20 * k + 23, 1)
    f.send("left", 20 * k + 20, k + 1)
    f.send("left", 20 * k + 40, k + 2)
    f.send("right", 20 * k + 43, 2)
    assert [len(c.sources) for c in f.settled(alone + 2)[-2:]] == [2, 2]


def test_a_radar_without_info_is_not_used(ros, fusion):
    """Its clouds cannot be understood; they are counted, and the other radar goes on alone."""
    f = fusion(infos=("left",), solo_after=0.1)
    for k in range(10):
        f.send("left", 20 * k, k)
        f.send("right", 20 * k + 3, k)
    got = f.settled(4)  # those more than 100 ms after the first cloud of all
    assert all(c.sources[0].frame_id == "left/radar" for c in got)
    assert f.counts["without_info"] == 10
    _, warnings = f.node.extra_diagnostics()
    assert any("right has sent no radar/info" in w for w in warnings)
    f.radars["right"].publish(info_to_msg(info("right"), 0))
    assert ros.spin_until(lambda: f.node._radars["right"].info is not None)
    f.send("right", 203, 10)
    f.send("left", 200, 10)
    assert len(f.settled(5)[-1].sources) == 2
    assert {m.header.frame_id for m in f.described} == {"fused"}
    assert len({info_from_msg(m) for m in f.described}) == 1  # it never changes, because stages refuse that


def test_another_radar_in_its_place_is_refused(ros, fusion):
    """A mount that changes while running would put points elsewhere; the old info ends that."""
    f = fusion()
    f.radars["right"].publish(info_to_msg(info("right", mount=Pose(x=5.0)), 0))
    assert ros.spin_until(lambda: f.node._radars["right"].refused)
    f.send("left", 0, 0)
    f.send("right", 3, 0)
    assert (f.settled(0), f.counts["without_info"]) == ([], 1)
    assert any("right/radar/info changed while running" in p for p in f.problems)
    f.radars["right"].publish(info_to_msg(info("right"), 1))
    assert ros.spin_until(lambda: not f.node._radars["right"].refused)
    f.send("left", 20, 1)
    f.send("right", 23, 1)
    assert len(f.settled(1)) == 1


def test_a_cloud_of_another_sensor_is_refused(ros, fusion):
    """Two radars that share a namespace: what the info does not describe is dropped and told of."""
    f = fusion()
    f.send("left", 0, 0)
    stray = cloud_to_msg(cloud("right", 3, 0))
    stray.header.frame_id = "left/radar"
    publisher = ros.node.create_publisher(PointCloudMsg, "right/radar/points", qos.sensor(reliable=True))
    assert ros.spin_until(publisher.get_subscription_count)
    ros.spin_until(lambda: False, 0.2)
    publisher.publish(stray)
    assert ros.spin_until(lambda: f.problems)
    assert "a cloud of right is in 'left/radar', but right/radar/info describes 'right/radar'" in f.problems[0]
    assert f.counts["broken"] == 2


def test_a_recording_that_starts_again(fusion):
    """Stamps that go back by more than any delay begin anew; the count goes on."""
    f = fusion()
    for start in (5000, 0):
        for k in range(3):
            f.send("left", start + 20 * k, k)
            f.send("right", start + 20 * k + 3, k)
    got = f.settled(6)
    assert [c.sequence for c in got] == list(range(6))
    assert dropped(f) == {}
    assert got[-1].stamp_ns == START + 43 * MS


def watched(f, offset_ms, enough):
    """Send clouds of both radars every 8 ms, those of the right one stamped by a clock that is ahead, until ``enough``."""
    for k in range(3000):
        for name, ahead in (("left", 0.0), ("right", offset_ms)):
            f.send(name, (f.node.get_clock().now().nanoseconds - START) / MS + ahead, k)
        time.sleep(0.006)
        if k % 10 == 9:
            values, warnings = f.node.extra_diagnostics()
            if enough(values, warnings):
                return values, [w for w in warnings if "clock of" in w]
    raise AssertionError((values, warnings))


QUICK_CLOCKS = {"clocks.window": 1.0, "clocks.parts": 2, "clocks.least": 2}  # half a second holds two clouds on the busiest machine


def known(values, _):
    return values["right.clock_offset_ms"] != "unknown"


def test_a_clock_that_is_a_frame_ahead_is_told(fusion):
    """Clouds of different frames would pair without a sound: the warning names the radar, how much, and what to do. Equal clocks: none."""
    f = fusion(**QUICK_CLOCKS)
    values, _ = f.node.extra_diagnostics()
    assert values["left.clock_offset_ms"] == values["right.clock_offset_ms"] == "unknown"
    values, warnings = watched(f, 0.0, known)
    assert float(values["left.clock_offset_ms"]) == 0.0
    # both are sent by one process right after their stamps: the smallest delays of dozens differ by far less than the limit of 5 ms
    assert abs(float(values["right.clock_offset_ms"])) < 5.0
    assert warnings == []
    assert not any("clock of" in p for p in f.problems)
    values, (told,) = watched(f, 20.0, lambda _, warnings: any("clock of" in w for w in warnings))
    offset, spread = (float(values[f"right.clock_{what}_ms"]) for what in ("offset", "spread"))
    assert offset - spread > 5.0
    assert offset < 25.0
    assert re.fullmatch(
        r"the clock of right is \d+\.\d ms ahead of that of left: clouds of different moments are fused; "
        r"synchronise the clocks \(PTP: ptp4l and phc2sys, see docs/explanation/timing\.md\)",
        told,
    )
    assert told in f.problems  # logged as well


@pytest.mark.long
def test_the_limit_of_clocks_is_a_parameter(fusion):
    """Who lives with 20 ms may say so; a clock that is behind is told as such."""
    f = fusion(**QUICK_CLOCKS, max_clock_offset=0.1)
    assert watched(f, 20.0, known)[1] == []
    _, (told,) = watched(f, -200.0, lambda _, warnings: any("clock of" in w for w in warnings))
    assert re.match(r"the clock of right is \d+\.\d ms behind that of left", told)


def test_simulated_time_says_nothing_of_clocks(ros, fusion):
    """A replay makes time as it pleases."""
    f = fusion(**QUICK_CLOCKS, use_sim_time=True)
    clock = ros.node.create_publisher(Clock, "/clock", 10)
    assert ros.spin_until(clock.get_subscription_count)
    for k in range(100):
        clock.publish(Clock(clock=to_time(START + 20 * k * MS)))
        for name, ahead in (("left", 0), ("right", 20)):
            f.send(name, 20 * k + ahead, k)
    values, warnings = f.node.extra_diagnostics()
    assert values["right.clock_offset_ms"] == "unknown"
    assert not any("clock of" in w for w in warnings)


def test_tracking_follows_a_fused_person(ros, fusion):
    """Stages behind the fusion work unchanged: a walker whom both radars see is one track where it is."""
    tracking = ros.add(radar_ros.nodes.tracking.make_node(parameter_overrides=[Parameter("reliable", value=True)]))
    tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
    labelled = ros.collect(PointCloud2, "radar/points2", qos.sensor(depth=50))
    f = fusion()
    assert ros.spin_until(lambda: tracking._info.info is not None and f.node._points.get_subscription_count() == 2)
    for k in range(40):
        body = (2.5 - 0.016 * k, 0.2, 1.1)
        for name, late in (("left", 0), ("right", 3)):
            f.send(name, 20 * k + late, k, body=body, velocity=(-0.8, 0.0, 0.0))
        assert ros.spin_until(lambda k=k: len(tracks) > k)
    (person,) = tracks[-1].tracks
    # twelve points of 0.1 m: 0.03 m per centroid, and a lag of the filter below 0.1 m at 0.8 m/s
    np.testing.assert_allclose(person.position[:2], (2.5 - 0.016 * 39, 0.2), atol=0.15)
    assert len(tracks[-1].point_track_id) == 12
    assert labelled
    assert labelled[-1].header.frame_id == "room"


def test_settings_that_make_no_sense(ros):
    """Radars that are none, and a patience shorter than the slop."""
    for parameters, message in (
        ({"radars": ["left", "left"]}, "has 'left' twice"),
        ({"radars": ["/left"]}, "has '/left'; a namespace is made of"),
        ({"solo_after": 0.01}, "solo_after = 0.01 s is shorter than slop"),
        ({"max_clock_offset": 0.0}, "max_clock_offset out of range Min: 0.0001, Max: 10"),
    ):
        with pytest.raises(ConfigError, match=message):
            radar_ros.nodes.fusion.make_node(parameter_overrides=[Parameter(k, value=v) for k, v in parameters.items()])
