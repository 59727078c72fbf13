"""Zones node: tracks to who is where."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import handwave.msg
from std_srvs.srv import Trigger

from radar_core import HandwaveError
from radar_core.config import config, knob, load_file
from radar_ros import qos
from radar_ros.messages.tracks import tracks_from_msg
from radar_ros.messages.zones import zones_to_msg
from radar_ros.params import declare_config, on_change
from radar_ros.stage import StageNode, run
from radar_tracking.zones import LayoutConfig, ZoneMonitor, ZoneStates

_AT_LEAST = 1.0  # s of tracks: without news, zones are said again after this long


@config
class ZonesNodeConfig:
    """Where the zones are."""

    zones_file: str = knob("", doc="YAML file of the zones (docs/how-to/zones.md); empty: only the whole room")


class ZonesNode(StageNode):
    """Tells who is in which zone, and when nobody knows."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("zones", **kwargs)
        self._config = declare_config(self, ZonesNodeConfig, changeable=True)
        self._monitor = ZoneMonitor(self._load(self._config))
        self._said: ZoneStates | None = None
        self._zones = self.create_publisher(handwave.msg.ZoneArray, "zones", qos.LATCHED)
        on_change(self, self._config, self._prepare)
        self.create_service(Trigger, "zones/reload", self._reload)
        self._say(self._monitor.stale())
        self.create_subscription(handwave.msg.TrackArray, "tracks", self._take, qos.RESULT)

    def _load(self, wanted: ZonesNodeConfig) -> LayoutConfig:
        return load_file(LayoutConfig, wanted.zones_file) if wanted.zones_file else LayoutConfig()

    def _prepare(self, wanted: ZonesNodeConfig) -> Callable[[], None]:
        return partial(self._use, wanted, self._load(wanted))

    def _use(self, wanted: ZonesNodeConfig, layout: LayoutConfig) -> None:
        """Work with other zones, and say so at once: tracking and gestures go by the topic."""
        self._config = wanted
        self._monitor.change(layout)
        if self._said is not None:
            self._say(self._monitor.states(stale=self._said.stale))

    def _reload(self, _: Any, response: Any) -> Any:
        try:
            self._use(self._config, self._load(self._config))
        except HandwaveError as error:
            response.success, response.message = False, str(error)
            self.problem(f"the zones stay as they are: {error}")
        else:
            names = ", ".join(zone.name for zone in self._monitor.layout.zones) or "none"
            response.success, response.message = True, f"zones: {names}"
        return response

    def _say(self, states: ZoneStates) -> None:
        self._zones.publish(zones_to_msg(states))
        self._said = states

    def _take(self, msg: Any) -> None:
        started = time.monotonic_ns()
        self.count_gap(msg.sequence, msg.every)
        tracks = tracks_from_msg(msg)
        if self.went_back(tracks.stamp_ns):
            self._monitor.reset()
        states, said = self._monitor.process(tracks), self._said
        if said is None or states.differs(said) or states.stamp_ns - said.stamp_ns >= _AT_LEAST * 1e9:
            self._say(states)
        self.finish(tracks.stamp_ns, tracks.sequence, started)

    def on_stale(self) -> None:
        """Nobody knows who is where."""
        self._say(self._monitor.stale())

    def extra_diagnostics(self) -> tuple[dict[str, Any], list[str]]:
        """People and presence of the room and of every zone."""
        if self._said is None:
            return {}, []
        every = {"room": self._said.room, **{f"zone.{zone.name}": zone for zone in self._said.zones}}
        return {name: f"{zone.presence.name.lower()}, {zone.count} people" for name, zone in every.items()}, []


make_node = ZonesNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
