"""Hours of a whole graph with everything that happens in hours: what it grows by, and whether it comes back by itself each time.

People come and go and gesture (the demo scene, again and again), frames are lost, sequences and stamps jump (`benchmarks.soak_relay`),
subscribers come and go, a real browser looks at the live page. In the first quarter, nodes are killed and stopped at random as well; in
the rest, processes live long enough for their growth to be measured, undisturbed: the page keeps the last minute, and with fewer messages
less of it. With ``--keep FOLDER`` hours that are done are not done again.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import random
import signal
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import handwave.msg
import numpy as np
import psutil

from benchmarks.browser import needs_browser, page, pictures
from radar_app.graph import NodeSpec, graph
from radar_app.supervisor import Supervisor, environment, refuse_busy_domain
from radar_core import HandwaveError
from radar_ros import qos
from radar_ros.interrupts import Visitor, ros

DOMAIN: Final = 150 + (os.getpid() + 40) % 80
_STAGES: Final = ("driver", "relay", "baseband", "tracking", "gestures", "hand", "zones")
_QUICK: Final = (28.0, 8.0)  # s with faults, and without
_FAULTS: Final = 0.25  # share of the time in which nodes are killed and stopped
_PAUSE: Final = (4.0, 25.0)  # s between the recovery from a fault and the next one, quick and not
_LONGEST: Final = 40.0  # s for everything to come back
_START: Final = 180.0  # s: a busy machine takes its time to start nodes and a browser
_SAMPLE: Final = (2.0, 10.0)  # s
_VISIT: Final = 3.0  # s: how long a subscriber stays
_SETTLED: Final = 600.0  # s: what a process grows by in its first ten minutes does not count
_REFILLED: Final = 60.0  # s: the page keeps the last minute, of which faults leave out a part
_LEAST: Final = 60  # samples for a slope
_SHOWN: Final = 300.0  # s between the memories that are told
_MEMORY: Final = Path("/dev/shm")


@dataclass
class Life:
    """What one process of a node was seen to hold, sample by sample."""

    name: str
    times: list[float] = field(default_factory=list)  # since it began [s]
    rss: list[float] = field(default_factory=list)  # MB
    files: list[int] = field(default_factory=list)
    threads: list[int] = field(default_factory=list)
    disturbed: int = 0  # samples that faults had to do with

    def growth(self) -> tuple[float, float] | None:
        """Slope of its memory and three standard errors of it [MB/h]; None: it did not live long enough."""
        times, rss = np.array(self.times), np.array(self.rss)
        late = (times >= _SETTLED) & (np.arange(len(times)) >= self.disturbed)
        if late.sum() < _LEAST:
            return None
        x, y = times[late] / 3600, rss[late]
        slope, offset = np.polyfit(x, y, 1)
        residual = y - slope * x - offset
        error = np.sqrt(residual @ residual / (len(x) - 2) / ((x - x.mean()) @ (x - x.mean())))
        return float(slope), float(3 * error)

    def drift(self, values: list[int]) -> int:
        """By how much a count rises from the first to the second half of a settled life, at the least: visitors come and go."""
        settled = [value for at, value in zip(self.times, values, strict=True) if at >= min(_SETTLED, 0.5 * self.times[-1])]
        half = len(settled) // 2
        return min(settled[half:]) - min(settled[:half]) if half else 0


class Ear(Visitor):
    """Hears which stages finish messages, and when they did last."""

    def __init__(self) -> None:
        super().__init__("handwave_soak")
        self.finished: dict[str, float] = {}  # on CLOCK_MONOTONIC [s]
        self.messages = 0
        for space in ("", "raw/"):
            self.node.create_subscription(handwave.msg.StageStatus, f"{space}stage_status", self._status, qos.sensor(depth=50))

    def _status(self, msg: Any) -> None:
        if not msg.stale and (msg.header.stamp.sec or msg.header.stamp.nanosec):
            self.finished[msg.stage] = time.monotonic()
            self.messages += 1

    def missing(self, since: float) -> list[str]:
        """Name the stages that have finished nothing since then."""
        return [stage for stage in _STAGES if self.finished.get(stage, 0.0) < since]


class Soak:
    """One run: a graph, who disturbs it, and what was seen."""

    def __init__(self, quick: bool, seed: int = 1) -> None:
        self.quick, self.random = quick, random.Random(seed)
        self.lives: dict[int, Life] = {}
        self.recoveries: list[float] = []
        self.unrecovered: list[str] = []
        self.faults: dict[str, int] = defaultdict(int)
        self.log_bytes = self.visits = self.pictures = 0
        self._segments: set[str] = set()
        self._sampled = self._visited = 0.0
        self._visitor: Visitor | None = None

    def log(self, name: str, line: str) -> None:
        """Count what the graph prints."""
        self.log_bytes += len(name) + len(line) + 2

    def specs(self) -> tuple[NodeSpec, ...]:
        """List the nodes: the demo's without recorder, and the relay; the driver speaks to nobody but the relay."""
        found = graph("live", without=("driver",))
        driver = graph("live", namespace="raw", parameters={"driver": {"scene": "demo", "at_end": "loop"}})[0]
        relay = NodeSpec("relay", "benchmarks.soak_relay", {"jump_every": 4.0 if self.quick else 15.0})
        return (driver, relay, *found)

    def live(self, supervisor: Supervisor, ear: Ear, pids: dict[str, int], until: Callable[[], bool]) -> None:
        """Let the graph live, take samples, and send visitors, until something is so."""
        while not until():
            ear.spin(0.2)
            supervisor.poll()
            now = time.monotonic()
            if now - self._sampled > _SAMPLE[not self.quick]:
                self._sampled = now
                self.sample({**{name: supervisor.pid(name) for name in supervisor.running}, **pids})
            if now - self._visited > _VISIT:
                self._visited = now
                self._visit()

    def _visit(self) -> None:
        """Let a subscriber of all results go that was there, or another one come."""
        if self._visitor is not None:
            self._visitor.close()
            self._visitor = None
            return
        self._visitor = Visitor(f"visitor_{self.visits}")
        self.visits += 1
        for topic, kind in (
            ("tracks", handwave.msg.TrackArray),
            ("radar/frame", handwave.msg.RadarFrame),
            ("gestures", handwave.msg.Gesture),
        ):
            self._visitor.node.create_subscription(kind, topic, lambda msg: None, qos.for_topic(topic))

    def sample(self, pids: dict[str, int]) -> None:
        """See what every process holds."""
        for name, pid in pids.items():
            with contextlib.suppress(psutil.Error, OSError):
                process = psutil.Process(pid)
                with process.oneshot():
                    life = self.lives.setdefault(pid, Life(name))
                    row = (time.time() - process.create_time(), process.memory_info().rss / 2**20, process.num_fds(), process.num_threads())
                for series, value in zip((life.times, life.rss, life.files, life.threads), row, strict=True):
                    series.append(value)  # type: ignore[arg-type]
        self._segments |= segments(pids.values())

    def disturb(self, supervisor: Supervisor, ear: Ear, pids: dict[str, int]) -> None:
        """Kill or stop a node, and see how long it takes until every stage has results again."""
        name = self.random.choice(sorted(supervisor.running))
        number = self.random.choice((signal.SIGKILL, signal.SIGSTOP))
        self.faults[f"{number.name} of {name}"] += 1
        began = time.monotonic()
        old = supervisor.pid(name)
        os.kill(old, number)

        def over() -> bool:
            ended = name not in supervisor.running or supervisor.pid(name) != old
            return (ended and supervisor.healthy and not ear.missing(began + 1.0)) or time.monotonic() - began > _LONGEST

        self.live(supervisor, ear, pids, over)
        missing = ear.missing(began + 1.0) + [one.label for one in supervisor.specs if one.label not in supervisor.running]
        if missing:
            self.unrecovered.append(f"{number.name} of {name}: after {_LONGEST:g} s nothing of {', '.join(missing)}")
        else:
            self.recoveries.append(time.monotonic() - began)

    def calm(self, pids: set[int]) -> None:
        """Keep the processes that live: nothing is killed from now on."""
        self.lives = {pid: life for pid, life in self.lives.items() if pid in pids}
        for life in self.lives.values():
            life.disturbed = len(life.times) + round(_REFILLED / _SAMPLE[not self.quick])

    def leaked(self) -> int:
        """How many shared segments of processes that have ended are there all the same."""
        return sum((_MEMORY / name).exists() for name in self._segments)


