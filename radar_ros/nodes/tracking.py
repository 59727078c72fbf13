"""Tracking node: radar/points to tracks."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import handwave.msg
from std_msgs.msg import UInt32

from radar_core import HandwaveError, RadarInfo
from radar_ros import qos
from radar_ros.budget import Budget
from radar_ros.messages.convert import cloud_from_msg, stride
from radar_ros.messages.tracks import tracks_to_msg
from radar_ros.messages.zones import areas_from_msg
from radar_ros.params import declare_config, on_change
from radar_ros.stage import InfoKeeper, StageNode, run
from radar_tracking import TrackerConfig, make_tracker
from radar_tracking.people.make import AnyTracker
from radar_tracking.people.tally import Tally, TrackConsistencyConfig
from radar_tracking.people.warm_up import warm_up


class TrackingNode(StageNode):
    """Follows people through point clouds, within a time budget where there is one."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("tracking", **kwargs)
        self._config = declare_config(self, TrackerConfig, changeable=True)
        self._budget = Budget(self, self._config, self._prepare_levels)
        self._tally = Tally(self._config.zones, declare_config(self, TrackConsistencyConfig, "consistency."))
        self._tracker: AnyTracker | None = None
        self._dropped_points = 0  # before the tracker was reset
        for level in set(self._budget.configs):
            warm_up(level)
        self._tracks = self.create_publisher(handwave.msg.TrackArray, "tracks", qos.RESULT)
        self._count = self.create_publisher(UInt32, "people_count", qos.RESULT)
        self._info = InfoKeeper(self, self._configure)
        self.create_subscription(handwave.msg.PointCloud, "radar/points", self._take, qos.sensor(reliable=self.reliable))
        self._follows_zones = False
        on_change(self, self._config, self._prepare)
        self.commands.add(self.create_subscription(handwave.msg.ZoneArray, "zones", self._take_zones, qos.LATCHED).topic_name)

    def _configure(self, info: RadarInfo) -> None:
        self._tracker = make_tracker(self._budget.configs[self._budget.number], info)
        self.get_logger().info(f"clouds come from {info.frame_id}, mounted {info.mount.z:g} m above the floor")

    def _prepare(self, config: TrackerConfig) -> Callable[[], None]:
        """Compile what another configuration needs; refused (`ConfigError`) when people could not be tracked on with it."""
        if self._follows_zones:  # the topic goes before the parameter
            config = replace(config, zones=replace(config.zones, areas=self._config.zones.areas))
        configs = self._budget.configs_of(config)
        if self._tracker is not None:
            self._tracker.check(configs[self._budget.number])
        self._prepare_levels(configs)
        return partial(self._use, config)

    def _use(self, config: TrackerConfig) -> None:
        """Work with another configuration from the next cloud on; it is looked up there."""
        self._config = config
        self._budget.rebase(config)

    def _prepare_levels(self, configs: tuple[TrackerConfig, ...]) -> Callable[[], None]:
        """Compile what other levels of the budget need."""
        for level in set(configs):
            warm_up(level)
        return lambda: None  # the level is looked up with every cloud

    def _take_zones(self, msg: Any) -> None:
        """Work with the zones that the zones node works with, from the next cloud on, once it has some."""
        if not msg.zones and not self._follows_zones:
            return
        self._follows_zones = True
        areas = tuple(area.text() for _, area in areas_from_msg(msg) if area.kind != "counting")
        if areas != self._config.zones.areas:
            self._config = replace(self._config, zones=replace(self._config.zones, areas=areas))
            self._budget.rebase(self._config)
            self.get_logger().info(f"works with {len(areas)} zones of the topic zones from now on")

    def _take(self, msg: Any) -> None:
        started, worked, every = time.monotonic_ns(), time.thread_time_ns(), stride(msg) * self._budget.begin()
        if not self.due(msg.sequence, every):  # left out to keep within the budget, and said so on stage_budget
            return
        self.count_gap(msg.sequence, every)
        info, tracker = self._info.usable(), self._tracker
        if info is None or tracker is None:
            return
        cloud = cloud_from_msg(msg).to_room(info.mount)
        if self.went_back(cloud.stamp_ns):
            self._dropped_points += tracker.dropped_points
            tracker.reset()
        config = self._budget.configs[self._budget.number]
        if config is not tracker.config:
            tracker.change(config)
        tracks = replace(tracker.process(cloud), every=every)
        self._tracks.publish(tracks_to_msg(tracks))
        self._budget.slow_down(worked)
        self.finish(tracks.stamp_ns, tracks.sequence, started)
        self._budget.spent(tracks.stamp_ns, started, stride(msg))
        self._count.publish(UInt32(data=tracks.people_count))
        try:  # for the diagnostics; what is wrong with it costs no tracks
            self._tally.add(tracks)
        except HandwaveError as error:
            self.problem(f"the filter's consistency is unknown: {error}")

    def extra_diagnostics(self) -> tuple[dict[str, Any], list[str]]:
        """Tracks by status, deletions by reason, people by zone, points without a place, and whether the filter knows how wrong it is."""
        values, warnings = self._tally.report()
        values["dropped_points"] = self._dropped_points + (self._tracker.dropped_points if self._tracker is not None else 0)
        more, worse = self._budget.report()
        return {**values, **more}, warnings + worse


make_node = TrackingNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
