"""The running graph beside bare references of the same run: processor time over the library's, latency over that of one bare hop.

The whole demo graph (recorder, evaluation and visualisation too), its scene again and again; the live graph alone, beside a busy core, and
with two radars.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.graph_runs import SETTLE, START, Load, composed, separate
from radar_app.graph import NodeSpec, graph
from radar_app.supervisor import environment
from radar_core import HandwaveError
from radar_lab.pipeline import Pipeline
from radar_sim import Simulator, load_scene

SCENE: Final = "demo"
_TURNS: Final = 3
_HOP: Final = """
import array, sys, time
import rclpy
from handwave.msg import RadarFrame
from radar_ros import qos
role, size, interval, seconds = sys.argv[1], int(sys.argv[2]), float(sys.argv[3]), float(sys.argv[4])
rclpy.init()
node = rclpy.create_node("hop_" + role)
if role == "out":
    publisher = node.create_publisher(RadarFrame, "hop", qos.stream_out())
    message = RadarFrame()
    message.data = array.array("f", bytes(size))
    def send():
        now = time.monotonic_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 1_000_000_000)
        publisher.publish(message)
    node.create_timer(interval, send)
else:
    late = []
    def take(message):
        sent = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        late.append((time.monotonic_ns() - sent) * 1e-6)
    node.create_subscription(RadarFrame, "hop", take, qos.sensor(depth=1))
end = time.monotonic() + seconds
while time.monotonic() < end:
    rclpy.spin_once(node, timeout_sec=0.1)
if role == "in":
    print(*late)
