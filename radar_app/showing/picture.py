"""A bag in one picture: the room from above, who was there and did what, micro-Doppler and range over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Polygon

from radar_app.showing.maps import Maps, TimeMap, time_maps
from radar_app.showing.results import GestureRow, PersonRow, Results
from radar_core import DataError, RadarInfo
from radar_lab.plots import HEAT, PEOPLE
from radar_lab.spectra import Scale
from radar_ros.bags import read
from radar_ros.messages.zones import areas_from_msg
from radar_ros.offline import parse

SIZE: Final = (1280, 720)  # pixels, those of a film
_DPI: Final = 100
_FONT: Final = 10
_ROWS: Final = 8  # most people that have a row of their own
_WIDE: Final = 1.5  # m: to either side that is always drawn
_REACH: Final = 12.0  # m: what lies beyond is not drawn
_FEW: Final = 4  # people, whose rows have room for two lines of names
_LETTER: Final = 0.0105  # of the duration: about how wide a letter of a name is


class Sheet:
    """The figure of a bag.

    Attributes
    ----------
    room : Axes
        From above: y to the left, x up [m].
    timed : list of Axes
        Those with the time across, to put cursors in.
    span : tuple of float
        First and last time [s].
    """

    def __init__(self, results: Results) -> None:
        self.results = results
        maps = time_maps(results)
        if maps is None and not results.people:
            raise DataError(f"{results.path}: holds no frames, no points and no tracks; there is nothing to draw")
        self.info = maps.info if maps is not None else None
        self.span = _span(results, maps)
        self.figure = Figure(figsize=(SIZE[0] / _DPI, SIZE[1] / _DPI), dpi=_DPI)
        FigureCanvasAgg(self.figure)
        self.room = self.figure.add_axes((0.05, 0.08, 0.36, 0.84))
        rows = len(_shown(results))
        bars = 0.03 + (0.045 if rows <= _FEW else 0.028) * max(rows, 1)
        bottoms = (0.08, 0.08 + (0.84 - bars) / 2)
        height = (0.84 - bars) / 2 - 0.05
        self.timed = [self.figure.add_axes((0.49, 0.92 - bars + 0.01, 0.42, bars - 0.01))]
        self._draw_room()
        self._draw_people()
        if maps is not None:
            names = (("range [m]", maps.distance), ("range rate [m/s]", maps.micro_doppler))
            for bottom, (name, shown) in zip(bottoms, names, strict=True):
                ax = self.figure.add_axes((0.49, bottom, 0.42, height))
                image = _show(ax, shown, maps.scale)
                _label(ax, x="time [s]" if shown is maps.distance else "", y=name)
                ax.set_xlim(self.span)
                self.timed.append(ax)
            self._bar(image, maps.level, bottoms[0], bottoms[1] + height)
        self.figure.suptitle(f"{results.path.name}: {_headline(results)}", fontsize=_FONT + 2)

    def _bar(self, image: AxesImage, name: str, low: float, high: float) -> None:
        bar = self.figure.add_axes((0.925, low, 0.01, high - low))
        self.figure.colorbar(image, cax=bar).set_label(name, fontsize=_FONT)
        bar.tick_params(labelsize=_FONT - 1)

    def _draw_room(self) -> None:
        ax, places = self.room, [np.zeros((1, 2))]
        if self.info is not None:
            places.append(_draw_radar(ax, self.info))
        for name, corners in _zones(self.results):
            ax.add_patch(Polygon(corners[:, ::-1], facecolor="none", edgecolor="#777777", linewidth=1.0, linestyle=":"))
            x, y = corners.mean(axis=0)
            ax.text(y, x, name, fontsize=_FONT - 1, color="#777777", ha="center")
            places.append(corners)
        for row in self.results.people:
            ax.plot(row.position[:, 1], row.position[:, 0], color=colour(row.person), linewidth=1.6, alpha=0.8)
            ax.text(row.position[-1, 1], row.position[-1, 0], f" {row.person}", color=colour(row.person), fontsize=_FONT, weight="bold")
            places.append(row.position[:, :2])
        for gesture in self.results.gestures:
            if math.isfinite(gesture.position[0]):
                ax.plot(gesture.position[1], gesture.position[0], "o", markersize=5, color=colour(gesture.person), markeredgecolor="black")
        everything = np.concatenate(places)
        everything = everything[np.all(np.abs(everything) < _REACH, axis=1)]
        low, high = everything.min(axis=0) - 0.5, everything.max(axis=0) + 0.5
        low[1], high[1] = min(low[1], -_WIDE), max(high[1], _WIDE)
        ax.set(xlim=(high[1], low[1]), ylim=(low[0], high[0]), aspect="equal")
        _label(ax, "the room from above; dots: gestures", "y, left [m]", "x, ahead [m]")
        ax.grid(alpha=0.3)

    def _draw_people(self) -> None:
        ax, rows = self.timed[0], _shown(self.results)
        for number, row in enumerate(rows):
            y = len(rows) - 1 - number
            ax.barh(y, row.time[-1] - row.time[0], left=row.time[0], height=0.8, color=colour(row.person), alpha=0.25, linewidth=0)
            done = [gesture for gesture in self.results.gestures if (gesture.namespace, gesture.person) == (row.namespace, row.person)]
            for gesture in done:
                width = max(gesture.end - gesture.start, 0.05)
                ax.barh(y, width, left=gesture.start, height=0.8, color=colour(row.person), alpha=0.75, linewidth=0)
            self._name(ax, y, done, (0.2, -0.2) if len(rows) <= _FEW else (0.0,))
        _label(ax, "who was there, and gestures" if rows else "no tracks in this recording")
        labels = [f"person {row.person}" for row in reversed(rows)]
        ax.set(xlim=self.span, ylim=(-0.6, max(len(rows), 1) - 0.4), yticks=range(len(rows)), yticklabels=labels)
        ax.tick_params(length=0, labelbottom=False)

    def _name(self, ax: Axes, y: float, gestures: Sequence[GestureRow], lines: Sequence[float]) -> None:
        """Write names of gestures on the first line that has room; none where no line has."""
        ends = dict.fromkeys(lines, -math.inf)
        for gesture in gestures:
            name = gesture.gesture.replace("_", " ")
            line = next((line for line in lines if ends[line] <= gesture.start), None)
            if line is not None:
                ax.text(gesture.start, y + line, name, fontsize=_FONT - 2, va="center", clip_on=True)
                ends[line] = gesture.start + (len(name) + 1) * _LETTER * (self.span[1] - self.span[0])


def colour(person: int) -> str:
    """Colour of a person, by the number of its track."""
    return PEOPLE[(person - 1) % len(PEOPLE)]


def _shown(results: Results) -> Sequence[PersonRow]:
    """Who has a row: those that were there for longest, in the order in which they came."""
    longest = sorted(results.people, key=lambda row: row.time[0] - row.time[-1])[:_ROWS]
    return [row for row in results.people if row in longest]


def _headline(results: Results) -> str:
    n, m = len(results.people), len(results.gestures)
    return f"{n} {'person' if n == 1 else 'people'}, {m} {'gesture' if m == 1 else 'gestures'}"


def _span(results: Results, maps: Maps | None) -> tuple[float, float]:
    begins = [row.time[0] for row in results.people] + ([maps.distance.extent[0]] if maps else [])
    ends = [row.time[-1] for row in results.people] + ([maps.distance.extent[1]] if maps else [])
    return float(min(begins)), float(max(ends)) + 1e-3


def _draw_radar(ax: Axes, info: RadarInfo) -> Any:
    """Draw a radar and the borders of its view; returns places that belong into the picture, shape (n, 2) [m]."""
    mount, reach = info.mount, min(info.waveform.max_range, _REACH / 2)
    ends = [(mount.x, mount.y)]
    for side in (-0.5, 0.5):
        angle = mount.yaw + side * info.array.fov_azimuth
        end = (mount.x + reach * math.cos(angle), mount.y + reach * math.sin(angle))
        ax.plot([mount.y, end[1]], [mount.x, end[0]], color="#999999", linewidth=0.9, linestyle="--")
    ax.plot(mount.y, mount.x, marker="^", markersize=8, color="black")
    ends.append((mount.x + min(reach, 3.0) * math.cos(mount.yaw), mount.y + min(reach, 3.0) * math.sin(mount.yaw)))
    return np.array(ends)


def _zones(results: Results) -> list[tuple[str, Any]]:
    """Zones as the bag said them last; names and corners, shape (n, 2) [m]."""
    source = results.first("zones")
    last = None
    for item in read(results.path, ("zones",)) if source else ():
        last = item if item.topic == source else last
    if last is None:
        return []
    return [(name, np.array(area.corners)) for name, area in areas_from_msg(parse(last.data, "zones"))]


def _show(ax: Axes, shown: TimeMap, scale: Scale) -> AxesImage:
    look: dict[str, Any] = {"origin": "lower", "aspect": "auto", "interpolation": "nearest", "cmap": HEAT}
    ax.set_facecolor("black")
    return ax.imshow(shown.values, extent=shown.extent, vmin=scale.low, vmax=scale.high, **look)


def _label(ax: Axes, title: str = "", x: str = "", y: str = "") -> None:
    ax.set_title(title, fontsize=_FONT)
    ax.set_xlabel(x, fontsize=_FONT)
    ax.set_ylabel(y, fontsize=_FONT)
    ax.tick_params(labelsize=_FONT - 1)
