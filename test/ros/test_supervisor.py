"""Processes of the graph: clean ends within 3 s, respawn after kill -9, no orphans, clear words for a busy domain."""

import itertools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import psutil
import pytest
from handwave.msg import TrackArray as TrackArrayMsg

from radar_app.graph import STAGES, NodeSpec, graph
from radar_app.supervisor import Supervisor, environment, refuse_busy_domain
from radar_core import ConfigError
from radar_ros import qos

pytestmark = pytest.mark.usefixtures("own_domain")


def specs(*without):
    return graph("live", parameters={"driver": {"scene": "single_target", "at_end": "loop"}}, without=("visualisation", *without))


def marked(marker):
    """Living processes whose environment carries a marker."""
    found = []
    for process in psutil.process_iter(["pid", "status"]):
        try:
            if process.info["status"] != psutil.STATUS_ZOMBIE and process.environ().get("HANDWAVE_TEST") == marker:
                found.append(process)
        except psutil.Error:
            continue
    return [p for p in found if p.pid != os.getpid()]


def wait_for(wanted, timeout):
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        if wanted():
            return True
        time.sleep(0.05)
    return False


@pytest.mark.long
def test_kill_9_of_any_node_and_its_restart_leave_the_graph_working(ros):
    """Each node in turn dies by SIGKILL; it is started again and tracks go on coming."""
    tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
    lines, nodes = [], ("driver", *STAGES, "zones")
    supervisor = Supervisor(specs(), respawn=True, log=lambda name, line: lines.append(f"{name}: {line}"))
    with supervisor:
        assert ros.spin_until(lambda: len(tracks) > 10, 40.0), lines
        for name in nodes:
            old = supervisor.pid(name)
            os.kill(old, signal.SIGKILL)
            assert ros.spin_until(lambda n=name: any(e[0] == n for e in supervisor.poll()), 5.0)
            assert ros.spin_until(lambda n=name: not supervisor.poll() and n in supervisor.running, 15.0)  # when the one before works
            assert supervisor.pid(name) != old
            # What was on its way does not count: from 0.5 s after the death on, ten new arrays have to come.
            ros.spin_until(lambda: False, 0.5)
            count = len(tracks)
            assert ros.spin_until(lambda c=count: len(tracks) > c + 10, 40.0), (name, lines[-10:])
            assert ros.spin_until(lambda: set(supervisor.running) == set(nodes), 5.0)
        started = time.monotonic()
    assert time.monotonic() - started < 3.0
    assert [name for name, _ in supervisor.crashes] == list(nodes)


@pytest.mark.long
def test_two_nodes_that_die_at_once_come_back_one_after_the_other(ros):
    """The second is started when the first works: nodes that come back together hear nothing any more far more often than one alone."""
    tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
    lines = []
    with Supervisor(specs(), respawn=True, log=lambda name, line: lines.append(f"{name}: {line}")) as supervisor:
        assert ros.spin_until(lambda: len(tracks) > 10 and not supervisor.poll() and supervisor.healthy, 40.0), lines
        for names in (("baseband", "hand"), ("tracking", "baseband"), ("gestures", "baseband")):
            old = {name: supervisor.pid(name) for name in names}
            for pid in old.values():
                os.kill(pid, signal.SIGKILL)
            back = []
            while len(back) < 2:
                ros.spin_until(lambda: False, 0.05)
                supervisor.poll()
                back += [name for name in set(supervisor.running) & set(names) if name not in back and supervisor.pid(name) != old[name]]
                assert len(back) < 2 or supervisor._watchdog.alive(supervisor.pid(back[0]))
            assert not supervisor.healthy
            count = len(tracks)
            assert ros.spin_until(lambda c=count: len(tracks) > c + 10 and not supervisor.poll() and supervisor.healthy, 40.0), lines[-10:]


@pytest.mark.long
def test_ctrl_c_stops_everything_within_three_seconds(tmp_path):
    """`handwave up`, told to stop by SIGINT: exit status 0, no process left."""
    marker = f"up-{os.getpid()}"
    variables = {**os.environ, "HANDWAVE_TEST": marker}
    command = [sys.executable, "-m", "radar_app", "up", "--scene", "single_target"]
    process = subprocess.Popen(command, env=variables, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert wait_for(lambda: len(marked(marker)) >= 7, 30.0)
    time.sleep(2.0)
    started = time.monotonic()
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=10.0)
    assert time.monotonic() - started < 3.0, output
    assert process.returncode == 0, output
    assert not marked(marker)
    assert "Traceback" not in output


@pytest.mark.long
def test_a_killed_launcher_leaves_no_orphans():
    """SIGKILL of `handwave up` itself: its nodes end too."""
    marker = f"orphans-{os.getpid()}"
    variables = {**os.environ, "HANDWAVE_TEST": marker}
    process = subprocess.Popen(
        [sys.executable, "-m", "radar_app", "up", "--scene", "single_target"], env=variables, stdout=subprocess.DEVNULL
    )
    assert wait_for(lambda: len(marked(marker)) >= 7, 30.0)
    time.sleep(1.0)
    process.kill()
    process.wait()
    assert wait_for(lambda: not marked(marker), 5.0), marked(marker)


