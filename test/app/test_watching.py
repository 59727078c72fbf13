"""`up`, `status`, `listen` and `watch` over one running graph of a small simulated scene."""

import fcntl
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
from ros_domains import next_domain

from radar_app.watching.status import as_json, look
from radar_ros.interrupts import ros

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
