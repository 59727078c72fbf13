"""The picture of docs/research/real-time.md: latency, processors and lost frames over time, while the load beside the graph steps.

    python -m benchmarks load_steps --json | tail -n 1 > load_steps.json
    python docs/research/make_load_pictures.py --figures load_steps.json

It also writes the table of that page, between its marks.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

FOLDER = Path(__file__).resolve().parent
PICTURE = FOLDER.parent / "img" / "load_steps.png"
PAGE = FOLDER / "real-time.md"
BEGIN, END = "<!-- load-steps -->\n", "<!-- /load-steps -->\n"
BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"  # Okabe and Ito: told apart by everybody


def spans(time: Sequence[float], loops: Sequence[int]) -> list[tuple[float, float, int]]:
    """Find the steps: from when until when [s], with how many loops. Times are the ends of what each row is about."""
    found, begin = [], 0.0
    for k, count in enumerate(loops):
        if k + 1 == len(loops) or loops[k + 1] != count:
            found.append((begin, float(time[k]), count))
            begin = float(time[k])
    return found


def latency(panel: Axes, rows: Mapping[str, Any]) -> None:
    """Draw the median and the worst latency of each half second, on a logarithmic axis; where no tracks came there is a gap."""
    for name, label, colour, style in (("worst", "worst", RED, "-"), ("median", "median", BLUE, "-")):
        values = np.array([np.nan if value is None else value for value in rows[f"latency_ms_{name}"]], float)
        panel.plot(rows["time_s"], values, style, color=colour, lw=1.4, marker="o" if name == "median" else "^", ms=2.5, label=label)
    panel.set(yscale="log", ylabel="frame to tracks [ms]")
    panel.yaxis.set_major_locator(mpl.ticker.LogLocator(subs=(1, 2, 5)))
    panel.yaxis.set_major_formatter(mpl.ticker.StrMethodFormatter("{x:g}"))
    panel.yaxis.set_minor_formatter(mpl.ticker.NullFormatter())
    panel.legend(loc="upper right", ncols=2, fontsize=8)


def processors(panel: Axes, rows: Mapping[str, Any], available: int) -> None:
    """Stack what graph, busy loops and all others used, below the line of what there is."""
    graph, loops, machine = (np.array(rows[f"{name}_cores"], float) for name in ("graph", "loops", "machine"))
    rest = np.maximum(machine - graph - loops, 0.0)
    labels, colours = ("graph", "busy loops", "all others, the measurement too"), (BLUE, ORANGE, "0.75")
    from_zero = [np.append(each[:1], each) for each in (graph, loops, rest)]  # a row is about the time before it
    panel.stackplot([0.0, *rows["time_s"]], *from_zero, labels=labels, colors=colours, step="pre")
    panel.axhline(available, color="0.2", ls="--", lw=1.0)
    panel.set(ylabel="processors busy", ylim=(0, 1.35 * available))
    panel.legend(loc="upper right", ncols=3, fontsize=8)


def losses(panel: Axes, rows: Mapping[str, Any], tick: float) -> None:
    """Draw the share of frames that no tracks came of, each half second."""
    share = 100 * np.array(rows["lost"], float) / np.maximum(rows["frames"], 1)
    panel.bar(rows["time_s"], share, width=-tick, align="edge", color=GREEN)
    panel.set(ylabel="frames lost [%]", xlabel="time [s]", ylim=(0, max(10.0, 1.15 * float(share.max(initial=0.0)))))


def picture(found: Mapping[str, Any]) -> Figure:
    """Draw three panels over one axis of time, with the steps above them."""
    rows = found["series"]
    figure, panels = plt.subplots(3, 1, figsize=(8, 7), sharex=True, height_ratios=(1.3, 1.1, 0.9), layout="constrained")
    latency(panels[0], rows)
    processors(panels[1], rows, found["machine"]["processors"])
    losses(panels[2], rows, found["tick_s"])
    for begin, end, count in spans(rows["time_s"], rows["loops"]):
        words = "no load" if count == 0 else f"{count} busy loop{'s' if count > 1 else ''}"
        panels[0].text((begin + end) / 2, 1.02, words, transform=panels[0].get_xaxis_transform(), ha="center", va="bottom", fontsize=9)
        for panel in panels:
            panel.axvline(end, color="0.2", lw=0.8, ls=":")
    for panel in panels:
        panel.grid(alpha=0.3)
        panel.set_xlim(0.0, rows["time_s"][-1])
    return figure


def number(value: float | None, digits: int = 1) -> str:
    """Write a figure; nothing came: a dash."""
    return "-" if value is None else f"{value:.{digits}f}"


def table(found: Mapping[str, Any]) -> str:
    """Write the steps as a table, with the machine above it."""
    about = found["machine"]
    load = ", ".join(f"{value:.1f}" for value in about["load_average"])
    lines = [
        f"Made on {found['made']}: {about['processor']}, {about['processors']} processors on {about['cores']} "
        f"core{'s' if about['cores'] > 1 else ''}, Python {about['python']}; nodes and loops at "
        f"nice {about['nice']}. Before anything was started, others used {about['used_before_cores']:.1f} (load average {load}).",
        "",
        "| busy loops | median [ms] | 99th percentile [ms] | worst [ms] | processors, graph | processors, others | frames | lost |",
        "|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for row in found["steps"]:
        late = [number(row[f"latency_ms_{name}"]) for name in ("median", "p99", "worst")]
        used = [number(row[f"{name}_cores"], 2) for name in ("graph", "others")]
        lines.append("| " + " | ".join([str(row["loops"]), *late, *used, str(row["frames"]), f"{row['dropped_fraction']:.1%}"]) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the picture and the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figures", type=Path, required=True, help="what python -m benchmarks load_steps --json printed last")
    found = json.loads(parser.parse_args().figures.read_text(encoding="utf-8"))
    figure = picture(found)
    figure.savefig(PICTURE, dpi=110, metadata={"Software": None})
    plt.close(figure)
    print(PICTURE)
    text = PAGE.read_text(encoding="utf-8")
    before, after = text.partition(BEGIN)[0], text.partition(END)[2]
    PAGE.write_text(before + BEGIN + table(found) + END + after, encoding="utf-8")
    print(PAGE)


if __name__ == "__main__":
    main()
