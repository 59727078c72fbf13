"""Gestures: the thesis's tables, another simulated world, streams, several users, and speed; or, with --real, real people.

``--keep FOLDER`` holds what was simulated: the first run takes hours, the next one minutes. ``--full`` simulates it all again.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any, Final

from benchmarks import gesture_crowds, gesture_knobs, gesture_networks, gesture_streams, gesture_tables, gesture_worlds, gestures_speed
from benchmarks.report import join
from benchmarks.stores import kept

_OURS: Final = ("tables", "knobs", "worlds", "streams", "crowds")  # folders within the one that --keep names


def measure(folder: Path, quick: bool, n_jobs: int) -> dict[str, Any]:
    """Measure everything that needs no recordings."""
    parts = [
        gestures_speed.figures(quick),
        gesture_tables.measure(folder / "tables", quick, n_jobs),
        gesture_networks.measure(folder / "tables", quick, n_jobs),
        gesture_knobs.run(quick, folder / "knobs", n_jobs),
        gesture_worlds.run(quick, folder / "worlds", n_jobs),
        gesture_streams.run(quick, folder / "streams", n_jobs),
        gesture_crowds.run(quick, folder / "crowds", n_jobs),
    ]
    return join(parts)


def run(quick: bool = False, keep: Path | None = None, real: bool = False, full: bool = False) -> dict[str, Any]:
    """Measure gestures: our own, or with ``real`` those of `gestures_real`; ``full``: simulate anew what ``keep`` holds."""
    if real:
        from benchmarks import gestures_real

        return gestures_real.run(quick, None if keep is None else keep / "real")
    n_jobs = 1 if quick else os.cpu_count() or 1
    with kept(keep) as folder:
        for name in _OURS if full else ():
            shutil.rmtree(folder / name, ignore_errors=True)
        return measure(folder, quick, n_jobs)
