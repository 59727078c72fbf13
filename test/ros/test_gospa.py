"""The evaluation node says live how far the tracks are from the truth."""

import json
import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from handwave.msg import Gospa as GospaMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import TrackArray as TrackArrayMsg
from handwave.msg import Truth as TruthMsg
from rclpy.parameter import Parameter

import radar_ros.nodes.evaluation
from radar_core import NO_GESTURE, RadarInfo
from radar_ros import bags, qos
from radar_ros.messages.convert import from_time, info_to_msg
from radar_ros.messages.tracks import tracks_to_msg
from radar_ros.messages.truth import truth_to_msg
from radar_sim import Truth
from radar_tracking import Track, Tracks, TrackStatus

STEP = 20_000_000  # ns


def truth(k):
    """Two people in view."""
    return Truth(
        stamp_ns=10**9 + k * STEP,
        sequence=k,
        frame_id="room",
        person_id=np.array([1, 2], np.uint32),
        position=np.array([[2.0, 0.0, 0.9], [3.0, 1.0, 0.9]]),
        velocity=np.zeros((2, 3)),
        hand_position=np.zeros((2, 3)),
        hand_velocity=np.zeros((2, 3)),
        gesture=np.full(2, NO_GESTURE, np.uint8),
        gesture_index=np.zeros(2, np.uint32),
        walking=np.zeros(2, bool),
        drawing=np.zeros(2, bool),
    )


def tracks(k, x=2.3):
    """One track 0.3 m from the first person, and a ghost."""
    made = tuple(
        Track(i, TrackStatus.CONFIRMED, 1.0, 0.0, 5, np.array([*p, 0.9]), np.zeros(3), np.full(3, 0.1), np.eye(6))
        for i, p in ((4, (x, 0.0)), (5, (5.0, -2.0)))
    )
    return Tracks(10**9 + k * STEP, k, "room", made, np.empty(0, np.int32))


@pytest.fixture
def judged(ros, tmp_path):
    """An evaluation node that knows its radar and gives people no time to be found; what it publishes."""
    overrides = [Parameter("settle", value=0.0), Parameter("report", value=str(tmp_path / "report.json"))]
    node = ros.add(radar_ros.nodes.evaluation.make_node(parameter_overrides=overrides))
    found = ros.collect(GospaMsg, "gospa", qos.for_topic("gospa"))
    figures = ros.collect(DiagnosticArray, "diagnostics")
    info = ros.node.create_publisher(RadarInfoMsg, "radar/info", qos.LATCHED)
    senders = ros.node.create_publisher(TrackArrayMsg, "tracks", qos.RESULT), ros.node.create_publisher(TruthMsg, "truth", qos.RESULT)
    info.publish(info_to_msg(RadarInfo(), 0))
    assert ros.spin_until(lambda: node._evaluator is not None and all(s.get_subscription_count() for s in senders))

    def send(k, x=2.3):
        senders[0].publish(tracks_to_msg(tracks(k, x)))
        senders[1].publish(truth_to_msg(truth(k)))

    return node, found, figures, send, tmp_path / "report.json"


def test_gospa_is_live_where_truth_is(ros, judged):
    """One message per pair of tracks and truth, with the tracks' stamp; distance and parts in closed form; the report holds the mean."""
    node, found, figures, send, report = judged
    for k in range(20):
        send(k)
        assert ros.spin_until(lambda n=k: len(found) > n)
    msg = found[-1]
    assert from_time(msg.header.stamp) == 10**9 + 19 * STEP
    assert msg.header.frame_id == "room"
    assert msg.localisation == pytest.approx(0.09)
    assert (msg.missed, msg.false_tracks) == (0.5, 0.5)
    assert msg.distance == pytest.approx(math.sqrt(1.09))
    assert (msg.n_truth, msg.n_tracks) == (2, 2)
    assert ros.spin_until(lambda: any(v.key == "gospa_mean_m" for a in figures for s in a.status for v in s.values))
    node.close()
    written = json.loads(report.read_text())
    assert written["gospa"]["mean_m"] == pytest.approx(math.sqrt(1.09))
    assert written["mota"] == pytest.approx(1 - 2 / 2)


def test_a_track_at_nan_costs_one_moment(ros, judged):
    """It is counted as dropped and said, and the node goes on."""
    node, found, _, send, _ = judged
    problems = []
    node.problem = problems.append
    send(0, math.nan)
    assert ros.spin_until(lambda: problems)
    assert "ObjectSet.position has 1 non-finite" in problems[0]
    assert node.dropped == 1
    send(1)
    assert ros.spin_until(lambda: found)


def test_a_report_that_does_not_fit_costs_a_line(judged, capfd):
    """On a disk without room, or where there is no folder for it: one line, and no traceback at the end."""
    node, _, _, _, report = judged
    report.parent.joinpath("file").write_text("")
    node._report = str(report.parent / "file" / "report.json")
    node.close()
    assert "the report cannot be written" in capfd.readouterr().err


def test_gospa_is_recorded():
    """The recorder knows the topic and its type."""
    assert bags.TYPES["gospa"] == "handwave/msg/Gospa"
    assert "gospa" in bags.RECORDED
    assert "handwave/msg/Gospa" in bags.typestore().types
