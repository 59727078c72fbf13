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
from collections.abc import Iterator, Mapping, Sequence
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


def measure(quick: bool, domain: int) -> dict[str, Any]:
    """Measure everything, one after the other; each window is one turn of the scene."""
    os.environ.update(environment(domain))
    scene = load_scene(SCENE)
    seconds = 4.0 if quick else scene.duration
    library = library_cores(100 if quick else None)
    hops = hop(min(seconds, 15.0), domain)
    live = graph("live", parameters={"driver": {"scene": SCENE, "at_end": "loop"}})
    two = graph("two_radars", parameters={f"{side}/driver": {"at_end": "loop"} for side in ("left", "right")})
    found: dict[str, Load] = {}
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        for prefix, run_graph in (("demo", separate), ("demo_composed", composed)):
            folder = Path(name) / prefix
            folder.mkdir()
            found[prefix] = run_graph(demo_nodes(folder), seconds, domain)
    if not quick:
        with busy_core():
            found["busy"] = separate(live, seconds, domain)
        found["two_radars"] = separate(two, seconds, domain, "left/driver")
    hops += hop(min(seconds, 15.0), domain)
    return figures(library, hops, found)


def figures(library: float, hops: Sequence[float], found: Mapping[str, Load]) -> dict[str, Any]:
    """Put the figures together."""
    result: dict[str, Any] = {
        "library_cores": library,
        "hop_ms_median": float(np.median(hops)),
        "hop_ms_p99": float(np.percentile(hops, 99)),
    }
    for name, load in found.items():
        result[f"{name}_cores"] = load.cores
        result[f"{name}_cores_by_node"] = {node: round(used / load.seconds, 3) for node, used in load.cpu.items()}
        result[f"{name}_dropped_fraction"] = load.dropped
        result[f"{name}_frames"] = load.due
        if load.latencies_ms:
            result[f"{name}_latency_ms_median"], result[f"{name}_latency_ms_p99"] = map(float, np.percentile(load.latencies_ms, (50, 99)))
    demo = found["demo"]
    result |= {
        "cpu_over_library": demo.cores / library,
        "composed_cpu_over_library": found["demo_composed"].cores / library,
        "latency_p99_over_hop": result["demo_latency_ms_p99"] / result["hop_ms_p99"],
    }
    if "two_radars" in found:
        result["two_radars_dropped"] = found["two_radars"].dropped
    return result
