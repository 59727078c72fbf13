"""Nodes that hang are found and told apart from those that only work, and nothing holds up who looks after them."""

import os
import signal
import subprocess
import sys
import threading
import time

import psutil
import pytest
from handwave.msg import StageStatus
from handwave.msg import TrackArray as TrackArrayMsg
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from std_msgs.msg import String

from radar_app.graph import NodeSpec, graph
from radar_app.printing import Printer
from radar_app.supervisor import Supervisor
from radar_app.watchdog import Watchdog
from radar_ros import qos

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="nodes that hang are found on Linux")
BEGIN = "import threading, time\nfrom radar_ros import heartbeat\nheartbeat.beat(); print('begun', flush=True)\n"
ENDS = {
    "deadlock": "lock = threading.Lock(); lock.acquire(); lock.acquire()",
    "endless": "while True: pass",
    "stopped": "while True: heartbeat.beat(); time.sleep(0.1)",
    "working": "with heartbeat.busy():\n    while True: pass",
    "well": "while True: heartbeat.beat(); time.sleep(0.1)",
}


@pytest.mark.long
def test_what_hangs_is_told_apart_from_what_works():
    """A deadlock, an endless loop and a stopped process are named with their cause; long work that was told of, and a well one are not."""
    watchdog = Watchdog()
    environment = {**os.environ, **watchdog.variables}
    children = {
        name: subprocess.Popen([sys.executable, "-c", BEGIN + code], env=environment, stdout=subprocess.PIPE) for name, code in ENDS.items()
    }
    names = {child.pid: name for name, child in children.items()}
    found = {}
    try:
        watchdog.look(names)
        assert all(child.stdout.readline() == b"begun\n" for child in children.values())
        children["stopped"].send_signal(signal.SIGSTOP)
        end = time.monotonic() + 30.0
        while len(found) < 3 and time.monotonic() < end:
            time.sleep(0.2)
            found |= {names[pid]: why for pid, why in watchdog.look(names)[0]}
        assert found.keys() == {"deadlock", "endless", "stopped"}
        assert "deadlock" in found["deadlock"]
        assert "endless loop" in found["endless"]
        assert "a signal has stopped it" in found["stopped"]
        assert watchdog.alive(children["well"].pid)
        assert not watchdog.alive(children["stopped"].pid)
        children["stopped"].send_signal(signal.SIGCONT)
        again = []
        while not again and time.monotonic() < end:
            time.sleep(0.2)
            again = watchdog.look(names)[1]
        assert names[again[0][0]] == "stopped"
        assert watchdog.alive(children["stopped"].pid)
    finally:
        for child in children.values():
            child.kill()
            child.communicate()
        watchdog.close()


