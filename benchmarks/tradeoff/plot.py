"""Pareto plots: time across, accuracy up; dominated choices grey, the default with a ring and its name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from benchmarks.tradeoff.front import kept, panels
from benchmarks.tradeoff.rows import Row

GREY: Final = "0.7"
COLOUR: Final = "tab:blue"
_PARTS: Final = ("tab:blue", "tab:orange", "tab:green")
_MARKERS: Final = "osD^v<>Pp*hX"


@dataclass(frozen=True)
class Point:
    """One choice as it is drawn."""

    name: str
    time_ms: float
    to_ms: float
    value: float
    colour: str
    on_front: bool
    ring: bool


@dataclass(frozen=True)
class Picture:
    """One panel as it is drawn; ``log`` says whether accuracy goes in decades."""

    title: str
    label: str
    points: tuple[Point, ...]
    log: bool


def pictures(rows: Sequence[Row]) -> list[Picture]:
    """Say what is drawn of every panel."""
    found = []
    for name, own in panels(rows):
        points = []
        for row, on_front in zip(own, kept(own), strict=True):
            time, colour = row["time_ms"], COLOUR if on_front else GREY
            points.append(
                Point(row["choice"], time["median"], time["p95"], row["accuracy"]["value"], colour, bool(on_front), row["default"])
            )
        values, figure = [point.value for point in points], own[0]["accuracy"]
        unit = f" [{figure['unit']}]" if figure["unit"] else ""
        label = f"{figure['name']}{unit}\n({own[0]['better']} is better)"
        found.append(Picture(name, label, tuple(points), min(values) > 0 and max(values) > 50 * min(values)))
    return found


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw one panel below the other; of rows with ``parts`` also what the time goes to."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    drawn, parts = pictures(rows), [row for row in rows if "parts" in row]
    heights = [max(2.4, 1.0 + 0.17 * len(picture.points)) for picture in drawn] + ([2.4] if parts else [])
    figure, axes = plt.subplots(
        len(heights), 1, figsize=(9, sum(heights)), squeeze=False, layout="constrained", gridspec_kw={"height_ratios": heights}
    )
    for axis, picture in zip(axes[:, 0], drawn, strict=False):
        _panel(axis, picture)
    if parts:
        _bars(axes[-1, 0], parts)
    figure.savefig(path, dpi=90, metadata={"Software": None})
    plt.close(figure)


def _panel(axis: Any, picture: Picture) -> None:
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

    front = sorted((p.time_ms, p.value) for p in picture.points if p.on_front)
    axis.step(*zip(*front, strict=True), where="post", color=COLOUR, alpha=0.3, linewidth=1)
    for point, marker in zip(picture.points, _MARKERS * len(picture.points), strict=False):
        spread = [[0], [max(point.to_ms - point.time_ms, 0)]]
        axis.errorbar(
            point.time_ms, point.value, xerr=spread, fmt=marker, color=point.colour, markersize=6, capsize=2, elinewidth=0.8,
            label=point.name + (" (default)" if point.ring else ""),
        )  # fmt: skip
        if point.ring:
            axis.plot(point.time_ms, point.value, "o", markersize=15, markerfacecolor="none", markeredgecolor="tab:red")
            axis.annotate(point.name, (point.time_ms, point.value), xytext=(8, 9), textcoords="offset points", fontsize=7, color="tab:red")
    medians = [point.time_ms for point in picture.points]
    limits = (0.6 * min(medians), 1.7 * max(medians))  # bars of a busy machine end where the picture does
    axis.set(xscale="log", xlim=limits, xlabel="time [ms], bar to the 95th percentile", title=picture.title)
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
    axis.xaxis.set_major_formatter(FormatStrFormatter("%g"))
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set_ylabel(picture.label, fontsize=8)
    axis.set_yscale("log" if picture.log else "linear")
    axis.grid(alpha=0.3)
    axis.margins(y=0.15)
    axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7, frameon=False)


def _bars(axis: Any, rows: Sequence[Row]) -> None:
    """Show the parts of each row's time beside each other."""
    names = [row["choice"] for row in rows]
    left = [0.0] * len(rows)
    for colour, part in zip(_PARTS, rows[0]["parts"], strict=False):
        width = [row["parts"][part] for row in rows]
        axis.barh(names, width, left=left, color=colour, label=part)
        left = [a + b for a, b in zip(left, width, strict=True)]
    axis.invert_yaxis()
    axis.set(xlabel="median time for a second of radar [ms]", title="what the time goes to")
    axis.legend(fontsize=7, frameon=False)
