"""Maps: range and Doppler of everything, and micro-Doppler, azimuth and elevation of one person."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import Any, Final

import numpy as np
from bokeh.models import ColumnDataSource, Range1d
from bokeh.models.annotations import ColorBar
from bokeh.models.widgets import Select
from bokeh.plotting import figure

from radar_app.view.feed import Feed, Snapshot
from radar_app.view.maps import MAX_SPEED, PersonMaps
from radar_app.view.pictures import Pictures
from radar_app.view.records import RangeDoppler
from radar_app.view.style import CARD, FAINT, FIELD, FONT, HEAT, both_sides, mapper, plot
from radar_core.types import Float32Array
from radar_gestures.maps import FeatureMaps

_SECONDS: Final = 2.0
_HEIGHT: Final = 230
_ANYBODY: Final = "0"
_EVERY_NS: Final = 150_000_000  # person maps are made five times a second: with every other picture
_ANGLES: Final = 60.0  # degrees to either side that colours reach

Shades = tuple[Sequence[str], float, float]
"""A palette, and the values of its first and its last colour."""


class RangeDopplerPanel:
    """The range-Doppler map of a radar, of several the one that is chosen; raw frames come only while it is there.

    Attributes
    ----------
    figure : figure
        The map.
    choice : Select
        Of which radar; not seen where there is only one.
    """

    def __init__(self, feed: Feed, pictures: Pictures) -> None:
        self._pictures = pictures
        self._wish = ExitStack()
        self._wish.enter_context(feed.want("range_doppler"))
        self._source = pictures.source("range_doppler", _image(_EMPTY, -1.0, 0.0, 2.0, 1.0))
        self._across, self._up = Range1d(start=-4.2, end=4.2), Range1d(start=0.0, end=6.4)
        self._shown: Any = None
        ranges = {"x_range": self._across, "y_range": self._up}
        self.figure = plot("range_doppler_plot", "speed, away from the radar [m/s]", "distance [m]", **ranges, height=_HEIGHT, tools="")
        _draw(self.figure, "image", self._source, (HEAT, 0.0, 45.0), "dB")
        self.choice = Select(title="of which radar", name="range_doppler_radar", visible=False, width=200, stylesheets=[FIELD])
        self.choice.on_change("value", pictures.look_again)
        self._offered = ""

    def update(self, now: Snapshot) -> None:
        """Show the map of a moment."""
        maps = now.range_doppler
        self._offer(maps)
        found = maps.get(self.choice.value)
        if found is self._shown:
            return
        self._shown = found
        if found is None:
            self._pictures.put(self._source, _image(_EMPTY, -1.0, 0.0, 2.0, 1.0))
            return
        self._across.update(start=-found.max_speed, end=found.max_speed)
        self._up.update(start=0.0, end=found.max_range)
        self._pictures.put(self._source, _image(found.power, -found.max_speed, 0.0, 2 * found.max_speed, found.max_range))

    def _offer(self, maps: Mapping[str, RangeDoppler]) -> None:
        """Let the user choose among the radars that were ever heard of."""
        known = sorted({*self.choice.options, *maps})
        if known != self.choice.options:
            self.choice.options = known
            if self.choice.value == self._offered:  # nobody has chosen yet
                self._offered = self.choice.value = known[0]
            self.choice.visible = len(known) > 1

    def close(self) -> None:
        """Want no more frames."""
        self._wish.close()


class MapFigures:
    """Micro-Doppler, azimuth and elevation over time, which have one axis of time.

    Parameters
    ----------
    name : str
        How the names of its figures and its source begin.
    across : Range1d
        Times that are shown [s].
    pictures : Pictures or None
        Sends what they show, for figures that change many times a second; None: they change at once.

    Attributes
    ----------
    figures : list of figure
        Of the three.
    """

    def __init__(self, name: str, across: Range1d, pictures: Pictures | None = None) -> None:
        self._pictures = pictures
        title = f"{name}person_maps"
        self._source = pictures.source(title, _NO_IMAGES) if pictures else ColumnDataSource(data=_NO_IMAGES, name=title)
        up, sides, angle = Range1d(start=-MAX_SPEED, end=MAX_SPEED), both_sides(), "\u00b0, orange: {}"
        self.figures = [
            self._figure(name, "micro_doppler", "micro-Doppler", (HEAT, 5.0, 40.0), "dB", across, up),
            self._figure(name, "azimuth", "azimuth", (sides, -_ANGLES, _ANGLES), angle.format("left"), across, up),
            self._figure(name, "elevation", "elevation", (sides, -_ANGLES / 2, _ANGLES / 2), angle.format("up"), across, up),
        ]

    def _figure(self, name: str, field: str, title: str, shades: Shades, unit: str, across: Range1d, up: Range1d) -> figure:
        made = plot(f"{name}{field}_plot", "time [s]", f"{title}: speed [m/s]", x_range=across, y_range=up, height=_HEIGHT, tools="")
        _draw(made, field, self._source, shades, unit)
        return made

    def show(self, maps: FeatureMaps, zero_ns: int) -> None:
        """Show maps; time counts from a moment [ns]."""
        self._put(_person_images(maps, zero_ns))

    def clear(self) -> None:
        """Show nothing."""
        self._put(_NO_IMAGES)

    def _put(self, data: dict[str, Any]) -> None:
        if self._pictures is not None:
            self._pictures.put(self._source, data)
        else:
            self._source.data = data


class PersonPanel:
    """What one person's points said in the last two seconds; of whom is chosen, or it is whoever made the last gesture, or is nearest."""

    def __init__(self, pictures: Pictures) -> None:
        self._maps = PersonMaps(_SECONDS)
        self._due_ns, self._whose = 0, -1
        self.choice = Select(
            title="whose maps (or click a person on the plan)",
            value=_ANYBODY,
            options=_choices([]),
            name="person",
            width=330,
            stylesheets=[FIELD],
        )
        self.choice.on_change("value", pictures.look_again)
        self._images = MapFigures("", Range1d(start=-_SECONDS, end=0.0), pictures)
        self.figures = self._images.figures

    def update(self, now: Snapshot) -> None:
        """Show the maps of a moment."""
        people = now.people
        ids = [track.id for track in people.tracks] if people is not None else []
        options = _choices(ids)
        if options != self.choice.options:
            self.choice.options = options
        whose = self._who(now, ids)
        if whose == self._whose and now.newest and 0 <= self._due_ns - now.stamp_ns < 2 * _EVERY_NS:
            return
        self._due_ns, self._whose = now.stamp_ns + _EVERY_NS, whose
        found = self._maps.process(now, whose) if whose >= 0 else None
        if found is not None and len(found.stamp_ns) > 1:
            self._images.show(found, now.stamp_ns)

    def _who(self, now: Snapshot, ids: list[int]) -> int:
        """Whose maps are shown; -1: nobody's."""
        if self.choice.value != _ANYBODY and int(self.choice.value) in ids:
            return int(self.choice.value)
        actors = [entry.value.track_id for entry in now.past("gestures", 10.0) if entry.value.label and entry.value.track_id in ids]
        if actors:
            return int(actors[-1])
        tracks = now.people.tracks if now.people is not None else ()
        nearest = sorted((float(np.hypot(track.position[0], track.position[1])), track.id) for track in tracks)
        return nearest[0][1] if nearest else -1

    def choose(self, track_id: int) -> None:
        """Show one person's maps from now on."""
        self.choice.value = str(track_id)


