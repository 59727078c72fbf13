"""The last minute of a graph or of a recording: what producers put in, and what a page, or anybody else, reads as frozen snapshots."""

from __future__ import annotations

import threading
import time
from bisect import bisect_left, bisect_right
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any, Final, Generic, Literal, TypeVar

import numpy as np

from radar_app.view.colours import Colours
from radar_app.view.records import EventMaps, NodeHealth, RangeDoppler, StageFigures
from radar_app.watching.latency import Latency, latencies
from radar_app.watching.reports import StageReport
from radar_core import PointCloud, RadarFrame, RadarInfo
from radar_gestures.gesture import Gesture
from radar_tracking.tracks import HandTrack, Tracks
from radar_tracking.zones import ZoneStates

T = TypeVar("T")
Channel = Literal["clouds", "tracks", "gestures", "maps", "hand", "zones", "range_doppler", "frames", "status", "health"]
"""What is kept, see `History`."""

KEEP: Final = 60.0
"""How much is kept [s]."""

KEEP_FRAMES: Final = 6.0
"""How much of the raw frames is kept [s]: they are large, a quarter of a megabyte each."""

_CHANNELS: Final[tuple[Channel, ...]] = (
    "clouds", "tracks", "gestures", "maps", "hand", "zones", "range_doppler", "frames", "status", "health",
)  # fmt: skip
_CLOCKS: Final = ("clouds", "tracks")  # whose stamps tell the time; those of others may be of any moment
_BACK: Final = 1_000_000_000  # ns: stamps that go back by more mean another recording, or the same one again
_WHILE: Final = 2_000_000_000  # ns: rates and latencies are those of the last while
_LATE: Final = 400_000_000  # ns: stages report some messages together
_LOOK_BACK: Final = 8  # tracks that may be newer than the newest cloud


@dataclass(frozen=True, slots=True)
class Entry(Generic[T]):
    """One thing that came.

    Attributes
    ----------
    number : int
        Counts everything that was put into the feed, from 1.
    stamp_ns : int
        Its time in the node's clock [ns]; what came late counts as of the one before it, so that a channel is in order of time.
    value : object
        What came, never changed afterwards.
    """

    number: int
    stamp_ns: int
    value: T


@dataclass(frozen=True, eq=False)
class History:
    """All that was kept at one moment, each channel in order of time; nothing in it changes any more.

    Attributes
    ----------
    number : int
        Of the newest entry; 0: nothing has come.
    clouds : tuple of Entry of PointCloud
        In ``room``.
    tracks : tuple of Entry of Tracks
        With the owner of every point of the cloud of the same sequence.
    gestures : tuple of Entry of Gesture
        Also those that are none (label 0, random).
    maps : tuple of Entry of EventMaps
        Stamp and track are those of the gesture of the same event; either of the two may come first.
    hand : tuple of Entry of HandTrack
        One that is not active ends a hand.
    zones : tuple of Entry of ZoneStates
        Who is where.
    range_doppler : tuple of Entry of RangeDoppler
        Some a second, while somebody wants them (`Feed.want`).
    frames : tuple of Entry of RadarFrame
        Of the last `KEEP_FRAMES` seconds, while somebody wants them.
    status, health : tuple of Entry of StageReport, of NodeHealth
        How the nodes are doing.
    radars : mapping of str to RadarInfo
        By their frames.
    colours : mapping of int to int
        Number of each person's colour, by their track, see `radar_app.view.colours`.
    silent : float
        How long nothing has come when this was made [s].
    """

    number: int = 0
    clouds: Sequence[Entry[PointCloud]] = ()
    tracks: Sequence[Entry[Tracks]] = ()
    gestures: Sequence[Entry[Gesture]] = ()
    maps: Sequence[Entry[EventMaps]] = ()
    hand: Sequence[Entry[HandTrack]] = ()
    zones: Sequence[Entry[ZoneStates]] = ()
    range_doppler: Sequence[Entry[RangeDoppler]] = ()
    frames: Sequence[Entry[RadarFrame]] = ()
    status: Sequence[Entry[StageReport]] = ()
    health: Sequence[Entry[NodeHealth]] = ()
    radars: Mapping[str, RadarInfo] = field(default_factory=lambda: MappingProxyType({}))
    colours: Mapping[int, int] = field(default_factory=lambda: MappingProxyType({}))
    silent: float = 0.0

    @property
    def start_ns(self) -> int:
        """Time of the oldest cloud or tracks [ns]; 0: there are none."""
        return min((getattr(self, name)[0].stamp_ns for name in _CLOCKS if getattr(self, name)), default=0)

    @property
    def end_ns(self) -> int:
        """Time of the newest cloud or tracks [ns]; 0: there are none."""
        return max((getattr(self, name)[-1].stamp_ns for name in _CLOCKS if getattr(self, name)), default=0)

    def at(self, stamp_ns: int | None = None) -> Snapshot:
        """Give what was known at a time [ns] within the history; None: at its end."""
        return Snapshot(self, self.end_ns if stamp_ns is None else stamp_ns, newest=stamp_ns is None)


