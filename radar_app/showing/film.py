"""A film of a bag at true speed: who is where at every moment, and a cursor in the maps over time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from radar_app.preview_video import MOST_PICTURES, draw_over, encode
from radar_app.showing.picture import Sheet, colour
from radar_core import PointCloud

_TRAIL: Final = 2.0  # s
_LOST: Final = 0.5  # s: who has no track for so long is not drawn


def film(sheet: Sheet, out: Path, every: float | None = None) -> None:
    """Write a film, whatever the ending of ``out``; ``every``: time between two pictures [s], None: 1/25 s."""
    step = 1.0 / MOST_PICTURES if every is None else every
    encode(out, 1.0 / step, _Stage(sheet).pictures(step))


class _Stage:
    """What stands still is drawn once; what moves is drawn over a copy of it."""

    def __init__(self, sheet: Sheet) -> None:
        canvas: Any = sheet.figure.canvas  # its methods carry no types
        self._sheet = sheet
        self._cursors = [ax.axvline(sheet.span[0], color="#888888" if number == 0 else "white") for number, ax in enumerate(sheet.timed)]
        self._points = sheet.room.plot([], [], ".", color="#666666", markersize=3, alpha=0.7)[0]
        self._bodies: list[tuple[Line2D, Line2D]] = [
            (
                sheet.room.plot([], [], color=colour(row.person), linewidth=4, alpha=0.6)[0],
                sheet.room.plot([], [], "o", color=colour(row.person), markersize=13, markeredgecolor="black")[0],
            )
            for row in sheet.results.people
        ]
        self._text = sheet.figure.text(0.05, 0.955, "", fontsize=12, family="monospace")
        moving: list[tuple[Axes | None, Artist]] = [(sheet.room, self._points)]
        moving += [(sheet.room, line) for pair in self._bodies for line in pair]
        moving += [*zip(sheet.timed, self._cursors, strict=True), (None, self._text)]
        self._moving = moving
        for _, artist in moving:
            artist.set_animated(True)
        self._canvas = canvas
        self._canvas.draw()
        self._still = self._canvas.copy_from_bbox(sheet.figure.bbox)

    def pictures(self, step: float) -> Iterator[NDArray[np.uint8]]:
        """Yield a picture for every moment, shape (height, width, 4); it is valid until the next."""
        first, last = self._sheet.span
        clouds = self._clouds()
        here, following = None, next(clouds, None)
        for now in track(np.arange(first, last, step).tolist(), description="filming", console=Console(stderr=True), transient=True):
            while following is not None and following[0] <= now:
                here, following = following, next(clouds, None)
            self._update(now, here[1] if here is not None and now - here[0] < _LOST else None)
            yield self._render()

    def _clouds(self) -> Iterator[tuple[float, PointCloud]]:
        results, info = self._sheet.results, self._sheet.info
        source = results.first("radar/points")
        if not source or info is None:
            return
        for cloud in results.measured(source):
            if isinstance(cloud, PointCloud):
                yield (cloud.stamp_ns - results.start_ns) * 1e-9, cloud.to_room(info.mount)

    def _update(self, now: float, cloud: PointCloud | None) -> None:
        for cursor in self._cursors:
            cursor.set_xdata([now, now])
        self._points.set_data([] if cloud is None else cloud.y, [] if cloud is None else cloud.x)
        count = 0
        for row, (trail, body) in zip(self._sheet.results.people, self._bodies, strict=True):
            end = int(np.searchsorted(row.time, now, side="right"))
            there = end > 0 and now - row.time[end - 1] < _LOST
            begin = int(np.searchsorted(row.time, now - _TRAIL))
            begin, end = (begin, end) if there else (0, 0)
            trail.set_data(row.position[begin:end, 1], row.position[begin:end, 0])
            body.set_data(row.position[begin:end, 1][-1:], row.position[begin:end, 0][-1:])
            count += there
        doing = [f"{one.person}: {one.gesture}" for one in self._sheet.results.gestures if one.start <= now < one.end + _LOST]
        self._text.set_text(f"{now:6.2f} s  {count} {'person' if count == 1 else 'people'}  {', '.join(doing)[:40]}")

    def _render(self) -> NDArray[np.uint8]:
        return draw_over(self._canvas, self._still, self._moving)
