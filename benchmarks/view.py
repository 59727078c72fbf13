"""The live page over a running graph: pictures a second, and what it adds to the latency from a frame to its tracks."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import psutil

from benchmarks.browser import needs_browser, page, pictures
from benchmarks.graph import DOMAIN, nodes
from benchmarks.report import choice
from radar_app.live import Monitor
from radar_app.supervisor import Supervisor, environment, refuse_busy_domain
from radar_core import HandwaveError
from radar_ros.interrupts import ros

_START: Final = 90.0  # s: for nodes, page and browser to be there
_SETTLE: Final = (1.0, 4.0)  # s: after a change, before anything is measured
_SECONDS: Final = (3.0, 15.0)  # of each turn
_TURNS: Final = (1, 6)  # alone, with the page, beside as much load in as many processes, and in one
_SLICE: Final = 0.02  # s: the load of one process works for a share of so long, then rests
_IDLE: Final = 0.005  # cores: a process that uses less is no load
_PEOPLE: Final = "return Bokeh.documents[0].get_model_by_name('people').data['id'].length"
_SCENE: Final = """
duration: 20.0
seed: 5
purpose: tracks
effects:
  noise: {noise_figure: 15}
people:
  - {id: 1, position: [2.0, 0.9], script: [{gesture: push, at: 3.0}, {gesture: swipe_left, at: 8.0}, {gesture: pull, at: 13.0}]}
  - {id: 2, position: [2.1, -0.9], script: [{gesture: pull, at: 5.0}, {gesture: swipe_up, at: 10.0}]}
  - id: 3
    position: [4.0, 2.2]
    script: [{walk: {to: [4.0, -1.4], speed: 0.8}}, {stand: 1.0}, {walk: {to: [3.8, 2.0], speed: 0.8}}]
  - id: 4
    position: [5.2, -2.4]
    script: [{walk: {to: [5.0, 2.0], speed: 0.9}}, {stand: 1.0}, {walk: {to: [5.2, -2.2], speed: 0.9}}]
"""
"""Four people, two who gesture and two who walk."""


def used(pid: int) -> dict[int, float]:
    """Processor time of a process and its children [s], by process."""
    found = {}
    with contextlib.suppress(psutil.Error):
        parent = psutil.Process(pid)
        for process in (parent, *parent.children(recursive=True)):
            with contextlib.suppress(psutil.Error):
                times = process.cpu_times()
                found[process.pid] = times.user + times.system
    return found


def grown(before: dict[int, float], after: dict[int, float], seconds: float) -> list[float]:
    """Cores that each process kept busy, of those that did."""
    shares = [(total - before.get(pid, 0.0)) / seconds for pid, total in after.items()]
    return [min(share, 1.0) for share in shares if share > _IDLE]


@contextlib.contextmanager
def load(groups: Sequence[list[float]], period: float) -> Iterator[None]:
    """Keep a process busy for each share of a core, a session per group.

    A process works for its share of every period [s], then rests, as a page does. Where sessions share the processor out among themselves
    (Linux, autogroup) the groups get what page and browser get.
    """
    code = "import os,sys,time\nshares=[float(each) for each in sys.argv[1:]]\nshare=shares[0]\n"
    code += "for each in shares[1:]:\n if os.fork()==0:\n  share=each\n  break\n"
    code += "while 1:\n end=time.thread_time()+share*{0}\n began=time.monotonic()\n"
    code += " while time.thread_time()<end: pass\n time.sleep(max(0.0,{0}-(time.monotonic()-began)))\n"
    command = [sys.executable, "-c", code.format(period)]
    busy = [subprocess.Popen([*command, *map(str, shares)], start_new_session=True) for shares in groups if shares]
    try:
        yield
    finally:
        for leader in busy:
            os.killpg(leader.pid, signal.SIGKILL)
            leader.wait()


def until(wanted: Callable[[], Any], monitor: Monitor, what: str) -> None:
    """Listen to the graph until something is so; a HandwaveError says what never was."""
    end = time.monotonic() + _START
    while not wanted():
        if time.monotonic() > end:
            raise HandwaveError(f"{what} did not come within {_START:g} s; look at: handwave up, and handwave view beside it")
        monitor.spin(0.1)


def latencies(monitor: Monitor, settle: float, seconds: float) -> list[float]:
    """Listen for some seconds: the time from every frame's publication to its tracks [ms]."""
    monitor.spin(settle)
    monitor.latencies.clear()
    monitor.spin(seconds)
    return [1e3 * value for value in monitor.latencies]


