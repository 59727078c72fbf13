"""What a running graph does, seen from outside: people, gestures, hand, rates, latency, drops."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field
from itertools import takewhile
from typing import Any, Final

import numpy as np
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from radar_app.watching.latency import latencies
from radar_app.watching.listener import Listener
from radar_app.watching.people import is_gesture, is_person, place
from radar_app.watching.reports import StageReport, reports_from_msg
from radar_app.watching.room_map import RoomMap, style_of
from radar_core import HandwaveError
from radar_ros.messages.convert import info_from_msg, stride
from radar_ros.messages.zones import areas_from_msg

_WINDOW: Final = 2.0  # s: rates and latencies on the display are those of the last while
_FRESH: Final = 4.0  # s: how long a gesture is bright
_WIDTH: Final = 80  # columns of the display
_MAP: Final = (34, 14)  # columns and lines of the map
_PEOPLE: Final = 6  # most that have a line of their own
_GESTURES: Final = 4
_NODES: Final = 6
_KEPT: Final = 1000  # reports of stages, and frames whose tracks or whose report did not come: some seconds
_STAGES: Final = ("driver", "cloud2", "baseband", "fusion", "tracking", "gestures", "hand", "presence")


@dataclass
class Stage:
    """What is known of one stage."""

    processed: int = 0
    dropped: int = 0
    stale: bool = False
    heard: float = 0.0  # when it last reported, on CLOCK_MONOTONIC [s]
    times: deque[float] = field(default_factory=lambda: deque(maxlen=200))  # when it finished messages, on CLOCK_MONOTONIC of its host [s]
    compute: deque[float] = field(default_factory=lambda: deque(maxlen=200))

    def rate(self, now: float) -> float:
        """Messages per second over the last while, up to what it reported last."""
        return sum(self.times[-1] - t < _WINDOW for t in self.times) / _WINDOW if now - self.heard < _WINDOW else 0.0


class Monitor(Listener):
    """Listens to a graph.

    Attributes
    ----------
    stages : dict of str to Stage
        By name; of a radar in a namespace of its own with that before it: ``left/driver``.
    latencies : list of float
        From a frame's publication to the arrival of its tracks here, on CLOCK_MONOTONIC [s].
    frames, skipped : int
        Frames that the driver has published, and left out, since the first one heard of; of radars that are fused, their fused clouds.
    received : int
        Frames that the track arrays which arrived here stand for.
    gestures : deque of (int, str, float)
        The last ones: track, name, confidence.
    tracks, hand : message or None
        The last ones; None: there are none.
    duration : float or None
        How long the source is going to send [s], so that the display can say what is left of it; None: nobody knows.
    """

    def __init__(self, namespace: str = "") -> None:
        super().__init__("monitor", namespace)
        self.stages: dict[str, Stage] = {}
        self.latencies: list[float] = []
        self.frames = self.skipped = 0
        self.received = 0
        self.gestures: deque[tuple[int, str, float]] = deque(maxlen=6)
        self.tracks: Any = None
        self.hand: Any = None
        self.duration: float | None = None
        self._map = RoomMap()
        self._seen: deque[tuple[float, int, str, float]] = deque(maxlen=_GESTURES)  # gestures with when they arrived
        self._first_ns = self._last_ns = 0  # stamps of frames
        self._newest = -1  # frame that was reported on
        self._reports: deque[StageReport] = deque(maxlen=_KEPT)
        self._published: dict[int, int] = {}
        self._arrived: dict[int, int] = {}
        self.hear_each("stage_status", self._status, reliable=True)
        self.hear_each("radar/info", self._info)
        self.hear("tracks", self._tracks)
        self.hear("gestures", self._gesture)
        self.hear("hand", self._hand)
        self.hear("zones", self._zones)

    def _status(self, space: str, msg: Any) -> None:
        below = space[len(self.node.get_namespace()) :].strip("/")
        for report in reports_from_msg(msg, below):
            stage = self.stages.setdefault(report.stage, Stage())
            stage.stale = report.stale
            if not report.stale:  # else it says only that nothing comes any more
                self._finished(stage, report)

    def _finished(self, stage: Stage, report: StageReport) -> None:
        stage.processed, stage.dropped, stage.heard = report.processed, report.dropped, time.monotonic()
        stage.times.append(report.monotonic_ns * 1e-9)
        stage.compute.append(report.compute)
        self._reports.append(report)
        if report.stage in ("driver", "fusion"):
            self.frames, self.skipped, self._newest = report.processed, report.dropped, report.sequence
        if report.stage == "driver":
            self._first_ns, self._last_ns = min(self._first_ns or report.stamp_ns, report.stamp_ns), report.stamp_ns
            self._published[report.sequence] = report.monotonic_ns
            self._pair(report.sequence)

    def _tracks(self, msg: Any) -> None:
        self._arrived[msg.sequence] = time.monotonic_ns()
        self.received += stride(msg)
        self.tracks = msg
        self._pair(msg.sequence)

    def _pair(self, sequence: int) -> None:
        """Status and tracks come on different topics, in any order."""
        if sequence in self._published and sequence in self._arrived:
            self.latencies.append((self._arrived.pop(sequence) - self._published.pop(sequence)) * 1e-9)
        for waiting in (self._published, self._arrived):
            if len(waiting) > _KEPT:
                del waiting[next(iter(waiting))]

    def _gesture(self, msg: Any) -> None:
        if is_gesture(msg):
            self.gestures.append((msg.track_id, msg.name, msg.confidence))
            self._seen.append((time.monotonic(), msg.track_id, msg.name.replace("_", " "), msg.confidence))

    def _hand(self, msg: Any) -> None:
        self.hand = msg if msg.active else None

    def _info(self, space: str, msg: Any) -> None:
        try:
            self._map.radars[space] = info_from_msg(msg)
        except (HandwaveError, ValueError):
            return  # the nodes complain; here it is only not drawn

    def _zones(self, msg: Any) -> None:
        try:
            self._map.zones = [(name, list(area.corners)) for name, area in areas_from_msg(msg)]
        except HandwaveError:
            return

    def figures(self) -> dict[str, Any]:
        """Latency in milliseconds and the fraction of frames whose tracks never came."""
        latency = np.array(self.latencies) * 1e3
        due = self.frames + self.skipped
        early = sum(1 for _ in takewhile(lambda sequence: sequence > self._newest, reversed(self._arrived)))  # not reported on yet
        received = self.received - early * (stride(self.tracks) if early else 0)
        return {
            "frames": due,
            "latency_ms_median": float(np.median(latency)) if len(latency) else None,
            "latency_ms_p99": float(np.percentile(latency, 99)) if len(latency) else None,
            "dropped_fraction": max(0.0, 1.0 - received / due) if due else None,
            "dropped": {name: stage.dropped for name, stage in sorted(self.stages.items())},
        }

    @property
    def people(self) -> list[Any]:
        """Tracks that count as people."""
        return [track for track in self.tracks.tracks if is_person(track)] if self.tracks is not None else []

    def left(self) -> float | None:
        """Time until the source ends [s]; None: nobody knows."""
        if self.duration is None:
            return None
        return max(self.duration - (self._last_ns - self._first_ns) * 1e-9, 0.0)

    def line(self) -> str:
        """Say in one line what the display shows, for logs."""
        parts = [f"{self.frames} frames" if self.frames else "no frames yet", f"{len(self.people)} people"]
        if recent := self._recent():
            parts.append(f"{np.median(recent[-50:]) * 1e3:.1f} ms from frame to people")
        if self.hand is not None:
            parts.append(f"hand at {self.hand.value:.0%}")
        if self.gestures:
            parts.append("last gestures " + ", ".join(f"{track}: {name.replace('_', ' ')}" for track, name, _ in list(self.gestures)[-2:]))
        return ", ".join(parts)

    def render(self, title: str) -> RenderableType:
        """Draw the state of the graph for a terminal of 80 columns and 24 lines."""
        left = self.left()
        ends = f"{left:.0f} s left" if left is not None else "Ctrl-C ends it"
        upper = Table.grid(padding=(0, 1))
        upper.add_column(width=_WIDTH - _MAP[0] - 5)
        upper.add_column(width=_MAP[0])
        places = {track.id: track.position for track in self.people}
        upper.add_row(self._people(), self._map.draw(places, *_MAP))
        return Panel(Group(upper, self._rates()), title=title, subtitle=ends, border_style="cyan", width=_WIDTH)

    def _people(self) -> RenderableType:
        now, people = time.monotonic(), self.people
        lines = [Text(f"{len(people)} {'person' if len(people) == 1 else 'people'}", style="bold")]
        for track in people[:_PEOPLE]:
            speed = float(np.hypot(track.velocity[0], track.velocity[1]))
            line = Text(f"{track.id:>3} ", style=style_of(track.id))
            line.append(f"{place(track.position)}, {speed:.1f} m/s", style="default")
            lines.append(line)
        if len(people) > _PEOPLE:
            lines.append(Text(f"    and {len(people) - _PEOPLE} more", style="dim"))
        if self.hand is not None:
            filled = round(20 * min(max(self.hand.value, 0.0), 1.0))
            lines.append(Text(f"hand [{'#' * filled}{'.' * (20 - filled)}] {self.hand.value:.0%}"))
        lines.append(Text("last gestures", style="bold"))
        for at, person, name, sure in reversed(self._seen):
            lines.append(Text(f"{person:>3} {name}, {sure:.0%} sure, {now - at:.0f} s ago", "bold green" if now - at < _FRESH else ""))
        if not self._seen:
            lines.append(Text("    none yet", style="dim"))
        return Text("\n", no_wrap=True, overflow="ellipsis").join(lines[: _MAP[1]])

    def _rates(self) -> RenderableType:
        if not self.stages:
            return Text(self._nothing(), style="yellow")
        table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
        table.add_column("node", width=18, no_wrap=True)
        for column in ("per second", "work [ms]", "lost", ""):
            table.add_column(Text(column), justify="right" if column else "left")  # as text: square brackets are markup
        now = time.monotonic()
        known = [name for stage in _STAGES for name in sorted(self.stages) if name.rpartition("/")[2] == stage]
        for name in known[:_NODES]:
            stage = self.stages[name]
            compute = f"{np.median(stage.compute) * 1e3:.2f}" if stage.compute else ""
            state = Text("no data any more", style="bold red") if stage.stale else Text()
            table.add_row(name, f"{stage.rate(now):.0f}", compute, str(stage.dropped), state)
        recent = self._recent()
        said = [f"{np.median(recent) * 1e3:.1f} ms from frame to people"] if recent else []
        said += [f"{len(known) - _NODES} more nodes: handwave status"] if len(known) > _NODES else []
        return Group(table, Text("; ".join(said)))

    def _recent(self) -> list[float]:
        """Give the latest latencies [s]; those of fused radars by what the stages report."""
        if "fusion" not in self.stages:
            return self.latencies[-100:]
        return [each.late_ns * 1e-9 for each in latencies(self._reports).get("tracking", [])[-100:]]

    def _nothing(self) -> str:
        """Say where there is something, when nothing is here."""
        spaces = sorted({name.rpartition("/")[0].strip("/") for name in self.publishers("tracks")} - {""})
        return f"nothing here; there are graphs in {', '.join(spaces)}: --namespace {spaces[0]}" if spaces else "waiting for a graph ..."
