"""What a running graph does, seen from outside: people, gestures, hand, rates, latency, drops."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any

import handwave.msg
import numpy as np
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from radar_ros import qos
from radar_ros.interrupts import Visitor
from radar_ros.messages.convert import stride

_WINDOW = 2.0  # s: rates and latencies on the display are those of the last while


@dataclass
class Stage:
    """What is known of one stage."""

    processed: int = 0
    dropped: int = 0
    times: deque[float] = field(default_factory=lambda: deque(maxlen=200))
    compute: deque[float] = field(default_factory=lambda: deque(maxlen=200))

    def rate(self, now: float) -> float:
        """Messages per second over the last while."""
        return sum(now - t < _WINDOW for t in self.times) / _WINDOW


class Monitor(Visitor):
    """Listens to a graph."""

    def __init__(self, namespace: str = "") -> None:
        super().__init__("handwave_monitor", namespace)
        self.stages: dict[str, Stage] = {}
        self.latencies: list[float] = []  # from a frame's publication to the arrival of its tracks here, CLOCK_MONOTONIC [s]
        self.frames = self.skipped = 0  # frames that the driver has published, and left out, since the first one heard of
        self.received = 0  # frames that the track arrays which arrived here stand for
        self.gestures: deque[tuple[int, str, float]] = deque(maxlen=6)
        self.tracks: Any = None
        self.hand: Any = None
        self._published: dict[int, int] = {}
        self._arrived: dict[int, int] = {}
        self.node.create_subscription(handwave.msg.StageStatus, "stage_status", self._status, qos.sensor(reliable=True))
        self.node.create_subscription(handwave.msg.TrackArray, "tracks", self._tracks, qos.RESULT)
        self.node.create_subscription(handwave.msg.Gesture, "gestures", self._gesture, qos.RESULT)
        self.node.create_subscription(handwave.msg.HandTrack, "hand", self._hand, qos.RESULT)

    def _status(self, msg: Any) -> None:
        if msg.header.stamp.sec == 0 and msg.header.stamp.nanosec == 0:
            return  # says only that the stage is ready
        if msg.stale:
            return  # says only that nothing comes any more
        stage = self.stages.setdefault(msg.stage, Stage())
        stage.processed, stage.dropped = msg.processed, msg.dropped
        stage.times.append(time.monotonic())
        stage.compute.append(msg.compute_s)
        if msg.stage == "driver":
            self.frames, self.skipped = msg.processed, msg.dropped
            self._published[msg.sequence] = msg.monotonic_ns
            self._pair(msg.sequence)

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
                for old in [s for s in waiting if s < sequence - 500]:
                    del waiting[old]

    def _gesture(self, msg: Any) -> None:
        if msg.label != handwave.msg.Gesture.RANDOM:
            self.gestures.append((msg.track_id, msg.name, msg.confidence))

    def _hand(self, msg: Any) -> None:
        self.hand = msg if msg.active else None

    def figures(self) -> dict[str, Any]:
        """Latency in milliseconds and the fraction of frames whose tracks never came."""
        latency = np.array(self.latencies) * 1e3
        due = self.frames + self.skipped
        return {
            "frames": due,
            "latency_ms_median": float(np.median(latency)) if len(latency) else None,
            "latency_ms_p99": float(np.percentile(latency, 99)) if len(latency) else None,
            "dropped_fraction": max(0.0, 1.0 - self.received / due) if due else None,
            "dropped": {name: stage.dropped for name, stage in sorted(self.stages.items())},
        }

    def render(self, title: str) -> RenderableType:
        """Draw the state of the graph for a terminal."""
        return Panel(Group(self._people(), Text(), self._rates()), title=title, border_style="cyan")

    def _people(self) -> Table:
        columns = ("track", "x  y [m]", "speed [m/s]", "points", "last gesture")
        table = Table(*columns, expand=True, box=None, title="people", title_justify="left")
        last = {track: f"{name} {confidence:.0%}" for track, name, confidence in self.gestures}
        for track in self.tracks.tracks if self.tracks is not None else ():
            if track.status == handwave.msg.Track.TENTATIVE:
                continue
            x, y, _ = track.position
            speed = float(np.hypot(track.velocity[0], track.velocity[1]))
            table.add_row(str(track.id), f"{x:5.2f} {y:5.2f}", f"{speed:.2f}", str(track.n_points), last.get(track.id, ""))
        if self.hand is not None:
            bar = ProgressBar(total=1.0, completed=self.hand.value, width=24)
            table.add_row("hand", f"z {self.hand.position[2]:.2f}", "", str(self.hand.n_points), bar)
        return table

    def _rates(self) -> Table:
        table = Table("stage", "rate [Hz]", "compute [ms]", "dropped", expand=True, box=None, title="stages", title_justify="left")
        now = time.monotonic()
        for name in ("driver", "baseband", "tracking", "gestures", "hand"):
            stage = self.stages.get(name, Stage())
            compute = f"{np.median(stage.compute) * 1e3:.2f}" if stage.compute else ""
            table.add_row(name, f"{stage.rate(now):.0f}", compute, str(stage.dropped))
        recent = self.latencies[-100:]
        latency = f"{np.median(recent) * 1e3:.1f} ms median" if recent else "-"
        table.add_row("frame to tracks", "", latency, "")
        return table
