"""Nodes that die, hang, fail or get too little of something, and what is between them: links that lose, stop or do not fit."""

from __future__ import annotations

import contextlib
import os
import signal
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import handwave.msg
import psutil
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from benchmarks.faults_graph import Running, watched
from benchmarks.faults_rows import MOST, Fault, Seen
from radar_ros import bags
from radar_ros.salvage import salvage

_NODES: Final = ("driver", "baseband", "tracking", "gestures", "hand", "zones", "patient")
_PAUSE: Final = 3.5  # s without data: longer than `stale_after`


def _signal(name: str, number: signal.Signals) -> Callable[[Running], Seen]:
    return watched(lambda running: os.kill(running.pid(name), number), dies=name)


def _ill(what: str, dies: str = "") -> Callable[[Running], Seen]:
    """Tell the patient to fall ill."""

    def inject(running: Running) -> None:
        with running.peer("illness", String) as publisher:
            publisher.publish(String(data=what))

    return watched(inject, dies=dies)


def _again_and_again(running: Running) -> None:
    """Kill a node as soon as it has begun, four times."""
    for _ in range(4):
        running.live(30.0, lambda: "patient" in running.supervisor.running)
        old = running.pid("patient")
        os.kill(old, signal.SIGKILL)
        running.live(30.0, lambda old=old: running.pids().get("patient", old) != old)  # type: ignore[misc]


def _two(running: Running) -> None:
    """Kill two nodes of which one feeds the other at the same time."""
    for name in ("baseband", "hand"):
        os.kill(running.pid(name), signal.SIGKILL)
    running.live(0.5)


def _stopped_and_killed(running: Running) -> None:
    """Let a reader of frames stand still for a moment and kill it, four times: it came back and heard nothing once in ten times."""
    for _ in range(4):
        os.kill(running.pid("baseband"), signal.SIGSTOP)
        running.live(0.3)
        os.kill(running.pid("baseband"), signal.SIGKILL)
        running.live(0.5)
        running.live(30.0, lambda: running.calm(time.monotonic() - 2.0))


def _limited(name: str, resource: int, value: Callable[[psutil.Process], int], seconds: float) -> Callable[[Running], Seen]:
    """Limit what a node may have, for a while."""

    def inject(running: Running) -> None:
        process = running.process(name)
        before = process.rlimit(resource)
        process.rlimit(resource, (value(process), before[1]))
        running.live(seconds, lambda: running.pids().get(name) != process.pid)
        if process.is_running():
            process.rlimit(resource, before)

    return watched(inject, dies=name)


def _no_memory(running: Running) -> None:
    """Let a node have no more memory than it has, and want a gigabyte."""
    process = running.process("patient")
    before = process.rlimit(psutil.RLIMIT_AS)
    process.rlimit(psutil.RLIMIT_AS, (process.memory_info().vms + (64 << 20), before[1]))
    with running.peer("illness", String) as publisher:
        publisher.publish(String(data="gigabyte"))
        running.live(1.0)
    process.rlimit(psutil.RLIMIT_AS, before)


def _slow(running: Running) -> None:
    """Let tracking have a third of a processor: stopped and continued by turns."""
    process = running.process("tracking")
    end = time.monotonic() + 4.0
    with contextlib.suppress(psutil.NoSuchProcess):
        while time.monotonic() < end:
            process.suspend()
            running.live(0.1)
            process.resume()
            running.live(0.05)


def _held(running: Running) -> tuple[Path, int]:
    """Find the recording that is being written, and count the messages that are in its file by now."""
    open_ones = [one for one in running.folder.glob("recorded*") if bags.was_cut_off(one)]
    path = max(open_ones, key=lambda one: next(one.glob("*.mcap")).stat().st_mtime)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "copy.mcap"
        file.write_bytes(next(path.glob("*.mcap")).read_bytes())
        return path, sum(1 for _ in salvage(file))


def _recorder_killed(running: Running) -> Seen:
    """Kill the recorder, and read afterwards what it had brought to the file."""
    path, held = _held(running)
    seen = running.seen(lambda one: os.kill(one.pid("recorder"), signal.SIGKILL), dies="recorder")
    seen.lost = max(held - sum(bags.repair(path).values()), 0)
    return seen


def _disk_full(running: Running) -> Seen:
    """Let the disk be full for the recorder (a limit of size) for a while: it has to go on when there is room."""
    path, held = _held(running)
    process = running.process("recorder")
    before = process.rlimit(psutil.RLIMIT_FSIZE)

    def inject(one: Running) -> None:
        process.rlimit(psutil.RLIMIT_FSIZE, (sum(file.stat().st_size for file in path.glob("*.mcap")), before[1]))
        one.live(2.0)
        process.rlimit(psutil.RLIMIT_FSIZE, before)

    seen = running.seen(inject)
    began = time.monotonic()
    running.live(20.0, lambda: _held(running)[0] != path)
    again, _ = _held(running)
    seen.recover_s = max(seen.recover_s, time.monotonic() - began)
    seen.lost = max(held - sum(bags.repair(path).values()), 0)
    if again == path:
        seen.survived, seen.note = False, "the recorder did not go on"
    return seen


