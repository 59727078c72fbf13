"""One movement seen by two sensors: where the second stands to the first, and how far their clocks are apart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_core.checks import require_shape
from radar_core.config import config, knob
from radar_core.errors import DataError
from radar_lab.alignment import rigid
from radar_lab.alignment.correlation import groups_of, integrated_time
from radar_lab.alignment.interpolation import nearest, since, slopes
from radar_lab.alignment.joint import Fit, State
from radar_lab.alignment.rigid import check_points, parameter_names
from radar_lab.alignment.solver import LOSSES, NotObservableError, Solution, SolverSettings, correlated_covariance

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]

_SECOND = 1e9  # ns
_SPAN = 10.0  # correlation times that a movement has to last
_COARSE = 0.02  # s: steps of the search for the clocks' offset


@config
class TrajectoryConfig:
    """How two trajectories are aligned."""

    freedom: str = knob("yaw", choices=("yaw", "full"), doc="yaw: turn about z only, for levelled sensors; full: any turn in space")
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
    depth: str = knob("considered", choices=("considered", "estimated"), doc="both only make the result less sure, or are estimated")
    loss: str = knob("tukey", choices=LOSSES, doc="none: least squares; huber: outliers count less; tukey: gross ones count nothing")
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


def align_trajectories(first: Trajectory, second: Trajectory, settings: TrajectoryConfig | None = None) -> TrajectoryAlignment:
    """Find where the second sensor stands to the first one, from one movement that both saw.

    Samples of the second are paired with the nearest ones of the first, moved on by their velocity; so let the first be the one with more
    samples. Pose, clock offset and depth are estimated
    together, by robust least squares on positions. Errors of positions are correlated in time:
    the covariance is that of sums over stretches several times as long as residuals are correlated.

    Parameters
    ----------
    first, second : Trajectory
        Of the same dimension.
    settings : TrajectoryConfig or None
        Knobs.

    Returns
    -------
    TrajectoryAlignment

    Raises
    ------
    NotObservableError
        When the movement leaves something open, such as the clock offset in a straight walk at one speed.
    DataError
        When the trajectories do not overlap in time, or nothing fits.
    """
    settings = settings or TrajectoryConfig()
    d = first.position.shape[1]
    if second.position.shape[1] != d:
        raise DataError(f"the first trajectory has {d} dimensions, the second {second.position.shape[1]}; leave out z, or give it in both")
    rotation, translation, offset = _begin(first, second, settings)
    state = State(rotation, translation, np.array([offset, 0.0, 0.0]))
    fit = Fit(first, second, settings)
    for _ in range(3):  # which samples have partners depends, at the edges of gaps, on the offset
        fit.choose(float(state.more[0]))
        solution = fit.solve(state)
        done = abs(solution.state.more[0] - state.more[0]) < 1e-3
        state = solution.state
        if done:
            break
    return _result(fit, solution)


def _begin(first: Trajectory, second: Trajectory, settings: TrajectoryConfig) -> tuple[Float64Array, Float64Array, float]:
    """Find a start: the offset of the clocks, on a coarse grid, with which a rigid motion fits best."""
    steps = math.ceil(settings.max_offset / _COARSE) if settings.clock else 0
    velocity = slopes(first, settings.window).velocity
    best: tuple[float, Float64Array, Float64Array, float] | None = None
    most = 0
    for k in sorted(range(-steps, steps + 1), key=abs):
        offset = k * settings.max_offset / max(steps, 1)
        index, partner = nearest(first, second.stamp_ns, offset, settings.max_gap)
        most = max(most, len(index))
        if len(index) < settings.min_samples:
            continue
        b = second.position[index]
        a = first.position[partner] + velocity[partner] * since(first, second, index, partner, offset)[:, None]
        names = parameter_names(b.shape[1], settings.freedom)
        rigid.refuse_few(b, a, len(names), b.shape[1])
        std = np.sqrt(np.trace(first.covariance[partner] + second.covariance[index], axis1=1, axis2=2) / b.shape[1])
        rotation, translation = rigid.start(b, a, std, settings.freedom)
        step = a - b @ rotation.T - translation
        misfit = float(np.median(np.sqrt((step * step).sum(-1))))
        if best is None or misfit < 0.98 * best[0]:  # a shift of the clocks has to be worth it
            best = misfit, rotation, translation, offset
    if best is None:
        raise DataError(
            f"only {most} samples of the second trajectory have a partner in the first, {settings.min_samples} are needed; both sensors "
            "must see the person at the same time, and their stamps must be of one time"
        )
    return best[1:]


def _result(fit: Fit, solution: Solution[State]) -> TrajectoryAlignment:
    settings, index = fit.settings, fit.index
    stamp = fit.second.stamp_ns[index]
    time = integrated_time(stamp, solution.whitened, solution.weight)
    apart = settings.correlation_time or time
    span = float(stamp[-1] - stamp[0]) / _SECOND
    if span < _SPAN * apart:
        known = f"errors stay alike for {apart:.2g} s, nearly as long as the {span:.3g} s that both sensors saw"
        raise NotObservableError(f"the uncertainty: {known}; measure for longer", ())
    group, longest = groups_of(stamp, apart)
    state = solution.state
    step = float(np.median(np.diff(stamp))) / _SECOND
    covariance = correlated_covariance(solution, group, longest, apart / step) + fit.considered(solution)
    return TrajectoryAlignment(
        state.rotation,
        state.translation,
        float(state.more[0]),
        float(state.more[1]),
        float(state.more[2]),
        fit.names,
        covariance,
        len(index),
        len(index) * min(1.0, step / max(apart, 1e-12)),
        apart,
        float((solution.weight >= 0.5).mean()),
        rigid.root_mean_square(solution.linear.residual, solution.weight),
        solution.scale,
        solution.rank,
        solution.condition,
        index,
        fit.seen(state),
        solution.weight,
        solution.linear.residual,
    )
