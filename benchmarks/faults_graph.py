"""One graph of real nodes over real DDS that many faults share, and what is heard of it meanwhile."""

from __future__ import annotations

import contextlib
import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import handwave.msg
import psutil
from diagnostic_msgs.msg import DiagnosticArray

from benchmarks.faults_rows import Fault, Seen
from radar_app.graph import NodeSpec, graph
from radar_app.supervisor import Supervisor, environment
from radar_app.watching.reports import reports_from_msg
from radar_core import HandwaveError
from radar_ros import qos
from radar_ros.interrupts import Visitor, ros

DOMAIN: Final = 150 + (os.getpid() + 20) % 80
STAGES: Final = ("driver", "baseband", "tracking", "gestures", "hand", "zones", "patient")
SCENE: Final = {"driver": {"scene": "single_target", "at_end": "loop"}}
_RECORDED: Final = ("radar/info", "radar/points", "tracks")  # without raw frames: gigabytes
_START: Final = 90.0  # s
_LONGEST: Final = 40.0  # s for everything to come back
_GAP: Final = 0.6  # s without a result of a stage are an interruption
_CALM: Final = 1.6  # s without an interruption, and everything is as before
_LISTEN: Final = 0.4  # s after the end: for lines that are on their way


class Ear(Visitor):
    """Hears when stages finish messages, what diagnostics say, and the last message of each topic that faults imitate."""

    def __init__(self) -> None:
        super().__init__("handwave_faults")
        self.finished: dict[str, list[float]] = defaultdict(list)  # on CLOCK_MONOTONIC [s]
        self.warnings: list[str] = []
        self.last: dict[str, Any] = {}
        self.node.create_subscription(handwave.msg.StageStatus, "stage_status", self._status, qos.sensor(depth=50))
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnose, 50)
        for topic, kind in TOPICS.items():
            qos.subscribe_latched(self.node, kind, topic, lambda msg, t=topic: self.last.__setitem__(t, msg), profile=qos.for_topic(topic))

    def _status(self, msg: Any) -> None:
        now = time.monotonic()
        self.finished[msg.stage] += [now - (msg.monotonic_ns - one.monotonic_ns) * 1e-9 for one in reports_from_msg(msg) if not one.stale]

    def _diagnose(self, msg: Any) -> None:
        for status in msg.status:
            text = f"{status.name}: {status.message}"
            if status.level > b"\0" and text not in self.warnings:
                self.warnings.append(text)

    def interrupted(self, since: float, now: float) -> float:
        """When the last interruption of any stage since then ended; ``now`` while one goes on, ``since`` when there was none."""
        ends = [since]
        for stage in STAGES:
            times = [t for t in self.finished[stage] if t > since - _GAP]
            for before, after in zip([since - 0.1, *times], [*times, now], strict=True):
                if after - max(before, since) > _GAP:
                    ends.append(after)
        return max(ends)

    def forget(self, before: float) -> None:
        """Let go of what is older."""
        for times in self.finished.values():
            times[:] = [t for t in times if t > before]


TOPICS: Final[dict[str, Any]] = {
    "radar/info": handwave.msg.RadarInfo,
    "radar/frame": handwave.msg.RadarFrame,
    "radar/points": handwave.msg.PointCloud,
    "tracks": handwave.msg.TrackArray,
    "zones": handwave.msg.ZoneArray,
    "gestures": handwave.msg.Gesture,
}


class Running:
    """The graph, and who listens to it."""

    def __init__(self, supervisor: Supervisor, ear: Ear, lines: list[str], folder: Path) -> None:
        self.supervisor, self.ear, self.lines, self.folder = supervisor, ear, lines, folder

    def live(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Let the graph live for so long, or until something is so; returns whether it is."""
        end = time.monotonic() + seconds
        while not until():
            if time.monotonic() > end:
                return False
            self.ear.spin(0.05)
            self.supervisor.poll()
        return True

    @contextlib.contextmanager
    def peer(self, topic: str, kind: Any = None) -> Iterator[Any]:
        """Publish on a topic for as long as the block lasts, once others have found this publisher."""
        profile = qos.offered(topic) if kind is None else qos.COMMAND
        publisher = self.ear.node.create_publisher(kind or TOPICS[topic], topic, profile)
        self.live(3.0, lambda: publisher.get_subscription_count() > 0)
        self.live(0.7)
        try:
            yield publisher
            self.live(0.3)
        finally:
            self.ear.node.destroy_publisher(publisher)

    def pid(self, name: str) -> int:
        """Process id of a node."""
        return self.supervisor.pid(name)

    def process(self, name: str) -> psutil.Process:
        """Process of a node."""
        return psutil.Process(self.pid(name))

    def pids(self) -> dict[str, int]:
        """Process ids of all nodes that live."""
        return {name: self.supervisor.pid(name) for name in self.supervisor.running}

    def calm(self, since: float) -> bool:
        """Whether all nodes are healthy and no stage has been interrupted for a moment."""
        now = time.monotonic()
        return self.supervisor.healthy and now - self.ear.interrupted(since, now) > _CALM

    def seen(self, inject: Callable[[Running], Any], *, dies: str = "") -> Seen:
        """Inject a fault and watch until everything is as before; ``dies`` names the nodes that may die of it, no other may."""
        self.ear.forget(time.monotonic() - 5.0)
        self.ear.warnings.clear()
        first, pids = len(self.lines), self.pids()
        said = inject(self) or []
        ended = time.monotonic()
        well = self.live(_LONGEST, lambda: self.calm(ended))
        recovered = self.ear.interrupted(ended, time.monotonic()) - ended
        self.live(_LISTEN)
        died = sorted(name for name, pid in pids.items() if self.pids().get(name) != pid and name not in dies.split())
        note = f"{', '.join(died)} died of it" if died else "" if well else f"not as before within {_LONGEST:g} s"
        return Seen(well and not died, [*said, *self.lines[first:], *self.ear.warnings], 0, recovered, note)


def watched(inject: Callable[[Running], Any], *, dies: str = "") -> Callable[[Running], Seen]:
    """Make of a function that injects something into a running graph one that tells what was seen."""
    return lambda running: running.seen(inject, dies=dies)


@contextlib.contextmanager
def running(folder: Path) -> Iterator[Running]:
    """Start the graph: a simulated radar, all stages, a recorder, and a node that falls ill when it is told to."""
    lines: list[str] = []
    os.environ.update(environment(DOMAIN))
    parameters = {**SCENE, "recorder": {"bag": str(folder / "recorded"), "topics": list(_RECORDED)}}
    found = graph("demo", without=("visualisation", "evaluation"), parameters=parameters)
    specs = (*found, NodeSpec("patient", "benchmarks.faults_node"))
    with Supervisor(specs, domain=DOMAIN, respawn=True, log=lambda name, line: lines.append(f"{name}: {line}")) as supervisor, ros():
        ear = Ear()
        try:
            one = Running(supervisor, ear, lines, folder)
            began = time.monotonic()
            if not one.live(_START, lambda: all(ear.finished[stage] for stage in STAGES) and one.calm(began)):
                raise HandwaveError(f"the graph did not start within {_START:g} s: " + "; ".join(lines[-5:]))
            yield one
        finally:
            ear.close()


def measured(faults: tuple[Fault, ...], folder: Path) -> Iterator[tuple[Fault, Seen]]:
    """Inject faults one after the other into one graph."""
    with running(folder) as one:
        for fault in faults:
            yield fault, fault.inject(one)
