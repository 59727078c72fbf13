"""The zones file: polygons with names, what each is for, and how long presence is waited for."""

from __future__ import annotations

from functools import cached_property
from typing import Final

from radar_core import ConfigError
from radar_core.config import config, knob
from radar_tracking.zones.area import HIGHEST, LOWEST, Area, Kind

ROOM: Final = "room"
"""Name of the whole room, unless its boundary has another."""


@config
class ZoneConfig:
    """One zone of a room."""

    name: str = knob(doc="of the zone, as on the topic zones")
    kind: Kind = knob(
        "counting",
        doc="counting: no more; entrance: people enter the room here; exclusion: a fan, a curtain: nothing starts here, who walks through "
        "is kept; boundary: the room, nobody is outside",
    )
    polygon: tuple[tuple[float, float], ...] = knob(
        unit="m", low=-1e4, high=1e4, doc="(x, y) of its corners in room, as one walks round it"
    )
    z_low: float = knob(LOWEST, unit="m", low=-100.0, high=100.0, doc="people lower than this are not in it (middle of the body)")
    z_high: float = knob(HIGHEST, unit="m", low=-100.0, high=100.0, doc="and those higher than this")
    on_delay: float = knob(0.5, unit="s", low=0.0, high=3600.0, doc="it is occupied once somebody has been in it for so long")
    off_delay: float = knob(5.0, unit="s", low=0.0, high=86400.0, doc="it is empty once nobody has been in it for so long")

    def validate(self) -> None:
        """Raise `ConfigError` when it has no name, or its corners make no polygon."""
        if not self.name.strip():
            raise ConfigError("ZoneConfig.name is empty; give the zone a name of its own")
        try:
            self.area  # noqa: B018  made here, so that a bad one is refused here
        except ConfigError as error:
            raise ConfigError(f"zone {self.name!r}: {error}") from None

    @cached_property
    def area(self) -> Area:
        """Its polygon and heights."""
        return Area(self.kind, self.polygon, self.z_low, self.z_high)


@config
class LayoutConfig:
    """Zones of a room: what a zones file holds."""

    zones: tuple[ZoneConfig, ...] = knob((), doc="each with a name and a polygon")
    on_delay: float = knob(0.5, unit="s", low=0.0, high=3600.0, doc="the room is occupied once somebody has been in it for so long")
    off_delay: float = knob(5.0, unit="s", low=0.0, high=86400.0, doc="the room is empty once nobody has been in it for so long")
    border: float = knob(0.15, unit="m", low=0.0, high=5.0, doc="who has been in a zone is out again this far beyond its sides")
    border_sigmas: float = knob(1.0, low=0.0, high=10.0, doc="or so many standard deviations of the place, if that is farther")

    def validate(self) -> None:
        """Raise `ConfigError` when two zones share a name, or one has that of the room."""
        names = [zone.name for zone in self.zones]
        for number, zone in enumerate(self.zones):
            if zone.name in names[:number]:
                raise ConfigError(f"zones.{number}.name is {zone.name!r}, as that of zone {names.index(zone.name)}; give each its own")
            if zone.name == ROOM and zone.kind != "boundary":
                raise ConfigError(f"zones.{number}.name is {ROOM!r}, which is the whole room; give the zone another name")

    @property
    def room(self) -> str:
        """Name of the whole room: that of its boundary, where there is one."""
        names = [zone.name for zone in self.zones if zone.kind == "boundary"]
        return names[0] if len(names) == 1 else ROOM

    @property
    def areas(self) -> tuple[str, ...]:
        """Zones that act where tracks begin and end, as texts: the tracker's knob ``zones.areas``."""
        return tuple(zone.area.text() for zone in self.zones if zone.kind != "counting")
