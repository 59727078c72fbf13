"""Runs a graph for a while and says what it did: latencies, lost frames, processor time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from radar_app.composed import composed_spec
from radar_app.graph import NodeSpec
from radar_app.live import Monitor, Stage
from radar_app.supervisor import Supervisor
from radar_core import HandwaveError
from radar_ros.interrupts import ros

START: Final = 90.0
"""How long the first tracks may take to come [s]; a cold disk is slow."""
SETTLE: Final = 4.0
"""Start-up and discovery are not measured [s]."""

REPORTED: Final = 1.0
"""How long a driver that lives may take to say what it has done [s]."""


@dataclass(frozen=True)
class Load:
    """What a running graph did in some seconds."""

    latencies_ms: list[float]  # from a frame's publication to its tracks' arrival [ms]
    due: int  # frames of the radar
    lost: int  # those that gave no tracks
    seconds: float
    cpu: Mapping[str, float] = field(default_factory=dict)  # processor time of each process [s]

    @property
    def cores(self) -> float:
        """Processors that were busy, on average."""
        return sum(self.cpu.values()) / self.seconds

    @property
    def dropped(self) -> float:
        """Share of the frames that gave no tracks."""
        return self.lost / max(self.due, 1)


def counts(monitor: Monitor, driver: str = "driver") -> tuple[int, int]:
    """Frames that a driver was to give so far, and those that the track arrays stand for, at the moment of its next report."""
    stage, end = monitor.stages.setdefault(driver, Stage()), time.monotonic() + REPORTED
    heard = stage.heard
    while stage.heard == heard and time.monotonic() < end:
        monitor.spin(0.005)
    return stage.processed + stage.dropped, monitor.received


def settle(monitor: Monitor) -> None:
    """Wait for the first tracks of a graph, and a little longer; a HandwaveError says that none came."""
    end = time.monotonic() + START
    while not monitor.received and time.monotonic() < end:
        monitor.spin(0.1)
    if not monitor.received:
        raise HandwaveError(f"the graph gave no tracks within {START:g} s; look at its nodes: handwave up")
    monitor.spin(SETTLE)


def listen(seconds: float, cpu: Callable[[], dict[str, float]], driver: str = "driver") -> Load:
    """Listen to a running graph; ``cpu`` says how many seconds each process has used. Raises HandwaveError when no tracks come."""
    with ros():
        monitor = Monitor()
        try:
            settle(monitor)
            (due, received), before, started = counts(monitor, driver), cpu(), time.monotonic()
            monitor.latencies.clear()
            monitor.spin(seconds)
            due, received = counts(monitor, driver)[0] - due, monitor.received - received
            wall, after = time.monotonic() - started, cpu()
            used = {name: value - before.get(name, 0.0) for name, value in after.items()}
            # A frame on its way at either end of the window is not lost.
            return Load([1e3 * value for value in monitor.latencies], due, max(0, due - received - 1), wall, used)
        finally:
            monitor.close()


def separate(specs: Sequence[NodeSpec], seconds: float, domain: int | None, driver: str = "driver") -> Load:
    """Run every node as a process of its own."""
    with Supervisor(specs, domain=domain, log=lambda name, line: None) as supervisor:
        return listen(seconds, supervisor.cpu_seconds, driver)


def composed(specs: Sequence[NodeSpec], seconds: float, domain: int | None) -> Load:
    """Run all nodes in one process."""
    return separate([composed_spec(specs)], seconds, domain)
