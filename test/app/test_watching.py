"""`up`, `status`, `listen` and `watch` over one running graph of a small simulated scene, and their parts without one."""

import fcntl
import io
import json
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import threading
import time

import psutil
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
from radar_app.watching.status import as_json, look
from radar_app.watching.teller import Teller
from radar_core import GESTURES, RadarInfo
from radar_ros.interrupts import ros
from radar_ros.messages.convert import to_time
from radar_ros.nodes.driver import DriverNode

DOMAIN = next_domain()
NODES = {"driver", "baseband", "tracking", "gestures", "hand", "zones", "visualisation", "vital"}
SCENE = """
duration: 6.0
seed: 7
effects: {doppler_in_chirp: true, noise: {noise_figure: 15}, losses: {level: 20}}
people:
  - {id: 1, position: [2.3, 0.2], script: [{gesture: push, at: 2.0}, {gesture: swipe_right, at: 4.0}]}
"""


def environment():
    return {**os.environ, "ROS_DOMAIN_ID": DOMAIN, "COLUMNS": "80"}


def run(*words, timeout=60.0):
    command = [sys.executable, "-m", "radar_app", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, env=environment(), check=False)


class Graph:
    """`handwave up` as a process, and what it has said so far."""

    def __init__(self, scene):
        command = [sys.executable, "-m", "radar_app", "up", "--scene", str(scene), "-p", "driver.at_end=loop", "--also", "vital"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment())
        self.lines = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        self.lines.extend(line.strip() for line in iter(self.process.stdout.readline, ""))

    def said(self, *words):
        return [line for line in list(self.lines) if line.startswith("handwave ") and all(word in line for word in words)]

    def node(self, name):
        """Process of a node."""
        children = psutil.Process(self.process.pid).children(recursive=True)
        return next(child for child in children if f"radar_ros.nodes.{name}" in " ".join(child.cmdline()))


def wait_until(done, timeout=90.0, text=""):
    end = time.monotonic() + timeout
    while not done():
        assert time.monotonic() < end, text() if callable(text) else text
        time.sleep(0.05)


@pytest.fixture(scope="module")
def graph(tmp_path_factory):
    """A graph that is ready, and is told to stop at the end."""
    scene = tmp_path_factory.mktemp("watching") / "one.yaml"
    scene.write_text(SCENE)
    running = Graph(scene)
    try:
        ready = f"ready: {len(NODES)} nodes run"
        wait_until(lambda: running.said(ready) or running.process.poll() is not None, text=lambda: "\n".join(running.lines))
        yield running
    finally:
        running.process.send_signal(signal.SIGINT)
        assert running.process.wait(timeout=20.0) == 0


@pytest.mark.long
def test_up_says_who_came_and_what_they_did(graph):
    """A line when the person comes, and one for each gesture; the nodes' own logs stay."""
    wait_until(lambda: graph.said("person", "swipe right ("), text=lambda: "\n".join(graph.lines))
    came = graph.said("came")[0]
    assert abs(float(re.search(r"([0-9.]+) m ahead", came)[1]) - 2.3) < 0.4
    assert any(line.startswith("tracking ") for line in graph.lines)
    assert not graph.said("no data any more")


@pytest.mark.long
def test_status_names_every_node_and_what_is_wrong(graph):
    """Rates, latencies and drops of all; that a node does not run is named, with exit status 1, and all is well again afterwards."""
    found = {}

    def running():
        done = run("status", "--json")
        found.update(json.loads(done.stdout))
        assert done.returncode == (1 if found["wrong"] else 0)
        return {node["state"] for node in found["nodes"]} <= {"running", "warning"}  # a busy machine loses messages

    def known():
        """Whether all have been heard in the same moment; on a busy machine that takes more than one look."""
        latencies = {node["name"]: node["latency"] for node in found["nodes"]} if running() else {}
        return latencies.get("baseband") and latencies.get("tracking") and found["people"] == {"/": 1}

    wait_until(known, text=lambda: found)
    nodes = {node["name"]: node for node in found["nodes"]}
    assert set(nodes) == NODES
    assert all(node["rate"] > 0 for node in nodes.values())
    assert nodes["driver"]["latency"] is None
    assert 0 < nodes["baseband"]["latency"] < nodes["tracking"]["latency"] < 10.0
    wait_until(lambda: running() and found["gestures"] and found["persons"] and found["zones"], text=lambda: found)
    assert found["persons"][0]["position"][:2] == pytest.approx([2.3, 0.2], abs=0.4)
    assert [(zone["name"], zone["count"]) for zone in found["zones"]] == [("room", 1)]
    assert found["gestures"][0]["gesture"] in ("push", "swipe_right")
    assert found["radars"][0] | {"position": None} == {
        "name": "radar", "position": None, "yaw_deg": 0.0, "view_deg": 120.0, "range": pytest.approx(6.4, abs=0.01),
    }  # fmt: skip
    held = graph.node("tracking")
    looks = []

    def stale():
        looks.append(run("status"))
        return "gestures: stale" in " ".join(looks[-1].stdout.split())

    held.suspend()
    try:
        wait_until(stale, text=lambda: looks[-1].stdout)  # after two seconds without tracks
    finally:
        held.resume()
    done = looks[-1]
    words = " ".join(done.stdout.split())
    assert done.returncode == 1, done.stdout
    silent, absent = "tracking: it is there but says nothing", "wait for it; tracking does, if it runs"  # whether it is still heard of
    assert silent in words or absent in words, done.stdout
    lines = [line for line in done.stdout.splitlines() if "RTPS_TRANSPORT" not in line]  # Fast DDS complains of the node that is stopped
    assert max(map(len, lines)) <= 80, done.stdout
    assert len(lines) <= 24
    wait_until(running, text=lambda: found)


