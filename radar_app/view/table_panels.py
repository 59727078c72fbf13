"""Tables: who is where, and how every node is doing; and how long results take, over the last minute."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from bokeh.models import DataRange1d, Range1d

from radar_app.view.colours import colour
from radar_app.view.feed import Snapshot
from radar_app.view.pictures import Pictures
from radar_app.view.records import NodeHealth, StageFigures
from radar_app.view.style import ACCENT, BAD, DOUBTFUL, FAINT, FONT, GOOD, LINE, TEXT, plot
from radar_app.watching.latency import Latency, latencies
from radar_tracking.tracks import Tracks, TrackStatus
from radar_tracking.zones import Presence, ZoneState, ZoneStates

_EVERY_NS: Final = 480_000_000  # tables are written twice a second
_MARKS: Final = {"ok": (GOOD, "ok"), "warn": (DOUBTFUL, "look"), "error": (BAD, "error"), "stale": (FAINT, "no data")}
_PRESENCE: Final = {Presence.EMPTY: (FAINT, "empty"), Presence.OCCUPIED: (GOOD, "occupied"), Presence.UNKNOWN: (DOUBTFUL, "not known")}
_FLOW: Final = ("driver", "cloud2", "baseband", "fusion", "tracking", "gestures", "hand", "presence", "zones")
_BINS: Final = 120  # places of the latency plot
_MINUTE_NS: Final = 60_000_000_000
_BEFORE: Final = 2.0  # s: how long before its tracks the reports of a frame may have come
_OPEN_NS: Final = 1_000_000_000  # ns: what is so new is worked out again, since another radar may report on its frame yet


class Tables:
    """The tables, and the plot of latencies."""

    def __init__(self, pictures: Pictures) -> None:
        self._pictures = pictures
        self.people, self.zones, self.nodes = (pictures.div(f"{name}_table") for name in ("people", "zones", "nodes"))
        self.latency_note = pictures.div("latency_note")
        self._source = pictures.source("latency", {"t": [], "latency": []})
        self.latency = plot(
            "latency_plot", "time [s]", "to people [ms]", x_range=Range1d(start=-60, end=0), y_range=DataRange1d(start=0), height=170,
            tools="",
        )  # fmt: skip
        self.latency.line("t", "latency", source=self._source, line_color=ACCENT, line_width=1.5)
        self._late = Latencies()
        self._due_ns, self._last_ns = 0, -1

    def update(self, now: Snapshot) -> None:
        """Write them anew, some times a second."""
        if now.newest and self._last_ns <= now.stamp_ns < self._due_ns:
            return
        self._due_ns, self._last_ns = now.stamp_ns + _EVERY_NS, now.stamp_ns
        self._pictures.write(self.people, _people(now.people, now.history.colours))
        self._pictures.write(self.zones, _zones(now.zones))
        self._pictures.write(self.nodes, _nodes(now.stages, now.health))
        late = _worst(self._late.until(now), now.stamp_ns)
        self._pictures.put(self._source, late)
        self._pictures.write(self.latency_note, "" if len(late["t"]) else table((), (), "not known: no graph reports when it is done"))


def table(header: Sequence[str], rows: Sequence[Sequence[str]], empty: str) -> str:
    """Write a table; cells are HTML already, ``empty`` is said where there is no row."""
    if not rows:
        return f'<div style="color:{FAINT};font:14px {FONT}">{empty}</div>'
    cell = f"padding:4px 10px 4px 0;border-bottom:1px solid {LINE};text-align:left;white-space:nowrap"
    head = "".join(f'<th style="{cell};color:{FAINT};font-weight:500">{name}</th>' for name in header)
    body = "".join("<tr>" + "".join(f'<td style="{cell}">{text}</td>' for text in row) + "</tr>" for row in rows)
    return (
        f'<div style="overflow-x:auto"><table style="border-collapse:collapse;width:100%;font:13px {FONT};color:{TEXT};'
        f'font-variant-numeric:tabular-nums"><tr>{head}</tr>{body}</table></div>'
    )


def _dot(shade: str, text: str) -> str:
    return f'<span style="color:{shade}">●</span> {text}'


def _people(people: Tracks | None, colours: Mapping[int, int]) -> str:
    rows = []
    for track in people.tracks if people is not None else ():
        x, y, _ = track.position
        speed = math.hypot(track.velocity[0], track.velocity[1])
        seen = "now" if track.status is not TrackStatus.COASTING else f"{track.unseen:.1f} s ago"
        rows.append([_dot(colour(colours, track.id), str(track.id)), f"{x:.2f}, {y:.2f}", f"{speed:.2f}", str(track.n_points), seen])
    return table(("person", "x, y [m]", "speed [m/s]", "points", "seen"), rows, "nobody is there")


def _zones(zones: ZoneStates | None) -> str:
    if zones is None:
        return table((), (), "nobody counts people in zones here")
    rows = [_zone(zone) for zone in (zones.room, *zones.zones)]
    return table(("zone", "people", "", "for [s]"), rows, "")


def _zone(zone: ZoneState) -> list[str]:
    people = "?" if zone.presence is Presence.UNKNOWN else str(zone.count)
    dwell = f"{zone.dwell:.0f}" if zone.dwell else ""
    return [html.escape(zone.name), f"<b>{people}</b>", _dot(*_PRESENCE[zone.presence]), dwell]


def _nodes(stages: Sequence[StageFigures], health: dict[str, NodeHealth]) -> str:
    """Write how the nodes are doing: those that report their work, then those that only say how they are."""
    said = {name.partition(":")[0]: node for name, node in health.items() if name.endswith(": processing")}
    others = {name: node for name, node in health.items() if not name.endswith(": processing")}
    rows = []
    for stage in sorted(stages, key=_in_flow):
        node = said.pop(stage.stage, None)
        level, text = _MARKS["error" if stage.stale else node.level if node is not None else "ok"]
        words = "no data comes any more" if stage.stale else node.message if node is not None else ""
        figures = (_number(stage.rate, ".0f"), _number(stage.compute * 1e3, ".1f"), _number(stage.latency * 1e3, ".0f"), str(stage.dropped))
        rows.append([_dot(level, html.escape(stage.stage)), *figures, html.escape(words if words != "running" else text)])
    for name, node in {**said, **others}.items():
        rows.append([_dot(_MARKS[node.level][0], html.escape(name)), "", "", "", "", html.escape(node.message)])
    return table(("node", "rate [Hz]", "work [ms]", "frame to here [ms]", "dropped", "says"), rows, "no node has said how it is doing")


def _in_flow(stage: StageFigures) -> tuple[int, str]:
    """Sort as data flows, then by place."""
    name = stage.stage.rpartition("/")[2]
    return _FLOW.index(name) if name in _FLOW else len(_FLOW), stage.stage


def _number(value: float, form: str) -> str:
    return "" if math.isnan(value) else format(value, form)


class Latencies:
    """How long the tracks of the last minute took; what is known of a history is not worked out again when more comes."""

    def __init__(self) -> None:
        self._number = -1  # of the newest entry of the history that was looked at
        self._known: list[Latency] = []

    def until(self, now: Snapshot) -> list[Latency]:
        """List them up to a moment, in the order of their stamps."""
        if now.history.number != self._number:
            self._number = now.history.number
            self._learn(now.history.at())
        return [each for each in self._known if now.stamp_ns - _MINUTE_NS < each.stamp_ns <= now.stamp_ns]

    def _learn(self, end: Snapshot) -> None:
        last_ns = self._known[-1].stamp_ns if self._known else -1
        if not end.stamp_ns - _MINUTE_NS < last_ns <= end.stamp_ns:  # another recording, or the first look
            self._known, last_ns = [], -1
        last_ns -= _OPEN_NS
        since = (end.stamp_ns - last_ns) * 1e-9 + _BEFORE if self._known else 60.0
        found = latencies(entry.value for entry in end.past("status", since)).get("tracking", [])
        self._known = [each for each in self._known if end.stamp_ns - _MINUTE_NS < each.stamp_ns <= last_ns]
        self._known += sorted(each for each in found if each.stamp_ns > last_ns)


def _worst(late: Sequence[Latency], now_ns: int) -> dict[str, Any]:
    """Make the time from a frame's publication to its tracks, over the last minute: the worst of every half second."""
    if not late:
        return {"t": [], "latency": []}
    stamps, late_ns = np.array(late).T
    place = np.floor((stamps - now_ns) * (_BINS / _MINUTE_NS)).astype(int)
    places = np.unique(place)
    return {"t": (places + 0.5) * 60.0 / _BINS, "latency": np.array([late_ns[place == each].max() for each in places]) * 1e-6}
