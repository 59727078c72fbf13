"""The TinyRad through pyusb and the real libusb: the kernel's side of the cable is emulated."""

import hashlib
import json
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from tinyrad_scenes import encode

from radar_driver.tinyrad import wire
from radar_driver.tinyrad.config import TinyRadConfig
from radar_driver.tinyrad.convert import analytic

pytestmark = pytest.mark.umockdev
CHILD = Path(__file__).parent / "tinyrad_child.py"
PLAIN = {"calibrate": False}


class Child:
    """A program beside us that reads the board."""

    def __init__(self, machine, n_frame, **settings):
        line = [sys.executable, str(CHILD), str(n_frame), json.dumps({**PLAIN, **settings})]
        self.process = subprocess.Popen(line, env=machine.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def hear(self, key):
        """Lines until one with this key."""
        lines = []
        for line in self.process.stdout:
            lines.append(json.loads(line))
            if key in lines[-1]:
                return lines
        raise AssertionError(f"{key} never came: {lines[-3:]}, {self.process.stderr.read()}")

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()


@pytest.fixture
def child():
    children = []

    def make(*arguments, **settings):
        children.append(Child(*arguments, **settings))
        return children[-1]

    yield make
    for one in children:
        one.close()


@pytest.mark.long
def test_frames_arrive_whole_and_in_order(machine, child):
    """Two frames in turn, 40 of them at 50 Hz: every sample is right, none is lost, nothing is left open."""
    rng = np.random.default_rng(2)
    real = rng.normal(0.0, 0.02, (2, 2, 64, 4, 63))
    blocks = [encode(one, TinyRadConfig()) for one in real]
    board = machine(b"".join(blocks))
    lines = child(board, 40).hear("report")
    assert lines[0]["found"] == [{"address": "USB 1-1", "problem": ""}]
    digests = []
    for one in real:
        volts = (np.round(one / wire.VOLTS).astype(np.float32) * np.float32(wire.VOLTS)).astype(np.float32)
        digests.append(hashlib.sha256(np.ascontiguousarray(analytic(np.ascontiguousarray(volts))).tobytes()).hexdigest()[:16])
    frames = [line for line in lines if "sequence" in line]
    for frame in frames:
        assert frame["digest"] == digests[frame["sequence"] % 2]
        assert frame["missing"] == 0
    end = lines[-1]
    assert end["report"]["lost_frames"] == 0
    assert end["counts"] == {}
    assert sum(b["sequence"] - a["sequence"] - 1 for a, b in pairwise(frames)) <= end["replaced"]  # newer ones took the place of those
    assert end["after"].pop("tasks") <= end["before"].pop("tasks") + 1  # libusb may keep a thread of its own for events
    assert end["after"] == end["before"]
    assert end["after"]["nodes"] == []
    ready = board.say("report")["ready_ns"]
    # The stamp is the start of the acquisition, 12.8 ms before its end, late by what the fastest transfer took; here that is milliseconds.
    late = [(frame["stamp"] + 12_800_000 - ready[frame["sequence"]]) * 1e-6 for frame in frames]
    assert min(late) > -2.1
    assert np.median(late) < 20.0


@pytest.mark.long
def test_unplugged_and_plugged_in_again(machine, child):
    """The real libusb's errno 19: told with the remedy; frames come again by themselves within 3 s of the plug."""
    board = machine()
    one = child(board, 10**6)
    one.hear("sequence")
    board.say("unplug")
    problem = next(line["problem"] for line in one.hear("problem") if line.get("problem"))
    assert "unplugged: plug it in again" in problem
    time.sleep(0.7)  # one attempt at least finds nothing
    board.say("plug")
    plugged = time.monotonic_ns()
    lines = one.hear("sequence")
    assert lines[-1]["arrived"] - plugged <= 3e9
    assert any("no TinyRad is plugged in" in line.get("problem", "") for line in lines)


def test_second_opener(machine, child):
    """The kernel says busy; the message names the program that holds it, which is not disturbed."""
    board = machine()
    first = child(board, 10**6)
    first.hear("sequence")
    error = child(board, 1).hear("error")[-1]["error"]
    assert "another program holds the TinyRad at 1-1: python" in error
    assert f"(process {first.process.pid})" in error
    before = first.hear("sequence")[-1]["sequence"]
    assert first.hear("sequence")[-1]["sequence"] > before


@pytest.mark.parametrize(("fault", "value", "said"), [("stall_data", True, "stalled"), ("cut", 1000, "64536 bytes instead of 65536")])
def test_a_fault_that_passes(machine, child, fault, value, said):
    """A stall and a frame cut short, as libusb reports them: told, and the next frame is there."""
    board = machine()
    one = child(board, 10**6)
    one.hear("sequence")
    board.say(f"fault {fault} {json.dumps(value)}")
    problem = next(line["problem"] for line in one.hear("problem") if line.get("problem"))
    assert said in problem
    assert len(one.hear("sequence")) >= 1


@pytest.mark.long
def test_kill_9_and_start_again(machine, child):
    """A program that dies in the middle of everything leaves a board that the next one brings into step."""
    board = machine()
    for _ in range(3):
        one = child(board, 10**6)
        lines = one.hear("sequence")
        assert lines[-1]["sequence"] <= 1
        one.hear("sequence")
        one.process.kill()
        one.process.wait()
        while board.say("report")["holders"]:  # a kernel lets go before `wait` returns, umockdev's thread a moment after
            time.sleep(0.01)


@pytest.mark.long
def test_a_board_that_hangs(machine, child):
    """No answer within the time: told with the remedy; reading goes on when it answers again."""
    board = machine()
    one = child(board, 10**6, timeout=0.3)
    one.hear("sequence")
    board.say("fault partial 5120")
    problem = next(line["problem"] for line in one.hear("problem") if line.get("problem"))
    assert "5120 of 65536 bytes into a frame" in problem
    assert "unplug it and plug it in again" in problem
    board.say("fault hang false")
    one.hear("sequence")
