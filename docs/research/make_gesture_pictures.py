"""Pictures of gesture recognition for docs/explanation/gestures.md: confusions, rates, real people, daily life, random rooms.

    python -m benchmarks gestures --json --keep FOLDER > gestures.json
    python -m benchmarks gestures --real --json --keep FOLDER > real.json
    python -m benchmarks gestures_people --json --keep FOLDER > people.json
    python -m benchmarks gestures_transfer --json --keep FOLDER > transfer.json
    python -m benchmarks gestures_daily --json --keep FOLDER > daily.json
    python -m benchmarks gesture_rooms --seeds first --json --keep FOLDER > rooms.json
    python docs/research/make_gesture_pictures.py --figures gestures.json --real real.json --rooms rooms.json --daily daily.json
    python docs/research/make_gesture_pictures.py --people people.json --transfer transfer.json

Any may be left out, and with it its pictures; confusions of real people need ``--people`` and ``--transfer``. The same versions of the
libraries give the same files.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

IMG = Path(__file__).resolve().parents[1] / "img"
COLOURS = ("#0072B2", "#E69F00", "#009E73")  # Okabe and Ito: told apart by everybody
THESIS = {"50 Hz": {"2 Tx": 0.943, "1 Tx": 0.903}, "25 Hz": {"2 Tx": 0.920, "1 Tx": 0.883}, "17 Hz": {"2 Tx": 0.876}}  # table 4.1


def confusion(axes: Axes, found: dict[str, Any], title: str) -> None:
    """Draw a matrix: rows are what was performed, numbers are per cent of a row."""
    counts = np.array(found["confusion"], float)
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1.0)
    names = [name.replace("_", " ") for name in found["labels"]]
    axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0)
    axes.set_xticks(range(len(names)), names, rotation=60, ha="right", fontsize=7)
    axes.set_yticks(range(len(names)), names, fontsize=7)
    for row, column in np.argwhere(share >= 0.005):
        shade = "white" if share[row, column] > 0.5 else "black"
        axes.text(column, row, f"{100 * share[row, column]:.0f}", ha="center", va="center", fontsize=6, color=shade)
    total = counts.trace() / max(counts.sum(), 1.0)
    axes.set_title(f"{title}\n{100 * total:.1f} % of {counts.sum():.0f}", fontsize=8)
    axes.set_xlabel("named", fontsize=7)
    axes.set_ylabel("performed", fontsize=7)


def matrices(found: dict[str, dict[str, Any]], titles: dict[str, str]) -> Figure:
    """Draw those matrices that there are, two in a row, so that their numbers can be read at the width of a page."""
    names = [name for name in titles if name in found]
    figure, axes = plt.subplots(-(-len(names) // 2), 2, figsize=(7.4, 3.9 * -(-len(names) // 2)), layout="constrained", squeeze=False)
    for one, name in zip(axes.flat, names, strict=False):
        confusion(one, found[name], titles[name])
    for one in axes.flat[len(names) :]:
        one.axis("off")
    return figure


def rates(table: dict[str, dict[str, dict[str, float]]]) -> Figure:
    """Draw accuracy against the time of one second of frames, as table 4.1 has it, with the thesis's figures."""
    figure, axes = plt.subplots(figsize=(6.0, 3.6), layout="constrained")
    for number, transmitters in enumerate(("2 Tx", "1 Tx")):
        ours = [(1e3 * row[transmitters]["busy"], 100 * row[transmitters]["recognised"], name) for name, row in table.items()]
        time, accuracy, names = zip(*ours, strict=True)
        axes.plot(time, accuracy, "o-", color=COLOURS[number], label=f"{transmitters}, people held out")
        for x, y, name in zip(time, accuracy, names, strict=True) if number == 0 else ():  # the other line's points lie beside these
            axes.annotate(name, (x, y), textcoords="offset points", xytext=(-26, 5), fontsize=7)
        theirs = [(x, 100 * THESIS[name][transmitters]) for x, _, name in ours if transmitters in THESIS[name]]
        axes.plot(*zip(*theirs, strict=True), "x--", color=COLOURS[number], label=f"{transmitters}, thesis (random split, real people)")
    axes.set_xlabel("computing for one second of radar frames [ms]")
    axes.set_ylabel("gestures recognised [%]")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7)
    return figure


def learning(rows: list[dict[str, float]]) -> Figure:
    """Draw accuracy on four people of mHomeGes against the number of other people in the training."""
    figure, axes = plt.subplots(figsize=(5.0, 3.2), layout="constrained")
    axes.plot([row["people"] for row in rows], [100 * row["accuracy"] for row in rows], "o-", color=COLOURS[0])
    axes.margins(x=0.16)
    for row in rows:
        axes.annotate(
            f"{row['samples']:.0f} samples", (row["people"], 100 * row["accuracy"]), textcoords="offset points", xytext=(6, -9), fontsize=7
        )
    axes.set_xlabel("people in the training")
    axes.set_ylabel("right for four others [%]")
    axes.grid(alpha=0.3)
    return figure


