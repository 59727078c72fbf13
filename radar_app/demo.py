"""`handwave demo`: a simulated room through the whole graph, watched live, recorded, and judged against the truth."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
from rich.console import Console
from rich.live import Live

from radar_app import compiling
from radar_app.demo_report import missing_of, show_report
from radar_app.fork_server import ForkServer
from radar_app.graph import STAGES, VARIANTS, NodeSpec, graph
from radar_app.live import Monitor
from radar_app.parameters import zone_parameters
from radar_app.supervisor import LOOK, Supervisor, environment, refuse_running
from radar_core import ConfigError
from radar_ros.bags import free_folder
from radar_ros.interrupts import ros
from radar_ros.signals import interruptible
from radar_ros.waiting import REMEDY, Patience
from radar_sim import load_scene

__all__ = ["DemoOptions", "run_demo", "show_report"]

_LOOKS = 0.12  # s: between two looks at the nodes
_READERS = {
    "radar/frame": {"baseband", "recorder"},
    "radar/points": {*STAGES[1:], "recorder"},
    "tracks": {"evaluation", "recorder", "zones"},
}


@dataclass(frozen=True)
class DemoOptions:
    """What the user asked for."""

    scene: str = "demo"
    duration: float | None = None
    bag: Path | None = None
    headless: bool = False
    domain: int | None = None
    namespace: str = ""
    verbose: bool = False
    zones: Path | None = None


@dataclass(frozen=True)
class _Plan:
    """What is run: the nodes, how long the scene takes [s], and where the results go."""

    specs: tuple[NodeSpec, ...]
    duration: float
    bag: Path

    @property
    def report(self) -> Path:
        return self.bag.with_name(f"{self.bag.name}.json")


def run_demo(options: DemoOptions, console: Console, fork_server: ForkServer | None = None) -> dict[str, Any]:
    """Run the demo and return its report; nodes come from a fork server where there is one.

    Of its figures ``crashes`` lists the nodes that died, ``interrupted`` tells whether the user ended it early, ``missing`` what should
    have been seen and was not. A `ConfigError` says that the scene makes no sense, the ROS domain is busy or nodes do not start.
    """
    os.environ.update(environment(options.domain))
    with interruptible(), ros():
        monitor = Monitor(options.namespace)  # first: while the scene is read it finds out who else is there
        due = time.monotonic() + LOOK
        try:
            plan = _plan(options)
            monitor.duration = plan.duration
            monitor.spin(max(due - time.monotonic(), 0.0))
            found = monitor.node.get_node_names_and_namespaces()
            refuse_running(found, [spec.name for spec in plan.specs], options.namespace, options.domain)
            return _run(plan, monitor, options, console, fork_server)
        finally:
            monitor.close()


def _plan(options: DemoOptions) -> _Plan:
    """Read the scene and describe the graph; nothing runs yet."""
    scene = load_scene(options.scene)
    duration = min(options.duration or scene.duration, scene.duration)
    bag = options.bag or free_folder(Path("out") / "demo")
    if bag.exists():
        raise ConfigError(f"{bag} exists already; choose another folder with --bag")
    parameters: dict[str, Any] = {"recorder": {"bag": str(bag)}, "evaluation": {"report": str(bag.with_name(f"{bag.name}.json"))}}
    # The driver starts with the others, waits until all of them listen, and ends when the scene is over.
    others = [name for name in VARIANTS["demo"].nodes if name != "driver"]
    driver = {"scene": str(options.scene), "duration": float(duration), "at_end": "exit", "wait_for_readers": 2, "wait_for_nodes": others}
    parameters |= {"driver": driver, **zone_parameters(options.zones)}
    specs = graph("demo", namespace=options.namespace, parameters=parameters)
    return _Plan(specs, float(duration), bag)


class _Log:
    """What the nodes print: kept for when something goes wrong, shown where the user wants it or has to know."""

    def __init__(self, console: Console, options: DemoOptions) -> None:
        self.lines: list[str] = []
        self.compiling = ""  # what a node that compiles says of it
        self._console, self._options = console, options

    def __call__(self, name: str, line: str) -> None:
        self.lines.append(f"{name}: {line}")
        about = compiling.told(line)
        if about:
            self.compiling = about if about.startswith("compiling") else ""
        bad = "[ERROR]" in line or "Traceback" in line
        if self._options.verbose or (self._options.headless and (bad or about)):
            self._console.print(f"{name}: {line}" if self._options.verbose or bad else about, markup=False, highlight=False, soft_wrap=True)


def _run(plan: _Plan, monitor: Monitor, options: DemoOptions, console: Console, fork_server: ForkServer | None) -> dict[str, Any]:
    """Run the nodes until the scene is over or the user has seen enough; returns the report."""
    log = _Log(console, options)
    supervisor = Supervisor(plan.specs, domain=options.domain, log=log, fork_server=fork_server)
    started, interrupted = time.monotonic(), False
    live: dict[str, Any] = {"first_frame_s": None, "stalled": False}
    try:
        supervisor.start()
        _await_frames(supervisor, monitor, console, log, options)
        live["first_frame_s"] = round(time.time() - psutil.Process().create_time(), 2)
        _watch(supervisor, monitor, plan, options, console)
        live["stalled"] = "driver" in supervisor.running
    except KeyboardInterrupt:
        interrupted = True
    finally:
        wall = time.monotonic() - started
        cpu = {name: round(100 * used / wall, 1) for name, used in supervisor.cpu_seconds().items()}
        supervisor.stop()
    live |= {**monitor.figures(), "cpu_percent": cpu, "received": monitor.received, "interrupted": interrupted, "bag": str(plan.bag)}
    report = {**_judged(plan.report), **live, "crashes": [f"{name} (status {status})" for name, status in supervisor.crashes]}
    report["missing"] = [] if interrupted else missing_of(report)
    if plan.report.exists():
        plan.report.write_text(json.dumps(report, indent=1), encoding="utf-8")
    return report


def _judged(file: Path) -> dict[str, Any]:
    """Read what the evaluation node wrote; empty: nothing."""
    return dict(json.loads(file.read_text(encoding="utf-8"))) if file.exists() else {}


def _await_frames(supervisor: Supervisor, monitor: Monitor, console: Console, log: _Log, options: DemoOptions) -> None:
    """Wait for the first tracks, as long as nodes work towards them; say who is waited for."""
    patience = Patience(work=supervisor.cpu_seconds)
    nodes = {spec.name for spec in supervisor.specs} - {"driver"}
    told = "starting"
    with nullcontext() if options.headless else console.status(told) as status:
        while not monitor.received and not supervisor.poll() and not patience.over():
            monitor.spin(_LOOKS)
            missing = _missing(monitor, nodes)
            names = [name for name in missing if " " not in name]
            text = log.compiling or (f"starting: waiting for {', '.join(names)}" if names else "starting: waiting for the first frame")
            if status is not None and text != told:
                status.update(text)
                told = text
    if "driver" not in supervisor.running and not monitor.received and not supervisor.crashes:
        return  # a scene of a moment
    if not monitor.received:
        raise ConfigError(_in_vain(_missing(monitor, nodes), supervisor.crashes, log.lines))


def _in_vain(missing: Sequence[str], crashes: Sequence[tuple[str, int]], lines: Sequence[str]) -> str:
    """Say why no frame came, and what to do."""
    died = [f"{name} ended with status {status}" for name, status in crashes]
    what = ", ".join(died) or (f"{', '.join(missing)} missing" if missing else "all nodes are there, but no tracks come")
    return f"the graph did not start: {what}; {REMEDY}. The nodes said last:\n" + "\n".join(lines[-20:])


def _missing(monitor: Monitor, nodes: set[str]) -> list[str]:
    """Name the nodes that are not there yet, and those that do not read their input yet: nodes compile before they subscribe."""
    missing = sorted(nodes - set(monitor.node.get_node_names()))
    for topic, readers in _READERS.items():
        present = {reader.node_name for reader in monitor.node.get_subscriptions_info_by_topic(topic)}
        missing += [f"{name} as a reader of {topic}" for name in sorted(readers & nodes - present - set(missing))]
    return missing


def _watch(supervisor: Supervisor, monitor: Monitor, plan: _Plan, options: DemoOptions, console: Console) -> None:
    """Show what the nodes do until the driver has been through the scene and ended."""
    title = f"handwave demo: {options.scene}"
    if options.headless:
        _until_the_end(supervisor, monitor, _plain_lines(monitor, console))
    else:
        with Live(monitor.render(title), console=console, refresh_per_second=8, transient=True) as display:
            _until_the_end(supervisor, monitor, lambda: display.update(monitor.render(title)))


def _until_the_end(supervisor: Supervisor, monitor: Monitor, show: Callable[[], None]) -> None:
    """Listen, look for dead nodes, show. A pause of the frames is no end; only when nothing works any more is it given up."""
    patience, seen = Patience(work=supervisor.cpu_seconds), -1
    while "driver" in supervisor.running and not patience.over():
        monitor.spin(_LOOKS)
        supervisor.poll()
        show()
        if monitor.frames + monitor.skipped != seen:
            seen = monitor.frames + monitor.skipped
            patience.again()
            supervisor.cpu_seconds()  # while the driver lives
    supervisor.poll()


def _plain_lines(monitor: Monitor, console: Console) -> Callable[[], None]:
    """Make what shows one line a second, for logs."""
    next_line = time.monotonic() + 1.0

    def show() -> None:
        nonlocal next_line
        if time.monotonic() < next_line:
            return
        next_line += 1.0
        console.print(monitor.line(), highlight=False, soft_wrap=True)

    return show
