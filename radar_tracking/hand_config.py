"""Knobs of hand tracking; every duration in seconds, every length in metres."""

from __future__ import annotations

from radar_core import ConfigError
from radar_core.config import config, knob


@config
class HandConfig:
    """Everything that `HandTracker` can be told (thesis, 7.3)."""

    trigger: str = knob("rotate", doc="name of the gesture that starts the hand track of who performs it; empty: none does")
    trigger_delay: float = knob(
        0.1, unit="s", low=0.0, high=10.0, doc="a trigger takes effect this long after its stamp, so that message order does not matter"
    )
    toggle: bool = knob(False, doc="the trigger gesture also ends the hand track; off, because circles drawn by the hand look like it")
    lost_after: float = knob(1.0, unit="s", low=0.05, high=60.0, doc="the hand track ends when the hand is unseen for longer")
    reacquire_after: float = knob(0.1, unit="s", low=0.0, high=60.0, doc="unseen for longer, the hand is looked for anywhere within reach")
    reach: float = knob(0.9, unit="m", low=0.1, high=3.0, doc="largest horizontal distance of the hand from the body")
    gate: float = knob(0.4, unit="m", low=0.02, high=3.0, doc="points farther from the predicted hand than this are not its own")
    gate_sigmas: float = knob(5.0, low=0.5, high=100.0, doc="the same in standard deviations")
    body_radius: float = knob(0.12, unit="m", low=0.01, high=1.0, doc="slow points this near to the body's axis are body, never hand")
    torso_depth: float = knob(
        0.1, unit="m", low=0.0, high=1.0, doc="slow points no nearer to the radar than the torso by this are body, never hand"
    )
    find_points: int = knob(2, low=1, high=100, doc="points that a hand must have to be found (to be followed, one is enough)")
    body_speed: float = knob(0.25, unit="m/s", low=0.0, high=5.0, doc="radial speed up to which a point is slow")
    hand_radius: float = knob(
        0.2, unit="m", low=0.01, high=1.0, doc="a point is the hand's if it is nearer to it in units of this than to the body"
    )
    hand_length: float = knob(
        0.1, unit="m", low=0.01, high=1.0, doc="points this much farther in than the outermost count 1/e: the forearm"
    )
    speed_scale: float = knob(0.25, unit="s", low=0.0, high=10.0, doc="k-means: 1 m/s of radial speed counts as much as this many metres")
    process_noise: float = knob(8.0, unit="m^2/s^3", low=1e-3, high=1e5, doc="spectral density of the hand's acceleration")
    position_std: float = knob(0.08, unit="m", low=1e-3, high=1.0, doc="how far the centroid of the hand's points is from the hand")
    angle_std: float = knob(0.03, unit="rad", low=0.0, high=1.0, doc="direction error of one point, for clouds that carry no own estimate")
    damping: float = knob(0.05, unit="s", low=0.01, high=1e3, doc="time in which an unseen hand loses 63 % of its speed")
    value_axis: str = knob(
        "height", choices=("height", "lateral", "reach"), doc="what the control value follows: z, y or horizontal distance"
    )
    value_low: float = knob(-0.4, unit="m", low=-10.0, high=10.0, doc="offset of the hand from the body that gives 0")
    value_high: float = knob(0.4, unit="m", low=-10.0, high=10.0, doc="offset of the hand from the body that gives 1")

    def validate(self) -> None:
        """Raise `ConfigError` when the range of the control value is empty, or the gate admits more than the reach."""
        if self.value_low == self.value_high:
            raise ConfigError(
                f"HandConfig.value_low and value_high are both {self.value_low:g} m; they must differ (low > high turns it round)"
            )
        if self.gate > self.reach:
            raise ConfigError(f"HandConfig.gate = {self.gate:g} m is larger than reach = {self.reach:g} m; make it smaller")
