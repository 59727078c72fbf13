"""What the machine does to a running graph: disks that cannot be written to, terminals that close, readers that stop, suspends."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from handwave.msg import TrackArray as TrackArrayMsg

from radar_app import places
from radar_app.graph import graph
from radar_app.supervisor import Supervisor, environment
from radar_ros import qos

UP = [sys.executable, "-m", "radar_app", "up", "--scene", "single_target", "--param", "driver.at_end=loop"]
may_mount = pytest.mark.skipif(
    sys.platform != "linux"
    or not shutil.which("unshare")
    or subprocess.run(["unshare", "-m", "true"], capture_output=True).returncode != 0,
    reason="needs the right to mount",
)


@may_mount
@pytest.mark.long
def test_a_read_only_disk(ros):
    """Nothing can be written but memory: logs and compiled loops go there, one line each, and tracks come."""
    tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
    mount = 'mount --make-rprivate / && mount -o remount,ro,bind / && exec "$@"'
    process = subprocess.Popen(["unshare", "-m", "sh", "-c", mount, "sh", *UP], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert ros.spin_until(lambda: len(tracks) > 10, 60.0)
    finally:
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=20.0)
    assert process.returncode == 0, output
    assert output.count("Read-only file system; ROS's logs go to") == 1
    assert "Traceback" not in output


def test_a_place_of_somebody_else_is_not_used(tmp_path, monkeypatch):
    """What is compiled is run: a folder that others can write to is none of ours; without any, nothing is promised."""
    monkeypatch.setattr(places, "_MEMORY", tmp_path / "no" / "such")
    (tmp_path / f"handwave-{os.getuid()}").mkdir()
    (tmp_path / f"handwave-{os.getuid()}").chmod(0o777)
    (tmp_path / "file").write_text("")
    variables = {"HOME": str(tmp_path), "TMPDIR": str(tmp_path), "ROS_LOG_DIR": str(tmp_path / "file" / "log")}
    assert places.writable(variables) == variables
    (tmp_path / f"handwave-{os.getuid()}").chmod(0o700)
    assert places.writable(variables)["ROS_LOG_DIR"] == str(tmp_path / f"handwave-{os.getuid()}" / "logs")


def test_nothing_is_moved_where_everything_can_be_written(tmp_path, monkeypatch, capsys):
    """The usual places, without a word."""
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))
    before = os.environ.get("NUMBA_CACHE_DIR")
    found = environment()
    assert found["ROS_LOG_DIR"] == str(tmp_path)
    assert found.get("NUMBA_CACHE_DIR") == before
    assert capsys.readouterr().err == ""


@pytest.mark.long
def test_a_suspended_machine(ros):
    """All processes stop and continue: it is said for how long, nobody is taken for hanging, and tracks come again."""
    tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
    process = subprocess.Popen([*UP, "--respawn"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert ros.spin_until(lambda: len(tracks) > 10, 60.0)
        family = [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]
        for member in family:
            member.suspend()
        ros.spin_until(lambda: False, 5.0)
        for member in reversed(family):  # the one that looks after the others last, or first: either may happen
            member.resume()
        count = len(tracks)
        assert ros.spin_until(lambda: len(tracks) > count + 10, 30.0)
        ros.spin_until(lambda: False, 3.0)
    finally:
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=20.0)
    assert process.returncode == 0, output
    assert "stood still for" in output
    assert "hangs" not in output, output


@pytest.mark.long
def test_nobody_reads_the_output_of_up(ros):
    """A pipe that is full: tracks go on, a node that dies then is started again, and the end is as clean as ever."""
    tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writing, 4096 * b"x")
    os.set_blocking(writing, True)
    process = subprocess.Popen([*UP, "--respawn"], stdout=writing, stderr=writing)
    try:
        assert ros.spin_until(lambda: len(tracks) > 10, 60.0)
        victim = next(p for p in psutil.Process(process.pid).children() if "radar_ros.nodes.tracking" in p.cmdline())
        victim.kill()
        victim.wait(10.0)
        count = len(tracks)
        assert ros.spin_until(lambda: len(tracks) > count + 20, 30.0)
        process.send_signal(signal.SIGINT)
        assert process.wait(20.0) == 0
    finally:
        process.kill()
        process.wait()
        os.close(reading)
        os.close(writing)


@pytest.mark.long
def test_a_closed_terminal():
    """SIGHUP ends everything in order."""
    process = subprocess.Popen(UP, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    end = time.monotonic() + 60.0
    while len(family := psutil.Process(process.pid).children(recursive=True)) < 6 and time.monotonic() < end:
        time.sleep(0.1)
    process.send_signal(signal.SIGHUP)
    output, _ = process.communicate(timeout=20.0)
    assert process.returncode == 129, output
    assert output.count("stopped because its terminal was closed") == 1
    assert not psutil.wait_procs(family, timeout=10.0)[1]  # an ended one is listed until its parent has asked for its status
    assert "Traceback" not in output


@pytest.mark.long
def test_a_killed_node_leaves_no_shared_memory(ros):
    """Its segment goes, that of the nodes that live stays, and they still hear each other."""
    tracks, held = ros.collect(TrackArrayMsg, "tracks", qos.RESULT), Path("/dev/shm")
    specs = graph(
        "live", parameters={"driver": {"scene": "single_target", "at_end": "loop"}}, without=("visualisation", "gestures", "hand")
    )
    with Supervisor(specs, respawn=True, log=lambda name, line: None) as supervisor:
        assert ros.spin_until(lambda: supervisor.poll() == [] and len(tracks) > 10, 60.0)
        ros.spin_until(lambda: False, 3.5)
        owned = {name: segments_of(supervisor.pid(name)) for name in ("zones", "tracking")}
        assert all(owned.values())
        os.kill(supervisor.pid("zones"), signal.SIGKILL)
        gone = owned["zones"] - owned["tracking"]
        assert ros.spin_until(lambda: supervisor.poll() is not None and not any((held / name).exists() for name in gone), 30.0)
        assert all((held / name).exists() for name in owned["tracking"])
        count = len(tracks)
        assert ros.spin_until(lambda: supervisor.poll() == [] and len(tracks) > count + 10, 30.0)


def segments_of(pid):
    """Segments whose lock a process holds."""
    inodes = {line.split()[5].rpartition(":")[2] for line in Path("/proc/locks").read_text().splitlines() if line.split()[4] == str(pid)}
    locks = [path for path in Path("/dev/shm").glob("fast*_el") if "port" not in path.name]
    return {path.name.removesuffix("_el") for path in locks if str(path.stat().st_ino) in inodes}