@dataclass(frozen=True, eq=False)
class Snapshot:
    """What was known at one moment of a history; everything is worked out when it is asked for, once.

    Attributes
    ----------
    history : History
        All that was kept.
    stamp_ns : int
        The moment [ns].
    newest : bool
        Whether it is the end of the history: then also what has no later cloud or tracks counts.
    """

    history: History
    stamp_ns: int
    newest: bool = True

    def past(self, channel: Channel, seconds: float | None = None) -> Sequence[Entry[Any]]:
        """Entries of a channel up to this moment, in order of time; of the last so many ``seconds``, or all."""
        entries: Sequence[Entry[Any]] = getattr(self.history, channel)
        last = len(entries) if self.newest else bisect_right(entries, self.stamp_ns, key=_stamp)
        first = 0 if seconds is None else bisect_left(entries, self.stamp_ns - round(seconds * 1e9), key=_stamp)
        return entries[first:last]

    def last(self, channel: Channel) -> Any:
        """Value of the last entry of a channel up to this moment, or None."""
        found = self.past(channel)
        return found[-1].value if found else None

    @cached_property
    def tracks(self) -> Tracks | None:
        """The last tracks whose cloud is there, or the last ones where no clouds come."""
        found = self.past("tracks")
        if not found:
            return None
        clouds = {entry.value.sequence for entry in self.past("clouds", 1.0)}
        newest: Tracks = found[-1].value
        return next((entry.value for entry in reversed(found[-_LOOK_BACK:]) if entry.value.sequence in clouds), newest)

    @cached_property
    def cloud(self) -> PointCloud | None:
        """The cloud of `tracks`; the last one where there are no tracks; None: no points belong to this moment."""
        found = self.past("clouds", 1.0)
        if self.tracks is None:
            return found[-1].value if found else None
        return next((entry.value for entry in reversed(found) if entry.value.sequence == self.tracks.sequence), None)

    @cached_property
    def people(self) -> Tracks | None:
        """`tracks` without tentative ones."""
        if self.tracks is None:
            return None
        kept = self.tracks.people
        return Tracks(
            self.tracks.stamp_ns, self.tracks.sequence, self.tracks.frame_id, kept, self.tracks.point_track_id, every=self.tracks.every
        )

    @property
    def hand(self) -> HandTrack | None:
        """The hand that is followed."""
        hand: HandTrack | None = self.last("hand")
        return hand if hand is not None and hand.active else None

    @property
    def zones(self) -> ZoneStates | None:
        """Who is where."""
        zones: ZoneStates | None = self.last("zones")
        return zones

    @cached_property
    def range_doppler(self) -> dict[str, RangeDoppler]:
        """The last range-Doppler map of every radar in the last two seconds, by the radar's frame."""
        return {entry.value.frame_id: entry.value for entry in self.past("range_doppler", 2.0)}

    @property
    def health(self) -> dict[str, NodeHealth]:
        """The last word of every node, by its name."""
        return {entry.value.name: entry.value for entry in self.past("health")}

    @cached_property
    def stages(self) -> tuple[StageFigures, ...]:
        """What every stage did in the last while, in the order in which they were first heard of."""
        last = {entry.value.stage: entry.value for entry in self.past("status")}
        recent: dict[str, list[StageReport]] = {name: [] for name in last}
        for entry in self.past("status", (_WHILE + _LATE) * 1e-9):
            if entry.value.stamp_ns > last[entry.value.stage].stamp_ns - _WHILE:
                recent[entry.value.stage].append(entry.value)
        late = latencies(report for reports in recent.values() for report in reports)
        return tuple(_figures(last[name], recent[name], late.get(name, ())) for name in last)


def _stamp(entry: Entry[Any]) -> int:
    return entry.stamp_ns


