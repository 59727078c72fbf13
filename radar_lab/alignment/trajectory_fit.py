"""One movement seen by two sensors: find where the second stands to the first, and how far their clocks are apart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from radar_core.errors import DataError
from radar_core.types import Float64Array, IndexArray
from radar_lab.alignment import rigid
from radar_lab.alignment.rigid import noise_information, parameter_names, rigid_jacobian
from radar_lab.alignment.solver import Linear, NotObservableError, Solution, correlated_covariance, solve
from radar_lab.alignment.trajectory import Trajectory, TrajectoryAlignment, TrajectoryConfig, nearest, sight_lines, since, slopes

_SECOND = 1e9  # ns
_SPAN = 10.0  # correlation times that a movement has to last
_COARSE = 0.02  # s: steps of the search for the clocks' offset
_MORE = ("offset", "depth", "depth_difference")
_WINDOW = 5.0  # correlation times that are summed over (Sokal 1997)
_LENGTH = 8.0  # correlation times in one stretch
_STRETCHES = 12  # at least that many stretches, if correlation times allow
_LONGEST = 0.2  # of the whole time: correlations that last longer cannot be told from a trend


def align_trajectories(first: Trajectory, second: Trajectory, config: TrajectoryConfig | None = None) -> TrajectoryAlignment:
    """Find where the second sensor stands to the first one, from one movement that both saw.

    Samples of the second are paired with the nearest ones of the first, moved on by their velocity; so let the first be the one with more
    samples. Pose, clock offset and depth are estimated together, by robust least squares on positions. Errors of positions are correlated
    in time: the covariance is that of sums over stretches several times as long as residuals are correlated.

    Parameters
    ----------
    first, second : Trajectory
        Of the same dimension.
    config : TrajectoryConfig or None
        Knobs.

    Raises
    ------
    NotObservableError
        When the movement leaves something open, such as the clock offset in a straight walk at one speed.
    DataError
        When the trajectories do not overlap in time, or nothing fits.
    """
    config = config or TrajectoryConfig()
    d = first.position.shape[1]
    if second.position.shape[1] != d:
        raise DataError(f"the first trajectory has {d} dimensions, the second {second.position.shape[1]}; leave out z, or give it in both")
    rotation, translation, offset = _begin(first, second, config)
    state = State(rotation, translation, np.array([offset, 0.0, 0.0]))
    fit = Fit(first, second, config)
    for _ in range(3):  # which samples have partners depends, at the edges of gaps, on the offset
        fit.choose(float(state.more[0]))
        solution = fit.solve(state)
        done = abs(solution.state.more[0] - state.more[0]) < 1e-3
        state = solution.state
        if done:
            break
    return _result(fit, solution)


def _begin(first: Trajectory, second: Trajectory, config: TrajectoryConfig) -> tuple[Float64Array, Float64Array, float]:
    """Find a start: the offset of the clocks, on a coarse grid, with which a rigid motion fits best."""
    steps = math.ceil(config.max_offset / _COARSE) if config.clock else 0
    velocity = slopes(first, config.window).velocity
    best: tuple[float, Float64Array, Float64Array, float] | None = None
    most = 0
    for k in sorted(range(-steps, steps + 1), key=abs):
        offset = k * config.max_offset / max(steps, 1)
        index, partner = nearest(first, second.stamp_ns, offset, config.max_gap)
        most = max(most, len(index))
        if len(index) < config.min_samples:
            continue
        b = second.position[index]
        a = first.position[partner] + velocity[partner] * since(first, second, index, partner, offset)[:, None]
        names = parameter_names(b.shape[1], config.freedom)
        rigid.refuse_few(b, a, len(names), b.shape[1])
        std = np.sqrt(np.trace(first.covariance[partner] + second.covariance[index], axis1=1, axis2=2) / b.shape[1])
        rotation, translation = rigid.start(b, a, std, config.freedom)
        step = a - b @ rotation.T - translation
        misfit = float(np.median(np.sqrt((step * step).sum(-1))))
        if best is None or misfit < 0.98 * best[0]:  # a shift of the clocks has to be worth it
            best = misfit, rotation, translation, offset
    if best is None:
        raise DataError(
            f"only {most} samples of the second trajectory have a partner in the first, {config.min_samples} are needed; both sensors "
            "must see the person at the same time, and their stamps must be of one time"
        )
    return best[1:]


def _result(fit: Fit, solution: Solution[State]) -> TrajectoryAlignment:
    config, index = fit.config, fit.index
    stamp = fit.second.stamp_ns[index]
    time = integrated_time(stamp, solution.whitened, solution.weight)
    apart = config.correlation_time or time
    span = float(stamp[-1] - stamp[0]) / _SECOND
    if span < _SPAN * apart:
        known = f"errors stay alike for {apart:.2g} s, nearly as long as the {span:.3g} s that both sensors saw"
        raise NotObservableError(f"the uncertainty: {known}; measure for longer", ())
    group, longest = groups_of(stamp, apart)
    state = solution.state
    step = float(np.median(np.diff(stamp))) / _SECOND
    covariance = correlated_covariance(solution, group, longest, apart / step) + fit.considered(solution)
    offset, depth, difference = state.more.tolist()
    return TrajectoryAlignment(
        state.rotation, state.translation, fit.names, covariance, solution.weight, solution.linear.residual, solution.scale, solution.rank,
        solution.condition, offset, depth, difference, len(index) * min(1.0, step / max(apart, 1e-12)), apart, index, fit.seen(state),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class State:
    """Where the second sensor stands, clock offset [s], depth and depth difference [m]."""

    rotation: Float64Array
    translation: Float64Array
    more: Float64Array


class Fit:
    """The least squares problem of two trajectories."""

    def __init__(self, first: Trajectory, second: Trajectory, config: TrajectoryConfig) -> None:
        self.first, self.second, self.config = first, second, config
        d = first.position.shape[1]
        self.pose = parameter_names(d, config.freedom)
        deep = config.depth == "estimated"
        wanted = (config.clock, deep and config.depth_std > 0, deep and config.depth_difference_std > 0)
        self.more = np.flatnonzero(wanted)  # which of `_MORE` are estimated
        self.names = (*self.pose, *(_MORE[k] for k in self.more))
        stds = np.array([math.inf, config.depth_std, config.depth_difference_std])
        self.prior = np.concatenate([np.full(len(self.pose), math.inf), stds[self.more]])
        self.slopes = slopes(first, config.window)

    def choose(self, offset: float) -> None:
        """Choose the samples that have partners at an offset [s]."""
        self.index, self.partner = nearest(self.first, self.second.stamp_ns, offset, self.config.max_gap)
        if len(self.index) < self.config.min_samples:
            raise DataError(f"only {len(self.index)} samples have a partner, {self.config.min_samples} are needed; measure for longer")

    def seen(self, state: State) -> Float64Array:
        """Where the first sensor saw it at the second one's samples, shape (n, d) [m]."""
        later = since(self.first, self.second, self.index, self.partner, float(state.more[0]))
        return np.asarray(self.first.position[self.partner] + self.slopes.velocity[self.partner] * later[:, None])

    def solve(self, state: State) -> Solution[State]:
        """Solve from a start."""
        known = np.zeros(len(self.names))

        def prior(at: State) -> Float64Array:
            known[len(self.pose) :] = -at.more[self.more]
            return known

        return solve(state, self.names, self.linearise, self._move, self.prior, prior, self.config, _advice)

    def linearise(self, state: State) -> Linear:
        """Residuals in the first sensor's frame, and how they change."""
        _, depth, difference = state.more.tolist()
        a, b = self.seen(state), self.second.position[self.index]
        sight_a, sight_b = sight_lines(a), sight_lines(b)
        turned = (b + (depth + 0.5 * difference) * sight_b) @ state.rotation.T
        jacobian, turning = rigid_jacobian(turned, self.pose)
        columns = np.concatenate([-self.slopes.velocity[self.partner][..., None], self.depths(state)], axis=-1)
        own = state.rotation @ self.second.covariance[self.index] @ state.rotation.T
        covariance = own + self.first.covariance[self.partner]
        p, k = len(self.names), len(self.pose)
        noise = np.zeros((p, p))
        noise[:k, :k] = noise_information(turning, covariance, own)
        if self.config.clock:
            noise[k, k] = np.trace(np.linalg.solve(covariance, self.slopes.covariance[self.partner]), axis1=1, axis2=2).sum()
        residual = a + (depth - 0.5 * difference) * sight_a - turned - state.translation
        return Linear(residual, np.concatenate([jacobian, columns[..., self.more]], axis=-1), covariance, noise)

    def depths(self, state: State) -> Float64Array:
        """How residuals change with depth and depth difference, shape (n, d, 2)."""
        along_a = sight_lines(self.seen(state))
        along_b = sight_lines(self.second.position[self.index]) @ state.rotation.T
        return np.stack([along_b - along_a, 0.5 * (along_b + along_a)], axis=-1)

    def considered(self, solution: Solution[State]) -> Float64Array:
        """Work out what depths that are not estimated do to the covariance of the parameters, shape (p, p) (Schmidt 1966)."""
        config = self.config
        std = np.array([config.depth_std, config.depth_difference_std]) * (config.depth == "considered")
        root = np.linalg.cholesky(solution.linear.covariance)
        change = np.linalg.solve(root, self.depths(solution.state)) * solution.weight[:, None, None]
        moved = solution.bread @ np.einsum("nip,nik->pk", solution.jacobian, change) * std
        return np.asarray(moved @ moved.T)

    def _move(self, state: State, step: Float64Array) -> State:
        rotation, translation = rigid.moved((state.rotation, state.translation), step[: len(self.pose)])
        more = state.more.copy()
        more[self.more] += step[len(self.pose) :]
        # a step too far would leave samples without neighbours
        limit = 2.0 * self.config.max_offset + 0.1
        more[0] = min(max(more[0], -limit), limit)
        return State(rotation, translation, more)


