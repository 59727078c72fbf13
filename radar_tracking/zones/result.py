"""Results of zones: who is in each, since when, and whether anybody knows."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from radar_tracking.zones.area import Area


class Presence(IntEnum):
    """Whether somebody is in a zone; the numbers are those of ``msg/Zone.msg``."""

    EMPTY = 0
    OCCUPIED = 1
    UNKNOWN = 2


@dataclass(frozen=True)
class Occupant:
    """Somebody in a zone: whose track it is, and how long they have been in it [s]."""

    track_id: int
    dwell: float


@dataclass(frozen=True)
class ZoneState:
    """One zone after one set of tracks.

    Attributes
    ----------
    name : str
        Of the zone.
    area : Area or None
        Its polygon; None: everywhere.
    presence : Presence
        After the delays.
    since_ns : int
        When presence became what it is [ns].
    dwell : float
        How long it has been occupied [s]; 0 unless it is.
    people : tuple of Occupant
        Who is in it now, without delays, in the order of their tracks; nobody while presence is unknown for want of tracks.
    """

    name: str
    area: Area | None
    presence: Presence
    since_ns: int
    dwell: float
    people: tuple[Occupant, ...]

    @property
    def count(self) -> int:
        """Number of people in it now."""
        return len(self.people)


@dataclass(frozen=True)
class ZoneStates:
    """All zones after one set of tracks.

    Attributes
    ----------
    stamp_ns, sequence : int
        Of the tracks; when stale, of the last ones.
    stale : bool
        Tracks have stopped: all presence is unknown.
    room : ZoneState
        Everybody, in the room's boundary where there is one.
    zones : tuple of ZoneState
        In the order of the zones file.
    """

    stamp_ns: int
    sequence: int
    stale: bool
    room: ZoneState
    zones: tuple[ZoneState, ...]

    def differs(self, other: ZoneStates) -> bool:
        """Whether there is more news than the time: another presence, or others in a zone."""
        return self.stale != other.stale or _news(self) != _news(other)


def _news(states: ZoneStates) -> list[tuple[object, ...]]:
    every = (states.room, *states.zones)
    return [(zone.name, zone.area, zone.presence, tuple(person.track_id for person in zone.people)) for zone in every]
