"""What a newcomer sees: set-up in a fresh clone with a fresh home, how soon a first frame comes, and the demo beside two busy loops.

The full run clones the checkout (what is committed), installs everything from the package index and takes some minutes; a quick one shows
a short scene with the environment that it runs in.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.report import checkout
from radar_core import DataError

_BUSY = 2  # loops that take all they get, beside the demo
_SETUP = 1800.0  # s: longest time for the set-up
_DEMO = 300.0  # s: and for a demo
_INHERITED = ("PATH", "LANG", "ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE", "PIP_INDEX_URL", "PIP_CERT", "SSL_CERT_FILE")
"""What the newcomer's shell has of ours: no caches, and nothing that is set for this project."""


def run(quick: bool = False) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if quick:
            with _busy():
                loaded = _demo(
                    [sys.executable, "-m", "radar_app.cli"], folder / "loaded", dict(os.environ), ("--scene", "short", "--duration", "4")
                )
            return {**_figures(loaded), **_under_load(loaded)}
        handwave, environment, setup_s = _set_up(folder)
        alone = _demo([handwave], folder / "alone", environment)
        with _busy():
            loaded = _demo([handwave], folder / "loaded", environment)
    return {"setup_s": setup_s, "load_before": os.getloadavg()[0], **_figures(alone), **_under_load(loaded)}


def _set_up(folder: Path) -> tuple[str, dict[str, str], float]:
    """Clone and set up as a newcomer does; gives the command, the newcomer's environment, and how long it took [s]."""
    clone, home = folder / "handwave", folder / "home"
    home.mkdir()
    environment = {name: os.environ[name] for name in _INHERITED if name in os.environ} | {"HOME": str(home)}
    environment |= {name: value for name, value in os.environ.items() if name.lower().endswith("_proxy")}
    subprocess.run(["git", "clone", "--quiet", str(checkout(".git").parent), str(clone)], check=True)
    started = time.monotonic()
    done = subprocess.run(["make", "setup"], cwd=clone, env=environment, capture_output=True, text=True, timeout=_SETUP)
    if done.returncode:
        raise DataError(f"make setup failed with status {done.returncode}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    print(done.stdout, file=sys.stderr)
    return str(clone / ".venv" / "bin" / "handwave"), environment, time.monotonic() - started


@contextmanager
def _busy() -> Iterator[None]:
    """Keep processors busy meanwhile."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(_BUSY)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def _demo(command: Sequence[str], bag: Path, environment: dict[str, str], more: Sequence[str] = ()) -> dict[str, Any]:
    """Show the demo; gives its report, with its exit ``status``."""
    words = [*command, "demo", "--headless", "--json", "--bag", str(bag), *more]
    done = subprocess.run(words, cwd=bag.parent, env=environment, capture_output=True, text=True, timeout=_DEMO)
    if not done.stdout.strip():
        raise DataError(f"the demo said nothing, status {done.returncode}:\n{done.stderr[-2000:]}")
    return {**json.loads(done.stdout.splitlines()[-1]), "status": done.returncode}


def _figures(report: dict[str, Any]) -> dict[str, Any]:
    gestures = report["gestures"]
    return {
        "first_frame_after_setup_s": report["first_frame_s"],
        "demo_gestures": gestures["total"],
        "demo_gestures_right": gestures["hits"],
        "demo_gestures_wrong": gestures["wrong"],
        "demo_gestures_missed": gestures["misses"],
        "demo_gestures_false": gestures["false_gestures"],
        "demo_dropped_fraction": report["dropped_fraction"],
    }


def _under_load(report: dict[str, Any]) -> dict[str, Any]:
    """Say whether the demo went to its end beside the busy loops, saw everybody, and named no gesture wrong."""
    gestures, people = report["gestures"], report["people"].values()
    whole = report["status"] == 0 and not report["missing"] and not report["crashes"]
    return {
        "demo_under_load_ok": bool(whole and gestures["wrong"] == 0 and all(person["tracked_fraction"] for person in people)),
        "demo_under_load_gestures": gestures["total"],
        "demo_under_load_gestures_right": gestures["hits"],
        "demo_under_load_gestures_wrong": gestures["wrong"],
        "demo_under_load_gestures_missed": gestures["misses"],
        "demo_under_load_dropped_fraction": report["dropped_fraction"],
        "demo_under_load_first_frame_s": report["first_frame_s"],
    }
