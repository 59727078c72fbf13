"""Measure everything and write docs/benchmarks.md with one picture per stage: ``python -m benchmarks.document [NAME[=FILE] ...]``.

``tracking=figures.json`` takes what ``python -m benchmarks tracking --json`` printed instead of measuring, and
``gestures=speed.json,tables.json`` what its parts printed.
"""

from __future__ import annotations

import json
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

from rich.progress import track

from benchmarks.plot import draw, scalars, tables
from benchmarks.report import join

ROOT = Path(__file__).resolve().parent.parent
NAMES = (
    *("graph", "simulator", "dsp", "tracking", "gestures", "gesture_model", "hand", "hand_velocity", "hand_mars", "calibrate_pair"),
    *("boards", "effects", "budget"),
)
HEAD = """# What accuracy costs in time

Every accuracy knob with what it achieves and what it takes, measured in one run per stage; the last column is the ratio to the one that
stands first. Absolute times drift from machine to machine, ratios less so. Made by `python -m benchmarks.document` on {machine};
one stage alone: `python -m benchmarks NAME` (`--json`, `--plot PNG`).
"""


def table(choices: list[dict[str, Any]]) -> str:
    """One Markdown row per choice."""
    several = len({row["stage"] for row in choices}) > 1
    rows = ["| choice | accuracy | median ms | p95 ms | x reference |", "|---|---|---:|---:|---:|"]
    for row in choices:
        accuracy, time = row["accuracy"], row["time_ms"]
        name = f"{row['stage']}: {row['choice']}" if several else row["choice"]
        name += f", {row['at']['value']:g} {row['at']['name']}" if "at" in row else ""
        value = f"{accuracy['name']} {accuracy['value']:.4g} {accuracy['unit']}".rstrip()
        rows.append(f"| {name} | {value} | {time['median']:.3f} | {time['p95']:.3f} | {row['ratio']:.2f} |")
    return "\n".join(rows)


def figures(result: dict[str, Any]) -> str:
    """List the figures, and make tables of those that are told by two names; what lies deeper, as causes do, only the JSON tells."""
    flat = [(key, value) for key, value in scalars(result, levels=3) if not isinstance(value, list)]
    found = "\n".join(f"* `{key}`: {value:.4g}" if isinstance(value, float) else f"* `{key}`: {value}" for key, value in flat)
    for head, *body in tables(result):
        lines = [head, ["---"] * 2 + ["---:"] * (len(head) - 2), *body]
        found += "\n\n" + "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
    return found


def sections(text: str) -> dict[str, str]:
    """Split the document into its sections by name."""
    parts = text.split("\n## ")[1:]
    return {part.split("\n", 1)[0]: part.split("\n", 1)[1] for part in parts}


def measure(name: str) -> str:
    """Run one benchmark in a process of its own; returns what it printed."""
    command = [sys.executable, "-m", "benchmarks", name, "--json"]
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout


def main() -> None:
    """Run each benchmark (all, or those named) in a process of its own, so that none warms the caches of another."""
    path = ROOT / "docs" / "benchmarks.md"
    kept = sections(path.read_text(encoding="utf-8")) if path.exists() else {}
    head = HEAD.format(machine=f"{platform.system()} {platform.machine()}, Python {platform.python_version()}")
    for argument in track(sys.argv[1:] or NAMES, description="measuring"):
        name, _, file = argument.partition("=")
        printed = [Path(part).read_text(encoding="utf-8") for part in file.split(",")] if file else [measure(name)]
        result = join(json.loads(text.splitlines()[-1]) for text in printed)
        draw(result["choices"], ROOT / "docs" / "img" / f"choices_{name}.png")
        kept[name] = f"\n{figures(result)}\n\n{table(result['choices'])}\n\n![accuracy against time](img/choices_{name}.png)\n"
        body = "".join(f"\n## {section}\n{kept[section]}" for section in NAMES if section in kept)
        path.write_text(head + body, encoding="utf-8")  # after each: the slow ones come last


if __name__ == "__main__":
    main()
