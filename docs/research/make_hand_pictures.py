"""Pictures of hand tracking for docs/explanation/tracking.md: how well one snapshot of two radars tells a hand's velocity, all over a room.

    python -m benchmarks hand_velocity --json --keep FOLDER > velocity.json
    python docs/research/make_hand_pictures.py --figures velocity.json

The same versions of the libraries give the same file.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

IMG = Path(__file__).resolve().parents[1] / "img"
SHOWN = (0.3, 0.6)  # m: the baselines of the thesis
PANELS = {
    # key of the map: title, colours, from, to, format, factor
    "std": ("error across, standard deviation [m/s]", "viridis", 0.0, 0.6, "{:.2f}", 1.0),
    "ratio": ("the same over the Cramér-Rao bound", "PuOr_r", 0.6, 1.4, "{:.2f}", 1.0),
    "refused": ("refused: told along one axis only [%]", "cividis_r", 0.0, 100.0, "{:.0f}", 100.0),
}


def velocity_map(maps: list[dict[str, Any]]) -> Figure:
    """Draw rooms from above, the radars below, a row for each baseline; a cell is a place of the hand at the radars' height."""
    rows = [found for found in maps if found["baseline"] in SHOWN] or maps
    figure, grid = plt.subplots(len(rows), len(PANELS), figsize=(12.6, 4.9 * len(rows)), layout="constrained", squeeze=False)
    for panels, found in zip(grid, rows, strict=True):
        for axes, key in zip(panels, PANELS, strict=True):
            _room(axes, found, key)
        panels[0].set_ylabel(f"radars {found['baseline']:g} m apart\nx, away from the radars [m]")
    for axes in grid[-1]:
        axes.set_xlabel("y, left [m]")
    return figure


def _room(axes: Axes, found: dict[str, Any], key: str) -> None:
    """Draw one map, with its values; grey: outside the common field of view; white: hardly ever told."""
    title, colours, low, high, form, factor = PANELS[key]
    x, y = np.array(found["x"]), np.array(found["y"])
    seen, values = np.isfinite(_grid(found["refused"])), factor * _grid(found[key])
    extent = (*_edges(y), *_edges(x))
    axes.imshow(np.where(seen, np.nan, 1.0), cmap="Greys", vmin=0.0, vmax=4.0, origin="lower", extent=extent)
    axes.imshow(values, cmap=colours, vmin=low, vmax=high, origin="lower", extent=extent)
    span = mpl.colors.Normalize(low, high)
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            red, green, blue, _ = mpl.colormaps[colours](span(value))
            shade = "black" if 0.3 * red + 0.6 * green + 0.1 * blue > 0.5 else "white"
            axes.text(y[column], x[row], form.format(value), ha="center", va="center", fontsize=7, color=shade)
    axes.plot([found["baseline"] / 2, -found["baseline"] / 2], [0.0, 0.0], "^", color="#D55E00", ms=9, clip_on=False)
    axes.set(xlim=(y.max() + 0.15, y.min() - 0.15), ylim=(-0.1, x.max() + 0.15), title=title)
    axes.set_aspect("equal")


def _grid(rows: list[list[float | None]]) -> NDArray[np.float64]:
    return np.array([[np.nan if value is None else value for value in row] for row in rows], np.float64)


def _edges(centres: NDArray[np.float64]) -> tuple[float, float]:
    """Outer edges of cells around evenly spaced centres."""
    half = float(centres[1] - centres[0]) / 2
    return float(centres[0]) - half, float(centres[-1]) + half


def main() -> None:
    """Draw what there are figures for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--figures", type=Path, metavar="JSON", required=True, help="what `python -m benchmarks hand_velocity --json` printed"
    )
    parser.add_argument("--out", type=Path, default=IMG, metavar="FOLDER", help="folder for the picture")
    options = parser.parse_args()
    found = json.loads(options.figures.read_text(encoding="utf-8").splitlines()[-1])
    options.out.mkdir(parents=True, exist_ok=True)
    figure = velocity_map(found["maps"])
    path = options.out / "hand_velocity_map.png"
    figure.savefig(path, dpi=80, metadata={"Software": None})
    plt.close(figure)
    print(path)


if __name__ == "__main__":
    main()
