"""Pictures of hand tracking for docs/explanation/tracking.md: places of a hand and how far off (Figs. 7.10, 7.11); clocks; a slider.

    python -m benchmarks hand --json --keep FOLDER | tail -n 1 > hand.json
    python docs/research/make_hand_track_pictures.py --figures hand.json --keep FOLDER

FOLDER holds what the benchmark simulated. The same versions of the libraries give the same files.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # the benchmarks are not installed

from benchmarks.hand import plan
from benchmarks.hand_runs import DISTANCES, SETTLED, Followed, HandStore, Tracked, counts, follow, residual, scene, track
from benchmarks.hand_search import configured
from radar_core import DataError
from radar_tracking import HandConfig

COLOURS = {"linear": "#E69F00", "mm_vel_est": "#0072B2"}  # Okabe and Ito: told apart by everybody
NAMES = {"linear": "Kalman filter", "mm_vel_est": "MMVelEst"}
DISTANCE = DISTANCES[2]  # m
_LABELS = ("x (depth) [m]", "y (across) [m]", "z (height) [m]")


def scene_of(store: HandStore, name: str) -> Tracked:
    """Tracked clouds of one of the benchmark's scenes."""
    return track(store, scene(*next(one for one in plan(quick=False) if one[0].name == name and one[2] == DISTANCE), "mesh"))


def positions(store: HandStore, tuned: Mapping[str, Any], path: Path) -> None:
    """Draw a hand that draws a circle fast: three coordinates and the residual of both filters over time."""
    tracked = scene_of(store, "circle")
    own = counts(tracked)
    figure, panels = plt.subplots(4, 1, figsize=(8, 7.5), sharex=True, height_ratios=(1, 1, 1, 1.2))
    for axis, label in enumerate(_LABELS):
        panels[axis].plot(tracked.time[own], tracked.hand[own, axis], color="0.2", lw=1.2, label="visible hand")
        panels[axis].set_ylabel(label)
    for name, colour in COLOURS.items():
        followed = follow(tracked, configured(name, **tuned[name]))
        for axis in range(3):
            panels[axis].plot(tracked.time[own], followed.position[own, axis], color=colour, lw=0.9, label=NAMES[name])
        panels[3].plot(tracked.time[own], residual(tracked, followed)[own], color=colour, lw=0.9, label=NAMES[name])
    panels[3].set(ylabel="residual [m]", xlabel="time [s]", ylim=(0, None))
    panels[0].legend(loc="upper right", ncols=3, fontsize=8)
    for panel in panels:
        panel.grid(alpha=0.3)
    save(figure, path)


def clocks(figures: Mapping[str, Any], path: Path) -> None:
    """Draw the residual over the offset between the radars' clocks."""
    by_clock = figures["by_clock_ms"]
    offset = [float(name) for name in by_clock]
    figure, panel = plt.subplots(figsize=(6, 3.4))
    rows = (
        ("p95_fast_m", "frames begin at other times, fast parts, 95th percentile", "#D55E00", "o-"),
        ("rmse_m", "frames begin at other times, rms", "#0072B2", "s-"),
        ("rmse_stamps_m", "only stamps are wrong, rms", "#009E73", "^--"),
    )
    for name, label, colour, style in rows:
        panel.plot(offset, [one[name] for one in by_clock.values()], style, color=colour, label=label)
    panel.set(xlabel="offset between the clocks [ms]", ylabel="residual [m]", ylim=(0, None))
    panel.grid(alpha=0.3)
    panel.legend(fontsize=8)
    save(figure, path)


def slider(store: HandStore, path: Path) -> None:
    """Draw the control value of a hand that goes up and down by half a metre, and what the height of the visible hand would give."""
    tracked, value = scene_of(store, "slider"), HandConfig().value
    followed: Followed = follow(tracked)
    own = counts(tracked)
    truth = tracked.hand[own, 2] / (value.high - value.low)
    figure, panel = plt.subplots(figsize=(8, 2.8))
    panel.plot(
        tracked.time[own], truth - np.mean(truth - followed.value[own]), color="0.2", lw=1.2, label="visible hand, mean offset removed"
    )
    panel.plot(tracked.time[own], followed.value[own], color="#0072B2", lw=1.0, label="control value")
    panel.set(xlabel="time [s]", ylabel="value", ylim=(0, 1), xlim=(SETTLED, None))
    panel.grid(alpha=0.3)
    panel.legend(fontsize=8, loc="upper right")
    save(figure, path)


def save(figure: Any, path: Path) -> None:
    """Write a picture and say where."""
    figure.tight_layout()
    figure.savefig(path, dpi=110, metadata={"Software": None})
    plt.close(figure)
    print(path)


def main() -> None:
    """Make all pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figures", type=Path, required=True, help="what python -m benchmarks hand --json printed last")
    parser.add_argument("--keep", type=Path, required=True, help="folder that was given to the benchmark as --keep")
    given = parser.parse_args()
    images, store = Path(__file__).resolve().parents[1] / "img", HandStore(given.keep)
    figures = json.loads(given.figures.read_text())
    clocks(figures, images / "hand_clocks.png")
    try:
        positions(store, figures["tuned"], images / "hand_position.png")
        slider(store, images / "hand_slider.png")
    except DataError as error:
        sys.exit(f"{error}; for two pictures run first: make figures ARGS=hand")


if __name__ == "__main__":
    main()
