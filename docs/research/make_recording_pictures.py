"""Pictures of tracking on real recordings, for docs/reference/recordings.md: walkers; exercises beside a Kinect.

    python docs/research/make_recording_pictures.py --data ../shared/data            # pictures into docs/img

The same recordings and versions of the libraries give the same files. Without --data, HANDWAVE_DATA names the folder with the recordings.
The figures: ``python -m benchmarks recordings --json``.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # the benchmarks are not installed

from benchmarks import hand_mars, recordings
from benchmarks.hand_mars import KNOWN, estimate, exercises
from radar_core import PointCloud
from radar_lab.plots import PEOPLE
from radar_lab.posture.training import train_postures

mpl.rcParams["axes.prop_cycle"] = mpl.cycler(color=PEOPLE)  # told apart by everybody


def draw_walkers(axes: Any, clouds: Sequence[PointCloud], run: recordings.Run) -> None:
    """Draw y over time: points grey, each confirmed identity a line; the longest two are named."""
    seconds = np.array([(cloud.stamp_ns - clouds[0].stamp_ns) * 1e-9 for cloud in clouds])
    axes.plot(np.repeat(seconds, [len(c) for c in clouds]), np.concatenate([c.y for c in clouds]), ",", color="0.75", rasterized=True)
    for place, (identity, _) in enumerate(run.people().most_common()):
        axes.plot(seconds, run.path(identity)[:, 1], lw=2 if place < 2 else 1, label=f"track {identity}" if place < 2 else None)
    axes.set(ylim=(-6, 6), xlabel="time [s]", ylabel="y, left [m]")
    axes.legend(loc="upper left")


def draw_spine(axes: Any, name: str, run: recordings.Run, axis: int) -> None:
    """Draw one coordinate (0: x, 1: y) of the longest identity, less its mean difference, and of the spine over the clouds."""
    body = recordings.spine(name)[:, axis]
    people = run.people()
    track = run.path(people.most_common(1)[0][0])[:, axis] if people else np.full(len(body), np.nan)
    axes.plot(body, lw=1.5, label="Kinect spine")
    axes.plot(track - np.nanmean(track - body), lw=1, label="track, mean difference removed")
    axes.set(xlabel="cloud", ylabel=("x, forward [m]", "y, left [m]")[axis], title=name)
    axes.legend(loc="upper right")


def draw_two_people(out: Path) -> None:
    """Side over time of the two walkers, one panel for each tracker."""
    clouds = recordings.clouds_of("crossing", "two_people")
    fig, panels = plt.subplots(1, len(recordings.TRACKERS), figsize=(13, 4), sharey=True)
    for axes, name in zip(panels, recordings.TRACKERS, strict=True):
        draw_walkers(axes, clouds, recordings.follow(recordings.tracker_for("dense", name), clouds))
        axes.set_title(name)
    for axes in panels[1:]:
        axes.set_ylabel("")
    save(fig, out / "two_people_trackers.png")


def draw_exercises(out: Path, name: str = "subject1_test") -> None:
    """Both coordinates of the track and of the Kinect's spine over one file of MARS."""
    run = recordings.follow(recordings.tracker_for(recordings.PRESETS["mars"], recordings.TRACKERS[0]), recordings.clouds_of("mars", name))
    fig, panels = plt.subplots(2, 1, figsize=(11, 6), sharex=True)
    for coordinate, axes in enumerate(panels):
        draw_spine(axes, name, run, coordinate)
    panels[0].set_xlabel("")
    panels[1].set_title("")
    save(fig, out / "mars_spine.png")


def draw_hand(out: Path, name: str = "subject1_test", first: int = 230, n: int = 300) -> None:
    """Draw height and place across of the right hand for half a minute: Kinect, learned posture with its deviation, mean pose."""
    split = hand_mars.Split.of(*KNOWN)
    found, part = estimate(train_postures(split.recordings), name), slice(first, first + n)
    truth, plain = split.truth(name)[part, 1], (split.truth(name) + split.mean_error(name))[part, 1]
    place, std, seconds = found.position[part, 1], found.std[part, 1], 0.1 * np.arange(n)
    fig, panels = plt.subplots(2, 1, figsize=(11, 6), sharex=True)
    for axes, axis, label in zip(panels, (2, 1), ("height [m]", "y, left [m]"), strict=True):
        axes.fill_between(seconds, place[:, axis] - std[:, axis], place[:, axis] + std[:, axis], color="#D55E00", alpha=0.25, lw=0)
        axes.plot(seconds, truth[:, axis], color="#0072B2", lw=1.5, label="Kinect")
        axes.plot(seconds, place[:, axis], color="#D55E00", lw=1.2, label="posture, one radar (band: its deviation)")
        axes.plot(seconds, plain[:, axis], color="0.5", lw=1, ls="--", label="mean pose")
        axes.set_ylabel(label)
    panels[0].set_title(f"{name}, right hand; {len(exercises(name).clouds)} clouds, this is {first} to {first + n}")
    panels[0].set_ylim(0.7, 2.6)
    panels[0].legend(loc="upper center", ncols=3)
    panels[1].set_xlabel("time [s]")
    save(fig, out / "mars_hands.png")


def save(fig: Any, path: Path) -> None:
    """Write without date or version, so that the same picture is the same file."""
    fig.tight_layout()
    fig.savefig(path, dpi=80, metadata={"Software": None})
    plt.close(fig)


def main() -> None:
    parser = argparse.ArgumentParser(description="Pictures of people tracking on real recordings.")
    here = Path(__file__).resolve().parents[1]
    default = os.environ.get("HANDWAVE_DATA", here.parents[1] / "shared" / "data")
    parser.add_argument("--data", type=Path, default=Path(default), help="folder with the recordings")
    parser.add_argument("--out", type=Path, default=here / "img", help="folder for the pictures")
    arguments = parser.parse_args()
    if not arguments.data.is_dir():
        raise SystemExit(f"{arguments.data}: no recordings there; name their folder with --data or HANDWAVE_DATA")
    os.environ["HANDWAVE_DATA"] = str(arguments.data.resolve())
    arguments.out.mkdir(parents=True, exist_ok=True)
    draw_two_people(arguments.out)
    draw_exercises(arguments.out)
    draw_hand(arguments.out)


if __name__ == "__main__":
    main()
