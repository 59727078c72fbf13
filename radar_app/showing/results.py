"""Gestures and people of a bag, read without a graph."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from radar_app.watching.people import is_gesture, is_person
from radar_core import DataError, PointCloud, RadarFrame, RadarInfo
from radar_core.types import Float64Array
from radar_ros.bags import contents, local, read
from radar_ros.messages.convert import cloud_from_msg, frame_from_msg, from_time, info_from_msg
from radar_ros.offline import parse

_STAMPED: Final = ("radar/frame", "radar/points", "tracks")
"""Topics whose first stamp is when a recording begins, the earliest of the pipeline first."""


@dataclass(frozen=True)
class GestureRow:
    """One gesture: whose, what, how sure (0 to 1), from when to when since the recording began [s], and where [m]."""

    namespace: str
    person: int
    gesture: str
    confidence: float
    start: float
    end: float
    position: tuple[float, float, float]
    zones: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class PersonRow:
    """One person, from its first track to its last.

    Attributes
    ----------
    namespace : str
        Of the graph that followed it.
    person : int
        Number of the track.
    time : ndarray of float64, shape (n,)
        Since the recording began [s].
    position, velocity : ndarray of float64, shape (n, 3)
        In the room [m], [m/s].
    points : ndarray of float64, shape (n,)
        Points of the cloud that belonged to it.
    """

    namespace: str
    person: int
    time: Float64Array
    position: Float64Array
    velocity: Float64Array
    points: Float64Array

    @property
    def walked(self) -> float:
        """How far it walked, by its speed along the floor [m]."""
        speed = np.hypot(self.velocity[:, 0], self.velocity[:, 1])
        return float(np.sum(speed[1:] * np.diff(self.time)))


@dataclass(frozen=True, eq=False)
class Results:
    """What was recognised in a bag; ``start_ns`` is the stamp of its beginning [ns], ``topics`` what it holds, by full name."""

    path: Path
    start_ns: int
    topics: dict[str, int]
    gestures: list[GestureRow] = field(default_factory=list)
    people: list[PersonRow] = field(default_factory=list)

    def first(self, topic: str) -> str:
        """Full name of the first topic of this name within its namespace; empty: the bag has none with messages."""
        return next((name for name, count in sorted(self.topics.items()) if count and local(name) == topic), "")

    def info(self, source: str) -> RadarInfo:
        """Read the radar of a topic of frames or clouds; a `DataError` says that the bag does not hold it."""
        wanted = source[: len(source) - len(local(source))] + "radar/info"
        for item in read(self.path, ("radar/info",)):
            if item.topic == wanted:
                return info_from_msg(parse(item.data, "radar/info"))
        raise DataError(f"{self.path}: {source} can only be understood with {wanted}, which is not in it; record it too")

    def measured(self, source: str) -> Iterator[RadarFrame | PointCloud]:
        """Read the raw frames or the clouds of one topic, in order."""
        kind = local(source)
        for item in read(self.path, (kind,)):
            if item.topic == source:
                msg = parse(item.data, kind)
                yield frame_from_msg(msg) if kind == "radar/frame" else cloud_from_msg(msg)


def read_results(path: Path) -> Results:
    """Read gestures and tracks of a bag; a `DataError` says that it cannot be read."""
    topics = contents(path)
    results = Results(Path(path), _start(path, topics), topics)
    rows: dict[tuple[str, int], list[Any]] = {}
    for item in read(path, ("gestures", "tracks")):
        kind = local(item.topic)
        space = item.topic[: -len(kind) - 1] or "/"
        msg = parse(item.data, kind)
        if kind == "gestures":
            if is_gesture(msg):
                results.gestures.append(_gesture(space, msg, results.start_ns))
            continue
        now = (from_time(msg.header.stamp) - results.start_ns) * 1e-9
        for track in msg.tracks:
            if is_person(track):
                rows.setdefault((space, track.id), []).append((now, *track.position, *track.velocity, track.n_points))
    for (space, person), row in sorted(rows.items(), key=lambda one: one[1][0][0]):
        values = np.array(row, np.float64)
        results.people.append(PersonRow(space, person, values[:, 0], values[:, 1:4], values[:, 4:7], values[:, 7]))
    return results


def _gesture(space: str, msg: Any, start_ns: int) -> GestureRow:
    start, end = ((from_time(time) - start_ns) * 1e-9 for time in (msg.start, msg.end))
    x, y, z = (float(value) for value in msg.position)
    return GestureRow(space, msg.track_id, msg.name, float(msg.confidence), start, end, (x, y, z), tuple(msg.zones))


def _start(path: Path, topics: dict[str, int]) -> int:
    """Find the stamp of the first message that has one: times in tables count from there."""
    held = {local(name) for name, count in topics.items() if count}
    for topic in _STAMPED:
        if topic in held:
            return from_time(parse(next(iter(read(path, (topic,)))).data, topic).header.stamp)
    return 0
