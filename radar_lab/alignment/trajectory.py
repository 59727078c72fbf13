"""Trajectories that two sensors saw of one movement, at their own and at other times, and what their alignment found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from radar_core.checks import require_shape
from radar_core.config import config, knob
from radar_core.errors import DataError
from radar_core.types import Float64Array, IndexArray
from radar_lab.alignment.rigid import Motion, check_points
from radar_lab.alignment.solver import Freedom, Loss, SolverConfig

_SECOND = 1e9  # ns
_MOST = 50  # samples on either side that a slope is fitted to: more make it no better for what it is needed


@config
class TrajectoryConfig(SolverConfig):
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
    correlation_time: float = knob(
        0.0, unit="s", low=0.0, high=1e3, doc="errors this far apart in time are independent; 0: measured from the residuals"
    )
    min_samples: int = knob(20, low=4, high=1_000_000, doc="fewer pairs are refused")
    max_condition: float = knob(1e5, low=1.0, high=1e14, doc="worse conditioned movements are refused")


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Where something was, as one sensor saw it, in that sensor's frame (levelled, where only yaw is to be found).

    Raises
    ------
    DataError
        When shapes differ, stamps do not ascend, or a position or covariance is not finite.
    """

    stamp_ns: IndexArray  # by the sensor's clock, ascending, shape (n,) [ns]
    position: Float64Array  # d = 2 (floor plane) or 3; the sensor is at the origin; shape (n, d) [m]
    covariance: Float64Array  # of the positions [m^2]. Only ratios matter: a common factor is measured; shape (n, d, d)
    velocity: Float64Array | None = None  # where known [m/s], else NaN, and found from the positions, shape (n, d)

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
        checked = {"stamp_ns": stamp.astype(np.int64), "position": position, "covariance": covariance, "velocity": velocity}
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def known_velocity(self) -> Float64Array:
        """Velocities, shape (n, d) [m/s]; NaN: not known."""
        assert self.velocity is not None
        return self.velocity


@dataclass(frozen=True, eq=False)
class TrajectoryAlignment(Motion):
    """The second sensor's pose in the first one's frame; the source of the motion is the second sensor, its target the first.

    The covariance is for errors that are correlated in time. After the names of the motion come those of ``offset``, ``depth`` and
    ``depth_difference`` that were estimated.
    """

    offset: float  # what is to be added to the second one's stamps to get the first one's [s]; 0 where it was not looked for
    # depth, depth_difference: how far the body's centre lies behind the positions along the lines of sight, mean of both sensors, and
    # second minus first [m]
    depth: float
    depth_difference: float
    n_effective: float  # how many independent samples would say as much
    correlation_time: float  # within which errors are correlated [s]
    used: IndexArray  # indices of the second sensor's samples that have a partner, shape (n,)
    partner: Float64Array  # where the first sensor saw it then, in its frame, shape (n, d) [m]

    @property
    def pairs(self) -> int:
        """Samples of the second sensor that have a partner."""
        return len(self.used)


class Slopes(NamedTuple):
    """Velocities of a trajectory's samples, shape (n, d) [m/s], and what errors of positions make of them, (n, d, d) [m^2/s^2]."""

    velocity: Float64Array
    covariance: Float64Array


def slopes(track: Trajectory, window: float) -> Slopes:
    """Find the velocity at every sample: the known one, else the slope of a straight line through the samples around it.

    Parameters
    ----------
    track : Trajectory
        With n samples.
    window : float
        How far from a sample others may be [s]; where there are none, its neighbours count.
    """
    n, d = track.position.shape
    time = (track.stamp_ns - track.stamp_ns[:1]) / _SECOND
    sums = np.zeros((n, 3))  # of 1, t, t^2
    place, product = np.zeros((n, d)), np.zeros((n, d))  # of x and t x, both relative to the sample
    sums[:, 0] = 1.0
    apart = np.diff(time, prepend=-np.inf, append=np.inf)
    lonely = (apart[:-1] > window) & (apart[1:] > window)  # whose neighbours count however far they are
    for lag in range(1, min(n - 1, _MOST) + 1):
        step = time[lag:] - time[:-lag]
        far = step > window
        if lag > 1 and far.all():
            break
        for first, sign in ((0, 1.0), (lag, -1.0)):
            low = np.flatnonzero(~far | (lonely[first : first + len(step)] & (lag == 1)))
            own, t, x = low + first, step[low], track.position[low + lag] - track.position[low]
            sums[own] += np.stack([np.ones(len(t)), sign * t, t * t], axis=1)
            place[own] += sign * x
            product[own] += t[:, None] * x
    divisor = np.maximum(sums[:, 0] * sums[:, 2] - sums[:, 1] ** 2, 1e-30)[:, None]
    slope = (sums[:, :1] * product - sums[:, 1:2] * place) / divisor
    known = np.isfinite(track.known_velocity)
    # a tracker's velocity comes from the same positions, so it is no surer than theirs
    return Slopes(np.where(known, track.known_velocity, slope), track.covariance * (sums[:, :1] / divisor)[..., None])


def nearest(track: Trajectory, stamp_ns: IndexArray, offset: float, max_gap: float) -> tuple[IndexArray, IndexArray]:
    """Find for each time the sample nearest to it, which is then moved on by its velocity.

    Straight lines between samples would average the errors of two: most between them, not at all at one of them. A clock offset that is
    fitted then settles in the middle between samples, where errors seem smallest. The nearest sample has its own error everywhere.

    Parameters
    ----------
    track : Trajectory
        With m samples.
    stamp_ns : ndarray of int64, shape (n,)
        Times [ns], by another clock.
    offset : float
        What is to be added to them [s].
    max_gap : float
        Times farther than half of this from every sample are left out [s].

    Returns
    -------
    index, partner : ndarray of int64, shape (k,)
        Which of the times were used, and the samples nearest to them.
    """
    m = len(track)
    if m == 0 or len(stamp_ns) == 0:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    time = stamp_ns + round(offset * _SECOND)
    after = np.clip(np.searchsorted(track.stamp_ns, time), 1, max(m - 1, 1))
    before = after - 1
    after = np.minimum(after, m - 1)
    partner = np.where(time - track.stamp_ns[before] <= track.stamp_ns[after] - time, before, after)
    index = np.flatnonzero(np.abs(track.stamp_ns[partner] - time) <= 0.5e9 * max_gap)
    return index, partner[index]


def since(first: Trajectory, second: Trajectory, index: IndexArray, partner: IndexArray, offset: float) -> Float64Array:
    """Compute how much later than their partners samples of the second trajectory are, with a clock offset, shape (n,) [s]."""
    return np.asarray((second.stamp_ns[index] - first.stamp_ns[partner]) / _SECOND + offset)


def sight_lines(position: Float64Array) -> Float64Array:
    """Return unit vectors on the floor plane from the sensor, at the origin, to positions, shape (n, d); zero right above it."""
    sight = position.copy()
    sight[:, 2:] = 0.0
    length = np.sqrt((sight * sight).sum(axis=-1, keepdims=True))
    return np.asarray(np.where(length > 1e-9, sight / np.maximum(length, 1e-9), 0.0))
