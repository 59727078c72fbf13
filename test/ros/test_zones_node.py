"""The zones node over real DDS: who is where, changes while it runs, and what it says when tracks stop."""

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from handwave.msg import StageStatus as StageStatusMsg
from handwave.msg import TrackArray as TrackArrayMsg
from handwave.msg import Zone as ZoneMsg
from handwave.msg import ZoneArray as ZoneArrayMsg
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter as Override
from std_srvs.srv import Trigger

from radar_core import ConfigError
from radar_ros import qos
from radar_ros.messages.tracks import tracks_to_msg
from radar_ros.messages.zones import areas_from_msg
from radar_ros.nodes.zones import make_node
from radar_ros.stage import Silence
from radar_tracking.tracks import Track, Tracks, TrackStatus

LEFT = """
zones:
  - name: left half
    polygon: [[0, 0], [5, 0], [5, 4], [0, 4]]
    on_delay: 0.0
    off_delay: 0.0
"""
RIGHT = (
    LEFT.replace("left half", "right half").replace("4]", "-4]")
    + "  - {name: fan, kind: exclusion, polygon: [[1, -1], [2, -1], [2, -2]]}\n"
)


def tracks(number, *places):
    """Confirmed tracks at some places, ten a second."""
    made = [
        Track(i + 1, TrackStatus.CONFIRMED, 1.0, 0.0, 5, np.array([x, y, 1.0]), np.zeros(3), np.full(3, np.nan), 1e-4 * np.eye(6))
        for i, (x, y) in enumerate(places)
    ]
    return tracks_to_msg(Tracks(number * 10**8, number, "room", tuple(made), np.empty(0, np.int32)))


class Bench:
    """A zones node with a publisher of tracks, and what it says."""

    def __init__(self, ros, tmp_path, text=LEFT, **parameters):
        self.ros, self.file = ros, tmp_path / "zones.yaml"
        self.file.write_text(text)
        given = {"zones_file": str(self.file), **parameters}
        self.node = ros.add(make_node(parameter_overrides=[Override(name, value=value) for name, value in given.items()]))
        self.zones = ros.collect(ZoneArrayMsg, "zones", qos.LATCHED)
        self.statuses = ros.collect(StageStatusMsg, "stage_status", qos.sensor(reliable=True))
        self.diagnostics = ros.collect(DiagnosticArray, "diagnostics")
        self.publisher = ros.node.create_publisher(TrackArrayMsg, "tracks", qos.RESULT)
        assert ros.spin_until(lambda: self.zones and self.publisher.get_subscription_count())
        self.number = 0

    def send(self, *places, times=1):
        for _ in range(times):
            self.publisher.publish(tracks(self.number, *places))
            self.number += 1
        done = self.number - 1
        assert self.ros.spin_until(lambda: any(s.sequence == done and not s.stale for s in self.statuses))

    def call(self, kind, name, request):
        client = self.ros.node.create_client(kind, name)
        assert client.wait_for_service(10.0)
        future = client.call_async(request)
        assert self.ros.spin_until(future.done)
        return future.result()


def test_who_is_where(ros, tmp_path):
    """Counts, presence and dwell come with the tracks that change them, and once a second without news."""
    bench = Bench(ros, tmp_path)
    first = bench.zones[0]
    assert (first.stale, first.room.presence, first.zones[0].presence) == (True, ZoneMsg.UNKNOWN, ZoneMsg.UNKNOWN)
    bench.send((2.0, 2.0), (2.0, -2.0), times=8)
    assert ros.spin_until(lambda: bench.zones[-1].room.presence == ZoneMsg.OCCUPIED)
    (zone,) = bench.zones[-1].zones
    assert (zone.name, zone.kind, zone.presence) == ("left half", ZoneMsg.COUNTING, ZoneMsg.OCCUPIED)
    assert (zone.count, list(zone.track_id)) == (1, [1])
    assert list(zone.polygon) == [0, 0, 5, 0, 5, 4, 0, 4]
    assert (bench.zones[-1].stale, bench.zones[-1].room.count, list(bench.zones[-1].room.track_id)) == (False, 2, [1, 2])
    said = len(bench.zones)
    assert said <= 1 + 2  # stale, the first tracks, the room's presence after its delay
    bench.send((2.0, 2.0), (2.0, -2.0), times=10)
    assert ros.spin_until(lambda: len(bench.zones) == said + 1)
    stamp = bench.zones[-1].header.stamp
    np.testing.assert_allclose(bench.zones[-1].zones[0].person_dwell_s, [stamp.sec + stamp.nanosec * 1e-9])
    bench.send((2.0, -2.0))
    assert ros.spin_until(lambda: bench.zones[-1].zones[0].presence == ZoneMsg.EMPTY)


