"""Baseband node: radar/frame to radar/points."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import handwave.msg
from sensor_msgs.msg import PointCloud2

from radar_core import DataError, HandwaveError, RadarInfo
from radar_dsp import Baseband
from radar_dsp.context import CalibratedBasebandConfig, load_context
from radar_dsp.tally import FLAWS, Tally
from radar_ros import qos
from radar_ros.budget import Budget
from radar_ros.messages.convert import cloud_to_cloud2, cloud_to_msg, frame_from_msg
from radar_ros.params import declare_config, on_change
from radar_ros.stage import InfoKeeper, StageNode, run


class BasebandNode(StageNode):
    """Turns raw frames into point clouds; its configuration may be changed while it runs, and gives way to a time budget."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("baseband", **kwargs)
        self._config = declare_config(self, CalibratedBasebandConfig, changeable=True)
        self._budget = Budget(self, self._config, self._prepare_levels)
        self._levels: tuple[Baseband | None, ...] = (None,)
        self._warm_up()
        self._tally = Tally()
        self._points = self.create_publisher(handwave.msg.PointCloud, "radar/points", qos.stream_out())
        self._points2 = self.create_publisher(PointCloud2, "radar/points2", qos.stream_out())
        self._info = InfoKeeper(self, self._configure)
        on_change(self, self._config, self._prepare)
        self.create_subscription(handwave.msg.RadarFrame, "radar/frame", self._take, qos.sensor(reliable=self.reliable, depth=1))

    def _warm_up(self) -> None:
        """Compile and design thresholds before subscribing: a driver that waits for its readers then loses no frame meanwhile."""
        with contextlib.suppress(HandwaveError):  # what suits no usual radar may suit the one that comes, and is refused there
            for config in set(self._budget.configs):
                Baseband(config, RadarInfo())

    def _configure(self, info: RadarInfo) -> None:
        self._levels = self._make(self._budget.configs, info)

    def _prepare(self, config: CalibratedBasebandConfig) -> Callable[[], None]:
        """Make a new chain for the radar that is there; refused (`ConfigError`) when it does not suit that radar."""
        place = self._prepare_levels(self._budget.configs_of(config))

        def apply() -> None:
            self._config = config
            self._budget.rebase(config)
            place()

        return apply

    def _prepare_levels(self, configs: tuple[CalibratedBasebandConfig, ...]) -> Callable[[], None]:
        """Make new chains for all levels of the budget, likewise."""
        unusable = self._info.unusable  # it may be the configuration that the radar did not suit
        levels = self._make(configs, self._info.info or unusable)

        def apply() -> None:
            self._levels = levels
            if unusable is not None:
                self._info.accept(unusable)

        return apply

    def _make(self, configs: Sequence[CalibratedBasebandConfig], info: RadarInfo | None) -> tuple[Baseband | None, ...]:
        """Make the chains for the calibrated radar; None without a radar, and for a source that gives ready point clouds only."""
        if info is None or info.waveform.n_sample == 0:
            return (None,) * len(configs)
        radar = load_context(info, configs[0].calibration).radar  # levels differ in other knobs only
        made = {config: Baseband(config, radar) for config in set(configs)}  # or only in how many frames they leave out
        return tuple(made[config] for config in configs)

    def _take(self, msg: Any) -> None:
        started, worked, every = time.monotonic_ns(), time.thread_time_ns(), self._budget.begin()
        if not self.due(msg.sequence, every):  # left out to keep within the budget, and said so on stage_budget
            return
        self.count_gap(msg.sequence, every)
        if self._info.usable() is None:
            return
        baseband = self._levels[self._budget.number]
        if baseband is None:
            raise DataError("raw frames come, but radar/info says that this source gives no frames (n_sample = 0)")
        cloud = replace(baseband.process(frame_from_msg(msg)), every=every)
        self._points.publish(cloud_to_msg(cloud))
        self._budget.slow_down(worked)
        self.finish(cloud.stamp_ns, cloud.sequence, started)
        self._budget.spent(cloud.stamp_ns, started)
        if self._points2.get_subscription_count():
            self._points2.publish(cloud_to_cloud2(cloud))
        self._tally.add(cloud)
        for flaw, (_, text) in FLAWS.items():
            if flaw in cloud.quality:
                self.caution(f"frame {cloud.sequence}: {text}")

    def extra_diagnostics(self) -> tuple[dict[str, Any], list[str]]:
        """Noise floor, points per frame, and frames of doubtful quality in the period that ends."""
        values, warnings = self._tally.report()
        self._tally.clear()
        if self._info.reason:
            warnings.append(f"cannot work with this radar: {self._info.reason}")
        more, worse = self._budget.report()
        return {**values, **more}, warnings + worse


make_node = BasebandNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
