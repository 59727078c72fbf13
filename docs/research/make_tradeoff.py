"""Make accuracy-and-time.md and its pictures of what `handwave tradeoff` left: python docs/research/make_tradeoff.py FOLDER [NOTE].

Without FOLDER only the pictures are drawn anew, of the figures that `handwave view` shows.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

from benchmarks.plot import draw
from benchmarks.tradeoff.document import report
from benchmarks.tradeoff.stages import STAGES

HERE = Path(__file__).resolve().parent
PICTURES = "../img/tradeoff/"
SHOWN = HERE.parents[1] / "config" / "tradeoff"  # what `handwave view` shows as accuracy against time


def main() -> None:
    if len(sys.argv) > 1:
        write(Path(sys.argv[1]), " ".join(sys.argv[2:]))
    (HERE / PICTURES).mkdir(parents=True, exist_ok=True)
    for name in STAGES:
        draw(json.loads((SHOWN / f"{name}.json").read_text(encoding="utf-8"))["rows"], HERE / PICTURES / f"{name}.png")


def write(folder: Path, note: str) -> None:
    """Write the page, and keep the figures."""
    results = [json.loads((folder / f"{name}.json").read_text(encoding="utf-8")) for name in STAGES]
    quick, factor = results[0]["quick"], results[0]["device_factor"]
    if {(one["quick"], one["device_factor"]) for one in results} != {(quick, factor)}:
        sys.exit(f"{folder} holds quick and full runs, or runs of several devices; measure again")
    for one in results:
        shutil.copyfile(folder / f"{one['stage']}.json", SHOWN / f"{one['stage']}.json")
    command = "handwave tradeoff -o report" + (" --quick" if quick else "")
    text = report(results, command=command, quick=quick, factor=factor, pictures=PICTURES, note=note)
    (HERE / "accuracy-and-time.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
