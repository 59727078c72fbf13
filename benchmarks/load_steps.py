"""The demo graph while load beside it goes up and down in steps: latency, processor time and lost frames every half second.

The load is busy loops, each a process that wants a whole processor. All nodes of the demo run (recorder, evaluation and visualisation too),
each in a process of its own. What else the machine does meanwhile is measured and reported, not prevented.
"""

from __future__ import annotations

import contextlib
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import psutil
from numpy.typing import ArrayLike, NDArray

from benchmarks.graph import DOMAIN
from benchmarks.graph_load import SCENE, demo_nodes
from benchmarks.graph_runs import counts, settle
from radar_app.live import Monitor
from radar_app.supervisor import Supervisor, environment, refuse_busy_domain
from radar_ros.interrupts import ros

STEPS: Final = (0, 1, 2, 0)
"""Busy loops beside the graph, one step after the other."""
TICK: Final = 0.5
"""From one reading to the next [s], each at the driver's next report."""
_SECONDS: Final = (2.0, 20.0)  # of one step: quick, and for the figure
_MOMENT: Final = 1.0  # s: some reports of the driver
_LOOP: Final = "while True: pass"


@dataclass(frozen=True)
class Reading:
    """What was read at one moment: counts and processor times are sums since the start, latencies are those since the last reading."""

    at: float  # s, on CLOCK_MONOTONIC
    due: int  # frames that the driver was to give
    received: int  # frames that tracks came of
    graph_s: float  # processor time of all nodes
    loops_s: float  # of the busy loops
    machine_s: float  # of everything on the machine
    latencies_ms: tuple[float, ...]  # from a frame's publication to the arrival of its tracks
    loops: int  # how many ran since the last reading


def lost(due: ArrayLike, received: ArrayLike) -> NDArray[np.int64]:
    """Count the frames that were lost between readings.

    Parameters
    ----------
    due, received : array_like of int, shape (n,)
        Sums at each reading: frames that were due, and frames that results came of.

    Returns
    -------
    ndarray of int, shape (n - 1,)
        A frame on its way at a reading is no lost one: its result counts, whenever it comes.
    """
    gap = np.asarray(due, np.int64) - np.asarray(received, np.int64)
    missing = np.minimum.accumulate(gap[::-1])[::-1]  # the least that the gap still becomes: the rest was on its way
    return np.diff(missing)


def series(readings: Sequence[Reading]) -> dict[str, list[Any]]:
    """Make columns of readings, one row for each time between two of them; a latency is None where no tracks came."""
    at = np.array([one.at for one in readings])
    took = np.diff(at)

    def cores(name: str) -> list[float]:
        return [round(float(value), 4) for value in np.diff([getattr(one, name) for one in readings]) / took]

    def each(summary: Callable[[Any], Any]) -> list[float | None]:
        return [round(float(summary(one.latencies_ms)), 3) if one.latencies_ms else None for one in readings[1:]]

    return {
        "time_s": [round(float(value), 3) for value in at[1:] - at[0]],
        "loops": [one.loops for one in readings[1:]],
        "latency_ms_median": each(np.median),
        "latency_ms_worst": each(np.max),
        "graph_cores": cores("graph_s"),
        "loops_cores": cores("loops_s"),
        "machine_cores": cores("machine_s"),
        "frames": [int(value) for value in np.diff([one.due for one in readings])],
        "lost": [int(value) for value in lost([one.due for one in readings], [one.received for one in readings])],
    }


def step_rows(readings: Sequence[Reading], first: Sequence[int]) -> list[dict[str, Any]]:
    """Sum each step up; ``first`` are the places of the readings that steps begin with, and of the last one."""
    gone, rows = lost([one.due for one in readings], [one.received for one in readings]), []
    for begin, end in pairwise(first):
        late = [value for one in readings[begin + 1 : end + 1] for value in one.latencies_ms]
        before, after = readings[begin], readings[end]
        seconds, due = after.at - before.at, after.due - before.due
        middle, high, worst = (float(value) for value in np.percentile(late, (50, 99, 100))) if late else (None, None, None)
        others = (after.machine_s - before.machine_s) - (after.graph_s - before.graph_s) - (after.loops_s - before.loops_s)
        rows.append(
            {
                "loops": after.loops,
                "seconds": seconds,
                "latency_ms_median": middle,
                "latency_ms_p99": high,
                "latency_ms_worst": worst,
                "graph_cores": (after.graph_s - before.graph_s) / seconds,
                "others_cores": max(others / seconds, 0.0),
                "frames": due,
                "dropped_fraction": int(gone[begin:end].sum()) / max(due, 1),
            }
        )
    return rows


