"""The room from above: where radars look, zones, points, people and how they came, and the hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from bokeh.core.properties import value
from bokeh.core.property.descriptors import UnsetValueError
from bokeh.events import Tap
from bokeh.models import ColumnDataSource, CustomJSTickFormatter, LinearColorMapper, Range1d
from bokeh.models.annotations import LabelSet
from numpy.typing import NDArray

from radar_app.view.colours import NOBODY, PEOPLE, colour
from radar_app.view.feed import Entry, Snapshot
from radar_app.view.pictures import Pictures
from radar_app.view.style import ACCENT, BAD, FONT, GOOD, GROUND, LINE, TEXT, plot
from radar_core import PointCloud, RadarInfo
from radar_core.types import Float64Array
from radar_tracking.fusion.clouds import sensors
from radar_tracking.tracks import Tracks, TrackStatus
from radar_tracking.zones import Presence, ZoneStates
from radar_tracking.zones.area import Kind

_TRAIL: Final = 6.0  # s: how long a trail is
_TRAIL_STEP: Final = 0.2  # s: between two of its corners
_GLOW: Final = 0.3  # s: how long points stay
_GLOW_STEP: Final = 0.05  # s: between two clouds of which points are drawn: more would cost the browser time and show no more
_SPEED: Final = 0.8  # s: arrows point to where somebody will be so much later
_WIDTHS: Final = (0.22, 0.5)  # m: radius of a person
_TALL, _NARROW = 612, 520  # pixels: how tall the plan is, and how wide a phone, on which it is less tall
_MARGIN: Final = 0.4  # m: around all that is shown
_USUAL: Final = (0.0, 6.0, -3.5, 3.5)  # m: x and y that are shown while no radar is known
_ZONES: Final[dict[Kind, str]] = {"counting": ACCENT, "entrance": GOOD, "exclusion": BAD, "boundary": "#b8c2cf"}
_GESTURE: Final = 2.0  # s: how long a gesture's name stands beside a person


class Plan:
    """A figure of the room. The way the radar looks is up, left is left.

    Parameters
    ----------
    pictures : Pictures
        Sends what it shows.
    clicked : callable
        Is told x and y [m] of every click or tap on the plan.

    Attributes
    ----------
    figure : figure
        What it shows.
    draft : ColumnDataSource
        Corners of a zone that is being drawn, columns x and y [m].
    """

    def __init__(self, pictures: Pictures, clicked: Callable[[float, float], None]) -> None:
        self._across, self._up = Range1d(start=4.0, end=-4.0), Range1d(start=-0.5, end=6.5)
        self.figure = plot(
            "plan", "y, to the left [m]", "x, ahead of the radar [m]", x_range=self._across, y_range=self._up, height=_TALL, tools="tap",
        )  # fmt: skip
        self._extent: tuple[float, float, float, float] = _USUAL
        self._pictures = pictures
        self._sources = {name: pictures.source(name, data) for name, data in _EMPTY.items()}
        self.draft = ColumnDataSource(data={"x": [], "y": []}, name="draft")
        self._told: dict[str, object] = {}
        self._draw()
        self.figure.on_event(Tap, lambda event: clicked(float(event.y), float(event.x)))
        for side in ("inner_width", "inner_height"):
            self.figure.on_change(side, lambda _attr, _old, _new: self._fit())

    def _draw(self) -> None:
        """Make all that is drawn, from the floor up; what moves is an overlay, so that the browser paints the rest only when it changes."""
        f, s = self.figure, self._sources
        f.multi_line("y", "x", source=s["rings"], line_color=LINE, line_width=1)
        f.add_layout(_labels(s["ring_labels"], text_color="#55627a", text_font_size="10px"))
        f.patches("y", "x", source=s["views"], fill_color=ACCENT, fill_alpha=0.06, line_color=ACCENT, line_alpha=0.35)
        f.patches("y", "x", source=s["zones"], fill_color="colour", fill_alpha="alpha", line_color="colour", line_width=1.5)
        f.add_layout(_labels(s["zone_labels"], text_color="colour", text_font_size="12px", text_font_style="bold"))
        f.scatter("y", "x", source=s["radars"], marker="inverted_triangle", size=14, fill_color=TEXT, line_color=GROUND)
        f.add_layout(_labels(s["radars"], text_color=TEXT, text_font_size="12px", y_offset=9))
        f.multi_line(
            "y", "x", source=s["trails"], line_color="colour", line_width=2.5, line_alpha="alpha", line_cap="round", level="overlay"
        )
        whose: Any = {"field": "who", "transform": LinearColorMapper(palette=[*PEOPLE, NOBODY], low=-0.5, high=len(PEOPLE) + 0.5)}
        f.scatter("y", "x", source=s["points"], size="size", fill_color=whose, fill_alpha="alpha", line_color=None, level="overlay")
        f.circle(
            "y",
            "x",
            radius="radius",
            source=s["people"],
            fill_color="colour",
            fill_alpha="alpha",
            line_color="colour",
            line_width=2,
            level="overlay",
        )
        f.segment("y", "x", "y_to", "x_to", source=s["people"], line_color="colour", line_width=3, line_cap="round", level="overlay")
        f.add_layout(_labels(s["people"], text_color=TEXT, text_font_size="13px", text_font_style="bold", y_offset=14, level="overlay"))
        f.scatter("y", "x", source=s["hand"], marker="star", size=20, fill_color=TEXT, line_color=GROUND, level="overlay")
        f.line("y", "x", source=self.draft, line_color=TEXT, line_dash="dashed", line_width=2)
        f.scatter("y", "x", source=self.draft, size=9, fill_color=TEXT, line_color=GROUND)
        f.xaxis.formatter = f.yaxis.formatter = CustomJSTickFormatter(code="return (tick + 0).toString().replace('-', '\u2212')")

    def update(self, now: Snapshot) -> None:
        """Show a moment."""
        self._once("radars", tuple(now.history.radars.values()), self._show_radars)
        people = now.people
        self._put("points", _points(now))
        self._put("people", _people(people, _names(now), now.history.colours))
        self._put("trails", _trails(now, people))
        hand = now.hand
        place = hand.position if hand is not None else None
        self._put("hand", {"x": [] if place is None else [place[0]], "y": [] if place is None else [place[1]]})
        zones = now.zones
        self._once("zones", None if zones is None else _zone_news(zones), lambda _: self._show_zones(zones))

    def _put(self, name: str, data: dict[str, Any]) -> None:
        self._pictures.put(self._sources[name], data)

    def _once(self, name: str, value: object, show: Callable[[Any], None]) -> None:
        """Show what seldom changes only when it has."""
        if self._told.get(name, self) != value:
            self._told[name] = value
            show(value)

    def _show_radars(self, known: Sequence[RadarInfo]) -> None:
        radars = sensors(known)
        views = [_view(radar) for radar in radars if radar.array.fov_azimuth > 0]
        self._put("views", {"x": [view[:, 0].tolist() for view in views], "y": [view[:, 1].tolist() for view in views]})
        names = [radar.frame_id.rpartition("/")[0] if len(radars) > 1 else "" for radar in radars]
        self._put("radars", {"x": [radar.mount.x for radar in radars], "y": [radar.mount.y for radar in radars], "text": names})
        if views:
            corners = np.concatenate(views)
            low, high = corners.min(axis=0), corners.max(axis=0)
            self._extent = float(low[0]), float(high[0]), float(low[1]), float(high[1])
        self._show_rings(radars)
        self._fit()

    def _show_rings(self, radars: Sequence[RadarInfo]) -> None:
        """Draw how far it is from the radar, metre by metre; from several they would only confuse."""
        if len(radars) != 1:
            self._put("rings", _EMPTY["rings"])
            self._put("ring_labels", _EMPTY["ring_labels"])
            return
        reach, step = _reach(radars[0]), 1.0 if _reach(radars[0]) < 9 else 2.0
        distances = np.arange(step, reach + 0.01, step)
        arcs = [_arc(radars[0], distance) for distance in distances]
        self._put("rings", {"x": [arc[:, 0].tolist() for arc in arcs], "y": [arc[:, 1].tolist() for arc in arcs]})
        ends = [arc[0] for arc in arcs]
        texts = [f"{distance:g} m" for distance in distances]
        self._put("ring_labels", {"x": [end[0] for end in ends], "y": [end[1] for end in ends], "text": texts})

    def _show_zones(self, zones: ZoneStates | None) -> None:
        shown = [zone for zone in zones.zones if zone.area is not None] if zones is not None else []
        corners = [np.array(zone.area.corners) for zone in shown if zone.area is not None]
        shades = [_ZONES[zone.area.kind] for zone in shown if zone.area is not None]
        alphas = [0.28 if zone.presence is Presence.OCCUPIED else 0.08 for zone in shown]
        places = {"x": [c[:, 0].tolist() for c in corners], "y": [c[:, 1].tolist() for c in corners]}
        self._put("zones", {**places, "colour": shades, "alpha": alphas})
        ends = {"x": [float(c[:, 0].max()) for c in corners], "y": [float(c[:, 1].mean()) for c in corners]}
        texts = [f"{zone.name} {'?' if zone.presence is Presence.UNKNOWN else zone.count}" for zone in shown]
        self._put("zone_labels", {**ends, "colour": shades, "text": texts})

    def _fit(self) -> None:
        """Show all of the room, with metres as long across as up, in whatever size the browser gives the plan."""
        try:
            width, height = self.figure.inner_width, self.figure.inner_height
        except UnsetValueError:
            return  # no browser has said yet
        if not width or not height:
            return
        self.figure.height = _TALL if width > _NARROW else _TALL // 2 + 80
        low_x, high_x, low_y, high_y = self._extent
        metres = max((high_y - low_y + 2 * _MARGIN) / width, (high_x - low_x + 2 * _MARGIN) / height)
        middle_x, middle_y = (low_x + high_x) / 2, (low_y + high_y) / 2
        self._across.update(start=middle_y + metres * width / 2, end=middle_y - metres * width / 2)
        self._up.update(start=middle_x - metres * height / 2, end=middle_x + metres * height / 2)


_EMPTY: Final[dict[str, dict[str, list[Any]]]] = {
    "rings": {"x": [], "y": []},
    "ring_labels": {"x": [], "y": [], "text": []},
    "views": {"x": [], "y": []},
    "zones": {"x": [], "y": [], "colour": [], "alpha": []},
    "zone_labels": {"x": [], "y": [], "colour": [], "text": []},
    "radars": {"x": [], "y": [], "text": []},
    "trails": {"x": [], "y": [], "colour": [], "alpha": []},
    "points": {"x": [], "y": [], "size": [], "who": [], "alpha": []},
    "people": {"x": [], "y": [], "radius": [], "colour": [], "alpha": [], "x_to": [], "y_to": [], "text": [], "id": []},
    "hand": {"x": [], "y": []},
}


def _labels(source: ColumnDataSource, **options: Any) -> LabelSet:
    return LabelSet(x="y", y="x", text="text", source=source, text_font=value(FONT), text_align="center", **options)


def _reach(radar: RadarInfo) -> float:
    """How far a radar sees; of one that gives points only, a usual room."""
    return min(radar.waveform.max_range, 20.0) if radar.waveform.n_sample else _USUAL[1]


def _arc(radar: RadarInfo, distance: float) -> Float64Array:
    """Places at a distance within a radar's field of view, shape (n, 2) [m]."""
    half = min(radar.array.fov_azimuth / 2, math.pi)
    angle = radar.mount.yaw + np.linspace(-half, half, 61)
    return np.stack([radar.mount.x + distance * np.cos(angle), radar.mount.y + distance * np.sin(angle)], axis=-1)