def _silent(running: Running) -> None:
    """Deactivate the driver, and activate it again."""
    client = running.ear.node.create_client(ChangeState, "driver/change_state")
    running.live(10.0, client.service_is_ready)
    for number, seconds in ((Transition.TRANSITION_DEACTIVATE, _PAUSE), (Transition.TRANSITION_ACTIVATE, 0.2)):
        future = client.call_async(ChangeState.Request(transition=Transition(id=number)))
        running.live(10.0, future.done)
        running.live(seconds)
    running.ear.node.destroy_client(client)


def _unsuitable(running: Running) -> None:
    """Read tracks with a quality of service that they are not offered with."""
    profile = QoSProfile(depth=5, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    reader = running.ear.node.create_subscription(handwave.msg.TrackArray, "tracks", lambda msg: None, profile)
    running.live(2.0)
    running.ear.node.destroy_subscription(reader)


def _many_readers(running: Running) -> list[str]:
    """Let fifty readers come and go at once; gives what the diagnostics of descriptors say."""
    before = running.process("tracking").num_fds()
    for _ in range(3):
        readers = [running.ear.node.create_subscription(handwave.msg.TrackArray, "tracks", lambda msg: None, 10) for _ in range(16)]
        running.live(0.5)
        for reader in readers:
            running.ear.node.destroy_subscription(reader)
    running.live(1.0)
    return [f"descriptors of tracking: {running.process('tracking').num_fds() - before} more than before"]


NODES: Final = (
    *(
        Fault(f"{name} is killed", "SIGKILL", f"{name}: ended with status -9", _signal(name, signal.SIGKILL), quick=name == "zones")
        for name in _NODES
    ),
    *(
        Fault(f"{name} is stopped", "SIGSTOP", f"{name}: hangs: .*a signal has stopped it", _signal(name, signal.SIGSTOP))
        for name in ("driver", "baseband", "hand")
    ),
    Fault("a node that deadlocks", "real lock", "patient: hangs: .*a deadlock", _ill("deadlock", "patient")),
    Fault("a node in a loop without an end", "real loop", "patient: hangs: .*an endless loop", _ill("loop", "patient")),
    Fault("a node that hears nothing any more", "real subscription", "patient: hangs: it has heard nothing", _ill("deaf", "patient")),
    Fault("a callback that fails", "real exception", "illness: cannot be used .KeyError", _ill("fails"), quick=True),
    Fault("a callback that wants too much memory", "real allocation", "illness: cannot be used .MemoryError", _ill("memory")),
    Fault("a node that crashes", "SIGSEGV", "patient: ended with status -11", _ill("crash", "patient")),
    Fault("a node that ends with a status of its own", "real exit", "patient: ended with status 7", _ill("exit", "patient")),
    Fault(
        "a node that dies as soon as it has begun",
        "SIGKILL",
        "patient: ended with status -9; starting it again in",
        watched(_again_and_again, dies="patient"),
    ),
    Fault("two nodes are killed at once", "SIGKILL", "baseband: ended with status -9", watched(_two, dies="baseband hand")),
    Fault(
        "a reader of frames stands still and is killed, four times",
        "SIGSTOP, SIGKILL",
        "baseband: ended with status -9",
        watched(_stopped_and_killed, dies="baseband"),
        most=2 * MOST,
    ),
    Fault("the recorder is killed", "SIGKILL", "recorder: ended with status -9", _recorder_killed),
    Fault("the disk is full for the recorder", "RLIMIT_FSIZE", "the recording ended", _disk_full),
    Fault("a node that may have no more memory", "RLIMIT_AS", "illness: cannot be used .MemoryError", watched(_no_memory)),
    Fault(
        "hand has used its time of a processor",
        "RLIMIT_CPU",
        "hand: ended with status -24",
        _limited("hand", psutil.RLIMIT_CPU, lambda p: max(int(sum(p.cpu_times()[:2])), 1), 20.0),
    ),
    Fault("tracking gets a third of a processor", "SIGSTOP and SIGCONT by turns", "tracking: processing.* dropped", watched(_slow)),
)
TRANSPORT: Final = (
    Fault("the driver is silent for 3.5 s", "real lifecycle service", r"nothing has come for .* \(stale\)", watched(_silent), 6),
    Fault("a reader whose quality of service does not fit", "real reader", "incompatible QoS", watched(_unsuitable)),
    Fault("readers that come and go", "real readers", "descriptors of tracking: [0-3] more", watched(_many_readers)),
)
