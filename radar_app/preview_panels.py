"""What a preview is made of: the room from in front and from above, spectra of frames, and what people do over time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from radar_core import RadarInfo
from radar_lab.plots import HEAT, PEOPLE
from radar_lab.spectra import Observer, Scale, Strip, scale_of
from radar_sim.scene import Scene
from radar_sim.simulator import Simulator
from radar_sim.things import Corner, Furniture, Point, Wall
from radar_sim.truth import Truth

__all__ = ["Observer", "Scale", "Strip"]

FloatArray = NDArray[np.floating]
COLOURS: Final[tuple[str, ...]] = PEOPLE
"""Of people, in the scene's order, again and again."""
THING_COLOUR: Final[str] = "#6b6b6b"
_SIZES: Final[FloatArray] = np.array([1.6, 2.4, 3.6, 5.4])
"""Diameters [pt] of scatterers, from one upper bound of the cross-section to the next [m^2]; few sizes are drawn much faster than many."""
_BOUNDS: Final[FloatArray] = np.array([2e-4, 2e-3, 2e-2])
FONT: Final[int] = 10  # pt
_SMALLEST: Final[float] = 5.0  # pt, of names; one without room for that is left out
_TRAIL: Final[float] = 1.0  # s
_VIEWS: Final[tuple[tuple[int, int], ...]] = ((1, 2), (1, 0))
"""Horizontal and vertical coordinate: as the radar sees it, and from above. Left is on the left in both."""


def colour(owner: int) -> str:
    """Colour of the person (index in the scene), or of things (negative)."""
    return COLOURS[owner % len(COLOURS)] if owner >= 0 else THING_COLOUR


def find_scale(simulator: Simulator, observer: Observer, n: int = 9) -> Scale:
    """Look at ``n`` frames all over the scene: from the noise, or 65 dB below the strongest echo, to that."""
    chosen = np.unique(np.linspace(0, simulator.n_frames - 1, n).astype(int)).tolist()
    return scale_of([observer.process(simulator.process(k).frame) for k in chosen], observer)


@dataclass(frozen=True)
class Deed:
    """Something that a person does: index of the person, what, and from when to when [s]."""

    person: int
    name: str
    start: float
    end: float
    gesture: bool


def deeds(simulator: Simulator) -> list[Deed]:
    """List what people do and when, by the script as it was laid out in time; standing, turning and moving the arm back are left out."""
    labels = simulator.scene.labels
    return [
        Deed(i, s.kind if s.gesture is None else labels[s.gesture].replace("_", " "), s.start, s.end, s.gesture is not None)
        for i, timeline in enumerate(simulator.world.timelines)
        for s in timeline.segments
        if s.kind not in ("stand", "turn", "move")
    ]


def draw_deeds(ax: Axes, simulator: Simulator, span: tuple[float, float]) -> None:
    """Draw a row per person with what that person does, between two times [s]; names are as large as there is room until the next."""
    people, (start, end) = simulator.scene.people, span
    n, figure = len(people), ax.get_figure()
    points = 72 * ax.get_position().width * (figure.get_figwidth() if isinstance(figure, Figure) else 1.0) / (end - start)
    doing = deeds(simulator)
    for deed in doing:
        left, right, row = max(deed.start, start), min(deed.end, end), n - 1 - deed.person
        if left >= right:
            continue
        ax.barh(row, right - left, left=left, height=0.86, color=colour(deed.person), alpha=0.55 if deed.gesture else 0.18, linewidth=0)
        room = min((other.start for other in doing if other.person == deed.person and other.start > deed.start), default=end) - left
        size = min(points * room / (0.6 * len(deed.name)), FONT - 1)  # a letter is about 0.6 of the font's size wide
        if size >= _SMALLEST:
            ax.text(left + 1 / points, row, deed.name, fontsize=size, va="center", clip_on=True)
    ax.set(xlim=span, ylim=(-0.5, max(n, 1) - 0.5), yticks=range(n), yticklabels=[f"person {p.id}" for p in reversed(people)])
    ax.tick_params(length=0, labelsize=FONT - 1, labelbottom=False)
    colours = {f"person {person.id}": colour(i) for i, person in enumerate(people)}
    for label in ax.get_yticklabels():
        label.set_color(colours[label.get_text()])
    ax.spines[:].set_visible(False)


def mark_gestures(ax: Axes, simulator: Simulator, end: float) -> list[Line2D]:
    """Draw thin lines where gestures start and end."""
    marks = ((time, deed.person) for deed in deeds(simulator) if deed.gesture for time in (deed.start, deed.end) if time < end)
    return [ax.axvline(time, color=colour(person), linewidth=0.7, alpha=0.9) for time, person in marks]


