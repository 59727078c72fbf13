"""Pictures of people tracking: trackers against scenes, approach, merging, arms side by side, a furnished room.

    python -m benchmarks tracking --json > tracking.json
    python docs/research/make_tracking_pictures.py --figures tracking.json

Without --figures the first of them is left out. The same versions of the libraries give the same files.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.patches import Polygon

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # the benchmarks are not installed

from benchmarks.approaches import APART, BASEBANDS, NEAR, OWN, distance, one_track, scene, simulate, wide
from benchmarks.scenarios import MOUNT, Moment, moments, scenario
from benchmarks.tracking_suite import FLOOR, THESIS, TRACKERS, Tracker, make
from radar_core import RadarInfo
from radar_dsp import BasebandConfig
from radar_tracking import PeopleTracker, TrackerConfig, Tracks, TrackStatus
from radar_tracking.metrics import ClearMot, ObjectSet, people
from radar_tracking.people.zones import ZonesConfig

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")  # Okabe and Ito: told apart by everybody
MARKERS = "os^DvP"
NOBODY = "0.7"
NAMES = ("group_clustering", "group", "cluster_first")
APPROACH, MERGING, ARMS, ROOM = 0, 1009, 0, 1  # seeds; MERGING is of those for development
INFO = RadarInfo(mount=MOUNT)
PANELS = (("mota", "MOTA", "{:.2f}"), ("id_switches", "identity switches", "{:.0f}"), ("gospa", "mean GOSPA [m]", "{:.2f}"))


@dataclass(frozen=True, eq=False)
class Followed:
    """What a tracker made of a scene, and whom each track was last on after every cloud (track to row of a person)."""

    results: tuple[Tracks, ...]
    holders: tuple[dict[int, int], ...]

    def paths(self) -> dict[int, NDArray[np.float64]]:
        """Places (x, y) of every confirmed track, shape (n_clouds, 2) [m]; NaN where there is none."""
        found: dict[int, NDArray[np.float64]] = {}
        for k, tracks in enumerate(self.results):
            for item in tracks.tracks:
                if item.status is not TrackStatus.TENTATIVE:
                    found.setdefault(item.id, np.full((len(self.results), 2), np.nan))[k] = item.position[:2]
        return found

    def rows(self, k: int) -> NDArray[np.int64]:
        """Row of the person whose track each point of a cloud carries, shape (n_points,); -1: none's."""
        return np.array([self.holders[k].get(int(identity), -1) for identity in self.results[k].point_track_id], np.int64)


def follow(made: Sequence[Moment], tracker: Tracker) -> Followed:
    """Run a tracker over a scene."""
    mot = ClearMot()
    results, holders = [], []
    on: dict[int, int] = {}
    for moment in made:
        results.append(tracker.process(moment.cloud))
        truth = ObjectSet.of(moment.truth.position[:, :2], np.arange(len(moment.visible)), moment.visible)
        step = mot.process(truth, people(results[-1]))
        on = on | dict(zip(step.estimate_id.tolist(), step.truth_id.tolist(), strict=True))
        holders.append(on)
    return Followed(tuple(results), tuple(holders))


def draw_table(figures: dict[str, Any], out: Path) -> None:
    """Every tracker on every scene: three panels of numbered cells, dark is good."""
    trackers = list(figures["trackers"])
    scenes = list(figures["trackers"][trackers[0]])
    fig, panels = plt.subplots(len(PANELS), 1, figsize=(11, 2.1 + 1.75 * len(PANELS)), sharex=True)
    for axes, (key, title, form) in zip(panels, PANELS, strict=True):
        values = np.array([[figures["trackers"][t][s][key] for s in scenes] for t in trackers], np.float64)
        values /= [[figures["trackers"][t][s]["scenes"] for s in scenes] for t in trackers] if key == "id_switches" else 1.0
        low, high = (0.5, 1.0) if key == "mota" else (0.0, {"id_switches": 4.0, "gospa": 0.6}[key])
        goodness = np.clip((values - low) / (high - low), 0, 1)
        goodness = goodness if key == "mota" else 1 - goodness
        axes.imshow(goodness, cmap="cividis_r", vmin=0, vmax=1, aspect="auto")
        for (row, column), value in np.ndenumerate(values):
            colour = "white" if goodness[row, column] > 0.55 else "black"
            text = f"{value:.2g}" if key == "id_switches" else form.format(value)
            axes.text(column, row, text, ha="center", va="center", fontsize=8, color=colour)
        axes.set_yticks(range(len(trackers)), trackers)
        axes.set_title(f"{title} per scene" if key == "id_switches" else title)
        axes.tick_params(length=0)
    panels[-1].set_xticks(range(len(scenes)), scenes, rotation=30, ha="right")
    save(fig, out / "tracking_trackers.png")


