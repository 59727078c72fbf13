"""A film of a scene at true speed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.progress import track

from radar_app import preview_panels as panels
from radar_core import ConfigError
from radar_sim.simulator import Simulator
from radar_sim.truth import SimulatedFrame

MOST_PICTURES: Final[float] = 25.0
"""Pictures per second, unless the caller wants more."""
SIZE: Final[tuple[int, int]] = (1280, 720)
"""Pixels of a picture, both even as yuv420p needs."""
_DPI: Final[int] = 100
_BIT_RATE: Final[int] = 4_000_000  # of mpeg4, which is used where there is no H.264
_SLOWEST: Final[Fraction] = Fraction(1, 1000)  # pictures per second
_COLUMNS: Final[int] = 640
"""Columns of the micro-Doppler: about the pixels that it is wide."""


def need_av(out: Path) -> ModuleType:
    """Return PyAV; a `ConfigError` says that it is not installed."""
    try:
        import av
    except ImportError:
        advice = f"pip install 'handwave[video]', or draw a picture: {out.with_suffix('.png')}"
        raise ConfigError(f"preview {out}: films need PyAV; {advice}") from None
    module: ModuleType = av
    return module


def step_of(interval: float, every: float | None) -> int:
    """Frames from one picture of the film to the next, for frames ``interval`` apart [s]."""
    wanted = 1.0 / MOST_PICTURES if every is None else every
    return max(math.ceil(wanted / interval - 1e-3) if every is None else round(wanted / interval), 1)


def film(simulator: Simulator, out: Path, every: float | None) -> None:
    """Simulate all frames and write the film, whatever the ending of ``out``; see `radar_app.preview.draw`."""
    need_av(out)
    stage = _Stage(simulator)
    step = step_of(simulator.interval, every)
    encode(out, 1.0 / (step * simulator.interval), stage.pictures(step))


def encode(out: Path, per_second: float, pictures: Iterable[NDArray[np.uint8]]) -> None:
    """Write a film of pictures of `SIZE`, shape (height, width, 4), whatever the ending of ``out``."""
    av = need_av(out)
    rate = max(Fraction(per_second).limit_denominator(1000), _SLOWEST)
    codec = "libx264" if "libx264" in av.codec.codecs_available else "mpeg4"
    with av.open(str(out), "w", format="mp4") as container:
        stream: Any = container.add_stream(codec, rate=rate)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        if codec == "libx264":
            stream.options = {"crf": "23", "preset": "veryfast"}
        else:
            stream.bit_rate = _BIT_RATE
        stream.codec_context.thread_count = 1
        for rgba in pictures:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(rgba, format="rgba")))
        container.mux(stream.encode())


def draw_over(canvas: Any, still: Any, moving: Iterable[tuple[Axes | None, Artist]]) -> NDArray[np.uint8]:
    """Draw what moves over a copy of what stands still, shape (height, width, 4); it is valid until the next.

    ``moving``: each with its axes, or None for what stands in the figure itself.
    """
    canvas.restore_region(still)
    renderer = canvas.get_renderer()
    for ax, artist in moving:
        if ax is None:
            artist.draw(renderer)
        else:
            ax.draw_artist(artist)
    return np.asarray(canvas.buffer_rgba())


class _Stage:
    """The figure of the film. What stands still is drawn once; artists that move are drawn over a copy of it."""

    def __init__(self, simulator: Simulator) -> None:
        self._simulator, self._observer = simulator, panels.Observer(simulator.info)
        self._deeds = panels.deeds(simulator)
        self._scale = panels.find_scale(simulator, self._observer)
        self._start = simulator.radar.trigger_offset
        self._end = self._start + simulator.n_frames * simulator.interval
        self._figure = Figure(figsize=(SIZE[0] / _DPI, SIZE[1] / _DPI), dpi=_DPI)
        canvas: Any = FigureCanvasAgg(self._figure)  # its methods carry no types
        self._strip = panels.Strip(simulator.n_frames, len(self._observer.speed), _COLUMNS, self._scale.low)
        self._room = self._make_room(panels.room_extent(simulator.scene, simulator.info))
        self._make_spectra()
        self._make_state()
        self._moving: list[tuple[Axes | None, Artist]] = [
            (self._spectrum_axes, self._spectrum),
            (self._micro_axes, self._micro),
            *((self._micro_axes, mark) for mark in self._marks),
            *self._room.artists,
            (self._micro_axes, self._cursors[0]),
            (self._doing_axes, self._cursors[1]),
            *((None, text) for text in self._texts),
        ]
        for _, artist in self._moving:
            artist.set_animated(True)
        self._canvas = canvas
        canvas.draw()
        self._still = canvas.copy_from_bbox(self._figure.bbox)

    def pictures(self, step: int) -> Iterator[NDArray[np.uint8]]:
        """Yield a picture for every ``step``-th frame, shape (height, width, 4); it is valid until the next."""
        for k in track(range(self._simulator.n_frames), description="filming"):
            simulated = self._simulator.process(k)
            level = self._observer.process(simulated.frame)
            self._strip.add(k, self._observer.echoes(level).max(axis=1))
            if k % step == 0:
                self._update(simulated, level)
                yield self._render()

    def _render(self) -> NDArray[np.uint8]:
        return draw_over(self._canvas, self._still, self._moving)

    def _update(self, simulated: SimulatedFrame, level: NDArray[np.float32]) -> None:
        now = self._start + simulated.frame.sequence * self._simulator.interval
        self._room.update(simulated.truth)
        self._spectrum.set_data(level)
        self._micro.set_data(self._strip.values)
        for cursor in self._cursors:
            cursor.set_xdata([now, now])
        self._texts[0].set_text(f"{now:6.2f} s    frame {simulated.frame.sequence}    {len(simulated.truth.scatterer_rcs)} scatterers seen")
        doing = {deed.person: deed.name for deed in self._deeds if deed.start <= now < deed.end}
        for i, (text, person) in enumerate(zip(self._texts[1:], self._simulator.scene.people, strict=False)):
            text.set_text(f"{person.id}: {doing.get(i, '–')}")

    def _axes(self, left: float, bottom: float, width: float, height: float) -> Axes:
        """Axes at a place given in pixels from below."""
        return self._figure.add_axes((left / SIZE[0], bottom / SIZE[1], width / SIZE[0], height / SIZE[1]))

    def _make_room(self, extent: panels.Extent) -> panels.RoomView:
        left, width, low, gap, height = 55.0, 450, 45, 22, 640
        front_height, top_height = extent.heights
        unit = min(width / extent.width, (height - gap) / (front_height + top_height))
        left += (width - unit * extent.width) / 2
        top = self._axes(left, low, unit * extent.width, unit * top_height)
        front = self._axes(left, low + unit * top_height + gap, unit * extent.width, unit * front_height)
        panels.label(front, "what the radar sees: from the radar, from above", y="z [m]", labelbottom=False)
        panels.label(top, x="y [m]", y="x [m]")
        return panels.RoomView(front, top, self._simulator, extent)

    def _make_spectra(self) -> None:
        near, far, slow, fast = self._observer.extent
        rows = max(len(self._simulator.scene.people), 1)
        doing_height = min(18 * rows, 110)
        self._spectrum_axes = self._axes(575, 385, 620, 225)
        self._micro_axes = self._axes(575, 45, 620, 270 - doing_height)
        self._doing_axes = self._axes(575, 317 - doing_height, 620, doing_height)
        empty = np.full((len(self._observer.speed), 1), self._scale.low, np.float32)
        self._spectrum = panels.show_map(self._spectrum_axes, empty, self._observer.extent, self._scale)
        self._micro = panels.show_map(self._micro_axes, self._strip.values, (self._start, self._end, slow, fast), self._scale)
        self._spectrum_axes.set_xlim(near, far)
        self._doing_axes.set_title("what people do; micro-Doppler", fontsize=panels.FONT)
        panels.draw_deeds(self._doing_axes, self._simulator, (self._start, self._end))
        self._marks = panels.mark_gestures(self._micro_axes, self._simulator, self._end)
        panels.label(self._spectrum_axes, "range-Doppler map", "range [m]", "range rate [m/s]")
        panels.label(self._micro_axes, x="time [s]", y="range rate [m/s]")
        panels.add_colour_bar(self._micro, self._axes(1203, 45, 11, 565))

    def _make_state(self) -> None:
        tones = ((self._micro_axes, "white"), (self._doing_axes, "black"))
        self._cursors = [ax.axvline(self._start, color=tone, linewidth=1.0) for ax, tone in tones]
        people = self._simulator.scene.people
        self._texts = [self._figure.text(575 / SIZE[0], 685 / SIZE[1], "", fontsize=12, family="monospace")]
        per_row = max(min(len(people), 5), 1)
        for i in range(min(len(people), 2 * per_row)):
            x, y = 575 + (i % per_row) * 640 / per_row, 655 - 20 * (i // per_row)
            self._texts.append(self._figure.text(x / SIZE[0], y / SIZE[1], "", fontsize=12, color=panels.colour(i), weight="bold"))
