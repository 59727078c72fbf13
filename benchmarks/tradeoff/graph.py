"""The running graph: every node a process of its own, or all in one, beside the library without a graph; latency and lost frames."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import Final

from benchmarks.tradeoff.rows import Found, Panel, of_share
from benchmarks.tradeoff.settings import Settings
from radar_app.graph import NodeSpec, graph
from radar_app.supervisor import Supervisor, environment, refuse_busy_domain
from radar_core import HandwaveError
from radar_lab.pipeline import Pipeline
from radar_sim import Simulator, load_scene

PANEL = Panel("processes", "frames that gave tracks", "", "higher", "each node a process", "the library on the same frames, no graph")
_SETTLE: Final = 2.0  # s: start-up and discovery are not measured
_START: Final = 40.0  # s: for the first tracks to come; a cold disk is slow
_SCENE: Final = "demo"
_CODE: Final = (
    "import sys; from benchmarks.tradeoff.graph import nodes; from radar_app.supervisor import run_composed; "
    "sys.exit(run_composed(nodes(sys.argv[1])))"
)


@dataclass(frozen=True)
class Heard:
    """What a graph did: latency from a frame's publication to its tracks' arrival [ms], frames due, and the share that gave tracks."""

    latencies_ms: list[float]
    due: int
    share: float


def nodes(scene: str) -> tuple[NodeSpec, ...]:
    """List the nodes that are measured: the live graph without pictures, its scene again and again."""
    return graph("live", parameters={"driver": {"scene": scene, "at_end": "loop"}}, without=("visualisation",))


def listen(seconds: float) -> Heard:
    """Listen to a running graph.

    Raises
    ------
    HandwaveError
        When no tracks come.
    """
    from radar_app.live import Monitor
    from radar_ros.interrupts import ros

    with ros():
        monitor = Monitor()
        try:
            end = time.monotonic() + _START
            while not monitor.latencies and time.monotonic() < end:
                monitor.spin(0.1)
            if not monitor.latencies:
                raise HandwaveError(f"the graph gave no tracks within {_START:g} s; look at its nodes: handwave up --scene {_SCENE}")
            monitor.spin(_SETTLE)
            first_frame, first_track = monitor.frames + monitor.skipped, monitor.received
            monitor.latencies.clear()
            monitor.spin(seconds)
            due = monitor.frames + monitor.skipped - first_frame
            received = min(monitor.received - first_track + 1, due)  # a frame on its way at either end of the window is not lost
            return Heard([1e3 * value for value in monitor.latencies], due, received / max(due, 1))
        finally:
            monitor.close()


def separate(scene: str, seconds: float, domain: int | None) -> Heard:
    """Run every node as a process of its own."""
    with Supervisor(nodes(scene), domain=domain, log=lambda name, line: None):
        return listen(seconds)


def composed(scene: str, seconds: float, domain: int | None) -> Heard:
    """Run all nodes in one process."""
    command = [sys.executable, "-c", _CODE, scene]
    process = subprocess.Popen(command, env=environment(domain), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        return listen(seconds)
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(3.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def library(settings: Settings) -> list[float]:
    """Time the library on frames of a scene, one after the other [ms]."""
    simulator, times = Simulator(load_scene(settings.scene or _SCENE)), []
    pipeline = Pipeline(simulator.info)
    for k in range(min(simulator.n_frames, settings.pick(250, 1000))):
        made = simulator.process(k)
        start = time.perf_counter_ns()
        pipeline.process(made.frame)
        times.append((time.perf_counter_ns() - start) * 1e-6)
    return times


def measure(settings: Settings) -> Found:
    """Compare processes, one process, and no graph at all; the graphs run at the scene's frame rate over real DDS."""
    scene, seconds = settings.scene or _SCENE, settings.pick(5.0, 25.0)
    found, reference = Found(), library(settings)
    found.rows.append(PANEL.row("library, no graph", 1.0, reference, reference, margin=of_share(1.0, len(reference))))
    os.environ.update(environment(settings.domain))
    refuse_busy_domain([spec.label for spec in nodes(scene)], "", settings.domain)
    for name, run in (("each node a process", separate), ("all nodes in one process", composed)):
        try:
            heard = run(scene, seconds, settings.domain)
        except HandwaveError as error:
            found.leave_out(PANEL.name, name, str(error))
            continue
        found.rows.append(PANEL.row(name, heard.share, heard.latencies_ms, reference, margin=of_share(heard.share, max(heard.due, 1))))
    return found
