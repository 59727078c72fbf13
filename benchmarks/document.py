"""Measure everything and write docs/benchmarks.md with one picture per stage: ``python -m benchmarks.document``."""

from __future__ import annotations

import json
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

from rich.progress import track

from benchmarks.plot import draw

ROOT = Path(__file__).resolve().parent.parent
NAMES = ("simulator", "baseband", "tracking", "gestures", "graph")
HEAD = """# What accuracy costs in time

Every accuracy knob with what it achieves and what it takes, measured in one run per stage; the last column is the ratio to the one that
stands first. Absolute times drift from machine to machine, ratios less so. Made by `python -m benchmarks.document` on {machine};
one stage alone: `python -m benchmarks NAME` (`--json`, `--plot PNG`).
"""


def table(choices: list[dict[str, Any]]) -> str:
    """One Markdown row per choice."""
    rows = ["| choice | accuracy | median ms | p95 ms | x reference |", "|---|---|---:|---:|---:|"]
    for row in choices:
        accuracy, time = row["accuracy"], row["time_ms"]
        value = f"{accuracy['name']} {accuracy['value']:.4g} {accuracy['unit']}".rstrip()
        rows.append(f"| {row['choice']} | {value} | {time['median']:.3f} | {time['p95']:.3f} | {row['ratio']:.2f} |")
    return "\n".join(rows)


def figures(result: dict[str, Any]) -> str:
    """List the flat figures."""
    flat = {key: value for key, value in result.items() if key != "choices" and not isinstance(value, (dict, list))}
    return "\n".join(f"* `{key}`: {value:.4g}" if isinstance(value, float) else f"* `{key}`: {value}" for key, value in flat.items())


def main() -> None:
    """Run each benchmark in a process of its own, so that none warms the caches of another."""
    parts = [HEAD.format(machine=f"{platform.system()} {platform.machine()}, Python {platform.python_version()}")]
    for name in track(NAMES, description="measuring"):
        done = subprocess.run([sys.executable, "-m", "benchmarks", name, "--json"], cwd=ROOT, check=True, capture_output=True, text=True)
        result = json.loads(done.stdout.splitlines()[-1])
        draw(result["choices"], ROOT / "docs" / "img" / f"choices_{name}.png")
        parts.append(f"## {name}\n\n{figures(result)}\n\n{table(result['choices'])}\n\n![accuracy against time](img/choices_{name}.png)\n")
    (ROOT / "docs" / "benchmarks.md").write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