def test_a_machine_that_stood_still_makes_nobody_hang(monkeypatch):
    """After a suspend everybody has been silent for hours; it is said for how long, and no process is ended."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        watchdog = Watchdog()
        watchdog.look({child.pid: "one"})
        now = time.monotonic()
        monkeypatch.setattr(time, "monotonic", lambda: now + 7200.0)
        found, again, late = watchdog.look({child.pid: "one"})
        assert (found, again) == ([], [])
        assert late == pytest.approx(7200.0, abs=5.0)
        assert watchdog.look({child.pid: "one"})[0] == []
        watchdog.close()
        child.communicate(b"\n")


def test_signs_of_life_of_others_count_for_nobody():
    """Who is not watched may send what it likes, also nonsense."""
    watchdog = Watchdog()
    code = BEGIN + "heartbeat.notify('WATCHDOG_USEC=99999999999999', 'x' * 3000)"
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        watchdog.look({child.pid: "one"})
        subprocess.run([sys.executable, "-c", code], env={**os.environ, **watchdog.variables}, check=True, stdout=subprocess.DEVNULL)
        assert watchdog.look({child.pid: "one"}) == ([], [], pytest.approx(0.0, abs=60.0))
        assert not watchdog.alive(child.pid)
        child.communicate(b"\n")
    watchdog.close()


def test_nobody_reads(monkeypatch):
    """A full pipe holds up nobody; who reads again gets lines, and the number of those that are missing."""
    reading, writing = os.pipe()
    with os.fdopen(writing, "w", encoding="utf-8") as out, os.fdopen(reading, encoding="utf-8") as read:
        monkeypatch.setattr(sys, "stdout", out)
        printer = Printer(4)
        for k in range(6000):
            printer("node", f"line {k} " + 60 * "x")
        lines = []
        reader = threading.Thread(target=lambda: lines.extend(read))
        reader.start()
        printer.flush(30.0)
        printer("node", "the last line")
        printer.close()
        out.close()
        reader.join(30.0)
    missing = [int(line.split()[1]) for line in lines if "are missing here" in line]
    assert missing  # once, or again where the pipe had room in between
    assert len(lines) - 1 - len(missing) + sum(missing) == 6000
    assert lines[-1].endswith("the last line\n")
    assert lines[0].startswith("node line 0 ")


def in_state(processes, wanted):
    return all((process.status() == psutil.STATUS_STOPPED) == wanted for process in processes)


def wait_for(wanted, timeout):
    end = time.monotonic() + timeout
    while not wanted():
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True


def supervised(lines, *more):
    """Run people in a simulated room, and ``more`` nodes; what they say goes to ``lines``."""
    specs = graph(
        "live", parameters={"driver": {"scene": "single_target", "at_end": "loop"}}, without=("visualisation", "gestures", "hand")
    )
    return Supervisor((*specs, *more), respawn=True, log=lambda name, line: lines.append(f"{name}: {line}"))


@pytest.mark.long
def test_a_node_that_hangs_is_started_again_and_the_graph_goes_on(ros):
    """SIGSTOP of one that frames go through: it is named, gets another process, and tracks come again."""
    tracks, lines = ros.collect(TrackArrayMsg, "tracks", qos.RESULT), []
    with supervised(lines) as supervisor:
        assert ros.spin_until(lambda: supervisor.poll() == [] and len(tracks) > 10, 60.0), lines
        assert ros.spin_until(lambda: supervisor.poll() == [] and supervisor.healthy, 10.0), lines
        old = supervisor.pid("tracking")
        os.kill(old, signal.SIGSTOP)
        assert ros.spin_until(lambda: ("tracking", -signal.SIGKILL) in supervisor.poll(), 30.0), lines
        count = len(tracks)
        assert ros.spin_until(lambda: supervisor.poll() == [] and len(tracks) > count + 10, 60.0), lines
        assert supervisor.pid("tracking") != old
    assert [name for name, _ in supervisor.hangs] == ["tracking"], lines
    assert any(line.startswith("tracking: hangs: ") and "a signal has stopped it" in line for line in lines)


@pytest.mark.long
def test_a_node_that_hears_nothing_any_more_is_started_again(ros):
    """Its subscription is gone, as with shared memory that fails, and it gives signs of life: it is named, and works in another process."""
    statuses, lines = ros.collect(StageStatus, "stage_status", qos.sensor(depth=50)), []
    illness = ros.node.create_publisher(String, "illness", qos.COMMAND)

    def heard():
        return sum(status.stage == "patient" for status in statuses)

    with supervised(lines, NodeSpec("patient", "benchmarks.faults_node")) as supervisor:
        assert ros.spin_until(lambda: supervisor.poll() == [] and supervisor.healthy and heard() > 10, 60.0), lines
        old = supervisor.pid("patient")
        illness.publish(String(data="deaf"))
        assert ros.spin_until(lambda: ("patient", -signal.SIGKILL) in supervisor.poll(), 30.0), lines
        count = heard()
        assert ros.spin_until(lambda: supervisor.poll() == [] and heard() > count + 10, 60.0), lines
        assert supervisor.pid("patient") != old
    assert [name for name, _ in supervisor.hangs] == ["patient"], lines
    assert any(line.startswith("patient: hangs: it has heard nothing for ") for line in lines)


@pytest.mark.long
def test_a_driver_that_is_silent_lets_nobody_hang(ros):
    """It was told to be: longer than any silence that is a fault, everybody waits, and goes on in the same process afterwards."""
    tracks, lines = ros.collect(TrackArrayMsg, "tracks", qos.RESULT), []
    client = ros.node.create_client(ChangeState, "driver/change_state")
    with supervised(lines) as supervisor:
        assert ros.spin_until(lambda: supervisor.poll() == [] and len(tracks) > 10, 60.0), lines
        for number, seconds in ((Transition.TRANSITION_DEACTIVATE, 15.0), (Transition.TRANSITION_ACTIVATE, 0.0)):
            done = client.call_async(ChangeState.Request(transition=Transition(id=number)))
            assert ros.spin_until(done.done, 10.0)
            assert not ros.spin_until(lambda: supervisor.poll() != [], seconds)
        count = len(tracks)
        assert ros.spin_until(lambda: supervisor.poll() == [] and len(tracks) > count + 10, 60.0), lines
    assert supervisor.hangs == [], lines


@pytest.mark.long
@pytest.mark.parametrize("way", [[], ["--composed"]])
def test_ctrl_z_stops_all_nodes_and_fg_continues_them(ros, way):
    """Nodes are in sessions of their own; up stops and continues them with itself, says so, and takes nobody for hanging."""
    tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
    command = [sys.executable, "-m", "radar_app", "up", "--scene", "single_target", "--param", "driver.at_end=loop", "--respawn", *way]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert ros.spin_until(lambda: len(tracks) > 10, 60.0)
        family = [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]
        process.send_signal(signal.SIGTSTP)
        assert wait_for(lambda: in_state(family, wanted=True), 10.0)
        ros.spin_until(lambda: False, 4.0)
        process.send_signal(signal.SIGCONT)
        assert wait_for(lambda: in_state(family, wanted=False), 10.0)
        count = len(tracks)
        assert ros.spin_until(lambda: len(tracks) > count + 10, 30.0)
        ros.spin_until(lambda: False, 3.0)
    finally:
        process.send_signal(signal.SIGCONT)
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=20.0)
    assert process.returncode == 0, output
    assert "stopped by Ctrl-Z" in output
    assert "everything goes on" in output
    assert "hangs" not in output, output


def test_a_sign_of_life_that_finds_no_room_is_sent_again():
    """The socket holds ten: with more nodes than that, whoever finds it full must not wait for its next turn, or it seems to hang."""
    watchdog = Watchdog()
    code = "import os, time\nfrom radar_ros import heartbeat\nn = 0\nwhile heartbeat.notify('STATUS=x') and n < 5000: n += 1\n"
    code += "heartbeat.beat(); print('full', heartbeat._Line.beaten < 0, flush=True); input()\n"
    code += "heartbeat.beat(); print('sent', flush=True); input()"
    child = subprocess.Popen(
        [sys.executable, "-c", code], env={**os.environ, **watchdog.variables}, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with child:
        assert child.stdout.readline() == "full True\n"
        watchdog.look({child.pid: "one"})
        assert not watchdog.alive(child.pid)
        child.stdin.write("\n")
        child.stdin.flush()
        assert child.stdout.readline() == "sent\n"
        watchdog.look({child.pid: "one"})
        assert watchdog.alive(child.pid)
        child.communicate("\n")
    watchdog.close()


@pytest.mark.long
def test_who_is_only_late_does_not_hang():
    """A process that still comes to its turn now and then on a machine with too much to do; one that waits for ever does."""
    watchdog = Watchdog()
    late = "end = time.monotonic() + 30\nwhile time.monotonic() < end: time.sleep(0.2)"
    environment = {**os.environ, **watchdog.variables}
    children = {
        name: subprocess.Popen([sys.executable, "-c", BEGIN + code], env=environment, stdout=subprocess.PIPE)
        for name, code in (("late", late), ("deadlock", ENDS["deadlock"]))
    }
    names, found = {child.pid: name for name, child in children.items()}, {}
    try:
        watchdog.look(names)
        assert all(child.stdout.readline() == b"begun\n" for child in children.values())
        end = time.monotonic() + 8.0
        while time.monotonic() < end:
            time.sleep(0.2)
            found |= {names[pid]: why for pid, why in watchdog.look(names)[0]}
        assert found.keys() == {"deadlock"}
    finally:
        for child in children.values():
            child.kill()
            child.communicate()
        watchdog.close()
