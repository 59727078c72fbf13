"""Measure everything and write docs/research/benchmarks.md with its pictures: ``python -m benchmarks.document [NAME[=FILE] ...]``.

``tracking=figures.json`` takes what ``python -m benchmarks tracking --json`` printed instead of measuring, and
``gestures=speed.json,tables.json`` what its parts printed. It needs a checkout of the project: that is where the document lies.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from rich.progress import track

from benchmarks.plot import draw, markdown, scalars, tables
from benchmarks.report import Row, checkout, join
from benchmarks.tradeoff.document import machine

NAMES = (
    *(
        "graph",
        "simulator",
        "dsp",
        "tracking",
        "gestures",
        "gesture_model",
        "gestures_daily",
        "gestures_enrolled",
        "gestures_transfer",
        "hand",
        "hand_velocity",
        "hand_mars",
        "calibrate_pair",
        "calibrate_tilt",
    ),
    *("boards", "effects", "budget"),
)
HEAD = """# What accuracy costs in time

Every accuracy knob with what it achieves and what it takes, measured in one run per stage; the last column is the ratio to the one that
stands first. Absolute times drift from machine to machine, ratios less so. Made by `python -m benchmarks.document` on {machine};
one stage alone: `python -m benchmarks NAME` (`--json`, `--plot PNG`); all of them with little data, to see that they run:
`python -m benchmarks --all --quick --json`. What is not on a machine (recordings, emulated boards) is left out with a message. The same
choices beside bare references, and which of them are worth their time: [accuracy and time](accuracy-and-time.md).
"""


def table(choices: list[Row]) -> str:
    """One Markdown row per choice."""
    several = len({row["stage"] for row in choices}) > 1
    rows = []
    for row in choices:
        accuracy, taken = row["accuracy"], row["time_ms"]
        name = f"{row['stage']}: {row['choice']}" if several else row["choice"]
        name += f", {row['at']['value']:g} {row['at']['name']}" if "at" in row else ""
        value = f"{accuracy['name']} {accuracy['value']:.4g} {accuracy['unit']}".rstrip()
        rows.append((name, value, f"{taken['median']:.3f}", f"{taken['p95']:.3f}", f"{row['ratio']:.2f}"))
    header = ("choice", "accuracy", "median ms", "p95 ms", "x reference")
    return "\n".join(markdown(header, rows, ("---", "---", "---:", "---:", "---:")))


def figures(result: dict[str, Any]) -> str:
    """List the figures, and make tables of those that are told by two names; what lies deeper, as causes do, only the JSON tells."""
    flat = [(key, value) for key, value in scalars(result, levels=3) if not isinstance(value, list)]
    found = "\n".join(f"* `{key}`: {value:.4g}" if isinstance(value, float) else f"* `{key}`: {value}" for key, value in flat)
    for head, *body in tables(result):
        found += "\n\n" + "\n".join(markdown(head, body, ["---"] * 2 + ["---:"] * (len(head) - 2)))
    return found


def section(name: str, result: dict[str, Any]) -> str:
    """Write a benchmark's section, without its heading."""
    return f"\n{figures(result)}\n\n{table(result['choices'])}\n\n![accuracy against time](../img/choices_{name}.png)\n"


def apart(name: str, quick: bool = False) -> dict[str, Any]:
    """Run one benchmark in a process of its own, so that none warms the caches of another.

    Returns what it printed, or ``failed`` or ``absent`` with the end of what it said; ``seconds`` by the clock, and ``cpu_seconds``.
    """
    start, before = time.monotonic(), os.times()
    command = [sys.executable, "-m", "benchmarks", name, "--json", *(["--quick"] if quick else [])]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode == 0:
        found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    else:
        key = "absent" if done.returncode == os.EX_UNAVAILABLE else "failed"
        found = {key: (done.stderr.strip().splitlines() or [f"status {done.returncode}"])[-1]}
    after = os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return {**found, "seconds": time.monotonic() - start, "cpu_seconds": used}


def measured(name: str, file: str) -> dict[str, Any]:
    """Read the figures of a benchmark from files, or measure them. Raises SystemExit when it fails."""
    if file:
        return join(json.loads(Path(part).read_text(encoding="utf-8").splitlines()[-1]) for part in file.split(","))
    found = apart(name)
    del found["seconds"], found["cpu_seconds"]
    if why := found.get("failed") or found.get("absent"):
        sys.exit(f"{name}: {why}")
    return found


def main() -> None:
    """Run each benchmark (all, or those named), and write its section."""
    docs = checkout("docs")
    path = docs / "research" / "benchmarks.md"
    parts = path.read_text(encoding="utf-8").split("\n## ")[1:] if path.exists() else []
    kept = dict(part.split("\n", 1) for part in parts)
    for argument in track(sys.argv[1:] or NAMES, description="measuring"):
        name, _, file = argument.partition("=")
        result = measured(name, file)
        draw(result["choices"], docs / "img" / f"choices_{name}.png")
        kept[name] = section(name, result)
        body = "".join(f"\n## {one}\n{kept[one]}" for one in NAMES if one in kept)
        path.write_text(HEAD.format(machine=machine()) + body, encoding="utf-8")  # after each: the slow ones come last


if __name__ == "__main__":
    main()
