"""Run one benchmark and print its figures."""

from __future__ import annotations

import argparse
import importlib
import inspect
import json
import os
import re
import sys
from pathlib import Path

for _pool in ("OMP", "OPENBLAS", "MKL", "NUMBA"):  # before numpy loads: second threads only fight at these sizes
    os.environ.setdefault(f"{_pool}_NUM_THREADS", "1")

_RUN = re.compile(r"^(def run\(|run = )", re.MULTILINE)


def names() -> list[str]:
    """Name the modules here that are benchmarks by themselves: those that have a function ``run``."""
    folder = Path(__file__).parent
    return sorted(path.stem for path in folder.glob("*.py") if _RUN.search(path.read_text(encoding="utf-8")))


def main() -> int:
    """Parse the command line, run the benchmark, print JSON or a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Measure Handwave: figures, and accuracy beside time.")
    parser.add_argument("name", choices=names(), help="what to measure")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--quick", action="store_true", help="small data, few repetitions: checks that it runs, not for quoting")
    parser.add_argument("--plot", type=Path, metavar="PNG", help="also draw accuracy against time")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep finished parts there; the same command goes on where it stopped")
    parser.add_argument("--full", action="store_true", help="with --keep: simulate again what is there (gestures)")
    parser.add_argument("--real", action="store_true", help="recordings of real people instead of simulated ones (gestures)")
    options = parser.parse_args()
    run = importlib.import_module(f"benchmarks.{options.name}").run
    chosen = {name: value for name in ("keep", "full", "real") if (value := getattr(options, name))}
    for name in chosen:
        if name not in inspect.signature(run).parameters:
            parser.error(f"{options.name} knows no --{name}: leave it out")
    result = {"choices": []} | run(quick=options.quick, **chosen)
    if options.plot:
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
