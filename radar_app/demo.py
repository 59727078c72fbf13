"""`handwave demo`: a simulated room through the whole graph, watched live, recorded, and judged against the truth."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.table import Table

from radar_app.graph import STAGES, graph
from radar_app.live import Monitor
from radar_app.parameters import zone_parameters
from radar_app.supervisor import Supervisor, environment, refuse_busy_domain
from radar_core import ConfigError
from radar_ros.bags import free_folder
from radar_ros.interrupts import interruptible, ros
from radar_sim import load_scene

_START_TIMEOUT = 30.0  # s: for all nodes to be there; a cold disk is slow
_GOSPA_PARTS = {"localisation": "localisation", "missed": "missed", "false_tracks": "false tracks"}
_DRAIN = 1.0  # s: after the last frame, for results to arrive and be written
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


def run_demo(options: DemoOptions, console: Console) -> dict[str, Any]:
    """Run the demo and return its report.

    Of its figures ``crashes`` lists the nodes that died, ``interrupted`` tells whether the user ended it early. A `ConfigError` says that
    the scene makes no sense, the ROS domain is busy or nodes do not start.
    """
    os.environ.update(environment(options.domain))
    scene = load_scene(options.scene)
    duration = min(options.duration or scene.duration, scene.duration)
    bag = options.bag or free_folder(Path("out") / "demo")
    if bag.exists():
        raise ConfigError(f"{bag} exists already; choose another folder with --bag")
    report_file = bag.with_name(f"{bag.name}.json")
    parameters = {"recorder": {"bag": str(bag)}, "evaluation": {"report": str(report_file)}}
    driver = {"scene": str(options.scene), "duration": float(duration), "wait_for_readers": 2}
    parameters |= zone_parameters(options.zones)
    specs = graph("demo", namespace=options.namespace, parameters={"driver": driver, **parameters})
    refuse_busy_domain([spec.name for spec in specs], options.namespace, options.domain)
    logs: list[str] = []
    supervisor = Supervisor(specs, domain=options.domain, log=_log_sink(logs, console, options))
    with interruptible():
        live = _watch(supervisor, duration, options, console, logs)
    report = {**live, "bag": str(bag), "crashes": [f"{name} (status {status})" for name, status in supervisor.crashes]}
    if report_file.exists():
        report = {**json.loads(report_file.read_text(encoding="utf-8")), **report}
        report_file.write_text(json.dumps(report, indent=1), encoding="utf-8")
    return report


def _log_sink(logs: list[str], console: Console, options: DemoOptions) -> Callable[[str, str], None]:
    def sink(name: str, line: str) -> None:
        logs.append(f"{name}: {line}")
        if options.verbose or (options.headless and ("[ERROR]" in line or "Traceback" in line)):
            console.print(f"{name}: {line}", markup=False, highlight=False, soft_wrap=True)

    return sink


def _watch(supervisor: Supervisor, duration: float, options: DemoOptions, console: Console, logs: list[str]) -> dict[str, Any]:
    """Run the nodes until the scene is over or the user has seen enough; show what happens."""
    with ros():
        monitor = Monitor(options.namespace)
        started = time.monotonic()
        interrupted, cpu = False, {}
        try:
            _show(supervisor, monitor, duration, options, console, logs)
        except KeyboardInterrupt:
            interrupted = True
        finally:
            wall = time.monotonic() - started
            cpu = {name: round(100 * used / wall, 1) for name, used in supervisor.cpu_seconds().items()}
            supervisor.stop()
            monitor.close()
    return {**monitor.figures(), "cpu_percent": cpu, "interrupted": interrupted}


def _show(supervisor: Supervisor, monitor: Monitor, duration: float, options: DemoOptions, console: Console, logs: list[str]) -> None:
    """Start the nodes, the driver last, and show what they do until the scene is over."""
    supervisor.start(without=("driver",))
    _await_nodes(supervisor, monitor, logs)
    supervisor.start()
    title = f"handwave demo: {options.scene}"
    if options.headless:
        _run(supervisor, monitor, duration, _plain_lines(monitor, console))
    else:
        with Live(monitor.render(title), console=console, refresh_per_second=8, transient=True) as display:
            _run(supervisor, monitor, duration, lambda: display.update(monitor.render(title)))


def _await_nodes(supervisor: Supervisor, monitor: Monitor, logs: list[str]) -> None:
    """Wait until every node is there and reads what it works on: nodes compile before they subscribe."""
    end = time.monotonic() + _START_TIMEOUT
    others = {spec.name for spec in supervisor.specs} - {"driver"}
    missing = _missing(monitor, others)
    while missing and time.monotonic() < end and not supervisor.poll():
        monitor.spin(0.1)
        missing = _missing(monitor, others)
    if missing:
        raise ConfigError(f"the graph did not start: {', '.join(missing)} missing.\n" + "\n".join(logs[-20:]))


def _missing(monitor: Monitor, nodes: set[str]) -> list[str]:
    """Name the nodes that are not there yet, and those that do not read their input yet."""
    missing = sorted(nodes - set(monitor.node.get_node_names()))
    for topic, readers in _READERS.items():
        present = {reader.node_name for reader in monitor.node.get_subscriptions_info_by_topic(topic)}
        missing += [f"{name} as a reader of {topic}" for name in sorted(readers & nodes - present)]
    return missing


def _run(supervisor: Supervisor, monitor: Monitor, duration: float, show: Callable[[], None]) -> None:
    """Until the driver has been through the scene: listen, look for dead nodes, show."""
    end = time.monotonic() + duration + _START_TIMEOUT
    last = (0, time.monotonic())
    while time.monotonic() < end:
        monitor.spin(0.12)
        supervisor.poll()
        show()
        if monitor.frames + monitor.skipped > last[0]:
            last = (monitor.frames + monitor.skipped, time.monotonic())
        elif last[0] and time.monotonic() - last[1] > _DRAIN:
            return
        if "driver" not in supervisor.running:
            return


def _plain_lines(monitor: Monitor, console: Console) -> Callable[[], None]:
    """Make what shows one line a second, for logs."""
    next_line = time.monotonic() + 1.0

    def show() -> None:
        nonlocal next_line
        if time.monotonic() < next_line:
            return
        next_line += 1.0
        people = len(monitor.tracks.tracks) if monitor.tracks is not None else 0
        latest = sorted(monitor.latencies[-50:])
        latency = f"{latest[len(latest) // 2] * 1e3:.1f} ms" if latest else "-"
        hand = f", hand {monitor.hand.value:.2f}" if monitor.hand is not None else ""
        gestures = ", ".join(f"{track}:{name}" for track, name, _ in list(monitor.gestures)[-2:])
        line = f"{monitor.frames:5d} frames, {people} tracks, latency {latency}{hand}, last gestures {gestures or '-'}"
        console.print(line, highlight=False)

    return show


def show_report(report: dict[str, Any], console: Console) -> None:
    """Print the table of what was recognised and the figures of the run."""
    table = Table("time [s]", "person", "performed", "recognised", "", title="gestures: performed and recognised")
    outcomes = report.get("gestures", {}).get("outcomes", [])
    first = outcomes[0]["time_s"] if outcomes else 0.0
    for row in outcomes:
        verdict = "[green]right" if row["performed"] == row["recognised"] else "[red]wrong"
        time_s = f"{row['time_s'] - first:+.1f}"
        table.add_row(time_s, str(row["person"]), row["performed"], row["recognised"] or "-", verdict)
    console.print(table)
    figures = Table(title="figures", show_header=False)
    for name, value in _figures(report):
        figures.add_row(name, value)
    console.print(figures)


def _number(value: Any, form: str, unit: str = "") -> str:
    """Format a figure; "-" where nothing is known of it."""
    return "-" if value is None else f"{value:{form}}{unit}"


def _figures(report: dict[str, Any]) -> list[tuple[str, str]]:
    rows = []
    for name, person in report.get("people", {}).items():
        seen, switches = _number(person["tracked_fraction"], ".0%"), person["identity_switches"]
        text = f"tracked {seen} of the time in view, {switches} identity switches, "
        rows.append((f"person {name}", text + f"position {_number(person['position_rms_m'], '.2f', ' m')} rms"))
    gestures, hand = report.get("gestures", {}), report.get("hand", {})
    if gestures:
        share = f" ({gestures['hits'] / gestures['total']:.0%})" if gestures["total"] else ""
        text = f"{gestures['hits']} of {gestures['total']} right{share}, {gestures['wrong']} wrong, {gestures['misses']} missed, "
        rows.append(("gestures", text + f"{gestures['false_gestures']} false"))
    followed = _number(hand.get("tracked_fraction"), ".0%")
    rows.append(("hand", f"{_number(hand.get('rms_m'), '.2f', ' m')} rms, followed {followed} of its drawing"))
    ghosts = f"{report.get('ghost_track_frames', '-')} of {report.get('track_frames', '-')} track-frames"
    rows.append(("ghosts", f"{ghosts} on nobody (gate {_number(report.get('gate_m'), '.1f', ' m')})"))
    gospa = report.get("gospa", {})
    parts = ", ".join(f"{text} {_number(gospa.get(key), '.3f')}" for key, text in _GOSPA_PARTS.items())
    rows.append(("MOTA", _number(report.get("mota"), ".1%")))
    rows.append(("GOSPA", f"{_number(gospa.get('mean_m'), '.2f', ' m')} mean; parts in m²: {parts}"))
    median, p99 = _number(report.get("latency_ms_median"), ".1f"), _number(report.get("latency_ms_p99"), ".1f")
    rows.append(("frame to tracks", f"{median} ms median, {p99} ms 99th percentile"))
    rows.append(("dropped", f"{_number(report.get('dropped_fraction'), '.2%')} of {report.get('frames')} frames"))
    rows.append(("processor", ", ".join(f"{name} {used:.0f} %" for name, used in report.get("cpu_percent", {}).items())))
    if report.get("interrupted"):
        rows.append(("interrupted", "these are the figures until then"))
    rows.append(("crashes", ", ".join(report.get("crashes", [])) or "none"))
    rows.append(("recording", str(report.get("bag"))))
    return rows