def draw_approach(out: Path, seed: int = APPROACH) -> None:
    """Side over time of two who meet and go back (thesis, Fig. 6.2): all as the thesis has it, and below all as we have it."""
    fig, rows = plt.subplots(2, len(NAMES), figsize=(13, 8), sharex=True, sharey=True)
    for panels, config, form in zip(rows, (BasebandConfig(), None), ("thesis_", ""), strict=True):
        made = list(moments("approach", seed, config=config))
        seconds = np.array([(m.cloud.stamp_ns - made[0].cloud.stamp_ns) * 1e-9 for m in made])
        for axes, name in zip(panels, NAMES, strict=True):
            axes.plot(np.repeat(seconds, [len(m.cloud) for m in made]), np.concatenate([m.cloud.y for m in made]), ",", color=NOBODY)
            for row in range(2):
                axes.plot(seconds, [m.truth.position[row, 1] for m in made], "k--", lw=1, label=None if row else "true centres")
            followed = follow(made, make("approach", (TRACKERS | THESIS)[form + name], INFO))
            for place, (identity, path) in enumerate(sorted(followed.paths().items())):
                axes.plot(seconds, path[:, 1], lw=2, color=COLOURS[place % len(COLOURS)], label=f"track {identity}")
            axes.set(title=f"{name}, {'as in the thesis' if form else 'ours'}", ylim=(-2.4, 2.4))
            axes.legend(loc="upper right", fontsize=8)
        panels[0].set_ylabel("y, left [m]")
    for axes in rows[-1]:
        axes.set_xlabel("time [s]")
    save(fig, out / "tracking_approach.png")


