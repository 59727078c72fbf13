"""How soon a graph of real nodes notices that its radar is dead: the driver is killed, and every stage is listened to."""

from __future__ import annotations

import os
import signal
import time
from typing import Any, Final

import handwave.msg

from radar_app.graph import STAGES, graph
from radar_app.supervisor import Supervisor, environment, refuse_busy_domain
from radar_core import DataError
from radar_ros import qos
from radar_ros.interrupts import Visitor, ros

_START: Final = 90.0  # s: for all stages to have results
_DEAF: Final = 10.0  # s: after which nothing is waited for


class Listener(Visitor):
    """Hears which stages have results, and which say that they are stale, and when."""

    def __init__(self) -> None:
        super().__init__("handwave_listener")
        self.busy: set[str] = set()
        self.stale: dict[str, float] = {}  # on CLOCK_MONOTONIC [s]
        self.last_frame = 0.0
        self.node.create_subscription(handwave.msg.StageStatus, "stage_status", self._status, qos.sensor(reliable=True))
        self.node.create_subscription(handwave.msg.ZoneArray, "zones", self._zones, qos.LATCHED)

    def _status(self, msg: Any) -> None:
        now = time.monotonic()
        if msg.stale:
            self.stale.setdefault(msg.stage, now)
        elif msg.processed:
            self.busy.add(msg.stage)
            if msg.stage == "baseband":  # what it has finished with, it soon tells; a driver that is killed does not
                self.last_frame = msg.monotonic_ns * 1e-9

    def _zones(self, msg: Any) -> None:
        if msg.stale and self.busy:
            self.stale.setdefault("topic zones", time.monotonic())


def stale_detected() -> dict[str, float]:
    """Kill a driver; returns for each stage, and for the topic ``zones``, how long after the last frame it said that it is stale [s].

    Raises
    ------
    DataError
        When the stages do not start, or one of them says nothing.
    """
    os.environ.update(environment())
    wanted = {*STAGES, "zones"}
    specs = graph("live", parameters={"driver": {"scene": "one_user", "at_end": "loop"}}, without=("visualisation",))
    refuse_busy_domain([spec.label for spec in specs], "", None)
    with Supervisor(specs, log=lambda *_: None) as supervisor, ros():
        listener = Listener()
        try:
            _spin(listener, supervisor, lambda: {*wanted, "driver"} <= listener.busy, _START, "did not start")
            listener.spin(2.0)
            listener.stale.clear()  # what was slow to start may have been
            os.kill(supervisor.pid("driver"), signal.SIGKILL)
            listener.spin(0.2)
            wanted.add("topic zones")
            _spin(listener, supervisor, lambda: wanted <= listener.stale.keys(), _DEAF, "did not notice that the radar is dead")
        finally:
            listener.close()
        return {name: at - listener.last_frame for name, at in sorted(listener.stale.items())}


def _spin(listener: Listener, supervisor: Supervisor, done: Any, timeout: float, problem: str) -> None:
    end = time.monotonic() + timeout
    while not done():
        if time.monotonic() > end:
            raise DataError(
                f"after {timeout:g} s some stages {problem}; results of {sorted(listener.busy)}, stale {sorted(listener.stale)}"
            )
        listener.spin(0.05)
        supervisor.poll()
