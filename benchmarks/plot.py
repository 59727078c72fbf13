"""Accuracy against time, as a table and as a picture."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table


def show(result: dict[str, Any]) -> None:
    """Print the flat figures, then one row per choice."""
    console = Console()
    for key, value in scalars(result):
        console.print(f"{key}: {value:.4g}" if isinstance(value, float) else f"{key}: {value}")
    for rows in tables(result):
        table = Table(*rows[0])
        for cells in rows[1:]:
            table.add_row(*cells)
        console.print(table)
    table = Table("stage", "choice", "accuracy", "median ms", "p95 ms", "x reference")
    for row in result["choices"]:
        accuracy, time = row["accuracy"], row["time_ms"]
        table.add_row(
            row["stage"],
            row["choice"],
            f"{accuracy['name']} {accuracy['value']:.4g} {accuracy['unit']}",
            f"{time['median']:.3f}",
            f"{time['p95']:.3f}",
            f"{row['ratio']:.2f}",
        )
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
        columns = list(dict.fromkeys(name for figures in rows.values() for name in figures))
        body = [[a, b, *("" if figures.get(c) is None else f"{figures[c]:.4g}" for c in columns)] for (a, b), figures in rows.items()]
        yield [[key, "", *columns], *body]


def _is_table(value: dict[str, Any]) -> bool:
    """Whether every entry is a dictionary of dictionaries."""
    return bool(value) and all(isinstance(part, dict) and all(isinstance(v, dict) for v in part.values()) for part in value.values())


def draw(choices: list[dict[str, Any]], path: Path) -> None:
    """Draw one panel per stage and accuracy figure: time (log) across, accuracy up, every choice labelled."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    panels: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in choices:
        panels.setdefault((row["stage"], f"{row['accuracy']['name']} [{row['accuracy']['unit']}]"), []).append(row)
    heights = [max(2.2, 0.9 + 0.18 * len(rows)) for rows in panels.values()]  # room for the legend
    ratios = {"height_ratios": heights}
    figure, axes = plt.subplots(len(panels), 1, figsize=(9, sum(heights)), squeeze=False, layout="constrained", gridspec_kw=ratios)
    for axis, ((stage, label), rows) in zip(axes[:, 0], panels.items(), strict=True):
        if "at" in rows[0]:
            _lines(axis, rows)
        else:
            _points(axis, rows)
            axis.set_ylabel(label, fontsize=8)
        axis.set_title(stage)
        axis.grid(alpha=0.3)
        axis.margins(0.1)
        axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7, frameon=False)
    figure.savefig(path, dpi=90)
    plt.close(figure)


def _points(axis: Any, rows: list[dict[str, Any]]) -> None:
    """Draw accuracy over time, one point per choice."""
    for row, marker in zip(rows, "osD^v<>Pp*hX" * len(rows), strict=False):
        x, y = row["time_ms"]["median"], row["accuracy"]["value"]
        spread = [[0], [max(row["time_ms"]["p95"] - x, 0)]]
        axis.errorbar(x, y, xerr=spread, fmt=marker, markersize=5, capsize=2, label=row["choice"])
    times, values = ([row[a][b] for row in rows] for a, b in (("time_ms", "median"), ("accuracy", "value")))
    axis.set(xscale="log" if max(times) > 5 * min(times) else "linear", xlabel="time [ms], bar to the 95th percentile")
    axis.set_yscale("log" if min(values) > 0 and max(values) > 100 * min(values) else "linear")


def _lines(axis: Any, rows: list[dict[str, Any]]) -> None:
    """Draw time over what is varied, one line per choice."""
    for name in dict.fromkeys(row["choice"] for row in rows):
        own = [row for row in rows if row["choice"] == name]
        axis.plot([row["at"]["value"] for row in own], [row["time_ms"]["median"] for row in own], "o-", markersize=4, label=name)
    axis.set(xscale="log", yscale="log", xlabel=rows[0]["at"]["name"], ylabel="time [ms], median")
