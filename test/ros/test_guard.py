"""What others send costs itself only: one guard around every callback of a node, and a log that stays short whatever comes."""

import time
from types import SimpleNamespace

import pytest
from handwave.msg import StageStatus as StageStatusMsg
from handwave.msg import Track as TrackMsg
from handwave.msg import TrackArray as TrackArrayMsg
from std_msgs.msg import UInt32
from std_srvs.srv import Trigger

import radar_ros.nodes.zones
from radar_ros import guard, qos
from radar_ros.guard import Problems
from radar_ros.stage import StageNode


class Ill(StageNode):
    """Fails over odd numbers, in its timer when it is told to, and in its service."""

    def __init__(self):
        super().__init__("ill")
        self.ticks, self.bad_timer, self.taken = 0, False, []
        self.create_subscription(UInt32, "numbers", self._take, 10)
        self.create_service(Trigger, "ask", self._serve)
        self.create_timer(0.02, self._tick)

    def _take(self, msg):
        self.taken.append(msg.data)
        if msg.data % 2:
            raise KeyError("odd")
        self.finish(msg.data, msg.data, time.monotonic_ns())

    def _serve(self, request, response):
        response.message = str({}["nothing"])
        return response

    def _tick(self):
        self.ticks += 1
        if self.bad_timer:
            raise ZeroDivisionError


@pytest.fixture
def ill(ros):
    node, lines = ros.add(Ill()), []
    node.problem = lines.append
    numbers = ros.node.create_publisher(UInt32, "numbers", 10)
    assert ros.spin_until(numbers.get_subscription_count)
    return node, lines, numbers


def test_a_callback_that_fails_costs_its_message_only(ros, ill):
    """Subscription, timer and service: counted, told with topic, kind and place, and the node goes on."""
    node, lines, numbers = ill
    for number in range(1, 7):
        numbers.publish(UInt32(data=number))
    assert ros.spin_until(lambda: len(node.taken) == 6)
    assert (node.processed, node.dropped) == (3, 3)
    assert [line.startswith("numbers: cannot be used (KeyError: 'odd'; test_guard.py, line ") for line in lines] == 3 * [True]
    client = ros.node.create_client(Trigger, "ask")
    assert client.wait_for_service(10.0)
    future = client.call_async(Trigger.Request())
    assert ros.spin_until(future.done)
    assert future.result() == Trigger.Response()
    assert "ask: cannot be used (KeyError: 'nothing'" in lines[-1]
    node.bad_timer = True
    assert ros.spin_until(lambda: node.ticks > 5 and "ZeroDivisionError" in lines[-1])


def test_a_node_that_only_fails_ends(ros, ill, monkeypatch):
    """To be started again: a fault that goes on without anything being finished is not outlived by waiting."""
    node, _, numbers = ill
    monkeypatch.setattr(guard, "_GIVE_UP", 0.2)
    numbers.publish(UInt32(data=1))
    assert ros.spin_until(lambda: node.taken == [1])
    numbers.publish(UInt32(data=2))  # which is finished: all is well again
    assert ros.spin_until(lambda: node.taken == [1, 2])
    ros.spin_until(lambda: False, 0.3)
    numbers.publish(UInt32(data=3))
    assert ros.spin_until(lambda: node.taken == [1, 2, 3])
    ros.spin_until(lambda: False, 0.3)
    numbers.publish(UInt32(data=5))
    with pytest.raises(KeyError):
        ros.spin_until(lambda: False, 5.0)


@pytest.mark.parametrize("hours", [1, -1])
def test_tracks_that_contradict_themselves(ros, hours):
    """A status that there is not, lists of unequal length, an hour off: refused, and the next tracks are used."""
    node, lines = ros.add(radar_ros.nodes.zones.make_node()), []
    node.problem = lines.append
    tracks = ros.node.create_publisher(TrackArrayMsg, "tracks", qos.RESULT)
    assert ros.spin_until(tracks.get_subscription_count)
    broken = TrackArrayMsg(sequence=1, tracks=[TrackMsg(status=99)])
    unequal = TrackArrayMsg(sequence=2, deleted_id=[4])
    good = TrackArrayMsg(sequence=3)
    for second, msg in enumerate((broken, unequal, good)):
        msg.header.stamp.sec = 7200 + second
        tracks.publish(msg)
    assert ros.spin_until(lambda: node.processed == 1)
    assert node.dropped == 2
    assert "99 is not a valid TrackStatus" in lines[0]
    assert "zip() argument" in lines[1]
    good.header.stamp.sec += hours * 3600
    good.sequence = 4
    tracks.publish(good)
    assert ros.spin_until(lambda: node.processed == 2)


def test_counts_that_no_message_holds(ros):
    """Sequences of 2^64 - 1, again and again: the count is at its limit, and the node goes on."""
    node = ros.add(radar_ros.nodes.zones.make_node())
    done = ros.collect(StageStatusMsg, "stage_status", qos.sensor())
    assert ros.connect("stage_status")
    for sequence in 3 * (0, 2**64 - 1):
        node.count_gap(sequence)
        node.finish(10**9, sequence, time.monotonic_ns())
    assert ros.spin_until(lambda: len(done) >= 1 and done[-1].dropped == 2**64 - 1)
    assert node.dropped > 2**64


def test_random_texts_fill_neither_log_nor_memory():
    """However many different texts come, few are told, and few are kept."""
    problems = Problems()
    told = [text for number in range(10_000) if (text := problems.told(f"name {number:x}{'ghijk'[number % 5]} is none", 0.001 * number))]
    quoted = [text for number in range(100) if (text := problems.told(f"{chr(97 + number % 26) * 3!r} is none", 100.0))]
    assert len(quoted) == 1
    assert len(problems) <= guard._KINDS + 1
    assert len(told) <= 3 * (guard._KINDS + 1)  # in ten seconds
    assert len(problems.told(100_000 * "x", 200.0)) < 600


def test_stamps_that_go_back_again_and_again_are_one_line(ros):
    """A peer whose clock is ahead, beside one whose is right."""
    node, lines = ros.add(radar_ros.nodes.zones.make_node()), []
    node.get_logger = lambda: SimpleNamespace(warning=lines.append)
    assert [node.went_back(stamp) for stamp in 10 * (1, 0)] == [False, True] * 10
    assert len(lines) == 1
    assert not node.went_back(3_600_000_000_000)
    assert lines[1].startswith("stamps jumped 3600 s ahead")
