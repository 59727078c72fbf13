"""What goes wrong while recording or starting, and what the user is told and keeps."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from rclpy.parameter import Parameter

from radar_app.graph import graph
from radar_app.supervisor import Supervisor
from radar_core.paths import find_config
from radar_ros import bags
from radar_ros.nodes import recorder as recording
from radar_ros.nodes.recorder import make_node

FRAME = bytes(131_200)


def recorder(ros, folder):
    return ros.add(make_node(parameter_overrides=[Parameter("bag", value=str(folder))]))


def wait_for(wanted, timeout):
    end = time.monotonic() + timeout
    while not wanted():
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True


@pytest.mark.long
def test_a_killed_recorder_goes_on_beside(tmp_path):
    """SIGKILL and respawn: the first part is recovered, the second is whole, and nothing is overwritten."""
    lines = []
    specs = graph(
        "demo",
        parameters={"driver": {"scene": "single_target", "at_end": "loop"}, "recorder": {"bag": str(tmp_path / "rec")}},
        without=("evaluation", "visualisation", "gestures", "hand", "baseband", "tracking"),
    )

    def size(name):
        return sum(file.stat().st_size for file in (tmp_path / name).glob("*.mcap"))

    with Supervisor(specs, respawn=True, log=lambda name, line: lines.append(f"{name}: {line}")) as supervisor:
        assert wait_for(lambda: size("rec") > 3_000_000, 20.0), lines
        os.kill(supervisor.pid("recorder"), signal.SIGKILL)
        assert wait_for(lambda: supervisor.poll(), 5.0)
        assert wait_for(lambda: size("rec_2") > 3_000_000, 20.0), lines
    assert any("was cut off; going on in" in line for line in lines)
    assert bags.repair(tmp_path / "rec")["/radar/frame"] > 10
    for name in ("rec", "rec_2"):
        assert bags.contents(tmp_path / name)["/radar/frame"] > 10
        assert len(list(bags.read(tmp_path / name, ("radar/frame",)))) > 10


def test_a_full_disk_ends_the_recording_and_nothing_else(ros, tmp_path, monkeypatch):
    """What was written before stays readable, later messages count as dropped, and the node still ends at once."""
    node = recorder(ros, tmp_path / "full")
    write, count = node._writer.write, iter(range(1000))

    def fill(*item):
        if next(count) >= 20:
            raise OSError(28, "No space left on device")
        write(*item)

    monkeypatch.setattr(node._writer, "write", fill)
    problems = []
    monkeypatch.setattr(node, "problem", problems.append)
    for number in range(bags_waiting := 50):
        node._waiting.append(("/radar/frame", bags.TYPES["radar/frame"], number, FRAME))
    assert wait_for(lambda: node.processed + node.dropped == bags_waiting, 10.0)
    assert (node.processed, node.dropped) == (20, 30)
    started = time.monotonic()
    node.close()
    assert time.monotonic() - started < 2.0
    assert "No space left on device" in problems[0]
    assert "handwave repair" in problems[0]
    node._writer.close()  # what the guard leaves open; the file ends where the disk was full
    assert bags.contents(tmp_path / "full") == {"/radar/frame": 20}
    monkeypatch.setattr(node, "close", lambda: None)


def test_a_disk_that_cannot_keep_up_costs_what_is_not_yet_flushed_only(ros, tmp_path, monkeypatch):
    """While more comes than can be written, what was written is brought to the file all the same."""
    node, flushed = recorder(ros, tmp_path / "slow"), []
    flush, end = node._writer.flush, time.monotonic() + 3.0

    def slow(*_):
        time.sleep(0.002)
        while len(node._waiting) < 50 and time.monotonic() < end:
            node._waiting.append(("/radar/frame", bags.TYPES["radar/frame"], 0, FRAME))

    monkeypatch.setattr(node._writer, "write", slow)
    monkeypatch.setattr(node._writer, "flush", lambda: (flushed.append(len(node._waiting)), flush()))
    node._waiting.append(("/radar/frame", bags.TYPES["radar/frame"], 0, FRAME))
    assert wait_for(lambda: flushed, 10.0)
    assert flushed[0] > 0
    monkeypatch.setattr(node._writer, "write", lambda *_: None)


def test_a_recorder_goes_on_when_there_is_room_again(ros, tmp_path, monkeypatch):
    """Beside what the full disk cut off; while nothing can be written, no folder comes of it."""
    node, full = recorder(ros, tmp_path / "full"), [True]

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(recording, "_AGAIN", 0.1)
    room = recording._require_room
    monkeypatch.setattr(recording, "_require_room", lambda folder: fail() if full[0] else room(folder))
    monkeypatch.setattr(node._writer, "write", fail)
    node._waiting.append(("/radar/frame", bags.TYPES["radar/frame"], 0, FRAME))
    assert wait_for(lambda: node.dropped == 1, 10.0)
    time.sleep(0.5)
    assert os.listdir(tmp_path) == ["full"]
    full[0] = False
    assert wait_for(lambda: (tmp_path / "full_2").exists() and not node._broken, 10.0)
    node._waiting.append(("/radar/frame", bags.TYPES["radar/frame"], 1, FRAME))
    assert wait_for(lambda: node.processed == 1, 10.0)
    node.close()
    assert bags.contents(tmp_path / "full_2") == {"/radar/frame": 1}
    monkeypatch.setattr(node, "close", lambda: None)


def test_repair_leaves_a_whole_recording_alone(tmp_path):
    """Not a byte changes."""
    with bags.BagWriter(tmp_path / "whole") as writer:
        writer.write("/radar/frame", bags.TYPES["radar/frame"], 1, FRAME)
    before = (tmp_path / "whole" / "whole_0.mcap").read_bytes()
    assert bags.repair(tmp_path / "whole") == {}
    assert (tmp_path / "whole" / "whole_0.mcap").read_bytes() == before
    assert not list(tmp_path.glob("whole/*.damaged"))


def test_a_file_cut_off_behind_finished_metadata_is_repaired(tmp_path):
    """A copy that was interrupted: metadata.yaml is there, but the file is not whole."""
    with bags.BagWriter(tmp_path / "copy") as writer:
        for number in range(40):
            writer.write("/radar/frame", bags.TYPES["radar/frame"], number, FRAME)
    file = tmp_path / "copy" / "copy_0.mcap"
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert 10 <= bags.repair(tmp_path / "copy")["/radar/frame"] < 40
    assert len(list(bags.read(tmp_path / "copy"))) == bags.contents(tmp_path / "copy")["/radar/frame"]


@pytest.mark.parametrize("change", [{"format": np.array(99)}, {"weights_0": np.zeros((2, 2), np.float32)}], ids=["version", "shape"])
def test_a_model_that_does_not_fit_is_refused_by_the_node(tmp_path, change):
    """Of another format version, or with a shape that makes no sense: one line, status 2."""
    with np.load(find_config("gestures", "models", ".npz"), allow_pickle=False) as shipped:
        arrays = dict(shipped)
    assert set(change) <= set(arrays)
    np.savez(tmp_path / "other.npz", **{**arrays, **change})
    command = [sys.executable, "-m", "radar_ros.nodes.gestures", "--ros-args", "-p", f"model:={tmp_path / 'other.npz'}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2, done.stderr
    assert "other.npz" in done.stderr
    assert "Traceback" not in done.stderr