def show_map(ax: Axes, level: FloatArray, extent: tuple[float, float, float, float], scale: Scale) -> AxesImage:
    """Show a map in dB, rows upwards."""
    look: dict[str, Any] = {"origin": "lower", "aspect": "auto", "interpolation": "nearest", "cmap": HEAT}
    return ax.imshow(level, extent=extent, vmin=scale.low, vmax=scale.high, **look)


def label(ax: Axes, title: str = "", x: str = "", y: str = "", **ticks: Any) -> None:
    """Name axes, in letters of one size; ``ticks`` as of ``Axes.tick_params``."""
    ax.set_title(title, fontsize=FONT)
    ax.set_xlabel(x, fontsize=FONT)
    ax.set_ylabel(y, fontsize=FONT)
    ax.tick_params(labelsize=FONT - 1, **ticks)


def add_colour_bar(image: AxesImage, bar: Axes) -> None:
    """Say what the colours of maps mean."""
    bar.figure.colorbar(image, cax=bar).set_label("power [dB]", fontsize=FONT)
    bar.tick_params(labelsize=FONT - 1)


@dataclass(frozen=True, eq=False)
class Extent:
    """Corners of what of the room is shown, shape (3,) each [m]."""

    low: FloatArray
    high: FloatArray

    @property
    def width(self) -> float:
        """From left to right [m]."""
        return float(self.high[1] - self.low[1])

    @property
    def heights(self) -> tuple[float, float]:
        """From bottom to top of both views [m]."""
        return float(self.high[2] - self.low[2]), float(self.high[0] - self.low[0])


def room_extent(scene: Scene, info: RadarInfo) -> Extent:
    """Find what holds the radar, people where their scripts say, and things, as far as the radar measures (at most 15 m)."""
    reach, origin = min(info.waveform.max_range, 15.0), info.mount.origin
    places = np.array([origin, *_places(scene)])
    places[:, :2] = np.clip(places[:, :2], origin[:2] - reach, origin[:2] + reach)
    places[:, 2] = np.clip(places[:, 2], -1.0, 4.0)
    low, high = places.min(axis=0), places.max(axis=0)
    middle = (low[:2] + high[:2]) / 2
    half = np.maximum((high[:2] - low[:2]) / 2 + (0.5, 0.75), 1.25)
    return Extent(np.array([*(middle - half), min(low[2], 0.0)]), np.array([*(middle + half), max(high[2] + 0.1, 2.1)]))


def _places(scene: Scene) -> Iterator[tuple[float, float, float]]:
    for person in scene.people:
        yield (*person.position, person.height)
        for action in person.script:
            if action.walk is not None:
                yield (*action.walk.to, person.height)
    reflectors: tuple[Point | Corner, ...] = (*scene.points, *scene.corners)
    for thing in reflectors:
        for time in (0.0, scene.duration):
            x, y, z = np.array(thing.position) + time * np.array(thing.velocity)
            yield x, y, z
    for box in _boxes(scene):
        for x, y in _outline(box):
            yield x, y, _levels(box)[1]


def _boxes(scene: Scene) -> tuple[Wall | Furniture, ...]:
    return (*scene.walls, *scene.furniture)


def _outline(thing: Wall | Furniture) -> FloatArray:
    """Corners on the floor, shape (4, 2) [m]."""
    if isinstance(thing, Wall):
        start, end = np.array(thing.start), np.array(thing.end)
        along = (end - start) / np.linalg.norm(end - start)
        middle, length, depth = (start + end) / 2, float(np.linalg.norm(end - start)), max(thing.thickness, 0.02)
    else:
        along = np.array([math.cos(thing.heading), math.sin(thing.heading)])
        middle, (length, depth, _) = np.array(thing.position), thing.size
    across = np.array([-along[1], along[0]])
    return np.array([middle + i * along * length / 2 + j * across * depth / 2 for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))])


def _levels(thing: Wall | Furniture) -> tuple[float, float]:
    """Underside and top [m]."""
    return (0.0, thing.height) if isinstance(thing, Wall) else (thing.base, thing.base + thing.size[2])