@dataclass
class Turn:
    """One turn: latencies [ms] with the page, beside as much load in as many processes, beside as much in one, and alone."""

    page: list[float]
    load: list[float]
    smooth: list[float]
    alone: list[float]
    rate: float
    cores: float


def turn(monitor: Monitor, folder: Path, quick: bool) -> Turn:
    """Measure all four in turn."""
    settle, seconds = (pair[0] if quick else pair[1] for pair in (_SETTLE, _SECONDS))
    alone = latencies(monitor, settle, seconds)
    with page(folder) as (driver, pids):
        until(lambda: pictures(driver) and (quick or driver.execute_script(_PEOPLE) >= 4), monitor, "a picture of four people")
        monitor.spin(settle)
        began, drawn, cpu = time.monotonic(), pictures(driver), [used(pid) for pid in pids]
        with_page = latencies(monitor, 0.0, seconds)
        wall = time.monotonic() - began
        rate = (pictures(driver) - drawn) / wall
        groups = [grown(before, used(pid), wall) for pid, before in zip(pids, cpu, strict=True)]
    total = sum(map(sum, groups))
    with load(groups, 1.0 / max(rate, 1.0)):
        beside = latencies(monitor, settle, seconds)
    with load([[total]], _SLICE):
        smooth = latencies(monitor, settle, seconds)
    return Turn(with_page, beside, smooth, alone, rate, total)


def measure(folder: Path, quick: bool) -> dict[str, Any]:
    """Measure in turns: with the page in a browser, and beside as much load without it."""
    scene = folder / "four.yaml"
    scene.write_text(_SCENE, encoding="utf-8")
    os.environ.update(environment(DOMAIN))
    refuse_busy_domain([spec.label for spec in nodes(str(scene))], "", DOMAIN)
    with Supervisor(nodes(str(scene)), domain=DOMAIN, log=lambda name, line: None), ros():
        monitor = Monitor()
        try:
            until(lambda: monitor.latencies, monitor, "tracks")
            turns = [turn(monitor, folder, quick) for _ in range(_TURNS[0] if quick else _TURNS[1])]
        finally:
            monitor.close()
    return figures(turns)


def figures(turns: Sequence[Turn]) -> dict[str, Any]:
    """Put the figures together; latencies in milliseconds, ratios with 90 % intervals over turns."""
    names = ("page", "load", "smooth", "alone")
    pooled = {name: [value for each in turns for value in getattr(each, name)] for name in names}
    if not all(pooled.values()):
        raise HandwaveError("no latencies were heard: is the machine too busy for the graph?")
    found: dict[str, Any] = {}
    for name, share in (("median", 50), ("p99", 99)):
        levels = {kind: float(np.percentile(values, share)) for kind, values in pooled.items()}
        found[f"latency_{name}_ratio"] = levels["page"] / levels["load"]
        found[f"latency_{name}_ratio_interval"] = ratio_interval(turns, share)
        found[f"latency_{name}_ratio_to_one_process"] = levels["page"] / levels["smooth"]
        found |= {f"latency_{name}_ms_{kind}": level for kind, level in levels.items()}
    rates = [each.rate for each in turns]
    rows = [
        choice("live page", label, accuracy=("pictures a second", rate, "1/s"), times_ms=pooled[name], reference_ms=pooled["load"])
        for label, rate, name in (
            ("nothing beside the graph", 0.0, "alone"),
            ("load of one process", 0.0, "smooth"),
            ("load of as many processes", 0.0, "load"),
            ("page in a browser", float(np.mean(rates)), "page"),
        )
    ]
    return {
        "updates_per_s": float(np.mean(rates)),
        "updates_per_s_worst_turn": min(rates),
        **found,
        "page_cores": float(np.mean([each.cores for each in turns])),
        "frames": len(pooled["page"]),
        "turns": len(turns),
        "choices": rows,
    }


def ratio_interval(turns: Sequence[Turn], share: float) -> list[float]:
    """90 % interval of the ratio of two percentiles, page over load: turns are drawn again, with replacement."""
    rng = np.random.default_rng(1)
    drawn = [[turns[k] for k in rng.integers(len(turns), size=len(turns))] for _ in range(400)]
    ratios = [np.percentile(np.concatenate([t.page for t in some]), share) / np.percentile(np.concatenate([t.load for t in some]), share)
              for some in drawn]  # fmt: skip
    return [float(value) for value in np.percentile(ratios, (5, 95))]


def run(quick: bool) -> dict[str, Any]:
    """Measure with four people at 50 Hz; an AbsentError says that there is no browser to drive."""
    needs_browser()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        return measure(Path(folder), quick)
