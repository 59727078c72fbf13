"""Zones of a room: who is where, by polygons on the floor; from the results of tracking alone."""

from radar_tracking.zones.config import LayoutConfig, ZoneConfig
from radar_tracking.zones.monitor import ZoneMonitor
from radar_tracking.zones.result import Occupant, Presence, ZoneState, ZoneStates

__all__ = ["LayoutConfig", "Occupant", "Presence", "ZoneConfig", "ZoneMonitor", "ZoneState", "ZoneStates"]
