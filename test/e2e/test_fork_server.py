"""Nodes that are forked are processes as any others: with their own logs, ends and signals."""

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest
import rclpy

from radar_app.fork_server import ForkServer
from radar_app.graph import NODES
from radar_app.supervisor import Supervisor
from radar_core import ConfigError

pytestmark = [pytest.mark.long, pytest.mark.skipif(sys.platform != "linux", reason="nodes are forked on Linux")]
NAMES = ("zones", "visualisation")
SPECS = [NODES[name] for name in NAMES]


@pytest.fixture(scope="module")
def fork_server():
    """One for all tests here; it loads two nodes."""
    with ForkServer([spec.module for spec in SPECS]) as found:
        yield found


def wait_for(wanted, timeout=60.0):
    """Whether it comes."""
    end = time.monotonic() + timeout
    while not wanted():
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True


@pytest.fixture
def seen():
    """Names of the nodes in the graph."""
    rclpy.init(args=[])
    node = rclpy.create_node("looker")
    yield node.get_node_names
    node.destroy_node()
    rclpy.try_shutdown()


def test_nodes_run_and_stop(fork_server, seen):
    """Each is a process of its own in the ROS graph, and ends well when it is told to."""
    with Supervisor(SPECS, fork_server=fork_server) as supervisor:
        assert wait_for(lambda: set(NAMES) <= set(seen()))
        pids = {supervisor.pid(name) for name in NAMES}
        assert len(pids) == 2
        assert os.getpid() not in pids
        assert {psutil.Process(pid).name() for pid in pids} == set(NAMES)
        assert all(used > 0 for used in supervisor.cpu_seconds().values())
    assert wait_for(lambda: not any(psutil.pid_exists(pid) for pid in pids))
    assert supervisor.crashes == []


def test_a_killed_node_is_told_and_started_again(fork_server, seen):
    """The status is that of the signal; with respawn it comes back, as a process of another number."""
    with Supervisor(SPECS, fork_server=fork_server, respawn=True) as supervisor:
        assert wait_for(lambda: set(NAMES) <= set(seen()))
        first = supervisor.pid("zones")
        os.kill(first, signal.SIGKILL)
        ended = []
        assert wait_for(lambda: ended.extend(supervisor.poll()) or ended)
        assert ended == [("zones", -signal.SIGKILL)]
        assert wait_for(lambda: "zones" in supervisor.poll() or "zones" in supervisor.running)
        assert supervisor.pid("zones") != first


def test_a_node_that_refuses_says_why(fork_server):
    """Its message is in the log, its status is 2."""
    said = []
    spec = NODES["zones"].__class__("zones", NODES["zones"].module, {"zones_file": "/nowhere.yaml"})
    with Supervisor([spec], fork_server=fork_server, log=lambda name, line: said.append((name, line))) as supervisor:
        ended = []
        assert wait_for(lambda: ended.extend(supervisor.poll()) or ended)
    assert ended == [("zones", 2)]
    assert any(name == "zones" and "/nowhere.yaml" in line for name, line in said)


def test_it_starts_no_threads(fork_server, seen):
    """A fork takes no threads along; there are none but those of LTTng, which `import rclpy` starts and which only tracing needs."""
    count = "import os, rclpy; print(len(os.listdir('/proc/self/task')))"
    bare = int(subprocess.run([sys.executable, "-c", count], capture_output=True, text=True, timeout=60).stdout)
    with Supervisor(SPECS, fork_server=fork_server):
        assert wait_for(lambda: set(NAMES) <= set(seen()))
        assert psutil.Process(fork_server._process.pid).num_threads() == bare


def test_all_end_with_who_started_them(tmp_path):
    """After a kill -9 of the command neither the fork server nor its nodes live on."""
    code = f"""
import time
from radar_app.graph import NODES
from radar_app.fork_server import ForkServer
from radar_app.supervisor import Supervisor
specs = [NODES[name] for name in {NAMES!r}]
fork_server = ForkServer([spec.module for spec in specs])
supervisor = Supervisor(specs, fork_server=fork_server)
supervisor.start()
print(fork_server._process.pid, *(supervisor.pid(name) for name in {NAMES!r}), flush=True)
time.sleep(100)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as parent:
        pids = [int(word) for word in parent.stdout.readline().split()]
        assert len(pids) == 3
        parent.kill()
    assert wait_for(lambda: not any(psutil.pid_exists(pid) and psutil.Process(pid).status() != "zombie" for pid in pids))


def test_one_that_cannot_load_says_so():
    """A module that is not there: a message that points at what was printed, not a wait."""
    with ForkServer(["radar_ros.nodes.nothing"]) as broken, pytest.raises(ConfigError, match="what it printed stands above"):
        Supervisor(SPECS, fork_server=broken).start()
