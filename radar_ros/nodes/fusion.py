"""Fusion node: the radar/points of several radars to one, in ``room``."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import handwave.msg
from sensor_msgs.msg import PointCloud2

from radar_core import DataError, HandwaveError, PointCloud, Pose, RadarInfo, merge
from radar_core.gaps import Gaps
from radar_ros import qos
from radar_ros.announce import Announcer
from radar_ros.messages.convert import cloud_from_msg, cloud_to_cloud2, cloud_to_msg, from_time, info_from_msg
from radar_ros.params import declare_config
from radar_ros.stage import StageNode, run
from radar_ros.sync import ApproximateTimeSynchronizer, SimpleFilter
from radar_tracking.fusion.clouds import ClockMonitor, ClockOffset, FusionConfig, RadarPresence, fused_info

_QUEUE = 1000  # clouds of one radar that wait; `RadarPresence.hopeless` and silence end the waiting long before
_REASONS = {
    "late": "came later than what was sent on already",
    "unmatched": "found no partner within slop",
    "without_info": "came without a radar/info to understand them",
    "lost": "were lost on the way here",
    "broken": "made no sense",
}


@dataclass
class _Radar:
    """What is known of one radar."""

    name: str
    info: RadarInfo | None = None
    refused: bool = False
    gaps: Gaps = field(default_factory=Gaps)
    arrived_ns: int | None = None


class FusionNode(StageNode):
    """Puts clouds of the same moment together; a radar that falls silent is told of and no longer waited for."""

    fixed_because = "its inputs are connected for it"

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("fusion", **kwargs)
        self._config = declare_config(self, FusionConfig)
        self._radars = {name: _Radar(name) for name in self._config.radars}
        self._presence = RadarPresence(self._config)
        self._clocks = ClockMonitor(self._config.radars, self._config.clocks)
        self._info: RadarInfo | None = None
        self._count = 0
        self._counts: Counter[str] = Counter()  # since the start: clouds of each radar, drops by reason, clouds passed on alone
        self._told: Counter[str] = Counter()  # the same when diagnostics were published last
        self._regroup(self._config.radars)
        self._points = self.create_publisher(handwave.msg.PointCloud, "radar/points", qos.stream_out())
        self._points2 = self.create_publisher(PointCloud2, "radar/points2", qos.stream_out())
        self._announcer = Announcer(self, tf=False)
        for name in self._config.radars:
            qos.subscribe_latched(self, handwave.msg.RadarInfo, f"{name}/radar/info", partial(self._take_info, name))
            profile = qos.sensor(reliable=self.reliable)
            self.create_subscription(handwave.msg.PointCloud, f"{name}/radar/points", partial(self._take, name), profile)

    def _regroup(self, names: tuple[str, ...]) -> None:
        """Wait for these radars from now on; what waits for others is given up."""
        for queue in getattr(self, "_waiting", {}).values():
            self._drop("unmatched", len(queue))
        self._present = names
        self._inputs = {name: SimpleFilter() for name in names}  # fed here, because who is waited for changes
        self._sync = ApproximateTimeSynchronizer(list(self._inputs.values()), _QUEUE, self._config.slop)
        self._sync.registerCallback(self._merge)
        self._waiting: dict[str, dict[int, Any]] = dict(zip(names, self._sync.queues, strict=True))

    def _drop(self, reason: str, count: int = 1) -> None:
        self._counts[reason] += count
        self.dropped += count

    def _take_info(self, name: str, msg: Any) -> None:
        radar = self._radars[name]
        try:
            info = info_from_msg(msg)
        except (HandwaveError, ValueError) as error:
            self.problem(f"{name}/radar/info makes no sense: {error}")
            return
        if radar.info is None:
            radar.info = info
            self._presence.knows(name, info.waveform.frame_interval)
        radar.refused = info != radar.info
        if radar.refused:
            self.problem(f"{name}/radar/info changed while running: its clouds are refused; start this node anew to use the new radar")
        if self._info is None and all(r.info is not None for r in self._radars.values()):
            self._describe()

    def _describe(self) -> None:
        """Fix what the fused radar is, from those that are known; it stays so, because stages refuse a radar that changes."""
        space = self.get_namespace().strip("/")
        self._info = fused_info([r.info for r in self._radars.values() if r.info is not None], f"{space}/fused".lstrip("/"))
        self.frame_interval, self.hardware_id = self._info.waveform.frame_interval, self._info.frame_id
        self._announcer.start(self._info)
        self.ready()

    def _take(self, name: str, msg: Any) -> None:
        self._started = time.monotonic_ns()
        radar, stamp = self._radars[name], from_time(msg.header.stamp)
        self._counts[f"{name}.clouds"] += 1
        radar.arrived_ns = self.get_clock().now().nanoseconds
        if self._presence.went_back(name, stamp):
            self._forget()
        if not self.get_clock().ros_time_is_active:  # simulated time ticks as a replay pleases: arrivals say nothing of clocks then
            self._clocks.hear(name, stamp, radar.arrived_ns)
        self._drop("lost", radar.gaps.lost(msg.sequence, msg.every))
        if radar.info is None or radar.refused:
            self._drop("without_info")
            return
        self._presence.hear(name, stamp)
        present = self._presence.present()
        if present != self._present:
            self._tell(present)
            self._regroup(present)
        if name not in present or self._presence.late(name, stamp):
            self._drop("late")
        elif present == (name,):
            self._merge(msg)
        else:
            self._inputs[name].signalMessage(msg)
        self._give_up()

    def _forget(self) -> None:
        """Begin anew: stamps went back in time."""
        self.caution("stamps went back in time (a recording starts again?): everything is forgotten")
        self._presence.forget()
        self._clocks.forget()
        for radar in self._radars.values():
            radar.gaps = Gaps()
        self._regroup(self._config.radars)

    def _tell(self, present: tuple[str, ...]) -> None:
        """Say who fell silent and who is back."""
        for name in self._present:
            if name not in present:
                self.caution(f"{name} is silent (or its clock is behind): going on with {', '.join(present)} alone")
        for name in present:
            if name not in self._present:
                self.get_logger().info(f"{name} is back")

    def _give_up(self) -> None:
        """Let go of clouds for which no partner can come any more."""
        stamps = {name: list(queue) for name, queue in self._waiting.items()}
        for name, queue in self._waiting.items():
            for stamp in stamps[name]:
                if self._presence.hopeless(name, stamp, stamps) and queue.pop(stamp, None) is not None:
                    self._drop("unmatched")

    def _merge(self, *msgs: Any) -> None:
        """Send one fused cloud of one message of every radar that is waited for."""
        try:
            cloud = merge(*self._understood(msgs), tolerance=self._config.slop)
        except HandwaveError as error:
            self._drop("broken", len(msgs))
            self.problem(str(error))
            return
        if self._presence.last_ns is not None and cloud.stamp_ns <= self._presence.last_ns:
            self._drop("late", len(msgs))
            return
        if self._info is None:
            self._describe()
        cloud = replace(cloud, sequence=self._count, every=1)  # counted anew: nothing of this count is left out
        self._count += 1
        self._counts["passed_alone"] += len(self._present) < len(self._radars)
        self._presence.sent({name: from_time(msg.header.stamp) for name, msg in zip(self._present, msgs, strict=True)}, cloud.stamp_ns)
        self._points.publish(cloud_to_msg(cloud))
        self.finish(cloud.stamp_ns, cloud.sequence, self._started)
        if self._points2.get_subscription_count():
            self._points2.publish(cloud_to_cloud2(cloud))

    def _understood(self, msgs: Sequence[Any]) -> tuple[list[PointCloud], list[Pose]]:
        """Clouds and mounts; what belongs to another sensor than the radar's info describes is refused with a `DataError`."""
        clouds, mounts = [], []
        for name, msg in zip(self._present, msgs, strict=True):
            info = self._radars[name].info
            assert info is not None
            cloud = cloud_from_msg(msg)
            if cloud.frame_id not in (info.frame_id, "room"):
                raise DataError(
                    f"a cloud of {name} is in {cloud.frame_id!r}, but {name}/radar/info describes {info.frame_id!r}; give every radar a "
                    "namespace of its own"
                )
            clouds.append(cloud)
            mounts.append(info.mount)
        return clouds, mounts

    def extra_diagnostics(self) -> tuple[dict[str, Any], list[str]]:
        """Clouds of each radar and what became of them in the period that ends; who is silent, and whose clock is off."""
        new, self._told = self._counts - self._told, self._counts.copy()
        keys = ("passed_alone", *(f"{name}.clouds" for name in self._radars), *_REASONS)
        missing = ((radar.name, self._missing(radar)) for radar in self._radars.values())
        warnings = [f"{name} {reason}" for name, reason in missing if reason]
        warnings += [f"{new[reason]} clouds {text}" for reason, text in _REASONS.items() if new[reason]]
        clocks = {offset.name: offset for offset in self._clocks.offsets()}
        off = (offset for offset in clocks.values() if abs(offset.offset) - offset.spread > self._config.max_clock_offset)
        warnings += [self._complain(offset) for offset in off]
        values: dict[str, Any] = {key: new[key] for key in keys}
        for name in self._radars:
            for figure in ("offset", "spread"):
                known = f"{getattr(clocks[name], figure) * 1e3:.3f}" if name in clocks else "unknown"
                values[f"{name}.clock_{figure}_ms"] = known
        return values, warnings

    def _complain(self, found: ClockOffset) -> str:
        """Say that two clocks differ, and what to do; logged too."""
        way = "ahead of" if found.offset > 0 else "behind"
        text = (
            f"the clock of {found.name} is {abs(found.offset) * 1e3:.1f} ms {way} that of {found.reference}: clouds of different moments "
            "are fused; synchronise the clocks (PTP: ptp4l and phc2sys, see docs/explanation/timing.md)"
        )
        self.caution(text)
        return text

    def _missing(self, radar: _Radar) -> str:
        """Why nothing of a radar goes in, for people; empty: something does."""
        if radar.info is None:
            return "has sent no radar/info: is its driver running, in this namespace?"
        if radar.refused:
            return "is another radar now: its clouds are refused"
        quiet = 0.0 if radar.arrived_ns is None else (self.get_clock().now().nanoseconds - radar.arrived_ns) * 1e-9
        if radar.arrived_ns is None:
            return "is silent: no cloud has come yet"
        if quiet > max(self._config.solo_after, 2 * radar.info.waveform.frame_interval):
            return f"is silent: no cloud for {quiet:.1f} s"
        waited = radar.name in self._present
        return "" if waited else "is not waited for: its stamps are behind those of the others; synchronise the clocks"


make_node = FusionNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
