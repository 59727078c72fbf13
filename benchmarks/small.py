"""The demo at 25 Hz on a small device: `handwave up --small` in one process, on one core slowed three times, beside the full graph.

The radar is a process of its own at full speed, as a real one would be, and so is the evaluation, which no device has. The full graph is
that of `handwave demo`, not slowed. Both go before what else this machine does, where that is allowed. Levels were measured on scenes of
`handwave lab tradeoff --tune`, budgets chosen on the demo with seeds 11 to 14; the figures are of its own seed and two others.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import handwave.msg
import numpy as np
import yaml

from benchmarks.report import AbsentError, Panel, Row, of_share, share, share_interval
from benchmarks.slowed import Slowing, precede, slowed
from radar_app.composed import composed_spec
from radar_app.graph import NODES, NodeSpec, graph
from radar_app.live import Monitor
from radar_app.small import small_graph
from radar_app.supervisor import Supervisor, environment
from radar_core import HandwaveError
from radar_core.paths import find_config
from radar_ros import qos
from radar_ros.interrupts import ros
from radar_sim import load_scene

DOMAIN: Final = 150 + (os.getpid() + 20) % 80
TIMES: Final = 3.0
_INTERVAL: Final = 0.04  # s: 25 Hz
_SEEDS: Final = (1, 3, 4)  # with 2 the hand is not in place for its drawing in time
_QUICK: Final = 4.0  # s of a scene of six
_START: Final = 90.0  # s: until all nodes listen
_DRAIN: Final = 1.0  # s: after the last frame, for its results
_FULL, _SMALL = "the full graph, each node a process", f"--small, one core slowed {TIMES:g} times"
_REFERENCE: Final = "from a frame to its tracks in the full graph"
GESTURES: Final = Panel("gestures of the demo at 25 Hz", "gestures named right", "", "higher", _FULL, _REFERENCE)
PEOPLE: Final = Panel("people of the demo at 25 Hz", "mean GOSPA", "m", "lower", _FULL, _REFERENCE)
_READERS: Final = (
    ("radar/frame", "baseband"),
    ("radar/points", "tracking"),
    ("radar/points", "gestures"),
    ("radar/points", "hand"),
    ("tracks", "zones"),
    ("tracks", "evaluation"),
)
_BESIDE: Final = ("driver", "evaluation", "recorder")  # what no device would run beside a radar


class Ear(Monitor):
    """Hears what a graph does, and which levels its nodes work at."""

    def __init__(self) -> None:
        super().__init__()
        self.budgets: list[tuple[float, str, str]] = []  # when it was heard on CLOCK_MONOTONIC [s], stage, level
        self.node.create_subscription(handwave.msg.StageBudget, "stage_budget", self._level, qos.LATCHED_EACH)

    def _level(self, msg: Any) -> None:
        self.budgets.append((time.monotonic(), msg.stage, msg.level))

    def listening(self) -> bool:
        """Whether all nodes read what they work on: they have compiled then."""
        find = self.node.get_subscriptions_info_by_topic
        return all(any(end.node_name == name for end in find(topic)) for topic, name in _READERS)


def level_shares(told: Sequence[tuple[float, str, str]], begin: float, end: float) -> dict[str, dict[str, float]]:
    """Give the share of a time that each stage worked at each level; told: when it began to [s], stage and level, in order."""
    found: dict[str, dict[str, float]] = {}
    for stage in sorted({stage for _, stage, _ in told}):
        steps = [(min(max(at, begin), end), level) for at, which, level in told if which == stage]
        shares: dict[str, float] = defaultdict(float)
        for (since, level), (until, _) in zip(steps, [*steps[1:], (end, "")], strict=True):
            shares[level] += (until - since) / (end - begin)
        found[stage] = {level: value for level, value in shares.items() if value > 0}
    return found


@dataclass(frozen=True)
class Played:
    """What a graph made of one demo."""

    report: dict[str, Any]  # of the evaluation node
    latencies_ms: list[float]
    frames: int  # that the radar gave
    lost: int  # those that gave no tracks
    skipped: int  # that it was to give and did not: this machine was too busy to simulate them
    levels: dict[str, dict[str, float]]
    cores: float  # processors that were busy with nodes that a device would run
    slowing: Slowing | None = None


def scene_file(folder: Path, name: str, seed: int | None) -> Path:
    """Write a scene of ours at 25 Hz, with another seed or its own (None)."""
    scene = yaml.safe_load(find_config(name, "scenes", ".yaml").read_text(encoding="utf-8"))
    scene["seed"] = scene["seed"] if seed is None else seed
    scene["radars"] = [{**radar, "waveform": {"frame_interval": _INTERVAL}} for radar in scene.get("radars", [{}])]
    path = folder / f"{name}_{scene['seed']}.yaml"
    path.write_text(yaml.safe_dump(scene), encoding="utf-8")
    return path


def nodes(folder: Path, scene: Path, seconds: float, *, small: bool) -> tuple[NodeSpec, ...]:
    """List the processes: of the full graph each node, of the small one the driver, the evaluation, and the rest in one."""
    report = {"report": str(folder / "report.json")}
    driver = {"scene": str(scene), "duration": seconds, "at_end": "exit", "wait_for_readers": 1 if small else 2}
    if small:
        specs = (*small_graph("live", parameters={"driver": driver}), replace(NODES["evaluation"], parameters=report))
    else:
        specs = graph("demo", parameters={"driver": driver, "recorder": {"bag": str(folder / "bag")}, "evaluation": report})
    others = [spec.name for spec in specs if spec.name != "driver"]
    driver["wait_for_nodes"] = others
    specs = tuple(replace(spec, parameters=driver) if spec.name == "driver" else spec for spec in specs)
    if not small:
        return specs
    own = [spec for spec in specs if spec.name not in _BESIDE]
    return (*(spec for spec in specs if spec.name in _BESIDE), composed_spec(own))


def play(specs: Sequence[NodeSpec], folder: Path, seconds: float, core: int | None = None) -> Played:
    """Run a graph through its scene; with a ``core`` the process of many nodes has that one, slowed, from when it listens to the end."""
    lines: list[str] = []
    supervisor = Supervisor(specs, domain=DOMAIN, log=lambda name, line: lines.append(f"{name}: {line}"))
    with ros():
        ear, slowing = Ear(), None
        try:
            supervisor.start(without=("driver",))
            _precede(supervisor)
            if not ear.until(ear.listening, _START):
                raise HandwaveError("nodes do not listen:\n" + "\n".join(lines[-20:]))
            with contextlib.ExitStack() as stack:
                if core is not None:
                    slowing = stack.enter_context(slowed(supervisor.pid("graph"), TIMES, core))
                begin, wall, used = _watch(supervisor, ear, seconds + _START)
        finally:
            ear.close()
            supervisor.stop()
    if supervisor.crashes or not used:
        raise HandwaveError(f"the graph did not run ({supervisor.crashes}):\n" + "\n".join(lines[-20:]))
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    cores = sum(value for name, value in used.items() if name not in _BESIDE) / wall
    lost, levels = max(ear.frames - ear.received, 0), level_shares(ear.budgets, begin, begin + wall)
    return Played(report, [1e3 * value for value in ear.latencies], ear.frames, lost, ear.skipped, levels, cores, slowing)


def _precede(supervisor: Supervisor) -> None:
    """Let nothing else on this machine be in the way of the graph."""
    for name in supervisor.running:
        precede(supervisor.pid(name))


def _watch(supervisor: Supervisor, ear: Ear, longest: float) -> tuple[float, float, dict[str, float]]:
    """Start the driver and hear until it has ended; gives when frames began [s], for how long they came, and processor times [s]."""
    supervisor.start()
    _precede(supervisor)
    begin = last = time.monotonic()
    end, before, used = begin + longest, {}, {}
    while "driver" in supervisor.running and time.monotonic() < end:
        ear.spin(0.1)
        supervisor.poll()
        if not ear.frames:
            begin, before = time.monotonic(), supervisor.cpu_seconds()
        elif "driver" in supervisor.running:
            last, used = time.monotonic(), supervisor.cpu_seconds()
    ear.spin(_DRAIN)
    return begin, last - begin, {name: value - before.get(name, 0.0) for name, value in used.items()}


@contextlib.contextmanager
def _leaving(core: int | None) -> Iterator[None]:
    """Let this process, and those that it starts, leave a core to another one, where there are two or more."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, before - {core} or before)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def ratio_interval(part: int, other: int, whole: int) -> tuple[float, float]:
    """Give the 95 % interval of the ratio of two shares of as many trials (MOVER by Donner and Zou, 2012, from Wilson's scores).

    It takes the two as independent: of the same gestures, it is too wide rather than too narrow.
    """
    if not whole:
        return 0.0, math.inf
    (low, high), (other_low, other_high) = share_interval(part, whole), share_interval(other, whole)
    p, q = part / whole, other / whole

    def limit(own: float, beside: float, sign: int) -> float:
        below = beside * (2 * q - beside)
        if below <= 0:
            return 0.0 if sign < 0 else math.inf
        return (p * q + sign * math.sqrt(max((p * q) ** 2 - own * (2 * p - own) * below, 0.0))) / below

    return limit(low, other_high, -1), limit(high, other_low, 1)