class RoomView:
    """The room as the radar sees it (``front``) and from above (``top``), on axes in proportion to `Extent`.

    Artists are made once and only moved afterwards; ``artists`` has all that move. ``size`` of markers is relative to those of a film.
    """

    def __init__(self, front: Axes, top: Axes, simulator: Simulator, extent: Extent, size: float = 1.0) -> None:
        self._size = size
        self._n = len(simulator.scene.people)
        self._trail: list[tuple[float, FloatArray]] = []
        self.artists: list[tuple[Axes, Line2D]] = []
        self._points: list[dict[tuple[int, int], Line2D]] = []
        self._hands: list[list[tuple[Line2D, Line2D, Line2D]]] = []
        for ax, (i, j) in zip((front, top), _VIEWS, strict=True):
            ax.set(xlim=(extent.high[i], extent.low[i]), ylim=(extent.low[j], extent.high[j]))
            _draw_still(ax, i, j, simulator)
            kinds = [(owner, size) for owner in range(-1, self._n) for size in range(4)]
            self._points.append({(owner, size): self._line(ax, owner, float(_SIZES[size])) for owner, size in kinds})
            self._hands.append([self._hand(ax, owner) for owner in range(self._n)])

    def _line(self, ax: Axes, owner: int, size: float) -> Line2D:
        line = Line2D([], [], linestyle="", marker="o", markersize=self._size * size, markeredgewidth=0, color=colour(owner), alpha=0.6)
        return self._add(ax, line)

    def _hand(self, ax: Axes, owner: int) -> tuple[Line2D, Line2D, Line2D]:
        """Acting hand, the other one, and the trail of the acting one."""
        trail = Line2D([], [], color=colour(owner), linewidth=1.8 * self._size, alpha=0.9)
        acting = Line2D([], [], linestyle="", marker="o", markersize=8 * self._size, markerfacecolor=colour(owner), markeredgecolor="black")
        other = Line2D([], [], linestyle="", marker="o", markersize=6 * self._size, markerfacecolor="none", markeredgecolor="black")
        return self._add(ax, acting), self._add(ax, other), self._add(ax, trail)

    def _add(self, ax: Axes, line: Line2D) -> Line2D:
        ax.add_line(line)
        self.artists.append((ax, line))
        return line

    def update(self, truth: Truth) -> None:
        """Show the state of a frame; trails go back one second over the frames that were shown before."""
        now = truth.stamp_ns * 1e-9
        self._trail = [entry for entry in self._trail if 0.0 <= now - entry[0] <= _TRAIL] + [(now, truth.hand_position)]
        trails = np.stack([hands for _, hands in self._trail])
        size = np.searchsorted(_BOUNDS, truth.scatterer_rcs)
        owner = np.maximum(truth.scatterer_owner, -1)
        for (i, j), points, hands in zip(_VIEWS, self._points, self._hands, strict=True):
            place = truth.scatterer_position[:, (i, j)]
            for (who, bound), line in points.items():
                chosen = place[(owner == who) & (size == bound)]
                line.set_data(chosen[:, 0], chosen[:, 1])
            for person, (acting, other, trail) in enumerate(hands):
                acting.set_data(truth.hand_position[person, [i]], truth.hand_position[person, [j]])
                other.set_data(truth.other_hand_position[person, [i]], truth.other_hand_position[person, [j]])
                trail.set_data(trails[:, person, i], trails[:, person, j])


def _draw_still(ax: Axes, i: int, j: int, simulator: Simulator) -> None:
    """Draw the radar, its field of view from above, walls and furniture."""
    mount, from_above = simulator.info.mount, j == 0
    for thing in _boxes(simulator.scene):
        outline, (low, high) = _outline(thing), _levels(thing)
        left, right = outline[:, 1].min(), outline[:, 1].max()
        corners = outline[:, ::-1] if from_above else np.array([(left, low), (right, low), (right, high), (left, high)])
        ax.add_patch(Polygon(corners, facecolor="#b9b2a6", edgecolor="#8a8378", alpha=0.75 if from_above else 0.22, linewidth=0.8))
    if from_above:
        reach = min(simulator.info.waveform.max_range, 15.0)
        for side in (-0.5, 0.5):
            angle = mount.yaw + side * simulator.info.array.fov_azimuth
            end = mount.origin[:2] + reach * np.array([math.cos(angle), math.sin(angle)])
            ax.plot([mount.y, end[1]], [mount.x, end[0]], color="#bbbbbb", linewidth=0.8, linestyle="--")
    else:
        ax.axhline(0.0, color="#8a8378", linewidth=0.8)
    ax.plot(mount.origin[i], mount.origin[j], marker="^" if from_above else "s", markersize=6, color="black", markerfacecolor="none")
