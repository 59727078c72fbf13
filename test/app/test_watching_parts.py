"""What `status`, `listen` and `watch` are made of, without a running graph."""

import io
import json
import threading
import time

import pytest
from handwave.msg import Gesture, HandTrack, StageStatus, Track, TrackArray, Zone, ZoneArray
from rich.console import Console
from ros_domains import next_domain

from radar_app.live import Monitor
from radar_app.watching.health import Health
from radar_app.watching.lines import Words, gesture_record, hand_record, people_record, zones_record
from radar_app.watching.listener import Ears
from radar_app.watching.people import Comings, finite, place
from radar_app.watching.room_map import RoomMap
from radar_app.watching.teller import Teller
from radar_core import GESTURES, RadarInfo
from radar_ros.interrupts import ros
from radar_ros.messages.convert import to_time
from radar_ros.nodes.driver import DriverNode

DOMAIN = next_domain()


def track(number, x, y, status=Track.CONFIRMED):
    return Track(id=number, status=status, position=[x, y, 1.0], velocity=[0.0, 0.5, 0.0], n_points=9)


def tracks(stamp, *people):
    msg = TrackArray(tracks=list(people))
    msg.header.stamp = to_time(stamp)
    return msg


def test_who_comes_and_goes():
    """Tentative tracks are nobody yet; a coasting one stays; who is gone is told with its last place."""
    comings = Comings()
    assert comings.process(tracks(1, track(4, 2.0, 1.0, Track.TENTATIVE))) == []
    assert [c.words for c in comings.process(tracks(2, track(4, 2.0, 1.0)))] == ["person 4 came, 2.0 m ahead, 1.0 m left"]
    assert comings.process(tracks(3, track(4, 2.1, 1.0, Track.COASTING))) == []
    assert [c.words for c in comings.process(tracks(4))] == ["person 4 went, 2.1 m ahead, 1.0 m left"]
    assert place((-1.0, -2.0)) == "1.0 m behind, 2.0 m right"
    assert place((float("nan"), 0.0)) == "place unknown"


def test_records_are_json():
    """No NaN, which is no JSON; messages of every kind have their words."""
    nan = float("nan")
    people = people_record("/", tracks(5 * 10**8, track(1, 2.0, nan), track(2, 1.0, 0.0, Track.TENTATIVE)))
    assert json.loads(json.dumps(finite(people), allow_nan=False))["people"][0]["position"] == [2.0, None, 1.0]
    assert people["count"] == 1
    hand = HandTrack(parent_id=3, active=True, value=0.52, position=[1.0, 0.0, nan])
    assert json.loads(json.dumps(finite(hand_record("/left", hand)), allow_nan=False))["namespace"] == "/left"
    zones = ZoneArray(room=Zone(name="room", presence=Zone.OCCUPIED, count=2, track_id=[1, 2]), zones=[Zone(name="sofa", kind=9)])
    record = finite(zones_record("/", zones))
    assert record["zones"][0] == {"name": "room", "kind": "counting", "presence": "occupied", "count": 2, "people": [1, 2], "dwell": 0.0}
    assert record["zones"][1]["kind"] == "9"
    words = Words()
    assert words.process("zones", "/hall", zones) == ["hall: zone room: occupied, 2 people", "hall: zone sofa: empty, 0 people"]
    assert words.process("zones", "/hall", zones) == []
    assert words.process("hand", "/", hand) == ["hand of person 3 at 52%"]
    assert words.process("hand", "/", HandTrack(active=False)) == ["hand: not followed any more"]
    assert words.process("gestures", "/", Gesture(label=Gesture.RANDOM, name="random")) == []
    swipe = Gesture(label=Gesture.SWIPE_UP, name="swipe_up", track_id=3, confidence=0.97, zones=["sofa"])
    assert words.process("gestures", "/", swipe) == ["person 3: swipe up (97%), in sofa"]
    assert gesture_record("/", swipe)["probabilities"] == {}
    swipe.probabilities = [0.1 * (k == 0) + 0.9 * (k == Gesture.SWIPE_UP) for k in range(10)]
    assert finite(gesture_record("/", swipe))["probabilities"] == {
        name: 0.1 * (name == "random") + 0.9 * (name == "swipe_up") for name in GESTURES
    }


