"""Accuracy against time, as a table and as a picture."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.report import Row, kept

GREY: Final = "0.7"
COLOUR: Final = "#0072B2"
PALETTE: Final = (
    COLOUR,
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
    "#000000",
    "#7F6000",
)  # told apart by the colour-blind, too
MOST_NAMED: Final = len(PALETTE)  # of a panel; the others are grey, and the table beside the picture has all


def show(result: dict[str, Any]) -> None:
    """Print the flat figures, then one row per choice."""
    console = Console()
    for key, value in scalars(result):
        console.print(f"{key}: {value:.4g}" if isinstance(value, float) else f"{key}: {value}")
    choices = [["stage", "choice", "accuracy", "median ms", "p95 ms", "x reference"]]
    for row in result["choices"]:
        accuracy, time = row["accuracy"], row["time_ms"]
        figure = f"{accuracy['name']} {accuracy['value']:.4g} {accuracy['unit']}"
        choices.append([row["stage"], row["choice"], figure, f"{time['median']:.3f}", f"{time['p95']:.3f}", f"{row['ratio']:.2f}"])
    for header, *body in (*tables(result), choices):
        table = Table(*header)
        for cells in body:
            table.add_row(*cells)
        console.print(table)


def scalars(result: dict[str, Any], prefix: str = "", levels: int = 9) -> Iterator[tuple[str, Any]]:
    """List the flat figures, and those of dictionaries, so many levels of them, with dotted names; what `tables` shows is left out."""
    for key, value in result.items():
        if isinstance(value, dict):
            if levels > 1 and not _is_table(value):
                yield from scalars(value, f"{prefix}{key}.", levels - 1)
        elif key != "choices":
            yield f"{prefix}{key}", value


def tables(result: dict[str, Any]) -> Iterator[list[list[str]]]:
    """Make one table, the header first, of every figure that is told by two names: one row for each pair of names."""
    for key, value in result.items():
        if not isinstance(value, dict) or not _is_table(value):
            continue
        rows = {(a, b): figures for a, part in value.items() for b, figures in part.items()}
        columns = list(dict.fromkeys(name for figures in rows.values() for name, told in figures.items() if not isinstance(told, dict)))
        body = [[a, b, *(_cell(figures.get(c)) for c in columns)] for (a, b), figures in rows.items()]
        if columns:  # else what lies deeper
            yield [[key, "", *columns], *body]


def _cell(value: float | Sequence[float] | None) -> str:
    """Write a figure, or both ends of an interval; nothing where there is none."""
    if isinstance(value, Sequence):
        return " to ".join(_cell(one) for one in value)
    return "" if value is None else f"{value:.4g}"


def markdown(header: Sequence[str], body: Iterable[Sequence[str]], align: Sequence[str] = ()) -> list[str]:
    """Lines of a Markdown table; columns without an alignment go to the left."""
    rules = [*align, *["---"] * (len(header) - len(align))]
    return [f"| {' | '.join(cells)} |" for cells in (header, rules, *body)]


def _is_table(value: dict[str, Any]) -> bool:
    """Whether every entry is a dictionary of dictionaries."""
    return bool(value) and all(isinstance(part, dict) and all(isinstance(v, dict) for v in part.values()) for part in value.values())


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw accuracy (up) over time (across), one panel below the other; of rows with ``parts`` also what the time goes to.

    Where rows say which accuracy is better, dominated choices are grey and the default has a ring; rows with ``at`` become lines of time.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    drawn: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        drawn.setdefault((row["stage"], row["accuracy"]["name"]), []).append(row)
    if len(drawn) > 1:  # a panel with a single point compares nothing
        drawn = {key: own for key, own in drawn.items() if len(own) > 1} or drawn
    parts = [row for row in rows if "parts" in row]
    heights = [2.8 for _ in drawn] + ([2.4] if parts else [])  # room for the legend
    figure, axes = plt.subplots(
        len(heights), 1, figsize=(9, sum(heights)), squeeze=False, layout="constrained", gridspec_kw={"height_ratios": heights}
    )
    for axis, ((stage, _), own) in zip(axes[:, 0], drawn.items(), strict=False):
        (_lines if "at" in own[0] else _points)(axis, own)
        axis.set_title(stage)
        axis.grid(alpha=0.3)
        axis.margins(y=0.15)
        axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7, frameon=False)
    if parts:
        _bars(axes[-1, 0], parts)
    figure.savefig(path, dpi=90, metadata={"Software": None})
    plt.close(figure)


def colours(rows: Sequence[Row]) -> list[str]:
    """Colour of every choice of a panel: grey where another choice dominates it, or where it is one of too many to be named."""
    if "better" not in rows[0]:
        chosen = named(rows, range(len(rows)))
        return [PALETTE[chosen.index(number)] if number in chosen else GREY for number in range(len(rows))]
    return [COLOUR if on_front else GREY for on_front in kept(rows)]


def named(rows: Sequence[Row], numbers: Sequence[int]) -> list[int]:
    """Which of these choices a panel names, at most `MOST_NAMED`: the default or the first, then always what is farthest apart."""
    places = np.array([(np.log(max(row["time_ms"]["median"], 1e-6)), row["accuracy"]["value"]) for row in rows])
    places = (places - places.min(axis=0)) / np.maximum(np.ptp(places, axis=0), 1e-12)
    chosen = [next((number for number in numbers if rows[number].get("default")), numbers[0])]
    while len(chosen) < min(MOST_NAMED, len(numbers)):
        apart = {number: min(np.hypot(*(places[number] - places[other])) for other in chosen) for number in numbers if number not in chosen}
        chosen.append(max(apart, key=lambda number: apart[number]))
    return sorted(chosen)


def _points(axis: Any, rows: Sequence[Row]) -> None:
    """Draw accuracy over time, one point per choice."""
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

    medians, values = ([row[a][b] for row in rows] for a, b in (("time_ms", "median"), ("accuracy", "value")))
    accuracy, better = rows[0]["accuracy"], rows[0].get("better")
    chosen = colours(rows)
    told = [number for number, colour in enumerate(chosen) if colour != GREY or rows[number].get("default")]
    told = named(rows, told if len(told) > MOST_NAMED or len(rows) > MOST_NAMED else range(len(rows)))
    if better:
        front = sorted((x, y) for x, y, colour in zip(medians, values, chosen, strict=True) if colour == COLOUR)
        axis.step(*zip(*front, strict=True), where="post", color=COLOUR, alpha=0.3, linewidth=1)
    for number, (row, x, y, colour, marker) in enumerate(zip(rows, medians, values, chosen, "osD^v<>Pp*hX" * len(rows), strict=False)):
        if number not in told:
            axis.plot(x, y, ".", color=GREY, markersize=5, zorder=1)
            continue
        label, spread = row["choice"], [[0], [max(row["time_ms"]["p95"] - x, 0)]]
        if row.get("default"):
            axis.plot(x, y, "o", markersize=15, markerfacecolor="none", markeredgecolor="tab:red")
            axis.annotate(label, (x, y), xytext=(8, 9), textcoords="offset points", fontsize=7, color="tab:red")
            label += " (default)"
        axis.errorbar(x, y, xerr=spread, fmt=marker, color=colour, markersize=6, capsize=2, elinewidth=0.8, label=label)
    if len(told) < len(rows):
        axis.plot([], [], ".", color=GREY, markersize=5, label=f"{len(rows) - len(told)} others: in the table")
    limits = (0.6 * min(medians), 1.7 * max(medians))  # bars of a busy machine end where the picture does
    axis.set(xscale="log", xlim=limits, xlabel="time [ms], bar to the 95th percentile")
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
    axis.xaxis.set_major_formatter(FormatStrFormatter("%g"))
    axis.xaxis.set_minor_formatter(NullFormatter())
    unit, wanted = f" [{accuracy['unit']}]" if accuracy["unit"] else "", f"\n({better} is better)" if better else ""
    axis.set_ylabel("\n".join(wrap(f"{accuracy['name']}{unit}", 30)) + wanted, fontsize=8)
    axis.set_yscale("log" if min(values) > 0 and max(values) > 50 * min(values) else "linear")


def _lines(axis: Any, rows: Sequence[Row]) -> None:
    """Draw time over what is varied, one line per choice."""
    for name in dict.fromkeys(row["choice"] for row in rows):
        own = [row for row in rows if row["choice"] == name]
        axis.plot([row["at"]["value"] for row in own], [row["time_ms"]["median"] for row in own], "o-", markersize=4, label=name)
    axis.set(xscale="log", yscale="log", xlabel=rows[0]["at"]["name"], ylabel="time [ms], median")


def _bars(axis: Any, rows: Sequence[Row]) -> None:
    """Show the parts of each row's time beside each other."""
    names = [row["choice"] for row in rows]
    left = [0.0] * len(rows)
    for part in rows[0]["parts"]:
        width = [row["parts"][part] for row in rows]
        axis.barh(names, width, left=left, label=part)
        left = [a + b for a, b in zip(left, width, strict=True)]
    axis.invert_yaxis()
    axis.set(xlabel="median time for a second of radar [ms]", title="what the time goes to")
    axis.legend(fontsize=7, frameon=False)
