"""A small map of a room, drawn with characters: radars at the bottom, people ahead of them, zones around them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

from rich.text import Text

from radar_core import RadarInfo
from radar_tracking.fusion.clouds import sensors

_ASPECT: Final = 2.0  # a character is about twice as high as wide
_FARTHEST: Final = 12.0  # m: what lies beyond is not drawn
_STYLES: Final = ("bold cyan", "bold yellow", "bold green", "bold magenta", "bold blue", "bold red")
_STEP: Final = 0.05  # m: along lines

Point = tuple[float, float]


def style_of(person: int) -> str:
    """Colour of a person; the number beside it says the same without colours."""
    return _STYLES[person % len(_STYLES)]


@dataclass
class RoomMap:
    """What there is to draw; the extent only grows, so that the picture stands still.

    Attributes
    ----------
    radars : dict of str to RadarInfo
        By namespace.
    zones : list of (str, list of (x, y))
        Names and corners [m].
    """

    radars: dict[str, RadarInfo] = field(default_factory=dict)
    zones: list[tuple[str, list[Point]]] = field(default_factory=list)
    _low: Point = (-0.3, -2.0)
    _high: Point = (4.0, 2.0)

    def draw(self, people: Mapping[int, Sequence[float]], width: int, height: int) -> Text:
        """Draw radars, zones and people (number to place in the room [m]) into so many characters."""
        shown = {number: (place[0], place[1]) for number, place in people.items() if _visible(place)}
        self._grow([*shown.values(), *(corner for _, corners in self.zones for corner in corners if _visible(corner)), *self._origins()])
        grid = _Grid(self._low, self._high, width, height - 1)
        for info in sensors(self.radars.values()):
            for end in _view(info):
                grid.line((info.mount.x, info.mount.y), end, ".", "dim")
        for name, corners in self.zones:
            for start, end in pairwise([*corners, *corners[:1]]):
                grid.line(start, end, ":", "dim")
            if corners:
                middle = (sum(x for x, _ in corners) / len(corners), sum(y for _, y in corners) / len(corners))
                grid.write(middle, name[: width // 3], "dim italic")
        for origin in self._origins():
            grid.write(origin, "^", "bold")
        for number, place in shown.items():
            grid.write(place, str(number), style_of(number))
        text = grid.text()
        text.append(grid.scale(), style="dim")
        return text

    def _origins(self) -> list[Point]:
        return [(info.mount.x, info.mount.y) for info in sensors(self.radars.values())]

    def _grow(self, places: Iterable[Point]) -> None:
        for x, y in places:
            self._low = (min(self._low[0], x - 0.3), min(self._low[1], y - 0.5))
            self._high = (max(self._high[0], x + 0.3), max(self._high[1], y + 0.5))


def _visible(place: Sequence[float]) -> bool:
    return all(math.isfinite(x) and abs(x) < _FARTHEST for x in place[:2])


def _view(info: RadarInfo) -> list[Point]:
    """Return the ends of the two borders of a radar's field of view."""
    reach = min(info.waveform.max_range, _FARTHEST) if math.isfinite(info.waveform.max_range) else _FARTHEST
    angles = (info.mount.yaw + side * info.array.fov_azimuth / 2 for side in (-1, 1))
    return [(info.mount.x + reach * math.cos(angle), info.mount.y + reach * math.sin(angle)) for angle in angles]


class _Grid:
    """Characters; x of the room points up, y to the left."""

    def __init__(self, low: Point, high: Point, width: int, height: int) -> None:
        self._width, self._height = width, height
        per_metre = min((height - 1) / (high[0] - low[0]), (width - 1) / _ASPECT / (high[1] - low[1]))
        self._rows, self._columns = per_metre, per_metre * _ASPECT
        self._low, self._middle = low[0], (low[1] + high[1]) / 2
        self._cells: list[list[tuple[str, str]]] = [[(" ", "")] * width for _ in range(height)]

    def _cell(self, place: Point) -> tuple[int, int]:
        row = self._height - 1 - round((place[0] - self._low) * self._rows)
        column = round((self._width - 1) / 2 - (place[1] - self._middle) * self._columns)
        return row, column

    def _put(self, row: int, column: int, character: str, style: str) -> None:
        if 0 <= row < self._height and 0 <= column < self._width:
            self._cells[row][column] = (character, style)

    def line(self, start: Point, end: Point, character: str, style: str) -> None:
        """Draw a line of one character."""
        n = max(math.ceil(math.dist(start, end) / _STEP), 1)
        for i in range(n + 1):
            share = i / n
            self._put(*self._cell((start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]))), character, style)

    def write(self, place: Point, text: str, style: str) -> None:
        """Write a word, its middle at a place."""
        row, column = self._cell(place)
        begin = column - len(text) // 2
        for i, character in enumerate(text):
            self._put(row, begin + i, character, style)

    def text(self) -> Text:
        """Put all lines together."""
        text = Text()
        for row in self._cells:
            for character, style in row:
                text.append(character, style=style or None)
            text.append("\n")
        return text

    def scale(self) -> str:
        """Draw how long a metre, or two, or five are."""
        metres: Any = next((m for m in (1, 2, 5) if m * self._columns >= 4), 5)
        return f"|{'-' * max(round(metres * self._columns) - 2, 1)}| {metres} m   ^ radar"