def _choices(ids: list[int]) -> Any:
    return [(_ANYBODY, "whoever acts"), *((str(number), f"person {number}") for number in ids)]


def _image(image: Float32Array, x: float, y: float, width: float, height: float) -> dict[str, Any]:
    return {"image": [image], "x": [x], "y": [y], "width": [width], "height": [height]}


def _images(micro_doppler: Float32Array, azimuth: Float32Array, elevation: Float32Array, x: float, width: float) -> dict[str, Any]:
    """Three images of shape (n_speed, n_time)."""
    images = {"micro_doppler": [micro_doppler], "azimuth": [azimuth], "elevation": [elevation]}
    return {**images, "x": [x], "width": [width], "y": [-MAX_SPEED], "height": [2 * MAX_SPEED]}


def _person_images(maps: FeatureMaps, now_ns: int) -> dict[str, Any]:
    level = np.where(maps.micro_doppler > 0, maps.micro_doppler, np.nan).astype(np.float32)
    angles = (np.degrees(maps.azimuth).astype(np.float32), np.degrees(maps.elevation).astype(np.float32))
    interval = float(np.median(np.diff(maps.stamp_ns))) * 1e-9
    start = (int(maps.stamp_ns[0]) - now_ns) * 1e-9
    span = (int(maps.stamp_ns[-1]) - int(maps.stamp_ns[0])) * 1e-9 + interval
    level, azimuth, elevation = (np.ascontiguousarray(each.T) for each in (level, *angles))
    return _images(level, azimuth, elevation, start, span)


_EMPTY: Final = np.full((2, 2), np.nan, np.float32)
_NO_IMAGES: Final = _images(_EMPTY, _EMPTY, _EMPTY, -_SECONDS, _SECONDS)


def _draw(made: figure, field: str, source: ColumnDataSource, shades: Shades, unit: str) -> None:
    """Draw an image as an overlay, so that axes and colour bar are painted only when they change.

    The bar has a mapper of its own: the image's tells of every image, and whoever listens is laid out anew.
    """
    options: Any = {"color_mapper": mapper(*shades), "level": "overlay"}
    made.image(field, "x", "y", "width", "height", source=source, **options)
    bar = ColorBar(
        color_mapper=mapper(*shades), width=7, padding=4, title=unit, title_text_color=FAINT, title_text_font=FONT,
        title_text_font_size="11px", title_text_font_style="normal", major_label_text_color=FAINT, major_label_text_font_size="10px",
        background_fill_color=CARD, bar_line_color=None, major_tick_line_color=None, title_standoff=4,
    )  # fmt: skip
    made.add_layout(bar, "right")
