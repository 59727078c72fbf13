"""The running graph: latency from a frame's publication to its tracks' arrival, drops, processor time; separate processes and composed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from typing import Any

import numpy as np

from benchmarks.report import choice
from radar_app.graph import graph
from radar_app.supervisor import Supervisor, environment

_SETTLE = 3.0  # s: start-up and discovery are not measured
_DOMAIN = 150 + os.getpid() % 80  # a domain of its own: stale readers of another run distort measurements


def run(quick: bool) -> dict[str, Any]:
    """Measure the separate and the composed graph on the demo scene at 50 Hz, over real DDS."""
    seconds = 6.0 if quick else 25.0
    os.environ.update(environment(_DOMAIN))
    separate = _separate(seconds)
    composed = _composed(seconds)
    result: dict[str, Any] = {"frame_rate_hz": 50, "seconds": seconds}
    for name in ("latency_ms_median", "latency_ms_p99", "dropped_fraction", "frames"):
        result[name] = separate[name]
        result[f"composed_{name}"] = composed[name]
    result["cpu_percent"] = separate["cpu_percent"]
    result["composed_cpu_percent"] = composed["cpu_percent"]
    result["choices"] = [
        choice(
            "graph",
            name,
            accuracy=("dropped_fraction", run["dropped_fraction"], "frames"),
            times_ms=run["latencies_ms"],
            reference_ms=reference,
        )
        for name, run, reference in (
            ("each node a process", separate, None),
            ("composed into one process", composed, separate["latencies_ms"]),
        )
    ]
    return result


def _specs() -> Any:
    return graph("live", parameters={"driver": {"scene": "demo", "at_end": "loop"}}, without=("visualisation",))


def _listen(seconds: float, cpu: Any) -> dict[str, Any]:
    """Listen to a running graph and return its figures."""
    import rclpy

    from radar_app.live import Monitor

    rclpy.init(args=[])
    monitor = Monitor()
    try:
        end = time.monotonic() + 40.0
        while not monitor.latencies and time.monotonic() < end:
            monitor.spin(0.1)
        if not monitor.latencies:
            raise RuntimeError("the graph gave no tracks within 40 s")
        monitor.spin(_SETTLE)
        before, first_frame, first_track = cpu(), monitor.frames + monitor.skipped, monitor.received
        monitor.latencies.clear()
        start = time.monotonic()
        monitor.spin(seconds)
        wall, after = time.monotonic() - start, cpu()
        due = monitor.frames + monitor.skipped - first_frame
        received = monitor.received - first_track
        latencies = np.array(monitor.latencies) * 1e3
    finally:
        monitor.close()
        rclpy.try_shutdown()
    return {
        "latencies_ms": latencies.tolist(),
        "latency_ms_median": float(np.median(latencies)),
        "latency_ms_p99": float(np.percentile(latencies, 99)),
        "frames": due,
        # A frame on its way at either end of the window is no drop.
        "dropped_fraction": max(0, due - received - 1) / due,
        "cpu_percent": {name: round(100 * (used - before.get(name, 0.0)) / wall, 1) for name, used in after.items()},
    }


def _separate(seconds: float) -> dict[str, Any]:
    with Supervisor(_specs(), domain=_DOMAIN, log=lambda name, line: None) as supervisor:
        return _listen(seconds, supervisor.cpu_seconds)


def _composed(seconds: float) -> dict[str, Any]:
    import psutil

    code = (
        "import sys; from benchmarks.graph import _specs; from radar_app.supervisor import run_composed; sys.exit(run_composed(_specs()))"
    )
    process = subprocess.Popen([sys.executable, "-c", code], env=environment(_DOMAIN), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def cpu() -> dict[str, float]:
        times = psutil.Process(process.pid).cpu_times()
        return {"composed": times.user + times.system}

    try:
        return _listen(seconds, cpu)
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(3.0)
        except subprocess.TimeoutExpired:
            process.kill()