def segments(pids: Any) -> set[str]:
    """Shared memory that processes hold: the names of locks that are theirs."""
    wanted = {str(pid) for pid in pids}
    rows = [line.split() for line in Path("/proc/locks").read_text(encoding="utf-8").splitlines()]
    inodes = {row[5].rpartition(":")[2] for row in rows if len(row) > 5 and row[4] in wanted}
    found = set()
    for path in _MEMORY.glob("fast*_el"):
        with contextlib.suppress(OSError):
            if "port" not in path.name and str(path.stat().st_ino) in inodes:
                found.add(path.name.removesuffix("_el"))
    return found


def figures(soak: Soak, hours: float) -> dict[str, Any]:
    """Put together what was seen."""
    growth = {life.name: found for life in soak.lives.values() if (found := life.growth()) is not None}
    long = [life for life in soak.lives.values() if len(life.times) >= 3]
    return {
        "hours": hours,
        "rss_growth_mb_per_hour": max((slope for slope, _ in growth.values()), default=None),
        "rss_growth_by_node": {name: {"mb_per_hour": slope, "three_errors": error} for name, (slope, error) in sorted(growth.items())},
        "rss_mb": {life.name: round(life.rss[-1], 1) for life in long},
        "rss_mb_every_five_minutes": {life.name: [round(rss, 1) for rss in life.rss[:: round(_SHOWN / _SAMPLE[1])]] for life in long},
        "descriptors_drift": max((life.drift(life.files) for life in long), default=0),
        "threads_drift": max((life.drift(life.threads) for life in long), default=0),
        "segments_leaked": soak.leaked(),
        "faults": dict(soak.faults),
        "recovered": len(soak.recoveries),
        "recovery_s_median": float(np.median(soak.recoveries or [_LONGEST])),
        "recovery_s_worst": max(soak.recoveries, default=_LONGEST),
        "unrecovered": len(soak.unrecovered),
        "unrecovered_what": soak.unrecovered,
        "subscribers": soak.visits,
        "pictures": soak.pictures,
        "log_kb_per_hour": soak.log_bytes / 1024 / hours,
    }


