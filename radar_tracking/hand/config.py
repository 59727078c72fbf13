"""Knobs of hand tracking; every duration in seconds, every length in metres."""

from __future__ import annotations

from typing import Literal

from radar_core import ConfigError
from radar_core.config import config, knob
from radar_tracking.estimators.config import EstimatorConfig, SnapshotConfig


@config
class SplitConfig:
    """Which points of a person are the hand."""

    reach: float = knob(0.9, unit="m", low=0.1, high=3.0, doc="largest horizontal distance of the hand from the body")
    gate: float = knob(0.4, unit="m", low=0.02, high=3.0, doc="points farther from the predicted hand than this are not its own")
    inward: float = knob(0.2, unit="m", low=0.0, high=3.0, doc="points that much farther in along the arm than a resting hand are forearm")
    gate_sigmas: float = knob(4.0, low=0.5, high=100.0, doc="the same in standard deviations")
    body_radius: float = knob(0.12, unit="m", low=0.01, high=1.0, doc="slow points this near to the body's axis are body, never hand")
    torso_depth: float = knob(0.2, unit="m", low=0.0, high=1.0, doc="slow points not so much nearer to the radar than the axis are body")
    body_speed: float = knob(0.25, unit="m/s", low=0.0, high=5.0, doc="radial speed up to which a point is slow")
    hand_radius: float = knob(0.2, unit="m", low=0.01, high=1.0, doc="a hand's points are nearer to it, in units of this, than to the body")
    find_speed: float = knob(0.5, unit="m/s", low=0.0, high=5.0, doc="a hand that rested is found elsewhere only when it moves faster")
    find_points: int = knob(2, low=1, high=100, doc="points that a hand must have to be found (to be followed, one is enough)")
    speed_scale: float = knob(0.25, unit="s", low=0.0, high=10.0, doc="k-means: 1 m/s of radial speed counts as much as this many metres")

    def validate(self) -> None:
        """Raise `ConfigError` when the gate admits more than the reach."""
        if self.gate > self.reach:
            raise ConfigError(f"SplitConfig.gate = {self.gate:g} m is larger than reach = {self.reach:g} m; make it smaller")


@config
class ValueConfig:
    """How the hand's place becomes a control value, 0..1."""

    axis: Literal["height", "lateral", "reach"] = knob("height", doc="what it follows: z, y or horizontal distance from the body")
    origin: Literal["body", "start"] = knob("body", doc="offsets count from the body, or from where the hand was found")
    low: float = knob(-0.4, unit="m", low=-10.0, high=10.0, doc="offset of the hand that gives 0")
    high: float = knob(0.4, unit="m", low=-10.0, high=10.0, doc="offset of the hand that gives 1")
    hysteresis: float = knob(0.02, low=0.0, high=0.5, doc="the value moves only when the hand is farther from it than this, either way")

    def validate(self) -> None:
        """Raise `ConfigError` when the range is empty."""
        if self.low == self.high:
            raise ConfigError(f"ValueConfig.low and high are both {self.low:g} m; they must differ (low > high turns the value round)")


@config
class HandConfig:
    """Knobs of `HandTracker` (thesis, 7.3)."""

    trigger: str = knob("rotate", doc="name of the gesture that starts the hand track of who performs it; empty: none does")
    trigger_delay: float = knob(0.1, unit="s", low=0.0, high=10.0, doc="a trigger acts this long after its stamp, in any message order")
    toggle: bool = knob(False, doc="the trigger gesture also ends the hand track; off, because circles drawn by the hand look like it")
    lost_after: float = knob(1.0, unit="s", low=0.05, high=60.0, doc="the hand track ends when a hand that moved is unseen for longer")
    rest_after: float = knob(10.0, unit="s", low=0.05, high=600.0, doc="the same for a hand that rested, which gives no moving echo")
    rest_speed: float = knob(0.25, unit="m/s", low=0.0, high=5.0, doc="a hand slower than this rests")
    reacquire_after: float = knob(0.1, unit="s", low=0.0, high=60.0, doc="unseen for longer, the hand is looked for anywhere within reach")
    split: SplitConfig = SplitConfig()
    hand_length: float = knob(0.08, unit="m", low=0.01, high=1.0, doc="points this much farther in than the outermost count 1/e (forearm)")
    position_std: float = knob(0.04, unit="m", low=1e-3, high=1.0, doc="how far the centroid of many points of a hand is from the hand")
    bias_std: float = knob(0.02, unit="m", low=0.0, high=1.0, doc="the lasting part of that error, which no filter averages out")
    extent: float = knob(0.08, unit="m", low=0.0, high=1.0, doc="how far one point of a hand is from their centroid")
    angle_std: float = knob(0.03, unit="rad", low=0.0, high=1.0, doc="direction error of one point, for clouds that carry no own estimate")
    rate_std: float = knob(0.05, unit="m/s", low=1e-3, high=5.0, doc="range-rate error of one point, for clouds that carry no own estimate")
    start_speed: float = knob(1.0, unit="m/s", low=0.01, high=10.0, doc="speed that a hand may have when it is found")
    snapshot: SnapshotConfig = SnapshotConfig()
    estimator: EstimatorConfig = EstimatorConfig(name="mm_vel_est", process_noise=4.0, height_noise=1.0)
    damping: float = knob(0.05, unit="s", low=0.01, high=1e3, doc="time in which an unseen hand loses 63 % of its speed")
    value: ValueConfig = ValueConfig()