def _view(radar: RadarInfo) -> Float64Array:
    """Outline of a radar's field of view on the floor, shape (n, 2) [m]."""
    return np.concatenate([[[radar.mount.x, radar.mount.y]], _arc(radar, _reach(radar))])


def _points(now: Snapshot) -> dict[str, Any]:
    """Points of the last moments in the colours of their people; older ones fade."""
    recent = _spaced(now.past("clouds", _GLOW))
    owners = {entry.value.sequence: entry.value.point_track_id for entry in now.past("tracks", _GLOW)}
    if not recent:
        return dict(_EMPTY["points"])
    who = [owners.get(cloud.sequence, np.empty(0)) for cloud in recent]
    who = [own if len(own) == len(cloud) else np.full(len(cloud), -1) for own, cloud in zip(who, recent, strict=True)]
    age = np.concatenate([np.full(len(cloud), (now.stamp_ns - cloud.stamp_ns) * 1e-9) for cloud in recent])
    owner = np.concatenate(who).astype(int)
    snr = np.concatenate([cloud.snr for cloud in recent])
    seen = np.clip(np.nan_to_num(snr, nan=10.0), 5.0, 40.0)
    return {
        "x": np.concatenate([cloud.x for cloud in recent]),
        "y": np.concatenate([cloud.y for cloud in recent]),
        "size": 2.5 + 0.12 * seen,
        "who": _shades(owner, now.history.colours),
        "alpha": np.clip(0.9 - 0.75 * age / _GLOW, 0.1, 0.9),
    }