def _figures(last: StageReport, recent: Sequence[StageReport], late: Sequence[Latency]) -> StageFigures:
    """Figures of one stage from its reports of the last while."""
    own = [] if last.stale else recent
    compute = float(np.median([report.compute for report in own])) if own else float("nan")
    latency = float(np.median([each.late_ns for each in late])) * 1e-9 if own and late else float("nan")
    return StageFigures(last.stage, len(own) / (_WHILE * 1e-9), compute, latency, last.dropped, last.stale)


class Feed:
    """Holds what came lately; safe for any number of producers and readers in any threads.

    Parameters
    ----------
    keep : float
        How much is kept [s], by the stamps; raw frames at most `KEEP_FRAMES`.
    """

    def __init__(self, keep: float = KEEP) -> None:
        self.keep = keep
        self._changed = threading.Condition()
        self._number = 0
        self._channels: dict[Channel, deque[Entry[Any]]] = {name: deque() for name in _CHANNELS}
        self._radars: Mapping[str, RadarInfo] = MappingProxyType({})
        self._colours = Colours()
        self._heard = time.monotonic()
        self._wanted: Counter[Channel] = Counter()

    @property
    def number(self) -> int:
        """Number of the newest entry; as long as it stays the same nothing is new."""
        return self._number

    @property
    def radars(self) -> Mapping[str, RadarInfo]:
        """What is known of the radars, by their frames."""
        return self._radars

    def put(self, channel: Channel, stamp_ns: int, value: Any) -> None:
        """Take something in: of the type that `History` names for the channel, with its time [ns].

        Clouds or tracks whose time goes back by more than a second belong to another recording, or to the same one once more: all that
        was kept is forgotten first. In other channels a stamp ahead of both counts as of now, so that what comes afterwards grows old.
        """
        with self._changed:
            entries = self._channels[channel]
            if channel in _CLOCKS and entries and stamp_ns < entries[-1].stamp_ns - _BACK:
                for others in self._channels.values():
                    others.clear()
                self._colours = Colours()
            elif channel not in _CLOCKS:
                stamp_ns = min(stamp_ns, self._now_ns(stamp_ns) + _BACK)
                if entries and stamp_ns < entries[-1].stamp_ns - round(1e9 * self.keep):
                    entries.clear()
            self._number += 1
            stamp_ns = max(stamp_ns, entries[-1].stamp_ns) if entries else stamp_ns
            entries.append(Entry(self._number, stamp_ns, value))
            oldest = stamp_ns - round(1e9 * min(self.keep, KEEP_FRAMES if channel == "frames" else self.keep))
            while entries[0].stamp_ns < oldest:
                entries.popleft()
            if channel in _CLOCKS:
                self._heard = time.monotonic()
            if channel == "tracks":
                self._colours.see(track.id for track in value.people)
            self._changed.notify_all()

    def _now_ns(self, otherwise: int) -> int:
        """Time of the newest cloud or tracks [ns], or ``otherwise``."""
        return max((self._channels[name][-1].stamp_ns for name in _CLOCKS if self._channels[name]), default=otherwise)

    def know(self, radar: RadarInfo) -> None:
        """Take in what a radar is and where it stands."""
        with self._changed:
            self._number += 1
            self._radars = MappingProxyType({**self._radars, radar.frame_id: radar})
            self._changed.notify_all()

    def history(self) -> History:
        """Freeze what is kept now."""
        with self._changed:
            kept: dict[str, Any] = {name: tuple(entries) for name, entries in self._channels.items()}
            silent = time.monotonic() - self._heard
            return History(self._number, radars=self._radars, colours=self._colours.numbers, silent=silent, **kept)

    def after(self, channel: Channel, number: int) -> tuple[Entry[Any], ...]:
        """Entries of a channel that are newer than a ``number``, in the order in which they came.

        Whoever asks again with the number of the last entry they got misses nothing that is still kept.
        """
        with self._changed:
            return tuple(entry for entry in self._channels[channel] if entry.number > number)

    def wait(self, number: int, timeout: float) -> bool:
        """Wait until something newer than a ``number`` is there, or for so many seconds; returns whether it is."""
        with self._changed:
            return self._changed.wait_for(lambda: self._number > number, timeout)

    @contextmanager
    def want(self, channel: Channel) -> Iterator[None]:
        """Ask producers for what they give only when somebody wants it (frames, range_doppler), as long as the block runs."""
        with self._changed:
            self._wanted[channel] += 1
        try:
            yield
        finally:
            with self._changed:
                self._wanted[channel] -= 1

    def wanted(self, channel: Channel) -> bool:
        """Whether somebody wants a channel now; producers look again and again."""
        return self._wanted[channel] > 0