def figures(full: Sequence[Played], small: Sequence[Played]) -> dict[str, Any]:
    """Put the figures together: gestures and lost frames over all demos, with their intervals."""
    right, total = ([sum(one.report["gestures"][key] for one in which) for which in (full, small)] for key in ("hits", "total"))
    result: dict[str, Any] = {
        "gestures_right": right[1] / right[0] if right[0] else None,
        "gestures_right_interval": list(ratio_interval(right[1], right[0], total[0])) if right[0] else None,
        **share("dropped_fraction", sum(one.lost for one in small), sum(one.frames for one in small)),
    }
    for name, which in (("full", full), ("small", small)):
        result |= {f"{name}_{key}": value for key, value in _of_graph(which).items()}
    for stage in sorted({stage for one in small for stage in one.levels}):
        shares: dict[str, float] = defaultdict(float)
        for one in small:
            for level, value in one.levels.get(stage, {}).items():
                shares[level] += value / len(small)
        result[f"level_{stage}"], result[f"levels_{stage}"] = max(shares, key=shares.__getitem__), dict(shares)
    slowings = [one.slowing for one in small if one.slowing is not None]
    result |= {"slowed_by": slowings[0].how, "slowed_share_on": float(np.mean([one.on for one in slowings])), "slowed_times": TIMES}
    return {**result, "choices": rows(full, small)}