def live_through(soak: Soak, hours: float, folder: Path) -> dict[str, Any]:
    """Run the graph for so long; raises HandwaveError when it does not start."""
    os.environ.update(environment(DOMAIN))
    specs = soak.specs()
    refuse_busy_domain([spec.path for spec in specs], "", DOMAIN)
    troubled, calm = _QUICK if soak.quick else (3600 * hours * _FAULTS, 3600 * hours * (1 - _FAULTS))
    with Supervisor(specs, domain=DOMAIN, respawn=True, log=soak.log) as supervisor, ros():
        ear = Ear()
        try:
            with page(folder) as (driver, (server, _)):
                pids = {"view": server}
                end = time.monotonic() + _START
                soak.live(supervisor, ear, pids, lambda: bool(not ear.missing(1.0) and pictures(driver)) or time.monotonic() > end)
                if missing := ear.missing(1.0):
                    raise HandwaveError(f"within {_START:g} s nothing came of {', '.join(missing)}; look at: handwave up")
                if not pictures(driver):
                    raise HandwaveError(f"within {_START:g} s the browser showed nothing; look at: handwave view, beside handwave up")
                began = time.monotonic()
                while time.monotonic() - began < troubled:
                    rest = time.monotonic() + _PAUSE[not soak.quick]
                    soak.live(supervisor, ear, pids, lambda rest=rest: time.monotonic() > rest)  # type: ignore[misc]
                    soak.disturb(supervisor, ear, pids)
                soak.calm({supervisor.pid(name) for name in supervisor.running} | {*pids.values()})
                end = time.monotonic() + calm
                soak.live(supervisor, ear, pids, lambda: time.monotonic() > end)
                lost = ear.missing(end - 5.0)
                if lost:
                    soak.unrecovered.append(f"in the end nothing of {', '.join(lost)}")
                hours = (time.monotonic() - began) / 3600
                soak.pictures = pictures(driver)
        finally:
            ear.close()
    return figures(soak, hours)


def together(parts: list[dict[str, Any]]) -> dict[str, Any]:
    """Combine the figures of several graphs, one after the other: the worst of each, or the sum."""
    growth: dict[str, Any] = {}
    for part in parts:
        for name, found in part["rss_growth_by_node"].items():
            growth[name] = max(growth.get(name, found), found, key=lambda one: one["mb_per_hour"])
    hours = sum(part["hours"] for part in parts)
    worst = ("descriptors_drift", "threads_drift", "recovery_s_median", "recovery_s_worst")
    return {
        "hours": hours,
        "rss_growth_mb_per_hour": max((found["mb_per_hour"] for found in growth.values()), default=None),
        "rss_growth_by_node": growth,
        **{key: parts[-1][key] for key in ("rss_mb", "rss_mb_every_five_minutes")},
        **{key: max(part[key] for part in parts) for key in worst},
        **{key: sum(part[key] for part in parts) for key in ("segments_leaked", "recovered", "unrecovered", "subscribers", "pictures")},
        "faults": {
            name: sum(part["faults"].get(name, 0) for part in parts) for name in sorted({n for part in parts for n in part["faults"]})
        },
        "unrecovered_what": [text for part in parts for text in part["unrecovered_what"]],
        "log_kb_per_hour": sum(part["log_kb_per_hour"] * part["hours"] for part in parts) / hours,
    }


def run(quick: bool, hours: float = 1.0, keep: Path | None = None) -> dict[str, Any]:
    """Measure for so many hours, in graphs of at most one hour each; quick: for half a minute. What is in ``keep`` is not done again."""
    needs_browser()
    count = 1 if quick else max(1, math.ceil(hours))
    parts = []
    for number in range(count):
        file = keep / f"soak_{number + 1}_of_{count}_{hours:g}h.json" if keep is not None else None
        if file is None or not file.exists():
            with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
                found = live_through(Soak(quick, seed=number + 1), hours / count, Path(folder))
            if file is not None:
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(json.dumps(found), encoding="utf-8")
        else:
            found = json.loads(file.read_text(encoding="utf-8"))
        parts.append(found)
    return together(parts)