def _shades(owner: NDArray[np.int_], colours: Mapping[int, int]) -> NDArray[np.int_]:
    """Numbers of the colours of points; one after the last: nobody's, or of somebody who is not believed yet."""
    people, place = np.unique(owner, return_inverse=True)
    return np.array([colours.get(person, len(PEOPLE)) for person in people.tolist()], int)[place]


def _spaced(entries: Sequence[Entry[PointCloud]]) -> list[PointCloud]:
    """Clouds some time apart, up to the last."""
    kept: list[PointCloud] = []
    for entry in reversed(entries):
        if not kept or kept[-1].stamp_ns - entry.stamp_ns >= _GLOW_STEP * 1e9:
            kept.append(entry.value)
    return kept[::-1]


def _names(now: Snapshot) -> dict[int, str]:
    """Name the gesture that each person has just made."""
    recent = (entry.value for entry in now.past("gestures", _GESTURE))
    return {gesture.track_id: gesture.name.replace("_", " ") for gesture in recent if gesture.label}


def _people(people: Tracks | None, names: Mapping[int, str], colours: Mapping[int, int]) -> dict[str, Any]:
    tracks = people.tracks if people is not None else ()
    ahead = [track.position + _SPEED * track.velocity for track in tracks]
    return {
        "x": [track.position[0] for track in tracks],
        "y": [track.position[1] for track in tracks],
        "radius": [_radius(track.extent) for track in tracks],
        "colour": [colour(colours, track.id) for track in tracks],
        "alpha": [0.08 if track.status is TrackStatus.COASTING else 0.3 for track in tracks],
        "x_to": [place[0] for place in ahead],
        "y_to": [place[1] for place in ahead],
        "text": [f"{track.id} {names.get(track.id, '')}".strip() for track in tracks],
        "id": [track.id for track in tracks],
    }


