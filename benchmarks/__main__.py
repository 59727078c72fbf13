"""Run one benchmark and print its figures, or all of them one after the other."""

from __future__ import annotations

import argparse
import functools
import importlib.util
import inspect
import json
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

for _pool in ("OMP", "OPENBLAS", "MKL", "NUMBA"):  # before numpy loads: second threads only fight at these sizes
    os.environ.setdefault(f"{_pool}_NUM_THREADS", "1")

from benchmarks.report import AbsentError
from benchmarks.tradeoff.stages import STAGES

_RUN = re.compile(r"^(def run\(|run = )", re.MULTILINE)
PARTS: Final = {
    "simulator": ("propagation",),
    "gestures": (
        *("gesture_crowds", "gesture_knobs", "gesture_networks", "gesture_streams", "gesture_tables", "gesture_worlds", "gestures_speed"),
    ),
    "tracking": ("stone_soup",),
}
"""Benchmarks that others contain: ``--all`` does not run them a second time."""


def names() -> list[str]:
    """Name the modules here with a function ``run``, and the other stages of `handwave tradeoff`."""
    folder = Path(__file__).parent
    return sorted({path.stem for path in folder.glob("*.py") if _RUN.search(path.read_text(encoding="utf-8"))} | STAGES.keys())


def stage(name: str, quick: bool) -> dict[str, Any]:
    """Measure a stage of `handwave tradeoff` that is no benchmark of its own."""
    from benchmarks.stores import kept
    from benchmarks.tradeoff.stages import StudyConfig

    with kept(None) as folder:
        found = STAGES[name].measure(StudyConfig(folder, quick))
    return {"left_out": found.left_out, "choices": found.rows}


def runner(name: str) -> Callable[..., dict[str, Any]]:
    """Find what measures a benchmark."""
    if importlib.util.find_spec(f"benchmarks.{name}") is None:
        return functools.partial(stage, name)
    found: Callable[..., dict[str, Any]] = importlib.import_module(f"benchmarks.{name}").run
    return found


def everything(quick: bool) -> tuple[dict[str, Any], bool]:
    """Run every benchmark in a process of its own; returns the results by name with their times, and whether none failed."""
    from rich.console import Console
    from rich.progress import track

    from benchmarks.document import apart

    contained = {part for parts in PARTS.values() for part in parts}
    console, found, good = Console(stderr=True), {}, True
    for name in track([name for name in names() if name not in contained], "measuring", console=console, transient=True):
        found[name] = apart(name, quick)
        failed = found[name].get("failed")
        good = good and not failed
        told = found[name].get("absent") or failed or "done"
        console.print(f"{name}: {told} ({found[name]['seconds']:.0f} s)", highlight=False, markup=False)
    return {"benchmarks": found, **{key: sum(one[key] for one in found.values()) for key in ("seconds", "cpu_seconds")}}, good


def main() -> int:
    """Parse the command line, run the benchmark, print JSON or a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Measure Handwave: figures, and accuracy beside time.")
    parser.add_argument("name", nargs="?", choices=names(), help="what to measure")
    parser.add_argument("--all", action="store_true", help="every benchmark, each in a process of its own")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--quick", action="store_true", help="small data, few repetitions: checks that it runs, not for quoting")
    parser.add_argument("--plot", type=Path, metavar="PNG", help="also draw accuracy against time")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep finished parts there; the same command goes on where it stopped")
    parser.add_argument("--full", action="store_true", help="with --keep: simulate again what is there (gestures)")
    parser.add_argument("--real", action="store_true", help="recordings of real people instead of simulated ones (gestures)")
    kinds = ("develop", "choose", "figure")
    parser.add_argument("--kind", choices=(*kinds, "all"), help="which recordings: default those for the figure (people_real)")
    parser.add_argument(
        "--seeds", choices=(*kinds, "first"), help="which scenes: to develop or to choose on; default those for the figure (rooms, suite)"
    )
    parser.add_argument(
        "--parts",
        metavar="A,B",
        help="some of zones, vital, hand, approaches, tracking; parsers (fuzz), groups (faults), trackers (people_real)",
    )
    parser.add_argument("--hours", type=float, metavar="H", help="how long (soak); default: 1")
    options = parser.parse_args()
    chosen = {name: value for name in ("keep", "full", "real", "kind", "seeds", "parts", "hours") if (value := getattr(options, name))}
    if options.all == bool(options.name) or (options.all and (chosen or options.plot)):
        parser.error("name one benchmark, or give --all and no other option than --json and --quick")
    if options.all:
        result, good = everything(options.quick)
        print(json.dumps(result) if options.json else f"{result['seconds']:.0f} s in all")
        return 0 if good else 1
    try:
        run = runner(options.name)
        for name in chosen:
            if name not in inspect.signature(run).parameters:
                parser.error(f"{options.name} knows no --{name}: leave it out")
        result = {"choices": []} | run(quick=options.quick, **chosen)
    except AbsentError as error:
        print(f"{options.name} is left out: {error}", file=sys.stderr)
        return os.EX_UNAVAILABLE
    if options.plot and not result["choices"]:
        print(f"{options.name} compares no choices: no plot", file=sys.stderr)
    elif options.plot:
        from benchmarks.plot import draw

        draw(result["choices"], options.plot)
    if options.json:
        print(json.dumps(result))
    else:
        from benchmarks.plot import show

        show(result)
    return 0


if __name__ == "__main__":
    sys.exit(main())