def _advice(names: Sequence[str]) -> str:
    """Say what to do about parameters that cannot be told."""
    if "offset" in names:
        return (
            "a straight walk at one speed looks the same with clocks apart: walk in several directions, or take the clocks as synchronised"
        )
    if "depth" in names or "depth_difference" in names:
        return "walk across the lines of sight too, not only towards the sensors, or take the depth as known"
    return rigid.advice(names)


def integrated_time(stamp_ns: IndexArray, residual: Float64Array, weight: Float64Array) -> float:
    """Measure the time over which one independent error is spread: the sum of the autocorrelation over all lags [s].

    The sum ends where it is several times the lag (Sokal's window): beyond, it would be noise. Lags are times, so gaps do no harm. It is at
    least the time between two samples, which is what independent errors have.

    Parameters
    ----------
    stamp_ns : ndarray of int64, shape (n,)
        Ascending [ns].
    residual, weight : ndarray of float64, shapes (n, d), (n,)
        Of unit variance, and how much each counts.
    """
    n = len(stamp_ns)
    if n < 3:
        return 0.0
    step = float(np.median(np.diff(stamp_ns))) / _SECOND
    place = np.round((stamp_ns - stamp_ns[0]) / _SECOND / step).astype(np.int64)
    keep = np.diff(place, prepend=-1) > 0
    length = int(min(place[-1] + 1, 64 * n))  # a day's gap needs no day of zeros
    keep &= place < length
    grid, filled = np.zeros((length, residual.shape[1])), np.zeros(length)
    grid[place[keep]] = residual[keep] * np.sqrt(weight[keep])[:, None]
    filled[place[keep]] = weight[keep]
    size = 1 << (2 * length - 1).bit_length()
    power = np.abs(np.fft.rfft(grid, size, axis=0)) ** 2
    product = np.fft.irfft(power.sum(axis=1), size)[:length]
    pairs = np.fft.irfft(np.abs(np.fft.rfft(np.sqrt(filled), size)) ** 2, size)[:length]
    with np.errstate(invalid="ignore", divide="ignore"):
        acf = np.where(pairs > 0.5, product / pairs, 0.0)
    if not acf[0] > 0:
        return step
    total = 1.0
    for lag in range(1, max(2, int(length * _LONGEST))):
        total += 2.0 * float(acf[lag] / acf[0])
        if lag >= _WINDOW * max(total, 1.0) / 2.0:
            break
    return step * max(total, 1.0)


def groups_of(stamp_ns: IndexArray, correlation_time: float) -> tuple[IndexArray, float]:
    """Cut time into stretches whose sums are nearly independent, by the integrated autocorrelation time [s].

    Returns the number of each sample's stretch, shape (n,), and half the correlation time over the length of a stretch.
    """
    elapsed = (stamp_ns - stamp_ns[0]) / _SECOND
    span = max(float(elapsed[-1]), 1e-9) * (1 + 1e-9)
    length = min(_LENGTH * correlation_time, span / _STRETCHES)
    length = max(length, 2.0 * correlation_time, 1e-9)
    return np.floor(elapsed / length).astype(np.int64), min(0.5, 0.5 * correlation_time / length)