def test_tracks_that_stop_are_noticed_and_come_back(ros, tmp_path):
    """Presence becomes unknown, diagnostics an error, the status stale; the next tracks end it."""
    bench = Bench(ros, tmp_path, stale_after=0.5)
    bench.send((2.0, 2.0), times=8)
    assert ros.spin_until(lambda: bench.zones[-1].stale)
    last = bench.zones[-1]
    assert (last.room.presence, last.room.count, last.zones[0].presence) == (ZoneMsg.UNKNOWN, 0, ZoneMsg.UNKNOWN)
    assert ros.spin_until(lambda: bench.statuses[-1].stale)
    assert (bench.statuses[-1].sequence, bench.statuses[-1].stage) == (7, "zones")
    assert ros.spin_until(lambda: bench.diagnostics and bench.diagnostics[-1].status[0].level == DiagnosticStatus.ERROR)
    assert "stale" in bench.diagnostics[-1].status[0].message
    bench.send((2.0, 2.0))
    assert ros.spin_until(lambda: not bench.zones[-1].stale)
    assert bench.zones[-1].zones[0].count == 1


def test_the_file_can_change_while_the_node_runs(ros, tmp_path):
    """By the parameter, and by the service where the same file has changed; what makes no sense changes nothing."""
    bench = Bench(ros, tmp_path)
    bench.send((2.0, -1.0), times=3)
    other = tmp_path / "other.yaml"
    other.write_text(RIGHT)
    value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=str(other))
    request = SetParameters.Request(parameters=[Parameter(name="zones_file", value=value)])
    assert bench.call(SetParameters, "zones/set_parameters", request).results[0].successful
    assert ros.spin_until(lambda: [zone.name for zone in bench.zones[-1].zones] == ["right half", "fan"])
    bench.send((2.0, -1.0))
    assert ros.spin_until(lambda: bench.zones[-1].zones[0].count == 1)
    other.write_text(RIGHT.replace("[2, -1], [2, -2]", "[2, -1]"))
    answer = bench.call(Trigger, "zones/reload", Trigger.Request())
    assert not answer.success
    assert "three corners" in answer.message
    assert str(other) in answer.message
    other.write_text(RIGHT.replace("name: fan", "name: stove"))
    assert bench.call(Trigger, "zones/reload", Trigger.Request()).success
    assert ros.spin_until(lambda: [zone.name for zone in bench.zones[-1].zones] == ["right half", "stove"])
    assert bench.zones[-1].zones[0].count == 1  # who was in a zone that stays is still in it
    value.string_value = str(tmp_path / "missing.yaml")
    result = bench.call(SetParameters, "zones/set_parameters", request).results[0]
    assert not result.successful
    assert "missing.yaml" in result.reason


def test_a_file_that_makes_no_sense_ends_the_start(ros, tmp_path):
    """One message names file, line and zone."""
    with pytest.raises(ConfigError, match=r"zones.yaml:\d+: .*'left half': the side from"):
        Bench(ros, tmp_path, LEFT.replace("[5, 4], [0, 4]", "[0, 4], [5, 4]"))


def test_polygons_survive_the_message(ros, tmp_path):
    """What tracking and gestures make of the message is what the file says."""
    bench = Bench(ros, tmp_path, RIGHT)
    (_, first), (name, second) = areas_from_msg(bench.zones[-1])
    assert (first.kind, second.kind, name) == ("counting", "exclusion", "fan")
    assert second.text() == "exclusion 1 -1, 2 -1, 2 -2; -10 10"


def test_silence_is_noticed_by_the_clock_alone():
    """After so long, once; not before anything came, and not when the node itself was held up."""
    silence = Silence(2.0)
    assert not any(silence.look(0.1 * k, 0.02) for k in range(100))
    assert not silence.heard(10.0)
    looks = [10.0 + 0.1 * k for k in range(60)]
    stale = [now for now in looks if silence.look(now, 0.02)]
    assert stale == [pytest.approx(12.0, abs=0.11)]
    assert silence.stale
    assert silence.heard(16.0)
    assert not silence.stale
    assert not silence.look(16.1, 0.02)
    assert not silence.look(26.0, 0.02)  # nobody looked for ten seconds: messages may wait
    assert not silence.look(26.1, 0.02)
    assert any(silence.look(26.1 + 0.1 * k, 0.02) for k in range(1, 25))


def test_a_slow_radar_is_not_stale_between_its_frames():
    """Five frames of a radar have to stay away."""
    silence = Silence(2.0)
    silence.heard(0.0)
    assert not any(silence.look(0.1 * k, 1.0) for k in range(49))
    assert any(silence.look(0.1 * k, 1.0) for k in range(49, 55))
