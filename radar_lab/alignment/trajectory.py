"""Trajectories that two sensors saw of one movement, and what their alignment found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from radar_core.checks import require_shape
from radar_core.config import config, knob
from radar_core.errors import DataError
from radar_lab.alignment.rigid import check_points
from radar_lab.alignment.solver import Freedom, Loss, SolverSettings

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]


@config
class TrajectoryConfig:
    """How two trajectories are aligned."""

    freedom: Freedom = knob("yaw", doc="yaw: turn about z only, for levelled sensors; full: any turn in space")
    clock: bool = knob(True, doc="also find a constant offset between the clocks")
    max_offset: float = knob(0.2, unit="s", low=0.0, high=60.0, doc="largest offset between the clocks that is looked for")
    max_gap: float = knob(
        0.15, unit="s", low=1e-4, high=60.0, doc="samples farther than half of this from every one of the other are left out"
    )
    window: float = knob(
        0.3, unit="s", low=1e-3, high=10.0, doc="velocities that are not known are slopes over this much time on either side"
    )
    depth_std: float = knob(
        0.0,
        unit="m",
        low=0.0,
        high=10.0,
        doc="positions of both sensors may lie this much (rms, the same for both) before the body's centre",
    )
    depth_difference_std: float = knob(
        0.0, unit="m", low=0.0, high=10.0, doc="and one sensor's this much farther before it than the other's"
    )
    depth: Literal["considered", "estimated"] = knob("considered", doc="both only make the result less sure, or are estimated")
    loss: Loss = knob("tukey", doc="none: least squares; huber: outliers count less; tukey: gross ones count nothing")
    cutoff: float = knob(0.0, low=0.0, high=100.0, doc="residual in standard deviations where that begins (tukey: ends); 0: 2, tukey 5")
    correlation_time: float = knob(
        0.0, unit="s", low=0.0, high=1e3, doc="errors this far apart in time are independent; 0: measured from the residuals"
    )
    min_samples: int = knob(20, low=4, high=1_000_000, doc="fewer pairs are refused")
    max_condition: float = knob(1e5, low=1.0, high=1e14, doc="worse conditioned movements are refused")
    max_noise: float = knob(0.25, low=0.0, high=1.0, doc="so are those of which this share of what seems to tell the pose is noise")
    max_iterations: int = knob(100, low=1, high=10_000, doc="more are refused")

    @property
    def solver(self) -> SolverSettings:
        """The same for `solve`."""
        return SolverSettings(self.loss, self.cutoff, "measured", self.max_condition, self.max_noise, self.max_iterations)


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Where something was, as one sensor saw it, in that sensor's frame (levelled, where only yaw is to be found).

    Attributes
    ----------
    stamp_ns : ndarray of int64, shape (n,)
        By the sensor's clock, ascending [ns].
    position : ndarray of float64, shape (n, d)
        d = 2 (floor plane) or 3; the sensor is at the origin [m].
    covariance : ndarray of float64, shape (n, d, d)
        Of the positions [m^2]. Only ratios matter: a common factor is measured.
    velocity : ndarray of float64, shape (n, d)
        Where known [m/s], else NaN, and found from the positions.

    Raises
    ------
    DataError
        When shapes differ, stamps do not ascend, or a position or covariance is not finite.
    """

    stamp_ns: IndexArray
    position: Float64Array
    covariance: Float64Array
    velocity: Float64Array | None = None

    def __post_init__(self) -> None:
        position, covariance = check_points("Trajectory", self.position, self.covariance)
        n, d = position.shape
        stamp = np.asarray(self.stamp_ns)
        require_shape("Trajectory.stamp_ns", stamp, (n,))
        if stamp.dtype.kind not in "iu":
            raise DataError(f"Trajectory.stamp_ns is {stamp.dtype}, expected whole nanoseconds (int64)")
        if (np.diff(stamp) <= 0).any():
            k = int(np.argmax(np.diff(stamp) <= 0)) + 1
            raise DataError(f"Trajectory.stamp_ns does not ascend at sample {k}; sort the samples and leave out those that repeat")
        velocity = np.full((n, d), np.nan) if self.velocity is None else np.asarray(self.velocity, np.float64)
        require_shape("Trajectory.velocity", velocity, (n, d))
        if np.isinf(velocity).any():
            raise DataError("Trajectory.velocity holds an infinity; NaN is the mark for what is not known")
        for name, value in (
            ("stamp_ns", stamp.astype(np.int64)),
            ("position", position),
            ("covariance", covariance),
            ("velocity", velocity),
        ):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def known_velocity(self) -> Float64Array:
        """Velocities, shape (n, d) [m/s]; NaN: not known."""
        assert self.velocity is not None
        return self.velocity


@dataclass(frozen=True, eq=False)
class TrajectoryAlignment:
    """The second sensor's pose in the first one's frame.

    Attributes
    ----------
    rotation : ndarray of float64, shape (d, d)
        Vectors of the second sensor's frame to the first one's.
    translation : ndarray of float64, shape (d,)
        Where the second sensor is in the first one's frame [m].
    offset : float
        What is to be added to the second one's stamps to get the first one's [s]; 0 where it was not looked for.
    depth, depth_difference : float
        How far the body's centre lies behind the positions along the lines of sight, mean of both sensors, and second minus first [m].
    names : tuple of str
        Of the p parameters: those of `Rigid`, then those of ``offset``, ``depth`` and ``depth_difference`` that were estimated.
    covariance : ndarray of float64, shape (p, p)
        Of these [m, rad, s], for errors that are correlated in time.
    pairs : int
        Samples of the second sensor that have a partner.
    n_effective : float
        How many independent samples would say as much.
    correlation_time : float
        Within which errors are correlated [s].
    inlier_share : float
        Share of pairs that count at least half.
    rms : float
        Root mean square distance of these after alignment [m].
    scale : float
        Standard deviations of the positions are this many times those given.
    rank : int
        Of the problem: always p; less is refused.
    condition : float
        Condition number of the equilibrated problem.
    used : ndarray of int64, shape (n,)
        Indices of the second sensor's samples that have a partner.
    partner : ndarray of float64, shape (n, d)
        Where the first sensor saw it then, in its frame [m].
    weight : ndarray of float64, shape (n,)
        How much each pair counts, 0..1.
    residual : ndarray of float64, shape (n, d)
        What is left after alignment [m].
    """

    rotation: Float64Array
    translation: Float64Array
    offset: float
    depth: float
    depth_difference: float
    names: tuple[str, ...]
    covariance: Float64Array
    pairs: int
    n_effective: float
    correlation_time: float
    inlier_share: float
    rms: float
    scale: float
    rank: int
    condition: float
    used: IndexArray
    partner: Float64Array
    weight: Float64Array
    residual: Float64Array

    @property
    def yaw(self) -> float:
        """Turn about z, from the second sensor's x to the first one's [rad]."""
        return math.atan2(self.rotation[1, 0], self.rotation[0, 0])

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of every parameter, by name [m, rad, s]."""
        return dict(zip(self.names, np.sqrt(np.diagonal(self.covariance)).tolist(), strict=True))

    def part(self, names: Sequence[str]) -> Float64Array:
        """Covariance of some parameters, shape (len(names), len(names))."""
        index = [self.names.index(name) for name in names]
        return self.covariance[np.ix_(index, index)]

    def apply(self, points: Float64Array) -> Float64Array:
        """Move points of the second sensor's frame, shape (..., d) [m], to the first one's."""
        return np.asarray(points @ self.rotation.T + self.translation)