"""


def demo_nodes(folder: Path) -> tuple[NodeSpec, ...]:
    """List all nodes of the demo, with the scene again and again; recordings and reports go to ``folder``."""
    driver = {"scene": SCENE, "at_end": "loop"}
    own = {"driver": driver, "recorder": {"bag": str(folder / "bag")}, "evaluation": {"report": str(folder / "report.json")}}
    return graph("demo", parameters=own)


@contextlib.contextmanager
def busy_core() -> Iterator[None]:
    """Keep one core busy beside what is measured."""
    process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def hop(seconds: float, domain: int, size: int | None = None) -> list[float]:
    """Time one hop between two bare nodes at the frame rate, with messages of so many bytes; None: of a frame's size [ms]."""
    info = Simulator(load_scene(SCENE)).info
    size = 8 * int(np.prod(info.cube_shape)) if size is None else size
    words = [str(size), str(info.waveform.frame_interval), str(seconds + SETTLE)]
    env = environment(domain)
    reader = subprocess.Popen([sys.executable, "-c", _HOP, "in", *words], env=env, stdout=subprocess.PIPE, text=True)
    writer = subprocess.Popen([sys.executable, "-c", _HOP, "out", *words], env=env)
    try:
        told, _ = reader.communicate(timeout=seconds + START)
    finally:
        for process in (reader, writer):
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGKILL)
            process.wait()
    late = [float(value) for value in told.split()]
    if len(late) < 20:
        raise HandwaveError(f"two bare nodes passed {len(late)} messages in {seconds:g} s: is this machine too busy?")
    return late[len(late) // 10 :]  # discovery and first messages are slower


def library_cores(n_frames: int | None = None) -> float:
    """Give the processors that one thread of the library would keep busy, simulating and processing the scene at its frame rate."""
    simulator = Simulator(load_scene(SCENE))
    pipeline, n = Pipeline(simulator.info), min(simulator.n_frames, n_frames or simulator.n_frames)
    for k in range(5):  # what is compiled or planned at first is not measured
        pipeline.process(simulator.process(k).frame)
    pipeline, started = Pipeline(simulator.info), time.thread_time()
    for k in range(n):
        pipeline.process(simulator.process(k).frame)
    return (time.thread_time() - started) / (n * simulator.info.waveform.frame_interval)


@dataclass(frozen=True)
class Turn:
    """The demo graph, both ways, with bare references before and after it: the speed of a shared machine changes within a minute."""

    library: float  # processors that the library alone keeps busy
    hops: Sequence[float]  # one bare hop of a frame [ms]
    demo: Load
    composed: Load

    def ratios(self) -> dict[str, float]:
        """Give the graph's figures over those of the references."""
        return {
            "cpu_over_library": self.demo.cores / self.library,
            "composed_cpu_over_library": self.composed.cores / self.library,
            "latency_p99_over_hop": float(np.percentile(self.demo.latencies_ms, 99) / np.percentile(self.hops, 99)),
        }


def turn(folder: Path, seconds: float, n_frames: int | None, domain: int) -> Turn:
    """Measure the demo graph once, and the references before, between and after."""
    library, hops, found = [library_cores(n_frames)], hop(min(seconds, 10.0), domain), []
    for name, run_graph in (("demo", separate), ("composed", composed)):
        (folder / name).mkdir(parents=True)
        found.append(run_graph(demo_nodes(folder / name), seconds, domain))
        hops += hop(min(seconds, 10.0), domain) if name == "demo" else []
        library.append(library_cores(n_frames))
    return Turn(float(np.mean(library)), hops, *found)


def pooled(loads: Sequence[Load]) -> Load:
    """Put several windows of one graph together."""
    cpu: Counter[str] = Counter()
    for load in loads:
        cpu.update(load.cpu)
    late = [value for load in loads for value in load.latencies_ms]
    return Load(late, sum(load.due for load in loads), sum(load.lost for load in loads), sum(load.seconds for load in loads), cpu)


def measure(quick: bool, domain: int) -> dict[str, Any]:
    """Measure everything, one after the other; each window is one turn of the scene."""
    os.environ.update(environment(domain))
    seconds, n_frames, turns = (4.0, 100, 1) if quick else (load_scene(SCENE).duration, None, _TURNS)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        made = [turn(Path(name) / str(number), seconds, n_frames, domain) for number in range(turns)]
    found: dict[str, Load] = {}
    if not quick:
        live = graph("live", parameters={"driver": {"scene": SCENE, "at_end": "loop"}})
        with busy_core():
            found["busy"] = separate(live, seconds, domain)
        two = graph("two_radars", parameters={f"{side}/driver": {"at_end": "loop"} for side in ("left", "right")})
        found["two_radars"] = separate(two, seconds, domain, "left/driver")
    return figures(made, found)


def figures(turns: Sequence[Turn], found: Mapping[str, Load]) -> dict[str, Any]:
    """Put the figures together: ratios are medians over turns, each of which has references of its own; all turns stand beside."""
    hops = [value for turn in turns for value in turn.hops]
    result: dict[str, Any] = {
        "library_cores": float(np.mean([turn.library for turn in turns])),
        "hop_ms_median": float(np.median(hops)),
        "hop_ms_p99": float(np.percentile(hops, 99)),
    }
    demo = {"demo": pooled([turn.demo for turn in turns]), "demo_composed": pooled([turn.composed for turn in turns])}
    for name, load in (demo | dict(found)).items():
        result[f"{name}_cores"] = load.cores
        result[f"{name}_cores_by_node"] = {node: round(used / load.seconds, 3) for node, used in load.cpu.items()}
        result[f"{name}_dropped_fraction"] = load.dropped
        result[f"{name}_frames"] = load.due
        if load.latencies_ms:
            result[f"{name}_latency_ms_median"], result[f"{name}_latency_ms_p99"] = map(float, np.percentile(load.latencies_ms, (50, 99)))
    ratios = [turn.ratios() for turn in turns]
    for name in ratios[0]:
        values = [one[name] for one in ratios]
        result |= {name: float(np.median(values)), f"{name}_by_turn": values}
    if "two_radars" in found:
        result["two_radars_dropped"] = found["two_radars"].dropped
    return result
