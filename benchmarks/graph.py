"""The running graph over real DDS: latency from frame to tracks, lost frames, processor time; beside the library without a graph."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import psutil

from benchmarks.report import Found, Panel, of_share, timed
from benchmarks.tradeoff.stages import StudyConfig
from radar_app.graph import NodeSpec, graph
from radar_app.live import Monitor
from radar_app.supervisor import Supervisor, environment, refuse_busy_domain
from radar_core import HandwaveError
from radar_lab.pipeline import Pipeline
from radar_ros.interrupts import ros
from radar_sim import Simulator, load_scene

DOMAIN: Final = 150 + os.getpid() % 80  # a ROS domain of its own: stale readers of another run distort measurements
PANEL = Panel("processes", "frames that gave tracks", "", "higher", "each node a process", "the library on the same frames, no graph")
SEPARATE, COMPOSED = "each node a process", "all nodes in one process"
_SETTLE: Final = 3.0  # s: start-up and discovery are not measured
_START: Final = 40.0  # s: for the first tracks to come; a cold disk is slow
_SCENE: Final = "demo"
_SECONDS: Final = (6.0, 25.0)
_CODE: Final = (
    "import sys; from benchmarks.graph import nodes; from radar_app.composed import run_composed; "
    "sys.exit(run_composed(nodes(sys.argv[1])))"
)


@dataclass(frozen=True)
class Heard:
    """What a graph did in some seconds."""

    latencies_ms: list[float]  # from a frame's publication to its tracks' arrival [ms]
    # due, lost: frames of the radar, and those of them that gave no tracks
    due: int
    lost: int
    cpu_percent: dict[str, float]  # of one core, by process


def nodes(scene: str) -> tuple[NodeSpec, ...]:
    """List the nodes that are measured: the live graph without pictures, its scene again and again."""
    return graph("live", parameters={"driver": {"scene": scene, "at_end": "loop"}}, without=("visualisation",))


def listen(seconds: float, cpu: Callable[[], dict[str, float]]) -> Heard:
    """Listen to a running graph; ``cpu`` says how many seconds each process has used. Raises HandwaveError when no tracks come."""
    with ros():
        monitor = Monitor()
        try:
            end = time.monotonic() + _START
            while not monitor.latencies and time.monotonic() < end:
                monitor.spin(0.1)
            if not monitor.latencies:
                raise HandwaveError(f"the graph gave no tracks within {_START:g} s; look at its nodes: handwave up --scene {_SCENE}")
            monitor.spin(_SETTLE)
            before, first_frame, first_track = cpu(), monitor.frames + monitor.skipped, monitor.received
            monitor.latencies.clear()
            start = time.monotonic()
            monitor.spin(seconds)
            wall, after = time.monotonic() - start, cpu()
            due, received = monitor.frames + monitor.skipped - first_frame, monitor.received - first_track
            used = {name: round(100 * (value - before.get(name, 0.0)) / wall, 1) for name, value in after.items()}
            # A frame on its way at either end of the window is not lost.
            return Heard([1e3 * value for value in monitor.latencies], due, max(0, due - received - 1), used)
        finally:
            monitor.close()


def separate(scene: str, seconds: float, domain: int | None) -> Heard:
    """Run every node as a process of its own."""
    with Supervisor(nodes(scene), domain=domain, log=lambda name, line: None) as supervisor:
        return listen(seconds, supervisor.cpu_seconds)


def composed(scene: str, seconds: float, domain: int | None) -> Heard:
    """Run all nodes in one process."""
    command = [sys.executable, "-c", _CODE, scene]
    process = subprocess.Popen(command, env=environment(domain), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def cpu() -> dict[str, float]:
        times = psutil.Process(process.pid).cpu_times()
        return {"composed": times.user + times.system}

    try:
        return listen(seconds, cpu)
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(3.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def library(study: StudyConfig) -> list[float]:
    """Time the library on frames of a scene, one after the other [ms]."""
    simulator = Simulator(load_scene(study.scene or _SCENE))
    pipeline, n = Pipeline(simulator.info), min(simulator.n_frames, study.pick(250, 1000))
    return [timed(pipeline.process, simulator.process(k).frame)[1] for k in range(n)]


def compare(study: StudyConfig) -> tuple[Found, dict[str, Heard]]:
    """Measure no graph, processes, and one process; the graphs run at the scene's frame rate. Also what was heard of each graph."""
    scene, found, reference = study.scene or _SCENE, Found(), library(study)
    found.rows.append(PANEL.row("library, no graph", 1.0, reference, reference, margin=of_share(1.0, len(reference))))
    os.environ.update(environment(study.domain))
    refuse_busy_domain([spec.label for spec in nodes(scene)], "", study.domain)
    graphs = {}
    for name, run_graph in ((SEPARATE, separate), (COMPOSED, composed)):
        try:
            heard = graphs[name] = run_graph(scene, study.pick(*_SECONDS), study.domain)
        except HandwaveError as error:
            found.leave_out(PANEL.name, name, str(error))
            continue
        due = max(heard.due, 1)
        share = 1.0 - heard.lost / due
        found.rows.append(PANEL.row(name, share, heard.latencies_ms, reference, margin=of_share(share, due)))
    return found, graphs


def measure(study: StudyConfig) -> Found:
    """Compare processes, one process, and no graph at all."""
    return compare(study)[0]


def run(quick: bool) -> dict[str, Any]:
    """Measure on the demo scene at 50 Hz."""
    study = StudyConfig(Path(), quick, domain=DOMAIN)
    found, graphs = compare(study)
    if found.left_out:
        raise HandwaveError("; ".join(one["why"] for one in found.left_out))
    result: dict[str, Any] = {"frame_rate_hz": 50, "seconds": study.pick(*_SECONDS)}
    for prefix, heard in (("", graphs[SEPARATE]), ("composed_", graphs[COMPOSED])):
        result |= {
            f"{prefix}latency_ms_median": float(np.median(heard.latencies_ms)),
            f"{prefix}latency_ms_p99": float(np.percentile(heard.latencies_ms, 99)),
            f"{prefix}dropped_fraction": heard.lost / heard.due,
            f"{prefix}frames": heard.due,
            f"{prefix}cpu_percent": heard.cpu_percent,
        }
    return {**result, "choices": found.rows}