def daily(curves: dict[str, dict[str, dict[str, Any] | None]]) -> Figure:
    """Draw false gestures an hour of daily life against the gestures kept, by when gestures count; bands are 95 % intervals."""
    figure, axes = plt.subplots(figsize=(6.0, 3.8), layout="constrained")
    waking = [name for name in curves if name.startswith("wake by")]
    for name in waking:
        line = [one for one in curves[name].values() if one is not None]
        label = f"after a gesture that wakes, within {waking[0].rsplit(', ', 1)[1]}; a line for each" if name == waking[0] else None
        axes.plot([100 * one["kept"] for one in line], [one["false_per_hour"] for one in line], ".-", color=COLOURS[2], lw=0.7, label=label)
    others = [name for name in curves if name not in waking]
    for number, name in enumerate(others):
        line = [one for one in curves[name].values() if one is not None]
        x, y = [100 * one["kept"] for one in line], [one["false_per_hour"] for one in line]
        axes.plot(x, y, "o-", color=COLOURS[number], label=name.replace("dwell, ", "after a rest of "))
        low, high = zip(*(one["false_per_hour_interval"] for one in line), strict=True)
        axes.fill_between(x, low, high, color=COLOURS[number], alpha=0.15, lw=0)
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_ylim(bottom=0)
    axes.set_xlabel("gestures kept [%]")
    axes.set_ylabel("false gestures an hour of daily life")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7)
    return figure


OUTCOMES = {"other name": "#E69F00", "called random": "#999999", "no event": "#56B4E9", "no track": "#333333"}
PANELS = {
    "distance": "distance",
    "turn": "turned away from the radar",
    "azimuth": "to the side (left positive)",
    "signal": "signal against the reference",
    "mount": "height of the radar",
    "radar": "radar",
}


def _first_number(name: str) -> float:
    head = name.split(" ", 1)[0]
    return float(head) if head.lstrip("-").replace(".", "", 1).isdigit() else 0.0


def where(by: dict[str, dict[str, dict[str, Any]]]) -> Figure:
    """Draw what became of the gestures in random rooms, by what was drawn: shares, with the 95 % interval of those named rightly."""
    figure, axes = plt.subplots(3, 2, figsize=(7.4, 6.6), layout="constrained")
    for one, (kind, title) in zip(axes.flat, PANELS.items(), strict=True):
        rows = sorted(by[kind].items(), key=lambda item: _first_number(item[0]))
        for place, (_, row) in enumerate(rows):
            right, (low, high) = row["right"], row["right_interval"]
            one.barh(place, right, color=COLOURS[2], label="right" if place == 0 else None)
            one.errorbar(right, place, xerr=[[right - low], [high - right]], color="black", capsize=2, linewidth=1)
            done = right
            for what, colour in OUTCOMES.items():
                one.barh(place, row[what] / row["strokes"], left=done, color=colour, alpha=0.5, label=what if place == 0 else None)
                done += row[what] / row["strokes"]
        one.set_yticks(range(len(rows)), [f"{name} ({row['strokes']})" for name, row in rows], fontsize=7)
        one.set(xlim=(0, 1), title=title)
        one.title.set_fontsize(8)
        one.tick_params(axis="x", labelsize=7)
        one.invert_yaxis()
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=7)
    return figure


def save(name: str, make: Callable[[], Figure]) -> None:
    """Write one picture."""
    figure = make()
    figure.savefig(IMG / f"{name}.png", dpi=130, metadata={"Software": None})
    plt.close(figure)
    print(IMG / f"{name}.png")


def printed(path: Path) -> dict[str, Any]:
    """Read what a benchmark printed: its last line."""
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8").splitlines()[-1])
    return found


def main() -> None:
    """Draw what there are figures for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figures", type=Path, metavar="JSON", help="what the benchmark of simulated people printed")
    parser.add_argument("--real", type=Path, metavar="JSON", help="what the benchmark of real people printed")
    parser.add_argument("--people", type=Path, metavar="JSON", help="what the benchmark of real people held out printed")
    parser.add_argument("--transfer", type=Path, metavar="JSON", help="what the benchmark of real people named from other worlds printed")
    parser.add_argument("--rooms", type=Path, metavar="JSON", help="what the benchmark of gestures in random rooms printed")
    parser.add_argument("--daily", type=Path, metavar="JSON", help="what the benchmark of real people's daily life printed")
    options = parser.parse_args()
    if options.rooms:
        rooms = printed(options.rooms)
        save("gestures_where", lambda: where(rooms["by"]))
    if options.figures:
        found = printed(options.figures)
        titles = {
            "subjects": "perceptron, two people held out",
            "random": "perceptron, random split",
            "cubes": "CNN on cubes, two people held out",
            "maps": "CNN on maps, two people held out",
        }
        save("gestures_confusion", lambda: matrices(found["confusion"] | found["confusion_networks"], titles))
        save("gestures_rates", lambda: rates(found["table_4_1"]))
    if options.people and options.transfer:
        people, transfer = printed(options.people), printed(options.transfer)
        titles = {
            "mhomeges_held_out": "mHomeGes, two people held out",
            "mtranssee_held_out": "mTransSee, two people held out",
            "synthetic_to_real": "simulated to real, mHomeGes",
        }
        save("gestures_real_confusion", lambda: matrices(people["confusion_people"] | transfer["confusion"], titles))
    if options.daily:
        life = printed(options.daily)
        save("gestures_daily", lambda: daily(life["curve"]))
    if options.real:
        real = printed(options.real)
        save("gestures_learning", lambda: learning(real["learning_curve"]))


if __name__ == "__main__":
    main()
