"""The least squares problem of two trajectories: pose, clock offset and depth of the body."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_core.errors import DataError
from radar_lab.alignment import rigid
from radar_lab.alignment.interpolation import nearest, sight_lines, since, slopes
from radar_lab.alignment.rigid import noise_information, parameter_names, rigid_jacobian
from radar_lab.alignment.solver import Linear, Solution, solve
from radar_lab.alignment.trajectory import Trajectory, TrajectoryConfig

Float64Array = NDArray[np.float64]

_MORE = ("offset", "depth", "depth_difference")


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

        return solve(state, self.names, self.linearise, self._move, self.prior, prior, self.config.solver, _advice)

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
