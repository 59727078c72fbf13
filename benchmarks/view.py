"""The live page over a running graph: pictures a second, and what it adds to the latency from a frame to its tracks."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import psutil

from benchmarks.graph import DOMAIN, nodes
from benchmarks.report import AbsentError, choice
from radar_app.live import Monitor
from radar_app.supervisor import Supervisor, environment, refuse_busy_domain
from radar_core import HandwaveError
from radar_ros.interrupts import ros

FLAGS: Final = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--window-size=1300,1000", "--remote-debugging-port=0",
)  # fmt: skip
_START: Final = 90.0  # s: for nodes, page and browser to be there
_SETTLE: Final = (1.0, 4.0)  # s: after a change, before anything is measured
_SECONDS: Final = (3.0, 15.0)  # of each turn
_TURNS: Final = (1, 4)  # with the page, and beside as much load without it
_SLICE: Final = 0.02  # s: the load works for a share of so long, then rests
_DRAWN: Final = "return Bokeh.documents.length ? Bokeh.documents[0].get_model_by_name('drawn').data.n[0] : 0"
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


@contextlib.contextmanager
def page(folder: Path) -> Iterator[tuple[Any, list[int]]]:
    """Open the page in a browser beside a graph; yields what drives the browser, and the process ids of page and browser."""
    from selenium.webdriver import Chrome, ChromeOptions
    from selenium.webdriver.chrome.service import Service

    command = [sys.executable, "-m", "radar_app", "view", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        driver: Any = None
        try:
            assert server.stdout is not None
            address = server.stdout.readline().strip()
            options = ChromeOptions()
            options.binary_location = str(shutil.which("chromium"))
            for flag in (*FLAGS, f"--user-data-dir={folder / 'profile'}"):
                options.add_argument(flag)
            driver = Chrome(options=options, service=Service(str(shutil.which("chromedriver"))))
            driver.get(address)
            yield driver, [server.pid, driver.service.process.pid]
        finally:
            if driver is not None:
                driver.quit()
            server.send_signal(signal.SIGINT)


def used(pids: list[int]) -> float:
    """Processor time that processes and their children have used [s]."""
    total = 0.0
    for parent in map(psutil.Process, pids):
        for process in (parent, *parent.children(recursive=True)):
            with contextlib.suppress(psutil.Error):
                times = process.cpu_times()
                total += times.user + times.system
    return total


@contextlib.contextmanager
def load(cores: float) -> Iterator[None]:
    """Keep so many cores busy, each process its share of every 20 ms, as a page that is drawn does."""
    shares = [min(1.0, cores - k) for k in range(int(np.ceil(cores)))]
    code = "import sys,time\nshare=float(sys.argv[1])\nwhile 1:\n end=time.thread_time()+share*{0}\n began=time.monotonic()\n"
    code += " while time.thread_time()<end: pass\n time.sleep(max(0.0,{0}-(time.monotonic()-began)))\n"
    busy = [subprocess.Popen([sys.executable, "-c", code.format(_SLICE), str(share)]) for share in shares]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


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


def measure(folder: Path, quick: bool) -> dict[str, Any]:
    """Measure in turns: with the page in a browser, and beside as much load without it."""
    scene = folder / "four.yaml"
    scene.write_text(_SCENE, encoding="utf-8")
    os.environ.update(environment(DOMAIN))
    refuse_busy_domain([spec.label for spec in nodes(str(scene))], "", DOMAIN)
    settle, seconds, turns = (pair[0] if quick else pair[1] for pair in (_SETTLE, _SECONDS, _TURNS))
    with_page: list[float] = []
    without: list[float] = []
    rates, shares = [], []
    with Supervisor(nodes(str(scene)), domain=DOMAIN, log=lambda name, line: None), ros():
        monitor = Monitor()
        try:
            until(lambda: monitor.latencies, monitor, "tracks")
            for _ in range(turns):
                with page(folder) as (driver, pids):
                    until(
                        lambda d=driver: d.execute_script(_DRAWN) and (quick or d.execute_script(_PEOPLE) >= 4),
                        monitor,
                        "a picture of four people",
                    )
                    monitor.spin(settle)
                    began, drawn, cpu = time.monotonic(), driver.execute_script(_DRAWN), used(pids)
                    with_page += latencies(monitor, 0.0, seconds)
                    wall = time.monotonic() - began
                    rates.append((driver.execute_script(_DRAWN) - drawn) / wall)
                    shares.append((used(pids) - cpu) / wall)
                with load(shares[-1]):
                    without += latencies(monitor, settle, seconds)
        finally:
            monitor.close()
    return figures(with_page, without, rates, shares)


def figures(with_page: list[float], without: list[float], rates: list[float], shares: list[float]) -> dict[str, Any]:
    """Put the figures together; latencies in milliseconds."""
    if not with_page or not without:
        raise HandwaveError("no latencies were heard: is the machine too busy for the graph?")
    (median, p99), (median_load, p99_load) = (np.percentile(each, (50, 99)) for each in (with_page, without))
    rows = [
        choice("live page", name, accuracy=("pictures a second", rate, "1/s"), times_ms=times, reference_ms=without)
        for name, rate, times in (("load without a page", 0.0, without), ("page in a browser", float(np.mean(rates)), with_page))
    ]
    return {
        "updates_per_s": float(np.mean(rates)),
        "updates_per_s_worst_turn": min(rates),
        "latency_median_ratio": float(median / median_load),
        "latency_p99_ratio": float(p99 / p99_load),
        "latency_ms_median": float(median),
        "latency_ms_p99": float(p99),
        "load_latency_ms_median": float(median_load),
        "load_latency_ms_p99": float(p99_load),
        "page_cores": float(np.mean(shares)),
        "frames": len(with_page),
        "turns": len(rates),
        "choices": rows,
    }


def run(quick: bool) -> dict[str, Any]:
    """Measure with four people at 50 Hz; an AbsentError says that there is no browser to drive."""
    if shutil.which("chromium") is None or shutil.which("chromedriver") is None:
        raise AbsentError("no chromium with chromedriver here: apt-get install chromium chromium-driver")
    try:
        import selenium  # noqa: F401
    except ImportError:
        raise AbsentError("no selenium here: pip install 'handwave[test]'") from None
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        return measure(Path(folder), quick)