@pytest.mark.long
@pytest.mark.parametrize("after", [0.6, 2.5])
def test_ctrl_c_while_everything_is_starting(after):
    """Whatever is being imported or made at that moment ends without a traceback and without leaving a process."""
    marker = f"early-{os.getpid()}-{after}"
    command = [sys.executable, "-m", "radar_app", "up", "--scene", "single_target"]
    variables = {**os.environ, "HANDWAVE_TEST": marker}
    process = subprocess.Popen(command, env=variables, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    time.sleep(after)
    started = time.monotonic()
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=10.0)
    assert time.monotonic() - started < 3.0, output
    assert process.returncode in (0, 130), output
    assert "Traceback" not in output
    assert wait_for(lambda: not marked(marker), 2.0), marked(marker)  # who is being imported ends with the process that it is a fork of


@pytest.mark.long
def test_a_node_that_cannot_start_says_why(tmp_path):
    """A scene that does not exist: one line of the node, one of the command, and status 2."""
    command = [sys.executable, "-m", "radar_app", "up", "--scene", str(tmp_path / "nowhere.yaml")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "nowhere.yaml: there is no such file" in done.stdout
    assert "node driver refused its configuration" in done.stderr
    assert "Traceback" not in done.stdout + done.stderr


@pytest.mark.long
def test_a_node_that_dies_leaves_the_others_running(ros):
    """Without --respawn: it is named, tracks go on coming, and the exit status tells of it in the end."""
    marker = f"others-{os.getpid()}"
    command = [sys.executable, "-m", "radar_app", "up", "--scene", "single_target", "--param", "driver.at_end=loop"]
    variables = {**os.environ, "HANDWAVE_TEST": marker}
    tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
    process = subprocess.Popen(command, env=variables, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        assert ros.spin_until(lambda: len(tracks) > 10, 40.0)
        victim = next(p for p in marked(marker) if "radar_ros.nodes.gestures" in p.cmdline())
        victim.kill()
        ros.spin_until(lambda: False, 1.0)
        count = len(tracks)
        assert ros.spin_until(lambda: len(tracks) > count + 10, 10.0)
    finally:
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=10.0)
    assert process.returncode == 1
    assert "node gestures ended with status -9; the others go on" in errors
    assert not marked(marker)


def test_a_node_that_dies_again_and_again_is_started_ever_later(monkeypatch):
    """At once the first time, then after growing pauses: a broken node must not eat a processor."""
    supervisor = Supervisor((NodeSpec("broken", "radar_ros.no_such_module"),), respawn=True, log=lambda name, line: None)
    deaths = []
    with supervisor:
        assert wait_for(lambda: deaths.extend((time.monotonic(), *e) for e in supervisor.poll()) or len(deaths) >= 3, 30.0)
        assert supervisor.active
    pauses = [b[0] - a[0] for a, b in itertools.pairwise(deaths)]
    assert pauses[1] >= 1.0  # 0.25 s * 2 ** 2 before the third start
    assert not supervisor.active


@pytest.mark.parametrize("number", ["abc", "-1", "233"])
def test_a_domain_that_is_none(monkeypatch, number):
    """Before anything is started."""
    monkeypatch.setenv("ROS_DOMAIN_ID", number)
    with pytest.raises(ConfigError, match=rf"ROS_DOMAIN_ID is '{number}'; it must be a number from 0 to 232"):
        environment()


def test_discovery_is_quick_unless_the_user_says_otherwise(monkeypatch):
    """A file of ours that is there and that Fast DDS can read; the user's own, by either name, wins."""
    for name in ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE"):
        monkeypatch.delenv(name, raising=False)
    ours = Path(environment()["FASTRTPS_DEFAULT_PROFILES_FILE"])
    assert ElementTree.parse(ours).getroot().tag == "{http://www.eprosima.com}dds"
    monkeypatch.setenv("FASTDDS_DEFAULT_PROFILES_FILE", "/mine.xml")
    assert "FASTRTPS_DEFAULT_PROFILES_FILE" not in environment()
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", "/other.xml")
    assert environment()["FASTRTPS_DEFAULT_PROFILES_FILE"] == "/other.xml"


def test_no_place_for_logs(monkeypatch):
    """ROS needs HOME or ROS_LOG_DIR."""
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.delenv("ROS_LOG_DIR", raising=False)
    with pytest.raises(ConfigError, match="neither HOME nor ROS_LOG_DIR"):
        environment()


@pytest.mark.long
def test_busy_domain_is_refused(ros):
    """A second graph with the same names in the same domain is not started."""
    import rclpy

    ros.add(rclpy.create_node("tracking"))
    ros.spin_until(lambda: False, 0.2)
    with pytest.raises(ConfigError, match=r"already has tracking in namespace /.*--domain"):
        refuse_busy_domain(["driver", "tracking"], "", None)
    refuse_busy_domain(["driver", "tracking"], "left", None)


@pytest.mark.long
def test_composed_graph_runs_and_ends_cleanly(ros):
    """All nodes in one process, on one executor."""
    tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
    command = [sys.executable, "-m", "radar_app", "up", "--composed", "--scene", "single_target", "--param", "driver.at_end=loop"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert ros.spin_until(lambda: len(tracks) > 10, 40.0)
    finally:
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=5.0)
    assert process.returncode == 0, output
