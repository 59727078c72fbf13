"""Replaying a recording in its own time, with /clock, through real node processes."""

import subprocess
import sys
import time

import psutil
import pytest
from ros_domains import next_domain
from rosgraph_msgs.msg import Clock
from typer.testing import CliRunner

from radar_app.cli import app


@pytest.fixture(scope="module")
def raw(tmp_path_factory):
    """Raw frames of a person who gestures."""
    path = tmp_path_factory.mktemp("replay") / "raw"
    done = CliRunner().invoke(app, ["simulate", "short", "--out", str(path)])
    assert done.exit_code == 0, done.output
    return path


@pytest.mark.long
def test_replay_recognises_and_tells_the_time(raw):
    """The gestures of the recording come out; /clock runs from its start to its end, never back."""
    import rclpy

    from radar_ros.executor import make_executor

    domain = next_domain()
    slower = ["--rate", "0.5"]  # other tests share the machine
    command = [sys.executable, "-m", "radar_app", "replay", str(raw), *slower, "--domain", domain]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=int(domain))
    node = rclpy.create_node("clock_reader", context=context)
    executor = make_executor(context)
    executor.add_node(node)
    clocks = []
    node.create_subscription(Clock, "/clock", lambda m: clocks.append(m.clock.sec + m.clock.nanosec * 1e-9), 100)
    end = time.monotonic() + 90
    while process.poll() is None and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    output, _ = process.communicate(timeout=10)
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)
    assert process.returncode == 0, output
    assert "push" in output, output
    assert len(clocks) > 100
    assert clocks == sorted(clocks)
    assert clocks[-1] == pytest.approx(6.0, abs=0.1)


def test_replay_without_a_graph_says_what_to_do(raw, monkeypatch):
    """Nobody listens: not silence, but a message."""
    import radar_app.replaying as replaying

    monkeypatch.setattr(replaying, "READER_TIMEOUT", 0.5)
    done = CliRunner().invoke(app, ["replay", str(raw), "--no-graph", "--domain", next_domain()])
    assert done.exit_code != 0
    assert "nobody reads radar/frame" in str(done.exception)


def test_out_needs_lockstep(raw):
    """An option that would be ignored is refused."""
    done = CliRunner().invoke(app, ["replay", str(raw), "--out", "results"])
    assert "--out goes with --lockstep" in str(done.exception)


@pytest.mark.parametrize("extra", [["--loop"], ["--rate", "2"], ["--topics", "truth"], ["--no-clock"]])
def test_lockstep_refuses_what_it_would_ignore(raw, extra):
    """It knows only one pace."""
    done = CliRunner().invoke(app, ["replay", str(raw), "--lockstep", *extra])
    assert "--lockstep goes once" in str(done.exception)


def test_topics_have_to_exist(raw):
    """A typing mistake gets the list."""
    done = CliRunner().invoke(app, ["replay", str(raw), "--topics", "radar/frmae"])
    assert "there is no 'radar/frmae'; topics: radar/info, " in str(done.exception)
    assert " radar/frame, " in str(done.exception)


def start(raw, *extra):
    command = [sys.executable, "-m", "radar_app", "replay", str(raw), "--domain", next_domain(), *extra]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


@pytest.mark.long
def test_an_interrupted_replay_tidies_up(raw):
    """SIGTERM: one word, status 143, no traceback."""
    process = start(raw, "--loop")
    time.sleep(7.0)
    process.terminate()
    output, _ = process.communicate(timeout=10)
    assert process.returncode == 143, output
    assert "stopped by SIGTERM" in output
    assert "Traceback" not in output


def is_tracking(process):
    try:
        return "radar_ros.nodes.tracking" in process.cmdline()
    except psutil.Error:  # it has just ended
        return False


@pytest.mark.long
def test_a_node_that_dies_ends_a_replay_in_lockstep(raw, tmp_path):
    """At once, not after a time-out, and not with status 0: results with a hole are no results."""
    process = start(raw, "--lockstep", "--out", str(tmp_path / "out"))
    end, victim = time.monotonic() + 40, None
    while victim is None and time.monotonic() < end:
        time.sleep(0.1)
        victim = next((c for c in psutil.Process(process.pid).children() if is_tracking(c)), None)
    assert victim is not None
    time.sleep(1.0)
    victim.kill()
    output, _ = process.communicate(timeout=15)
    assert process.returncode == 2, output
    assert "node tracking ended with status -9; the replay is not complete" in output
    assert "Traceback" not in output
