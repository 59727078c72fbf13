"""One movement seen by two sensors: find where the second stands to the first, and how far their clocks are apart."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from radar_core.errors import DataError
from radar_lab.alignment import rigid
from radar_lab.alignment.correlation import groups_of, integrated_time
from radar_lab.alignment.interpolation import nearest, since, slopes
from radar_lab.alignment.joint import Fit, State
from radar_lab.alignment.rigid import parameter_names
from radar_lab.alignment.solver import NotObservableError, Solution, correlated_covariance
from radar_lab.alignment.trajectory import Trajectory, TrajectoryAlignment, TrajectoryConfig

Float64Array = NDArray[np.float64]

_SECOND = 1e9  # ns
_SPAN = 10.0  # correlation times that a movement has to last
_COARSE = 0.02  # s: steps of the search for the clocks' offset


def align_trajectories(first: Trajectory, second: Trajectory, config: TrajectoryConfig | None = None) -> TrajectoryAlignment:
    """Find where the second sensor stands to the first one, from one movement that both saw.

    Samples of the second are paired with the nearest ones of the first, moved on by their velocity; so let the first be the one with more
    samples. Pose, clock offset and depth are estimated
    together, by robust least squares on positions. Errors of positions are correlated in time:
    the covariance is that of sums over stretches several times as long as residuals are correlated.

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
