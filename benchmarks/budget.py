"""Budget mode: a graph whose baseband is slowed ten times, without a time budget and with one; over real DDS, each node a process.

The radar is that of `five_people` with a frame every 15 ms instead of 20 ms, so that two echoes in a cell, which fit easily, take longer
than a frame once they are slowed ten times.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from handwave.msg import StageBudget
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter

from benchmarks.graph import DOMAIN
from benchmarks.tradeoff.stages import StudyConfig
from benchmarks.tradeoff.tune import LEVELS, tune, write
from radar_app.graph import graph
from radar_app.live import Monitor
from radar_app.supervisor import Supervisor, environment
from radar_core import HandwaveError
from radar_core.paths import find_config
from radar_ros import qos
from radar_ros.interrupts import ros

BUDGET_MS, INTERVAL, SLOWER = 12.0, 0.015, 10.0
_STEADY = 4.0  # s: a level that was not left for so long is settled
_PATIENCE = 40.0  # s
_STAGES = ("baseband", "tracking", "gestures", "hand")  # whose losses count


@dataclass
class Window:
    """What happened in some seconds: frames of the radar, what each stage finished and lost, and times from a frame to its tracks [s]."""

    frames: int
    finished: dict[str, int]
    lost: dict[str, int]
    latencies: list[float]

    @property
    def shares(self) -> dict[str, float]:
        """Share that each stage lost of the frames that it was to take; what was left out on purpose is neither lost nor to be taken."""
        return {name: count / max(count + self.finished[name], 1) for name, count in self.lost.items()}

    @property
    def share(self) -> float:
        """Of the stage that lost most: a frame that is lost by one is missing in all behind it."""
        return max(self.shares.values())


class Watch:
    """Listens to a graph and sets parameters of its baseband."""

    def __init__(self, stages: Sequence[str]) -> None:
        self.monitor, self._stages = Monitor(), stages
        self.budgets: list[Any] = []
        self.monitor.node.create_subscription(StageBudget, "stage_budget", self.budgets.append, qos.LATCHED_EACH)
        self._client = self.monitor.node.create_client(SetParametersAtomically, "baseband/set_parameters_atomically")

    def wait(self, wanted: Callable[[], Any], what: str, timeout: float = _PATIENCE) -> float:
        """Wait until something is true; return how long it took [s]."""
        start = time.monotonic()
        while not wanted():
            if time.monotonic() - start > timeout:
                said = [(one.number, one.reason) for one in self.budgets]
                raise HandwaveError(f"waited {timeout:g} s for {what}; dropped so far {self._counts('dropped')}, levels {said}")
            self.monitor.spin(0.02)
        return time.monotonic() - start

    def set(self, **values: Any) -> None:
        """Set parameters of the baseband, all together; ``__`` stands for a dot."""
        if not self._client.wait_for_service(_PATIENCE):
            raise HandwaveError("the baseband's parameters cannot be set: is it running?")
        parameters = [Parameter(name.replace("__", "."), value=value).to_parameter_msg() for name, value in values.items()]
        future = self._client.call_async(SetParametersAtomically.Request(parameters=parameters))
        self.wait(future.done, "the baseband's answer")
        answer = future.result()
        if answer is None or not answer.result.successful:
            raise HandwaveError(f"the baseband refused {values}: {answer.result.reason if answer else 'no answer'}")

    def settle(self) -> float:
        """Wait until the level stays; return how long it took to come there [s]."""
        start = changed = time.monotonic()
        known = len(self.budgets)
        while time.monotonic() - changed < _STEADY:
            self.monitor.spin(0.02)
            if len(self.budgets) != known:
                known, changed = len(self.budgets), time.monotonic()
        return changed - start

    def window(self, seconds: float) -> Window:
        """Count for some seconds."""
        lost, finished, frames = self._counts("dropped"), self._counts("processed"), self._frames()
        self.monitor.latencies.clear()
        self.monitor.spin(seconds)
        lost = {name: count - lost[name] for name, count in self._counts("dropped").items()}
        finished = {name: count - finished[name] for name, count in self._counts("processed").items()}
        return Window(self._frames() - frames, finished, lost, list(self.monitor.latencies))

    def _counts(self, what: str) -> dict[str, int]:
        return {name: getattr(self.monitor.stages[name], what) if name in self.monitor.stages else 0 for name in self._stages}

    def _frames(self) -> int:
        return self.monitor.frames + self.monitor.skipped


@contextmanager
def running(folder: Path, stages: Sequence[str], domain: int) -> Iterator[Watch]:
    """Run a driver and some stages, the baseband at two echoes in a cell, until the first tracks are there."""
    scene = yaml.safe_load(find_config("five_people", "scenes", ".yaml").read_text(encoding="utf-8"))
    scene["radars"] = [{**radar, "waveform": {"frame_interval": INTERVAL}} for radar in scene.get("radars", [{}])]
    path = folder / "five_people.yaml"
    path.write_text(yaml.safe_dump(scene), encoding="utf-8")
    parameters = {"driver": {"scene": str(path), "at_end": "loop"}, "baseband": {"doa.method": "dml2", "budget.recover": 1.0}}
    os.environ.update(environment(domain))
    specs = graph("live", parameters=parameters, without=("visualisation", *(name for name in _STAGES if name not in stages)))
    with Supervisor(specs, domain=domain, log=lambda name, line: None), ros():
        watch = Watch(stages)
        try:
            watch.wait(lambda: all(name in watch.monitor.stages for name in stages), "all stages")
            watch.wait(lambda: watch.monitor.latencies, "tracks")
            yield watch
        finally:
            watch.monitor.close()


def slowing(tuning: Path) -> float:
    """Give how many times slower the device gets: ten, or more where a fast machine would still keep the budget with its best level."""
    best = json.loads(tuning.read_text(encoding="utf-8"))["stages"]["baseband"]["levels"][0]
    return max(SLOWER, 2.0 * BUDGET_MS / float(best["time_ms"]))


def experiment(tuning: Path, folder: Path, seconds: float, *, stages: Sequence[str] = _STAGES, domain: int = DOMAIN) -> dict[str, Any]:
    """Slow the baseband (`slowing`), without a budget and with one, and let it recover; ``tuning``: file of ``handwave tradeoff --tune``.

    Returns shares of lost frames (``lost_...``), times, levels, and what the topic said.
    """
    factor = slowing(tuning)
    with running(folder, stages, domain) as watch:
        watch.set(device_factor=factor)
        watch.monitor.spin(2.0)
        windows = {"without": watch.window(seconds)}
        watch.set(device_factor=1.0, frame_budget_ms=BUDGET_MS, budget__tuning=str(tuning))
        watch.wait(lambda: watch.budgets, "the first level")
        watch.settle()
        windows["usual"], first = watch.window(seconds), watch.budgets[-1]
        watch.set(device_factor=factor)
        settled = watch.settle()
        windows["slowed"], level = watch.window(seconds), watch.budgets[-1]
        watch.set(device_factor=1.0)
        recovered = watch.wait(lambda: watch.budgets[-1].number == first.number, "the level of before")
        windows["recovered"] = watch.window(seconds)
    slow = windows["slowed"]
    return {
        "slowed_times": factor,
        "lost_without_budget": windows["without"].share,
        **{f"lost_{name}": windows[name].share for name in ("usual", "slowed", "recovered")},
        "lost_by_stage": {name: one.shares for name, one in windows.items()},
        "settle_s": settled,
        "recover_s": recovered,
        "level_usual": first.level,
        "level_slowed": level.level,
        "number_usual": first.number,
        "number_slowed": level.number,
        "gave_up": list(level.gave_up),
        "reason": level.reason,
        "frames": {name: one.frames for name, one in windows.items()},
        "taken_slowed": slow.finished["baseband"] + slow.lost["baseband"],
        "latencies_ms": {name: (1e3 * np.array(one.latencies)).tolist() for name, one in windows.items()},
    }


def run(quick: bool) -> dict[str, Any]:
    """Tune this machine, then run the experiment; choices are all that was measured for the levels."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        found = tune(StudyConfig(folder, quick), progress=not quick)
        write(folder, found)
        result = experiment(folder / LEVELS, folder, 3.0 if quick else 30.0)
    latencies = result.pop("latencies_ms")
    result |= {f"latency_ms_{name}": float(np.median(times)) if times else None for name, times in latencies.items()}
    return {**result, "choices": [row for tuned in found for row in tuned.rows]}