def test_the_display_fits_a_terminal(monkeypatch):
    """80 columns and 24 lines, however much there is to show; no thread is left."""
    monkeypatch.setenv("ROS_DOMAIN_ID", DOMAIN)
    before = set(threading.enumerate())
    with ros(), Monitor() as monitor:
        assert "waiting for a graph" in drawn(monitor)
        monitor._tracks(tracks(1, *(track(n, 0.5 * n, 1.0 - 0.3 * n) for n in range(1, 10))))
        monitor._hand(HandTrack(active=True, value=0.4, parent_id=1))
        for number in range(6):
            monitor._gesture(Gesture(label=Gesture.PUSH_PULL, name="push_pull", track_id=number, confidence=0.9))
        monitor._map.radars["/"] = RadarInfo()
        monitor._map.zones = [("a sofa with a very long name", [(1.0, -1.0), (2.0, -1.0), (2.0, 1.0), (1.0, 1.0)])]
        for space in ("/", "/left", "/right"):
            for stage in ("driver", "baseband", "fusion", "tracking", "gestures", "hand", "presence"):
                status = StageStatus(stage=stage, sequence=1, processed=12345, dropped=99999, compute_s=0.0123)
                status.header.stamp = to_time(1)
                monitor._status(space, status)
        monitor.duration = 12.0
        text = drawn(monitor)
    lines = text.splitlines()
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 80
    for word in ("9 people", "and 3 more", "hand [########", "push pull, 90% sure", "12 s left", "left/driver", "^ radar", "per second"):
        assert word in text
    assert set(threading.enumerate()) == before


def report(stage, last, *earlier):
    """A status of 50 Hz, of these frames; each was finished 5 ms after it came."""
    msg = StageStatus(stage=stage, sequence=last, processed=last + 1, compute_s=0.001, monotonic_ns=at(last))
    msg.header.stamp = to_time(at(last))
    msg.earlier_stamp_ns = msg.earlier_monotonic_ns = [at(k) for k in earlier]
    msg.earlier_sequence, msg.earlier_processed = list(earlier), [k + 1 for k in earlier]
    msg.earlier_dropped, msg.earlier_compute_s = [0 for _ in earlier], [0.001 for _ in earlier]
    return msg


def at(k):
    return 10**9 + k * 20_000_000


def test_what_stages_report_together_counts_as_if_it_came_alone(monkeypatch):
    """Rate, latencies and lost frames: all of those that were reported, and none of those whose report is to come yet."""
    monkeypatch.setenv("ROS_DOMAIN_ID", DOMAIN)
    with ros(), Monitor() as monitor:
        for k in range(10, 110, 10):
            for number in range(k - 10, k + 4):  # tracks of four come before their report
                if number != 7 and (number >= k - 6 or k == 10):
                    msg = tracks(1)
                    msg.sequence = number
                    monitor._tracks(msg)
            monitor._status("/", report("driver", k - 1, *range(k - 10, k - 1)))
        assert (monitor.frames, len(monitor.latencies)) == (100, 99)
        assert monitor.figures()["dropped_fraction"] == pytest.approx(0.01)
        driver = monitor.stages["driver"]
        assert driver.rate(driver.heard + 0.1) == 50.0
        assert driver.rate(driver.heard + 3.0) == 0.0
        before = len(monitor._arrived)
        for number in range(200, 5000):
            msg = tracks(1)
            msg.sequence = number
            monitor._tracks(msg)
        assert before < len(monitor._arrived) <= 1000  # nobody reports any more


def drawn(monitor):
    console = Console(width=80, height=24, file=io.StringIO(), color_system=None)
    console.print(monitor.render("title"))
    return console.file.getvalue()


def test_the_map_has_people_where_they_are():
    """Left is left, far is up, the radar is below them; a person far outside is left out."""
    text = RoomMap({"/": RadarInfo()}).draw({1: (2.0, 1.5), 2: (3.5, -1.5), 3: (90.0, 0.0)}, 34, 14).plain.splitlines()
    rows = {name: next((i for i, line in enumerate(text[:-1]) if name in line), None) for name in "123^"}
    columns = {name: text[rows[name]].index(name) for name in "12^"}
    assert rows["3"] is None
    assert rows["2"] < rows["1"] < rows["^"]
    assert columns["1"] < columns["^"] < columns["2"]
    assert len(text) == 14
    assert max(map(len, text)) <= 34


@pytest.mark.long
def test_the_end_of_a_source_is_told(monkeypatch):
    """By a real driver whose scene ends: the teller says ready, then that it has ended; status calls it wrong."""
    monkeypatch.setenv("ROS_DOMAIN_ID", next_domain())
    import rclpy

    from radar_ros.executor import make_executor

    said = []
    with ros():
        overrides = [rclpy.parameter.Parameter(name, value=value) for name, value in (("scene", "single_target"), ("duration", 1.5))]
        driver, node = DriverNode(parameter_overrides=overrides), rclpy.create_node("watcher")
        executor = make_executor()
        for each in (driver, node):
            executor.add_node(each)
        ears = Ears(node)
        teller, health = Teller(ears, ["driver"], said.append), Health(ears)
        end = time.monotonic() + 60.0
        while (len(said) < 2 or health.state("driver").state != "ended") and time.monotonic() < end:
            executor.spin_once(timeout_sec=0.1)
            teller.look()
        state = health.state("driver")
        driver.close()
        for each in (driver, node):
            executor.remove_node(each)
        executor.spin_once(timeout_sec=0.0)
        executor.shutdown()
        driver.destroy_node()
        node.destroy_node()
    assert said[0].startswith("ready: 1 node runs and data flows")
    assert said[1].startswith("the source of driver has ended")
    assert "has ended" in state.wrong
