"""Watches zones: who enters, who leaves, and when that counts as presence."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import numpy as np

from radar_core import DataError
from radar_core.types import BoolArray, Float64Array
from radar_tracking.tracks import Tracks
from radar_tracking.zones.area import Area
from radar_tracking.zones.config import LayoutConfig
from radar_tracking.zones.result import Occupant, Presence, ZoneState, ZoneStates

_WIDEST: Final = 0.5  # m: however unsure a place is, who is farther beyond a zone's sides has left it


class ZoneMonitor:
    """Tell who is in which zone.

    Confirmed and coasting tracks count, tentative ones do not. Who comes into a zone is in it at once; who leaves it is out once they are
    `LayoutConfig.border` beyond its sides, or as far as their place is unsure, so that who stands on a side is not counted in and out.
    Zones may overlap: whoever stands in two is in both.

    Parameters
    ----------
    layout : LayoutConfig or None
        The zones; None: only the whole room.
    """

    def __init__(self, layout: LayoutConfig | None = None) -> None:
        self.layout = layout or LayoutConfig()
        self._last: tuple[int, int] | None = None  # stamp [ns] and sequence of the last tracks
        self._make()

    def _make(self) -> None:
        layout = self.layout
        bounds = tuple(zone.area for zone in layout.zones if zone.kind == "boundary")
        self._room = _Watch(layout.room, bounds, layout.on_delay, layout.off_delay)
        self._zones = [_Watch(zone.name, (zone.area,), zone.on_delay, zone.off_delay) for zone in layout.zones]

    def change(self, layout: LayoutConfig) -> None:
        """Watch other zones from now on; those that stay as they are keep who is in them and since when."""
        room, before = self._room, {watch.name: watch for watch in self._zones}
        self.layout = layout
        self._make()
        self._room = room if self._room.same(room) else self._room
        self._zones = [before[new.name] if new.name in before and new.same(before[new.name]) else new for new in self._zones]

    def reset(self) -> None:
        """Forget everything, for a new recording."""
        self._last = None
        self._make()

    def process(self, tracks: Tracks) -> ZoneStates:
        """Take in the tracks after one cloud.

        Raises
        ------
        DataError
            When they are older than those before.
        """
        if self._last is not None and tracks.stamp_ns < self._last[0]:
            late = (self._last[0] - tracks.stamp_ns) * 1e-9
            raise DataError(f"tracks {tracks.sequence} are {late:g} s older than those before; reset() the zones before another recording")
        self._last = tracks.stamp_ns, tracks.sequence
        people = list(tracks.people)
        ids = [track.id for track in people]
        position = np.array([track.position for track in people]).reshape(-1, 3)
        border = np.array([self._border(track.covariance) for track in people])
        for watch in (self._room, *self._zones):
            watch.process(ids, position, border, tracks.stamp_ns)
        return self.states(stale=False)

    def _border(self, covariance: Float64Array) -> float:
        """How far beyond a zone's sides somebody is still in it [m]: by the larger axis of their place's ellipse on the floor."""
        a, b, c = float(covariance[0, 0]), float(covariance[1, 1]), float(covariance[0, 1])
        largest = 0.5 * (a + b) + math.hypot(0.5 * (a - b), c)
        unsure = self.layout.border_sigmas * math.sqrt(largest) if largest > 0 else 0.0  # not for NaN
        return min(max(self.layout.border, unsure), max(self.layout.border, _WIDEST))

    def stale(self) -> ZoneStates:
        """Say that tracks have stopped: nobody knows who is where until the next ones come, and delays begin anew with them."""
        for watch in (self._room, *self._zones):
            watch.forget(self._last[0] if self._last is not None else 0)
        return self.states(stale=True)

    def states(self, *, stale: bool = False) -> ZoneStates:
        """Say once more who is where, as of the last tracks; ``stale``: these have stopped."""
        stamp_ns, sequence = self._last if self._last is not None else (0, 0)
        zones = tuple(watch.state(stamp_ns) for watch in self._zones)
        return ZoneStates(stamp_ns, sequence, stale, self._room.state(stamp_ns), zones)


class _Watch:
    """One zone, or several as one: who is in it, since when, and its presence."""

    def __init__(self, name: str, areas: tuple[Area, ...], on_delay: float, off_delay: float) -> None:
        self.name, self._areas = name, areas
        self._delay_ns = {True: round(on_delay * 1e9), False: round(off_delay * 1e9)}
        self._people: dict[int, int] = {}  # track to when it came in [ns]
        self._presence, self._since_ns = Presence.UNKNOWN, 0
        self._somebody: tuple[bool, int] | None = None  # whether somebody is in it, and since when that is so [ns]; None: not known

    def same(self, other: _Watch) -> bool:
        """Whether the other one watches the same in the same way."""
        return (self.name, self._areas, self._delay_ns) == (other.name, other._areas, other._delay_ns)

    def process(self, ids: list[int], position: Float64Array, border: Float64Array, now_ns: int) -> None:
        inside = self._inside(ids, position, border)
        self._people = {number: self._people.get(number, now_ns) for number, there in zip(ids, inside.tolist(), strict=True) if there}
        somebody = bool(self._people)
        if self._somebody is None or self._somebody[0] != somebody:
            self._somebody = somebody, now_ns
        presence = Presence.OCCUPIED if somebody else Presence.EMPTY
        if presence is not self._presence and now_ns - self._somebody[1] >= self._delay_ns[somebody]:
            self._presence, self._since_ns = presence, now_ns

    def _inside(self, ids: Iterable[int], position: Float64Array, border: Float64Array) -> BoolArray:
        if not self._areas:
            return np.ones(len(position), np.bool_)
        inside = np.zeros(len(position), np.bool_)
        for area in self._areas:
            inside |= area.inside(position)
        for row, number in enumerate(ids):
            if not inside[row] and number in self._people:
                inside[row] = any(_near(area, position[row], float(border[row])) for area in self._areas)
        return inside

    def forget(self, now_ns: int) -> None:
        self._people, self._somebody = {}, None
        if self._presence is not Presence.UNKNOWN:
            self._presence, self._since_ns = Presence.UNKNOWN, now_ns

    def state(self, now_ns: int) -> ZoneState:
        people = tuple(Occupant(number, (now_ns - since) * 1e-9) for number, since in self._people.items())
        dwell = (now_ns - self._since_ns) * 1e-9 if self._presence is Presence.OCCUPIED else 0.0
        area = self._areas[0] if len(self._areas) == 1 else None
        return ZoneState(self.name, area, self._presence, self._since_ns, dwell, people)


def _near(area: Area, position: Float64Array, border: float) -> bool:
    """Whether a place, shape (3,), is no farther from an area than a border, on the floor and in height."""
    if position[2] < area.z_low - border or position[2] > area.z_high + border:
        return False
    return bool(area.inside(position[:2]) or area.distance(position) <= border)