def test_status_without_a_graph(monkeypatch):
    """Exit status 2: nothing is well and nothing is wrong."""
    monkeypatch.setenv("ROS_DOMAIN_ID", DOMAIN)
    with ros():
        found = look("nowhere", 0.5)
    assert (found.code, found.nodes, found.wrong, found.namespace) == (2, (), (), "/nowhere")
    assert as_json(found)["healthy"] is False


@pytest.mark.long
def test_listen_gives_a_line_for_each_and_ends_with_its_reader(graph):
    """JSON with units of its help; when nobody reads any more it ends by itself, with the status of a closed pipe."""
    command = [sys.executable, "-m", "radar_app", "listen", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment()) as process:
        seen = {}
        for line in process.stdout:
            record = json.loads(line)
            seen.setdefault(record["type"], record)
            if {"gesture", "people", "zones"} <= set(seen):
                break
        process.stdout.close()
        assert process.wait(timeout=30.0) == 141
        assert process.stderr.read() == ""
    person = seen["people"]["people"][0]
    assert seen["people"]["count"] == 1
    assert abs(person["position"][0] - 2.3) < 0.5
    assert seen["gesture"]["gesture"] in ("push", "swipe_right")
    assert 0.5 < seen["gesture"]["confidence"] <= 1.0
    assert seen["gesture"]["start"] < seen["gesture"]["end"] <= seen["gesture"]["time"]
    assert seen["zones"]["zones"][0]["name"] == "room"


@pytest.mark.long
def test_listen_ends_when_told(graph):
    """Ctrl-C is how it ends, status 0; a terminal that closes is not."""
    command = [sys.executable, "-m", "radar_app", "listen", "--json", "--people"]
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "env": environment()}
    signals = {signal.SIGINT: 0, signal.SIGHUP: 129}
    processes = {number: subprocess.Popen(command, **options) for number in signals}
    for number, process in processes.items():
        assert json.loads(process.stdout.readline())["type"] == "people"
        process.send_signal(number)
        _, complaint = process.communicate(timeout=30.0)
        assert process.returncode == signals[number]
        # A closed terminal is told where somebody may still read it; nothing else is said.
        assert complaint in ("", *(["handwave: stopped because its terminal was closed\n"] if number == signal.SIGHUP else []))


@pytest.mark.long
def test_watch_shows_the_room_in_a_terminal(graph):
    """A real terminal of 80 columns and 24 lines: person, map and rates are on it, and Ctrl-C ends it with status 0."""
    pid, master = pty.fork()
    if pid == 0:
        os.execve(sys.executable, [sys.executable, "-m", "radar_app", "watch"], {**environment(), "TERM": "xterm"})
    fcntl.ioctl(master, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    shown = b""

    def read():
        nonlocal shown
        if select.select([master], [], [], 0.1)[0]:
            shown += os.read(master, 65536)
        return all(word in shown for word in (b"1 person", b"m ahead", b"^ radar", b"tracking", b"from frame to people"))

    wait_until(read, text=lambda: shown[-3000:].decode(errors="replace"))
    os.kill(pid, signal.SIGINT)
    ended = []

    def gone():
        read() if not ended else None
        ended.append(os.waitpid(pid, os.WNOHANG))
        return ended[-1][0] == pid

    wait_until(gone)
    os.close(master)
    assert os.waitstatus_to_exitcode(ended[-1][1]) == 0
    assert b"Traceback" not in shown


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