def _of_graph(played: Sequence[Played]) -> dict[str, Any]:
    """Give the figures of one graph over all demos."""
    counts = {key: sum(one.report["gestures"][key] for one in played) for key in ("total", "hits", "wrong", "misses", "false_gestures")}
    latencies = [value for one in played for value in one.latencies_ms]
    return {
        "gestures": counts,
        **share("gestures_right_share", counts["hits"], counts["total"]),
        "frames": sum(one.frames for one in played),
        "frames_lost": sum(one.lost for one in played),
        "frames_not_simulated": sum(one.skipped for one in played),
        "cores": float(np.mean([one.cores for one in played])),
        "latency_ms_median": float(np.median(latencies)),
        "latency_ms_p99": float(np.percentile(latencies, 99)),
    }


def rows(full: Sequence[Played], small: Sequence[Played]) -> list[Row]:
    """Put accuracy and time of both side by side."""
    reference = [value for one in full for value in one.latencies_ms]
    found: list[Row] = []
    for panel in (GESTURES, PEOPLE):
        for name, which in ((_FULL, full), (_SMALL, small)):
            times = [value for one in which for value in one.latencies_ms]
            total = sum(one.report["gestures"]["total"] for one in which)
            right = sum(one.report["gestures"]["hits"] for one in which) / max(total, 1)
            means = [one.report["gospa"]["mean_m"] for one in which]
            value, margin = (right, of_share(right, max(total, 1))) if panel is GESTURES else (float(np.mean(means)), _margin(means))
            found.append(panel.row(name, value, times, reference, margin=margin))
    return found


def _margin(values: Sequence[float]) -> float:
    """Two standard errors of a mean; 0 of one value."""
    return float(2 * np.std(values, ddof=1) / len(values) ** 0.5) if len(values) > 1 else 0.0


def run(quick: bool) -> dict[str, Any]:
    """Play the demo with some seeds, by the full graph and by the small one in turn."""
    if not hasattr(os, "sched_setaffinity"):
        raise AbsentError("this system cannot give a process one core (sched_setaffinity): run it on Linux")
    os.environ.update(environment(DOMAIN))
    load, own = os.getloadavg()[0], max(os.sched_getaffinity(0))
    name, seeds = ("short", (None,)) if quick else ("demo", _SEEDS)
    seconds = _QUICK if quick else load_scene(name).duration
    full: list[Played] = []
    small: list[Played] = []
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        for seed in seeds:
            for which, core in ((full, None), (small, own)):
                folder = Path(place) / f"{seed}_{core}"
                folder.mkdir()
                specs = nodes(folder, scene_file(folder, name, seed), seconds, small=core is not None)
                with _leaving(core):
                    which.append(play(specs, folder, seconds, core))
    return {"frame_rate_hz": 1 / _INTERVAL, "demos": len(seeds), "load_before": load, **figures(full, small)}