def draw_merging(out: Path, seed: int = MERGING) -> None:
    """Three clouds of two who meet and part (thesis, Fig. 6.2), from above: every cell above the threshold is a point."""
    made = simulate(scene(None, seed), {"every_cell": BASEBANDS["every_cell"]})["every_cell"]
    followed = {name: follow(made, make("approach", wide(0.6)[name], INFO)) for name in ("cluster_first", "group", "group_clustering")}
    between = distance(made)
    near = np.flatnonzero(between < NEAR)
    merged = [one_track(made[k], followed["cluster_first"].results[k])[0] for k in near]
    middle = near[np.flatnonzero(merged)[sum(merged) // 2]]
    moments_of = {"approaching": np.flatnonzero(between[: near[0]] >= APART)[-1], "near": middle, "apart again": len(made) - 1}
    fig, rows = plt.subplots(len(moments_of), len(OWN), figsize=(11, 6), sharex=True, sharey=True)
    for panels, (phase, k) in zip(rows, moments_of.items(), strict=True):
        for axes, (name, run) in zip(panels, followed.items(), strict=True):
            draw_tracks(axes, made[k], run, int(k))
            axes.set_title(f"{name}, {phase}", fontsize=9)
        panels[0].set_ylabel("x, away [m]")
    for axes in rows[-1]:
        axes.set_xlabel("y, left [m]")
    save(fig, out / "tracking_merging.png")


def draw_tracks(axes: Any, moment: Moment, run: Followed, k: int) -> None:
    """Draw a cloud from above by the tracks that its points carry; a cross and a number at each confirmed track."""
    cloud, result = moment.cloud, run.results[k]
    colours = {identity: COLOURS[place % len(COLOURS)] for place, identity in enumerate(sorted(run.paths()))}
    shown = [colours.get(int(identity), NOBODY) for identity in result.point_track_id]
    axes.scatter(cloud.y, cloud.x, s=9, c=shown)
    axes.plot(moment.truth.position[:, 1], moment.truth.position[:, 0], "k+", ms=14, mew=1.5)
    for item in result.people:
        colour = colours[item.id]
        axes.plot(item.position[1], item.position[0], "x", color=colour, ms=9, mew=3)
        axes.text(item.position[1], item.position[0] + 0.35, str(item.id), color=colour, ha="center", fontsize=11, weight="bold")
    axes.set(xlim=(2.2, -2.2), ylim=(moment.truth.position[:, 0].mean() - 1.0, moment.truth.position[:, 0].mean() + 1.2), aspect="equal")


def draw_arms(out: Path, seed: int = ARMS) -> None:
    """One cloud of two who gesture side by side (thesis, Fig. 6.3): whose the points are, and whose the thesis's trackers say they are."""
    made = list(moments("side_by_side", seed, owners=True, config=BasebandConfig()))
    names = ("group", "group_clustering")
    followed = {name: follow(made, make("side_by_side", THESIS[f"thesis_{name}"], INFO)) for name in names}
    wrong = {name: np.array([count_wrong(m, f.rows(k)) for k, m in enumerate(made)]) for name, f in followed.items()}
    k = int(np.argmax(wrong["group"] - wrong["group_clustering"]))
    cloud, truth = made[k].cloud, made[k].truth
    shown = {"whose they are": made[k].owner} | {name: f.rows(k) for name, f in followed.items()}
    fig, panels = plt.subplots(1, 3, figsize=(12, 4.4), sharex=True, sharey=True)
    for axes, (title, owner) in zip(panels, shown.items(), strict=True):
        draw_points(axes, cloud.y, cloud.x, np.asarray(owner), truth.position)
        axes.set_title(f"{title}: {wrong[title][k]:.0f} on the wrong person" if title in wrong else title)
        axes.set(
            xlabel="y, left [m]",
            aspect="equal",
            xlim=(1.4, -1.4),
            ylim=(truth.position[:, 0].min() - 1.1, truth.position[:, 0].max() + 0.9),
        )
    panels[0].set_ylabel("x, away from the radar [m]")
    panels[0].legend(loc="lower left", fontsize=8)
    save(fig, out / "tracking_arms.png")


def count_wrong(moment: Moment, rows: NDArray[np.int64]) -> int:
    """Points of somebody that carry the other's track."""
    return int(np.count_nonzero((moment.owner >= 0) & (rows >= 0) & (rows != moment.owner)))


def draw_points(
    axes: Any, across: NDArray[np.float32], along: NDArray[np.float32], owner: NDArray[np.int64], body: NDArray[np.float64]
) -> None:
    """Draw points by their owners, with the true centres as crosses."""
    for row in (-1, *range(len(body))):
        own = owner == row
        colour, label = (NOBODY, "nobody's") if row < 0 else (COLOURS[row], f"person {row + 1}")
        axes.plot(across[own], along[own], "x" if row < 0 else MARKERS[row], color=colour, ms=6, label=label)
        if row >= 0:
            axes.plot(body[row, 1], body[row, 0], "+", color="black", ms=16, mew=2, label=None if row else "true centres")


def draw_room(out: Path, seed: int = ROOM) -> None:
    """Thirty seconds in a furnished room, from above: told of floor and walls, with the preset for such rooms, and of the floor only."""
    made = list(moments("clutter", seed))
    floor = PeopleTracker(TrackerConfig(zones=ZonesConfig(boundaries=FLOOR)), INFO)
    trackers = {"preset furnished, walls known": make("clutter", TRACKERS["group_clustering"], INFO), "default settings": floor}
    fig, panels = plt.subplots(1, 2, figsize=(11, 5.6), sharex=True, sharey=True)
    for axes, (title, tracker) in zip(panels, trackers.items(), strict=True):
        axes.plot(np.concatenate([m.cloud.y for m in made]), np.concatenate([m.cloud.x for m in made]), ",", color=NOBODY, zorder=0)
        draw_furniture(axes, seed)
        axes.plot(*np.array([m.truth.position[0, 1::-1] for m in made]).T, "k--", lw=1.5, label="true path")
        paths = follow(made, tracker).paths()
        for place, path in enumerate(paths.values()):
            label = {0: "tracks, a colour each"}.get(place)
            axes.plot(path[:, 1], path[:, 0], lw=2, color=COLOURS[place % len(COLOURS)], alpha=0.8, label=label)
            last = path[np.isfinite(path[:, 0])][-1]
            axes.plot(last[1], last[0], "o", color=COLOURS[place % len(COLOURS)], ms=7)
        axes.set(
            title=f"{title}: {len(paths)} confirmed track{'s' * (len(paths) != 1)}",
            xlabel="y, left [m]",
            aspect="equal",
            xlim=(3, -3),
            ylim=(0, 6),
        )
    panels[0].set_ylabel("x, away from the radar [m]")
    panels[0].legend(loc="lower left", fontsize=8)
    save(fig, out / "tracking_room.png")


def draw_furniture(axes: Any, seed: int) -> None:
    """Draw walls and furniture from above."""
    scene = scenario("clutter", seed)
    for wall in scene.walls:
        axes.plot(*np.array([wall.start[::-1], wall.end[::-1]]).T, color="0.3", lw=3)
    for thing in scene.furniture:
        along = np.array([np.cos(thing.heading), np.sin(thing.heading)]) * thing.size[0] / 2
        across = np.array([-np.sin(thing.heading), np.cos(thing.heading)]) * thing.size[1] / 2
        corners = np.array([thing.position + a * along + b * across for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))])
        axes.add_patch(Polygon(corners[:, ::-1], facecolor="0.85", edgecolor="0.3", zorder=1))


def save(fig: Any, path: Path) -> None:
    """Write without date or version, so that the same picture is the same file."""
    fig.tight_layout()
    fig.savefig(path, dpi=80, metadata={"Software": None})
    plt.close(fig)


def main() -> None:
    parser = argparse.ArgumentParser(description="Pictures of people tracking.")
    parser.add_argument("--figures", type=Path, help="what `python -m benchmarks tracking --json` printed")
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parents[1] / "img", help="folder for the pictures")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.figures:
        draw_table(json.loads(arguments.figures.read_text(encoding="utf-8").splitlines()[-1]), arguments.out)
    draw_approach(arguments.out)
    draw_merging(arguments.out)
    draw_arms(arguments.out)
    draw_room(arguments.out)


if __name__ == "__main__":
    main()