def figures(readings: Sequence[Reading], first: Sequence[int]) -> dict[str, Any]:
    """Put the result together: flat keys ``step1_...``, a row for each step, and the columns over time."""
    rows = step_rows(readings, first)
    flat = {f"step{k}_{name}": value for k, row in enumerate(rows, 1) for name, value in row.items()}
    return {**flat, "steps": rows, "series": series(readings)}


class Loops:
    """Busy loops that come and go."""

    def __init__(self) -> None:
        self._running: list[subprocess.Popen[bytes]] = []
        self._spent = 0.0

    def set(self, count: int) -> None:
        """Let so many run."""
        while len(self._running) < count:
            self._running.append(subprocess.Popen([sys.executable, "-c", _LOOP]))
        while len(self._running) > count:
            process = self._running.pop()
            self._spent += _used(process.pid)
            process.kill()
            process.wait()

    @property
    def seconds(self) -> float:
        """Processor time of all so far [s]."""
        return self._spent + sum(_used(process.pid) for process in self._running)


def _used(pid: int) -> float:
    with contextlib.suppress(psutil.Error):
        times = psutil.Process(pid).cpu_times()
        return float(times.user + times.system)
    return 0.0


@contextlib.contextmanager
def busy_loops() -> Iterator[Loops]:
    """Give busy loops, none at first; none is left behind."""
    loops = Loops()
    try:
        yield loops
    finally:
        loops.set(0)


def machine_seconds() -> float:
    """Processor time that everything on this machine has used [s]; waiting for disks is not work, and time of guests counts once."""
    times = psutil.cpu_times()
    idle = times.idle + getattr(times, "iowait", 0.0)
    guests = getattr(times, "guest", 0.0) + getattr(times, "guest_nice", 0.0)  # part of user and nice
    return float(sum(times) - idle - guests)


def machine() -> dict[str, Any]:
    """Describe this machine: processor, how many, and how loaded it is before anything is started."""
    model = platform.processor() or platform.machine()
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), model)
    before, began = machine_seconds(), time.monotonic()
    time.sleep(2.0)
    used = (machine_seconds() - before) / (time.monotonic() - began)
    cores = psutil.cpu_count(logical=False) or psutil.cpu_count() or 1
    own = {"processor": model, "processors": psutil.cpu_count() or 1, "cores": cores, "python": platform.python_version()}
    own |= {"nice": os.nice(0)}  # of nodes and loops too, which have this process's priority
    return {**own, "load_average": list(os.getloadavg()), "used_before_cores": used}


def recorded(supervisor: Supervisor, monitor: Monitor, seconds: float) -> tuple[list[Reading], list[int]]:
    """Read a running graph while the load steps up and down; returns readings, and the places where steps begin and the last ends."""
    first, count = [0], 0
    with busy_loops() as loops:

        def read() -> Reading:
            due, received = counts(monitor)
            late, monitor.latencies[:] = tuple(1e3 * value for value in monitor.latencies), []
            used = sum(supervisor.cpu_seconds().values())
            return Reading(time.monotonic(), due, received, used, loops.seconds, machine_seconds(), late, count)

        read()
        readings = [read()]
        due = readings[0].at
        for count in STEPS:
            loops.set(count)
            for _ in range(max(round(seconds / TICK), 1)):
                due += TICK
                monitor.spin(due - time.monotonic())
                readings.append(read())
            first.append(len(readings) - 1)
    readings[-1] = _landed(monitor, readings[-1])
    return readings, first


def _landed(monitor: Monitor, last: Reading) -> Reading:
    """Count frames that were on their way at the last reading as received: by the least gap of a moment between two of them."""
    end, least = time.monotonic() + _MOMENT, last.due - last.received
    while time.monotonic() < end:
        due, received = counts(monitor)
        least = min(least, due - received)
    return replace(last, received=last.due - least)


def run(quick: bool) -> dict[str, Any]:
    """Run the demo graph, step the load up and down, and tell what became of it."""
    about = machine()
    os.environ.update(environment(DOMAIN))
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        specs = demo_nodes(Path(folder))
        refuse_busy_domain([spec.label for spec in specs], "", DOMAIN)
        with Supervisor(specs, domain=DOMAIN, log=lambda name, line: None) as supervisor, ros():
            monitor = Monitor()
            try:
                settle(monitor)
                found = recorded(supervisor, monitor, _SECONDS[not quick])
            finally:
                monitor.close()
    told: Mapping[str, Any] = {"scene": SCENE, "tick_s": TICK, "made": time.strftime("%Y-%m-%d"), "machine": about}
    return {**told, **figures(*found)}
