"""Gestures and people of a bag as tables: for a terminal, as CSV, as JSON."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from radar_app.showing.results import GestureRow, PersonRow, Results
from radar_app.watching.people import finite

COLUMNS: Final = (
    "kind",
    "namespace",
    "person",
    "start_s",
    "end_s",
    "gesture",
    "confidence",
    "x_m",
    "y_m",
    "z_m",
    "walked_m",
    "mean_points",
    "zones",
)
"""Of the CSV: a row is a gesture or a person; of a person x, y, z are where it was last; what a kind has not is empty."""

POSITIONS: Final = ("namespace", "person", "time_s", "x_m", "y_m", "z_m", "vx_mps", "vy_mps", "vz_mps", "points")
"""Of the CSV of positions: a row for every person and message of tracks."""


def records(results: Results) -> list[dict[str, Any]]:
    """Make one record of each gesture and each person, in the order in which they began."""
    rows = [*map(_gesture, results.gestures), *map(_person, results.people)]
    return sorted(rows, key=lambda row: float(row["start_s"]))


def _gesture(row: GestureRow) -> dict[str, Any]:
    about = {"kind": "gesture", "namespace": row.namespace, "person": row.person, "start_s": row.start, "end_s": row.end}
    place = dict(zip(("x_m", "y_m", "z_m"), row.position, strict=True))
    return {**about, "gesture": row.gesture, "confidence": row.confidence, **place, "zones": " ".join(row.zones)}


def _person(row: PersonRow) -> dict[str, Any]:
    about = {"kind": "person", "namespace": row.namespace, "person": row.person, "start_s": row.time[0], "end_s": row.time[-1]}
    place = dict(zip(("x_m", "y_m", "z_m"), row.position[-1].tolist(), strict=True))
    return {**about, **place, "walked_m": row.walked, "mean_points": float(np.mean(row.points))}


def as_csv(results: Results) -> str:
    """Write gestures and people as CSV, with `COLUMNS`."""
    return _csv(COLUMNS, [[_cell(record.get(name)) for name in COLUMNS] for record in records(results)])


def positions_csv(results: Results) -> str:
    """Write where everybody was at every moment as CSV, with `POSITIONS`."""
    lines: list[list[Any]] = []
    for row in results.people:
        for now, place, speed, points in zip(row.time, row.position, row.velocity, row.points, strict=True):
            lines.append([row.namespace, row.person, *(f"{value:.4f}" for value in (now, *place, *speed)), int(points)])
    return _csv(POSITIONS, lines)


def _csv(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return text.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, float):
        return f"{value:.4f}" if np.isfinite(value) else ""
    return "" if value is None else value


def as_json(results: Results) -> dict[str, Any]:
    """Make what JSON holds: times in seconds since the recording began, places in metres; None where nothing is known."""
    rows = records(results)
    gestures, people = ([row for row in rows if row["kind"] == kind] for kind in ("gesture", "person"))
    found: dict[str, Any] = finite({"bag": str(results.path), "start_ns": results.start_ns, "gestures": gestures, "people": people})
    return found


def screen(results: Results) -> RenderableType:
    """Draw both tables for a terminal."""
    several = len({row.namespace for row in results.people} | {row.namespace for row in results.gestures}) > 1
    people, gestures = _table("people", several), _table("gestures", several)
    for name in ("from [s]", "to [s]", "walked [m]", "first at x, y [m]", "last at x, y [m]", "points"):
        people.add_column(Text(name), justify="right")
    for name in ("at [s]", "for [s]"):
        gestures.add_column(Text(name), justify="right")
    gestures.add_column("gesture")
    gestures.add_column("sure", justify="right")
    gestures.add_column("zones")
    for person in results.people:
        about = (f"{person.time[0]:.1f}", f"{person.time[-1]:.1f}", f"{person.walked:.1f}", _place(person, 0), _place(person, -1))
        people.add_row(*_who(person, several), *about, f"{np.mean(person.points):.0f}")
    for row in results.gestures:
        figures = (f"{row.start:.2f}", f"{row.end - row.start:.2f}", row.gesture.replace("_", " "), f"{row.confidence:.0%}")
        gestures.add_row(*_who(row, several), *figures, ", ".join(row.zones))
    return Group(people, Text(), gestures)


def _table(title: str, several: bool) -> Table:
    table = Table(title=title, title_justify="left", box=None, pad_edge=False, padding=(0, 2, 0, 0))
    if several:
        table.add_column("graph")
    table.add_column("person", justify="right")
    return table


def _who(row: PersonRow | GestureRow, several: bool) -> list[str]:
    return [*([row.namespace] if several else []), str(row.person)]


def _place(row: PersonRow, index: int) -> str:
    return f"{row.position[index, 0]:.1f}, {row.position[index, 1]:.1f}"