def _radius(extent: Float64Array) -> float:
    """Radius of the circle that stands for a person: twice the spread of their points, or a usual body."""
    spread = float(np.nanmax(extent[:2])) if np.isfinite(extent[:2]).any() else 0.15
    return min(max(2 * spread, _WIDTHS[0]), _WIDTHS[1])


def _trails(now: Snapshot, people: Tracks | None) -> dict[str, Any]:
    """Where the people who are there now have been."""
    alive = [track.id for track in people.tracks] if people is not None else []
    ways: dict[int, list[Float64Array]] = {number: [] for number in alive}
    due = -math.inf
    for entry in now.past("tracks", _TRAIL):
        if entry.stamp_ns < due:
            continue
        due = entry.stamp_ns + _TRAIL_STEP * 1e9
        for track in entry.value.tracks:
            if track.id in ways:
                ways[track.id].append(track.position)
    for track in people.tracks if people is not None else ():
        ways[track.id].append(track.position)
    return {
        "x": [[float(place[0]) for place in ways[number]] for number in alive],
        "y": [[float(place[1]) for place in ways[number]] for number in alive],
        "colour": [colour(now.history.colours, number) for number in alive],
        "alpha": [0.55] * len(alive),
    }


def _zone_news(zones: ZoneStates) -> tuple[object, ...]:
    """Pick what is drawn of the zones."""
    return tuple((zone.name, zone.area, zone.presence, zone.count) for zone in zones.zones)
