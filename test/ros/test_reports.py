"""What stages report: together where nobody waits for it, at once where somebody does, and nothing is lost."""

import time

import pytest
from handwave.msg import StageStatus
from rclpy.parameter import Parameter

from radar_app.graph import graph
from radar_app.supervisor import Supervisor
from radar_app.watching.reports import reports_from_msg
from radar_ros import bags, qos
from radar_ros.offline import parse
from radar_ros.stage import StageNode

FRAME = 20_000_000  # ns


class Bench:
    """A stage, and what others hear of it."""

    def __init__(self, ros, **parameters):
        self.ros = ros
        self.heard = ros.collect(StageStatus, "stage_status", qos.sensor(reliable=True))
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        self.node = ros.add(StageNode("tracking", parameter_overrides=overrides))
        assert ros.spin_until(self.node.reports.publisher.get_subscription_count)

    def finish(self, first, count, step_ns=FRAME):
        """Finish so many messages one right behind the other."""
        for sequence in range(first, first + count):
            self.node.finish(10**9 + sequence * step_ns, sequence, time.monotonic_ns())

    @property
    def reports(self):
        """Everything that was reported, in the order in which it came."""
        return [report for msg in self.heard for report in reports_from_msg(msg)]

    def all_came(self, count):
        return self.ros.spin_until(lambda: len(self.reports) >= count)


@pytest.mark.parametrize("parameters", [{}, {"stale_after": 0.0}])
def test_all_messages_are_reported_some_together(ros, parameters):
    """The first at once; the others by fifths of a second of their stamps, the rest soon after; each as it would be alone."""
    bench = Bench(ros, **parameters)
    bench.node.count_gap(22)
    bench.finish(0, 1)
    assert bench.all_came(1)
    bench.finish(1, 22)
    bench.node.count_gap(26)  # three were lost
    bench.finish(26, 1)
    assert bench.all_came(24)
    assert len(bench.heard) <= 4
    assert [report.sequence for report in bench.reports] == [*range(23), 26]
    assert [report.processed for report in bench.reports] == [*range(1, 25)]
    assert [report.dropped for report in bench.reports] == 23 * [0] + [3]
    assert [report.stamp_ns for report in bench.reports] == [10**9 + FRAME * report.sequence for report in bench.reports]
    times = [report.monotonic_ns for report in bench.reports]
    assert times == sorted(times)
    assert all(report.compute > 0 and report.stage == "tracking" and not report.stale for report in bench.reports)


def test_each_at_once_where_it_is_waited_for(ros):
    """With ``reliable`` a message holds one report; so does one of a stage that is slow."""
    bench = Bench(ros, reliable=True)
    bench.finish(0, 50)
    assert bench.all_came(50)
    assert [(msg.sequence, len(msg.earlier_sequence)) for msg in bench.heard] == [(k, 0) for k in range(50)]


def test_slow_stages_report_at_once(ros):
    """Frames that are a fifth of a second apart, on the clock or by the stamps of a recording that is played fast."""
    bench = Bench(ros)
    bench.finish(0, 10, 10 * FRAME)
    assert bench.all_came(10)
    assert len(bench.heard) == 10


def test_what_must_be_known_is_told_at_once_with_what_waits(ros):
    """That a stage is ready, and that it is stale."""
    bench = Bench(ros, stale_after=0.5)
    bench.finish(0, 3)
    bench.node.ready()
    assert bench.all_came(3)
    assert bench.heard[-1].header.stamp.sec == 0
    bench.finish(3, 3)
    assert bench.ros.spin_until(lambda: bench.heard[-1].stale)
    assert [(report.sequence, report.stale) for report in bench.reports][:7] == [*((k, False) for k in range(6)), (5, True)]


def test_numbers_that_no_message_holds_and_stamps_before_1970(ros):
    """They are at their limit, or as they are; the stage goes on."""
    bench = Bench(ros)
    bench.node.finish(-5, 2**70, time.monotonic_ns())
    bench.node.finish(-4, 2**70, time.monotonic_ns())
    bench.node.finish(-3, 3, time.monotonic_ns())
    assert bench.all_came(3)
    assert [(report.stamp_ns, report.sequence) for report in bench.reports] == [(-5, 2**64 - 1), (-4, 2**64 - 1), (-3, 3)]


def test_lists_of_unequal_length_are_read_as_far_as_they_go():
    """Somebody else's mistake costs that."""
    msg = StageStatus(stage="tracking", sequence=4)
    msg.header.stamp.sec = 1
    msg.earlier_stamp_ns, msg.earlier_sequence, msg.earlier_processed = [1, 2, 3], [1, 2], [1, 2, 3]
    assert [report.sequence for report in reports_from_msg(msg)] == [4]


@pytest.mark.long
def test_nothing_is_lost_at_the_end(tmp_path, own_domain):
    """A driver whose source ends, recorded: a report of each frame, in a fifth of the messages."""
    scene = tmp_path / "scene.yaml"
    scene.write_text("duration: 1.5\nseed: 3\npoints: [{position: [2.0, 0.5, 1.4], rcs: 0.1}]\neffects: {noise: {}}\n")
    topics = ["radar/frame", "radar/info", "stage_status"]
    driver = {"scene": str(scene), "at_end": "exit", "wait_for_nodes": ["recorder"], "wait_for_readers": 1}
    parameters = {"driver": driver, "recorder": {"bag": str(tmp_path / "bag"), "topics": topics}}
    specs = [spec for spec in graph("demo", parameters=parameters) if spec.name in ("driver", "recorder")]
    lines = []
    with Supervisor(specs, log=lambda name, line: lines.append(f"{name}: {line}")) as supervisor:
        end = time.monotonic() + 60
        while "driver" in supervisor.running and time.monotonic() < end:
            time.sleep(0.1)
            supervisor.poll()
    held = list(bags.read(tmp_path / "bag"))
    frames = [parse(item.data, "radar/frame").sequence for item in held if item.topic == "/radar/frame"]
    status = [parse(item.data, "stage_status") for item in held if item.topic == "/stage_status"]
    told = [report.sequence for msg in status for report in reports_from_msg(msg) if report.stage == "driver"]
    assert len(frames) > 20, lines
    assert told == frames
    assert len(status) < len(frames) / 3
