"""Knobs of the estimators."""

from __future__ import annotations

import math
from typing import Literal, get_args

from radar_core import ConfigError
from radar_core.config import config, knob

Motion = Literal["constant_velocity", "constant_acceleration", "coordinated_turn"]
Filter = Literal["linear", "extended", "unscented"]
MOTIONS: tuple[str, ...] = get_args(Motion)
FILTERS: tuple[str, ...] = get_args(Filter)
ESTIMATORS = (*FILTERS, "imm", "mmae", "mm_vel_est")


@config
class EstimatorConfig:
    """Which estimator follows the tracks, on which motion, with how much noise.

    ``linear``, ``extended`` and ``unscented`` are one Kalman filter on `motion`: the first takes converted positions, the others polar
    coordinates and the range rate. ``imm`` and ``mmae`` run one such filter, `filter`, on each of `modes`. ``mm_vel_est`` takes positions,
    and velocities or range rates where they were measured.
    """

    name: Literal["linear", "extended", "unscented", "imm", "mmae", "mm_vel_est"] = knob("linear", doc="estimator")
    motion: Motion = knob("constant_velocity", doc="motion model of an estimator with one model")
    process_noise: float = knob(1.0, unit="m^2/s^3", low=1e-9, high=1e6, doc="spectral density of acceleration, for velocity and turns")
    jerk_noise: float = knob(5.0, unit="m^2/s^5", low=1e-9, high=1e6, doc="spectral density of the jerk that drives constant acceleration")
    turn_noise: float = knob(1.0, unit="rad^2/s^3", low=1e-9, high=1e3, doc="spectral density of the turn rate's drift")
    height_noise: float = knob(1e-4, low=0.0, high=1.0, doc="vertical over horizontal process noise: people hardly move up and down")
    acceleration_std: float = knob(2.0, unit="m/s^2", low=1e-3, high=1e3, doc="how far a target's acceleration is from zero when unknown")
    turn_std: float = knob(1.0, unit="rad/s", low=1e-3, high=100.0, doc="how far a target's turn rate is from zero when unknown")
    filter: Filter = knob("linear", doc="filter of every mode of imm and mmae")
    modes: tuple[Motion, ...] = knob(("constant_velocity", "constant_velocity"), doc="motion models of imm and mmae, one for each mode")
    noise_scale: tuple[float, ...] = knob((0.1, 5.0), low=1e-9, high=1e9, doc="factor of the process noise in each mode")
    sojourn: tuple[float, ...] = knob((2.0, 0.5), unit="s", low=1e-3, high=1e6, doc="mean time that imm's targets stay in each mode")
    least_weight: float = knob(1e-6, low=1e-12, high=0.1, doc="no mode's probability falls below this, so that it can come back")
    sigma_spread: float = knob(0.6, low=0.52, high=1.0, doc="distance of the unscented filter's sigma points (alpha)")

    def validate(self) -> None:
        """Raise `ConfigError` when the modes' lists do not belong together."""
        if not self.modes:
            raise ConfigError(f"EstimatorConfig.modes is empty; choose one or more of {', '.join(MOTIONS)}")
        for name in ("noise_scale", "sojourn"):
            given = len(getattr(self, name))
            if given != len(self.modes):
                raise ConfigError(f"EstimatorConfig.{name} has {given} entries, modes has {len(self.modes)}; give one for each mode")


@config
class SnapshotConfig:
    """How the velocity of a hand is estimated from range rates.

    `spread`, `common`, `spin` and `rest` are maximum-likelihood estimates from range rates of simulated hands whose velocity is known:
    docs/research/tracking.md. What errs comes from the hand's turning, and a hand that moves faster turns faster.
    """

    spread: float = knob(0.07, unit="m/s", low=0.0, high=5.0, doc="how far rates of points of a hand at 1 m/s differ for reasons unknown")
    common: float = knob(0.01, unit="m/s", low=0.0, high=5.0, doc="error that all points of one radar have in common, at 1 m/s")
    spin: float = knob(1.25, unit="rad/s", low=0.0, high=100.0, doc="how fast a hand at 1 m/s turns; 0: it is a point")
    rest: float = knob(0.9, unit="m/s", low=1e-3, high=1e3, doc="these three grow with the speed of a hand that is faster than about this")
    huber: float = knob(2.0, low=0.1, high=100.0, doc="points farther off than this many standard deviations count less and less")
    iterations: int = knob(4, low=1, high=50, doc="rounds of weighing and solving; 1: no point is an outlier")
    max_std: float = knob(0.6, unit="m/s", low=1e-3, high=100.0, doc="axes along which the velocity is less certain are not given")

    def factor(self, speed: float | None) -> float:
        """How large `spread`, `common` and `spin` are at a speed [m/s], over those at 1 m/s; None: it is not known, and taken for that."""
        return 1.0 if speed is None else math.hypot(speed, self.rest) / math.hypot(1.0, self.rest)
