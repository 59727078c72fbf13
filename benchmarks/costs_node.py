"""A node whose processor time is taken apart, in place of the node itself: ``python -m benchmarks.costs_node MODULE FILE ARGUMENTS``.

MODULE may be `radar_app.composed`, which runs several in one process.

Once a second it adds a line to FILE: a moment on CLOCK_MONOTONIC [s], and for each of `PARTS` the processor time so far [s].
"""

from __future__ import annotations

import functools
import gc
import importlib
import json
import pkgutil
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

LIBRARY: Final = {
    "driver": ("radar_sim.simulator", "Simulator", "process"),
    "baseband": ("radar_dsp", "Baseband", "process"),
    "tracking": ("radar_tracking.poisson.tracker", "PoissonTracker", "process"),
    "gestures": ("radar_gestures.recognizer", "GestureRecognizer", "find"),
    "hand": ("radar_tracking", "HandTracker", "process"),
}
"""What does a stage's work: module, class and method."""
_BESIDE: Final = (
    ("radar_tracking.zones", "ZoneMonitor", "process"),
    ("radar_lab.evaluation.run", "Evaluator", "add"),
    ("radar_lab.evaluation.run", "Evaluator", "add_hand"),
    ("radar_lab.evaluation.run", "Evaluator", "report"),
    ("radar_ros.bags", "BagWriter", "write"),
    ("radar_ros.bags", "BagWriter", "flush"),
)
PARTS: Final = ("own work", "beside", "conversion", "publishing", "reports", "rest of callbacks", "collector", "executor", "other threads")
"""``own work``: of the library in a stage; ``beside``: of zones, evaluation and the bag's writer; ``conversion``: to and from messages;
``publishing``: all that a publisher takes, serialisation too; ``reports``: status and diagnostics; ``executor``: the rest of the main
thread, waiting, taking and deserialising; ``other threads``: those of the middleware."""


class Costs:
    """Processor time by part; what is called within another part counts for the inner one only."""

    def __init__(self) -> None:
        self.spent: dict[str, int] = defaultdict(int)  # ns, of all threads
        self.main = 0  # ns of `spent` that were of the main thread
        self._open = threading.local()

    def wrap(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Count what a function takes."""

        @functools.wraps(function)
        def counted(*given: Any, **named: Any) -> Any:
            began, inner = time.thread_time_ns(), getattr(self._open, "inner", 0)
            self._open.inner = 0
            try:
                return function(*given, **named)
            finally:
                whole = time.thread_time_ns() - began
                self.add(part, whole - self._open.inner)
                self._open.inner = inner + whole

        return counted

    def add(self, part: str, spent: int) -> None:
        """Count nanoseconds of this thread."""
        self.spent[part] += spent
        if threading.current_thread() is threading.main_thread():
            self.main += spent

    def collecting(self, phase: str, _: object) -> None:
        """Count what the garbage collector takes; for `gc.callbacks`."""
        if phase == "start":
            self._open.began = time.thread_time_ns()
        else:
            whole = time.thread_time_ns() - self._open.began
            self.add("collector", whole)
            self._open.inner = getattr(self._open, "inner", 0) + whole

    def line(self) -> str:
        """Make a line for the file; from the main thread."""
        whole, main, counted = time.process_time_ns(), time.thread_time_ns(), sum(self.spent.values())
        found = {**self.spent, "executor": main - self.main, "other threads": whole - main - (counted - self.main)}
        return json.dumps({"at": time.monotonic(), **{part: found.get(part, 0) * 1e-9 for part in PARTS}})


def instrument(costs: Costs) -> None:
    """Put counters around everything that is counted, before the node's module takes its names from elsewhere."""
    import rclpy.publisher

    import radar_ros.guard
    import radar_ros.messages
    from radar_ros.reports import Reports
    from radar_ros.stage import StageMixin

    for part, methods in (("own work", LIBRARY.values()), ("beside", _BESIDE)):
        for where, kind, method in methods:
            owner = getattr(importlib.import_module(where), kind)
            setattr(owner, method, costs.wrap(part, getattr(owner, method)))
    for module in pkgutil.iter_modules(radar_ros.messages.__path__, "radar_ros.messages."):
        found = importlib.import_module(module.name)
        for name in [name for name in vars(found) if name.endswith(("_to_msg", "_from_msg", "_to_cloud2"))]:
            setattr(found, name, costs.wrap("conversion", getattr(found, name)))
    rclpy.publisher.Publisher.publish = costs.wrap("publishing", rclpy.publisher.Publisher.publish)
    Reports.add, Reports.send = costs.wrap("reports", Reports.add), costs.wrap("reports", Reports.send)  # type: ignore[method-assign]
    StageMixin._diagnose = costs.wrap("reports", StageMixin._diagnose)  # type: ignore[method-assign]
    guarded = radar_ros.guard.guarded
    radar_ros.guard.guarded = lambda node, callback, where="": costs.wrap("rest of callbacks", guarded(node, callback, where))
    gc.callbacks.append(costs.collecting)


def main() -> int:
    """Run the node."""
    module, path = sys.argv[1], Path(sys.argv[2])
    del sys.argv[1:3]
    costs = Costs()
    instrument(costs)
    from radar_ros import heartbeat, stage

    beat, told = heartbeat.beat, [time.monotonic()]

    def beating(*more: str) -> None:
        beat(*more)
        if time.monotonic() - told[0] >= 1.0:
            told[0] = time.monotonic()
            with path.open("a", encoding="utf-8") as file:
                file.write(costs.line() + "\n")

    heartbeat.beat = beating
    found = importlib.import_module(module)
    return int(stage.run(found.make_node) if hasattr(found, "make_node") else found.main())


if __name__ == "__main__":
    raise SystemExit(main())
