"""Whether `handwave doctor` names the right fault first on fourteen recordings with one each, and nothing on three healthy ones.

The checks were written and their limits chosen on recordings with numbers from `DEVELOPED` on (three sets of sixteen, and healthy rooms of
`doctor_bags.DEVELOPED_TOO`); the figure is about the sixteen from `FIGURE` on.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from typer.testing import CliRunner

from benchmarks.doctor_bags import DEVELOPED_TOO, FAULTS, HEALTHY, Case
from benchmarks.report import share, timed

DEVELOPED: Final = 1000  # number of the first recording that was looked at while the checks were written
FIGURE: Final = 4000  # of the first recording of the figure; those from 2000 and from 3000 on were looked at with earlier code
_QUICK: Final = ("drops", "radar info missing")


def diagnose(bag: Path, case: Case) -> list[str]:
    """Ask the command about a bag; gives the faults that it names, the likeliest first."""
    from radar_app.cli import app

    told = [word for name, value in case.told.items() for word in (f"--{name}", str(value))]
    done = CliRunner().invoke(app, ["doctor", str(bag), "--json", *told])
    if done.exit_code not in (0, 1):
        raise RuntimeError(f"handwave doctor {bag} ended with status {done.exit_code}: {done.output}") from done.exception
    faults: list[str] = json.loads(done.stdout)["faults"]
    return faults


def judge(cases: Sequence[Case], first: int) -> dict[str, Any]:
    """Make the recordings with numbers from ``first`` on, one after the other, and ask about each."""
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="handwave_doctor_") as folder:
        for number, case in enumerate(cases):
            bag = Path(folder) / f"bag_{number}"
            case.make(bag, first + number)
            found, took = timed(diagnose, bag, case)
            rows.append({"is": case.fault, "named": found, "doctor_s": took * 1e-3})
            for file in bag.iterdir():
                file.unlink()
    sick = [row for row in rows if row["is"]]
    right = sum(row["named"][:1] == [row["is"]] for row in sick)
    alarms = sum(bool(row["named"]) for row in rows if not row["is"])
    figures = {"right": right, **share("right_share", right, len(sick)), "bags_with_a_fault": len(sick)}
    return {**figures, "false_alarms": alarms, **share("false_share", alarms, len(rows) - len(sick)), "bags": rows}


def run(quick: bool) -> dict[str, Any]:
    """Name the faults; quick: two of them and one healthy room, of those that the limits were chosen on."""
    if quick:
        return judge([*(case for case in FAULTS if case.fault in _QUICK), DEVELOPED_TOO[1]], DEVELOPED)
    return judge([*FAULTS, *HEALTHY], FIGURE)
