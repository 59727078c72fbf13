"""A whole scene in one picture: snapshots of people and their spectra, and maps over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from rich.progress import track

from radar_app import preview_panels as panels
from radar_sim.simulator import Simulator

SNAPSHOTS: Final[int] = 6
MOST_SNAPSHOTS: Final[int] = 12
_COLUMNS: Final[int] = 1600
"""Columns of the maps over time: what the picture can show."""
_WIDTH, _LEFT, _RIGHT, _GAP = 13.0, 0.95, 0.85, 0.12  # inches


@dataclass(frozen=True, eq=False)
class _Sheet:
    """The figure and its axes; three rows with a column per snapshot, and three rows over time."""

    figure: Figure
    front: list[Axes]
    top: list[Axes]
    spectrum: list[Axes]
    doing: Axes
    micro_doppler: Axes
    distance: Axes


def picture(simulator: Simulator, every: float | None) -> Figure:
    """Simulate all frames and draw; see `radar_app.preview.draw`."""
    observer = panels.Observer(simulator.info)
    scale, extent = panels.find_scale(simulator, observer), panels.room_extent(simulator.scene, simulator.info)
    times = snapshot_times(simulator.scene.duration, panels.deeds(simulator), every)
    wanted = sorted({min(max(round((t - simulator.radar.trigger_offset) / simulator.interval), 0), simulator.n_frames - 1) for t in times})
    sheet = _sheet(extent, len(wanted), len(simulator.scene.people))
    views = [panels.RoomView(front, top, simulator, extent, 0.55) for front, top in zip(sheet.front, sheet.top, strict=True)]
    n_range = 1 if simulator.info.waveform.modulation == "cw" else simulator.info.waveform.n_sample
    strips = [panels.Strip(simulator.n_frames, n, _COLUMNS, scale.low) for n in (len(observer.speed), n_range)]
    trail = math.ceil(1.0 / simulator.interval)
    for k in track(range(simulator.n_frames), description="drawing"):
        simulated = simulator.process(k)
        level = observer.process(simulated.frame)
        strips[0].add(k, observer.echoes(level).max(axis=1))
        strips[1].add(k, level.max(axis=0))
        for number, view, ax in zip(wanted, views, sheet.spectrum, strict=True):
            if number - trail <= k <= number:
                view.update(simulated.truth)
            if k == number:
                panels.show_map(ax, level, observer.extent, scale)
    _label_snapshots(sheet, simulator, wanted)
    _draw_times(sheet, simulator, observer, strips, scale)
    return sheet.figure


def snapshot_times(duration: float, doing: Sequence[panels.Deed], every: float | None) -> list[float]:
    """Choose moments of a scene evenly, and from each towards the nearest middle of something that somebody does, a gesture if possible.

    They ascend [s], and are at most `MOST_SNAPSHOTS`. With ``every`` it is so far [s] from one to the next, and nothing is preferred;
    without there are `SNAPSHOTS` of them.
    """
    if every is not None:
        n = min(max(math.floor(duration / every), 1), MOST_SNAPSHOTS)
        return [(i + 0.5) * every for i in range(n)] if n * every <= duration else [duration / 2]
    step = duration / SNAPSHOTS
    times = []
    for i in range(SNAPSHOTS):
        middle = (i + 0.5) * step
        # Shortly past the middle of a stroke the arm is out and its hand still moves.
        near = [(not d.gesture, abs(t - middle), t) for d in doing if abs((t := d.start + 0.6 * (d.end - d.start)) - middle) < step / 2]
        times.append(min(near)[2] if near else middle)
    return times


def _sheet(extent: panels.Extent, n: int, n_people: int) -> _Sheet:
    """Lay out the figure in inches, because both views of the room need one scale."""
    slot = (_WIDTH - _LEFT - _RIGHT) / n
    unit = min((slot - _GAP) / extent.width, 5.6 / sum(extent.heights))
    rows = [2.0, 2.6, 0.10 + 0.24 * max(n_people, 1), 1.6]  # range over time, micro-Doppler, people, spectra
    bottoms = np.cumsum([0.55, rows[0] + 0.12, rows[1] + 0.05, rows[2] + 0.6, rows[3] + 0.6]).tolist()
    front_height, top_height = (unit * height for height in extent.heights)
    height = bottoms[4] + top_height + 0.12 + front_height + 0.85
    figure = Figure(figsize=(_WIDTH, height), dpi=100)
    FigureCanvasAgg(figure)

    def axes(left: float, bottom: float, width: float, tall: float) -> Axes:
        return figure.add_axes((left / _WIDTH, bottom / height, width / _WIDTH, tall / height))

    lefts = [_LEFT + i * slot for i in range(n)]
    width, across = unit * extent.width, _WIDTH - _LEFT - _RIGHT - _GAP
    inset = (slot - _GAP - width) / 2
    return _Sheet(
        figure,
        [axes(left + inset, bottoms[4] + top_height + 0.12, width, front_height) for left in lefts],
        [axes(left + inset, bottoms[4], width, top_height) for left in lefts],
        [axes(left, bottoms[3], slot - _GAP, rows[3]) for left in lefts],
        *(axes(_LEFT, bottoms[i], across, rows[i]) for i in (2, 1, 0)),
    )


def _label_snapshots(sheet: _Sheet, simulator: Simulator, wanted: Sequence[int]) -> None:
    """Say when and what, and name the axes of the first column."""
    doing, people = panels.deeds(simulator), simulator.scene.people
    for i, (k, front, top, spectrum) in enumerate(zip(wanted, sheet.front, sheet.top, sheet.spectrum, strict=True)):
        now = simulator.radar.trigger_offset + k * simulator.interval
        acts = [f"{people[d.person].id}: {d.name}" for d in doing if d.start <= now < d.end]
        lines = [f"{now:.2f} s", *([", ".join(acts[:3])] if acts else [""])]
        z, x, speed = ("z [m]", "x [m]", "range rate [m/s]") if i == 0 else ("", "", "")
        panels.label(front, "\n".join(lines), y=z, labelbottom=False, labelleft=i == 0)
        panels.label(top, x="y [m]", y=x, labelleft=i == 0)
        top.xaxis.labelpad = 1
        panels.label(spectrum, x="range [m]", y=speed, labelleft=i == 0)
    title = "what the radar sees, from its place and from above; range-Doppler maps; micro-Doppler; range"
    sheet.figure.suptitle(title, fontsize=panels.FONT + 2, y=0.995)


def _draw_times(sheet: _Sheet, simulator: Simulator, observer: panels.Observer, strips: list[panels.Strip], scale: panels.Scale) -> None:
    """Draw what people do, the micro-Doppler and the range over time, below one another."""
    start, end = simulator.radar.trigger_offset, simulator.radar.trigger_offset + simulator.n_frames * simulator.interval
    near, far, slow, fast = observer.extent
    panels.draw_deeds(sheet.doing, simulator, (start, end))
    image = panels.show_map(sheet.micro_doppler, strips[0].values, (start, end, slow, fast), scale)
    panels.show_map(sheet.distance, strips[1].values, (start, end, near, far), scale)
    panels.mark_gestures(sheet.micro_doppler, simulator, end)
    panels.label(sheet.micro_doppler, y="micro-Doppler\nrange rate [m/s]", labelbottom=False)
    panels.label(sheet.distance, x="time [s]", y="range [m]")
    low, high = sheet.distance.get_position(), sheet.micro_doppler.get_position()
    panels.add_colour_bar(image, sheet.figure.add_axes((low.x1 + 0.006, low.y0, 0.009, high.y1 - low.y0)))
