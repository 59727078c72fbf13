"""Levels that a time budget chooses from: as a stage of the report, and as a file for nodes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from benchmarks.tradeoff.plot import draw
from benchmarks.tradeoff.rows import Found, Panel, Row
from benchmarks.tradeoff.settings import Settings
from benchmarks.tradeoff.tune import DEFAULTS, FIGURE, Tuned, tune
from radar_core.ladder import save_ladders

LEVELS: Final = "levels.json"
_REFERENCE: Final = "the default at every frame"
BASEBAND: Final = Panel("levels of the baseband", FIGURE, "m", "lower", DEFAULTS["baseband"], _REFERENCE)
TRACKING: Final = Panel("levels of the tracking", FIGURE, "m", "lower", DEFAULTS["tracking"], _REFERENCE)


def rows(found: Tuned) -> list[Row]:
    """Make a row of everything that was measured of a stage; times are those for each frame of the radar."""
    panel = {"baseband": BASEBAND, "tracking": TRACKING}[found.ladder.stage]
    default = next(one for one in found.candidates if one.level.name == panel.default)
    made = []
    for one in found.candidates:
        times = [value / one.every for value in one.times_ms]
        made.append(panel.row(one.level.name, one.judge.mean, times, default.times_ms, margin=one.judge.margin(default.judge)))
    return made


def measure(settings: Settings) -> Found:
    """Compare all candidates for levels of the baseband and the tracking; `handwave tradeoff --tune` keeps some of them for the nodes."""
    return Found([row for found in tune(settings, progress=False) for row in rows(found)])


def write(folder: Path, found: Sequence[Tuned]) -> None:
    """Write levels for nodes, and a picture of all that was measured."""
    save_ladders(folder / LEVELS, [one.ladder for one in found])
    draw([row for one in found for row in rows(one)], folder / "levels.png")
