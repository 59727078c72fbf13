"""Zones to and from ROS messages."""

from __future__ import annotations

from typing import Any, Final

import handwave.msg
import numpy as np

from radar_core import ConfigError, DataError
from radar_ros.messages.convert import header, to_time
from radar_tracking.zones import ZoneState, ZoneStates
from radar_tracking.zones.area import HIGHEST, KINDS, LOWEST, Area

_BOUNDARY: Final = KINDS.index("boundary")


def zones_to_msg(states: ZoneStates) -> handwave.msg.ZoneArray:
    """Put the states of all zones into a message."""
    return handwave.msg.ZoneArray(
        header=header(states.stamp_ns, "room"),
        sequence=states.sequence,
        stale=states.stale,
        room=_zone_to_msg(states.room),
        zones=[_zone_to_msg(zone) for zone in states.zones],
    )


def _zone_to_msg(zone: ZoneState) -> handwave.msg.Zone:
    area = zone.area
    return handwave.msg.Zone(
        name=zone.name,
        kind=_BOUNDARY if area is None else KINDS.index(area.kind),
        presence=int(zone.presence),
        since=to_time(zone.since_ns),
        dwell_s=zone.dwell,
        count=zone.count,
        track_id=[person.track_id for person in zone.people],
        person_dwell_s=[person.dwell for person in zone.people],
        polygon=[] if area is None else np.ravel(area.corners).tolist(),
        z_low=LOWEST if area is None else area.z_low,
        z_high=HIGHEST if area is None else area.z_high,
    )


def areas_from_msg(msg: Any) -> list[tuple[str, Area]]:
    """Take the names and polygons of the zones out of a message, without the whole room.

    Raises
    ------
    DataError
        When a zone is of no kind that is known here, or its corners make no polygon.
    """
    found = []
    for zone in msg.zones:
        if zone.kind >= len(KINDS):
            raise DataError(f"zones: {zone.name!r} is of kind {zone.kind}, which is none; whatever sent it is broken or of another version")
        corners = tuple(zip(zone.polygon[0::2], zone.polygon[1::2], strict=False))
        try:
            found.append((zone.name, Area(KINDS[zone.kind], corners, zone.z_low, zone.z_high)))
        except ConfigError as error:
            raise DataError(f"zones: {zone.name!r}: {error}") from None
    return found
