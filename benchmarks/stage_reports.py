"""What it costs that a stage reports on each message: processor time of the stage and of who reads it, alone and some together."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, Final

import rclpy

from benchmarks.report import Panel
from radar_app.supervisor import environment
from radar_core import HandwaveError
from radar_ros import qos, reports
from radar_ros.executor import make_executor
from radar_ros.stage import StageNode

DOMAIN: Final = 150 + (os.getpid() + 60) % 80
PANEL: Final = Panel("reports of stages", "reports that came", "", "higher", "0.2 s together", "each alone")
_MODES: Final = {"each alone": 0.0, "0.2 s together": reports.TOGETHER}
_READERS: Final = ("as it is", "read")  # as the recorder takes it, and as `handwave watch` does
_ROUNDS: Final = (1, 5)
_REPORTS: Final = (500, 2500)
_RATE: Final = 250.0  # reports in a second of this machine's time; their stamps are those of 50 Hz
_FRAME_NS: Final = 20_000_000
_WAIT: Final = 20.0  # s
_SETTLE: Final = 0.6  # s


def _used() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _spin(executor: Any, seconds: float, done: Callable[[], bool] = lambda: False) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end and not done():
        executor.spin_once(timeout_sec=0.1)


def report(count: int, together: float) -> None:
    """Report on so many messages, and print the processor time of it [s]; in a process of its own."""
    reports.TOGETHER = together  # type: ignore[misc]
    node, executor = StageNode("tracking"), make_executor()
    executor.add_node(node)
    _spin(executor, _WAIT, lambda: node.reports.publisher.get_subscription_count() >= len(_READERS))
    _spin(executor, _SETTLE)
    before, start = _used(), time.monotonic()
    for k in range(count):
        node.finish(10**9 + k * _FRAME_NS, k, time.monotonic_ns())
        time.sleep(max(start + (k + 1) / _RATE - time.monotonic(), 0.0))
    node.reports.send()
    print(_used() - before, flush=True)
    _spin(executor, _SETTLE)


def listen(parsed: bool) -> None:
    """Count reports until told to end, and print how many came, and the processor time since the first [s]; in a process of its own."""
    from handwave.msg import StageStatus
    from rclpy.serialization import deserialize_message

    from radar_app.watching.reports import reports_from_msg

    node, executor, heard = rclpy.create_node(f"reader_{os.getpid()}"), make_executor(), list[Any]()
    executor.add_node(node)
    count, ended, before = 0, threading.Event(), 0.0

    def take(msg: Any) -> None:
        nonlocal count, before
        before = before or _used()
        if parsed:
            count += len([*reports_from_msg(msg)])
        else:
            heard.append(msg)

    node.create_subscription(StageStatus, "stage_status", take, qos.sensor(reliable=True), raw=not parsed)
    threading.Thread(target=lambda: (sys.stdin.readline(), ended.set()), daemon=True).start()
    print("ready", flush=True)
    _spin(executor, 10 * _WAIT, ended.is_set)
    used = _used() - before
    count += sum(len([*reports_from_msg(deserialize_message(data, StageStatus))]) for data in heard)
    print(count, used, flush=True)


def _once(mode: str, count: int) -> dict[str, float]:
    """Run a stage and its readers once; returns processor time per report of each [ms], and the least share of reports that came."""
    command, env = [sys.executable, "-m", "benchmarks.stage_reports"], environment(DOMAIN)
    readers = {
        name: subprocess.Popen([*command, "listen", name], env=env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for name in _READERS
    }
    try:
        for reader in readers.values():
            assert reader.stdout is not None
            reader.stdout.readline()
        sent = subprocess.run([*command, "report", str(count), str(_MODES[mode])], env=env, stdout=subprocess.PIPE, text=True)
        told = {name: reader.communicate("\n", timeout=_WAIT)[0].split() for name, reader in readers.items()}
    finally:
        for reader in readers.values():
            reader.kill()
            reader.wait()
    if sent.returncode or not all(told.values()):
        raise HandwaveError("a stage and its readers did not find each other; is this machine too busy?")
    times = {"stage": float(sent.stdout)} | {name: float(used) for name, (_, used) in told.items()}
    came = min(int(number) for number, _ in told.values()) / count
    return {**{name: 1e3 * used / count for name, used in times.items()}, "came": came}


def run(quick: bool) -> dict[str, Any]:
    """Compare both in turn."""
    found: dict[str, list[dict[str, float]]] = {mode: [] for mode in _MODES}
    for _ in range(_ROUNDS[not quick]):
        for mode, rounds in found.items():
            rounds.append(_once(mode, _REPORTS[not quick]))
    parts = ("stage", *_READERS)
    sums = {mode: [sum(one[part] for part in parts) for one in rounds] for mode, rounds in found.items()}
    reference = sums["each alone"]
    rows = [PANEL.row(mode, min(one["came"] for one in found[mode]), times, reference) for mode, times in sums.items()]
    middle = {mode: {part: sorted(one[part] for one in rounds)[len(rounds) // 2] for part in parts} for mode, rounds in found.items()}
    return {"cpu_ms_per_report": middle, "choices": rows}


if __name__ == "__main__":
    rclpy.init(args=[])
    if sys.argv[1] == "report":
        report(int(sys.argv[2]), float(sys.argv[3]))
    else:
        listen(sys.argv[2] == "read")
    sys.stdout.flush()
    os._exit(0)  # what is measured is over
