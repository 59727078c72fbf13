"""How people and hands move between two measurements (thesis, figure A.20): kinematic models, discretised exactly for any time step.

Every model is driven by white noise of a given spectral density, so that what it predicts does not depend on how a time is cut into frames:
two steps of dt1 and dt2 equal one of dt1 + dt2, in the state, in the transition matrix and in the process noise (Bar-Shalom, Li and
Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, chapters 6 and 11).

States are ordered positions, velocities, then the rest; positions are in ``room`` [m].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError
from radar_tracking.estimators.arcs import arc, bend, lag, turn_moments

Float64Array = NDArray[np.float64]


class Motion(Protocol):
    """A kinematic model.

    Attributes
    ----------
    dimensions : int
        2 (floor plane) or 3.
    n_states : int
        Length of the state vector.
    """

    @property
    def dimensions(self) -> int:
        """2 or 3."""
        ...

    @property
    def n_states(self) -> int:
        """Length of the state vector."""
        ...

    def move(self, mean: Float64Array, dt: float) -> Float64Array:
        """States, shape (..., n_states), ``dt`` later [s], without noise."""
        ...

    def jacobian(self, mean: Float64Array, dt: float) -> Float64Array:
        """Differentiate `move`: shape (n, n_states, n_states), or (1, n_states, n_states) when it is the same for all n states."""
        ...

    def noise(self, mean: Float64Array, dt: float) -> Float64Array:
        """Covariance of what the noise adds to `move`, shape like that of `jacobian`."""
        ...


@dataclass(frozen=True)
class _Chain:
    """A chain of derivatives of the position, the highest of which drifts under white noise.

    Attributes
    ----------
    density : tuple of float
        Spectral density of that noise on every axis; its length, 2 or 3, is the number of dimensions.
    """

    density: tuple[float, ...]
    order: ClassVar[int]

    def __post_init__(self) -> None:
        _check_density(self.density)

    @property
    def dimensions(self) -> int:
        """2 or 3."""
        return len(self.density)

    @property
    def n_states(self) -> int:
        """Length of the state vector."""
        return self.order * len(self.density)

    def move(self, mean: Float64Array, dt: float) -> Float64Array:
        """States, shape (..., n_states), ``dt`` later [s], without noise (6.1)."""
        return np.asarray(mean @ _chain_jacobian(self.order, self.dimensions, dt).T)

    def jacobian(self, mean: Float64Array, dt: float) -> Float64Array:
        """Transition matrix, shape (1, n_states, n_states)."""
        return _chain_jacobian(self.order, self.dimensions, dt)[None]

    def noise(self, mean: Float64Array, dt: float) -> Float64Array:
        """Process noise, shape (1, n_states, n_states)."""
        return _chain_noise(self.order, self.density, dt)[None]


class ConstantVelocity(_Chain):
    """Velocity drifts under white acceleration, ``density`` in m^2/s^3; state (position, velocity)."""

    order = 2


class ConstantAcceleration(_Chain):
    """Acceleration drifts under white jerk, ``density`` in m^2/s^5; state (position, velocity, acceleration)."""

    order = 3


@dataclass(frozen=True)
class CoordinatedTurn:
    """The floor-plane velocity turns at a rate that drifts; height moves with constant velocity; state (position, velocity, turn rate).

    The turn rate is positive from x towards y [rad/s]. The step without noise is exact. The noise is that of the motion linearised about
    the noiseless arc, integrated exactly: acceleration noise turns on with the velocity, and turn noise bends the rest of the arc.

    Attributes
    ----------
    density : tuple of float
        Spectral density of the acceleration on every axis [m^2/s^3]; its length, 2 or 3, is the number of dimensions. Both axes of the
        floor plane must have the same one: a turn mixes them.
    turn_density : float
        Of the turn rate's drift [rad^2/s^3].
    """

    density: tuple[float, ...]
    turn_density: float

    def __post_init__(self) -> None:
        _check_density(self.density)
        _check_density((1.0, self.turn_density))
        if self.density[0] != self.density[1]:
            raise ConfigError(f"CoordinatedTurn.density is {self.density}; x and y must have the same, because a turn mixes them")

    @property
    def dimensions(self) -> int:
        """2 or 3."""
        return len(self.density)

    @property
    def n_states(self) -> int:
        """Length of the state vector."""
        return 2 * len(self.density) + 1

    def move(self, mean: Float64Array, dt: float) -> Float64Array:
        """States, shape (..., n_states), ``dt`` later [s], without noise."""
        d = self.dimensions
        turned, carried = arc(mean[..., -1], dt)
        velocity = mean[..., d] + 1j * mean[..., d + 1]
        way, after = carried * velocity, turned * velocity
        moved = mean.copy()
        moved[..., :d] += dt * mean[..., d : 2 * d]
        moved[..., 0], moved[..., 1] = mean[..., 0] + way.real, mean[..., 1] + way.imag
        moved[..., d], moved[..., d + 1] = after.real, after.imag
        return moved

    def jacobian(self, mean: Float64Array, dt: float) -> Float64Array:
        """Differentiate `move`, shape (n, n_states, n_states)."""
        d, n_states = self.dimensions, self.n_states
        rate = mean[:, -1]
        turned, carried = arc(rate, dt)
        after = turned * (mean[:, d] + 1j * mean[:, d + 1])
        curve = 1j * dt**2 * bend(rate * dt) * after  # derivative of the arc's end by the turn rate
        swing = 1j * dt * after
        F = np.zeros((len(mean), n_states, n_states))
        F[:, range(n_states), range(n_states)] = 1.0
        F[:, range(d), range(d, 2 * d)] = dt
        for row, factor in ((0, carried), (d, turned)):
            F[:, row, d], F[:, row, d + 1] = factor.real, -factor.imag
            F[:, row + 1, d], F[:, row + 1, d + 1] = factor.imag, factor.real
        F[:, 0, -1], F[:, 1, -1] = curve.real, curve.imag
        F[:, d, -1], F[:, d + 1, -1] = swing.real, swing.imag
        return F

    def noise(self, mean: Float64Array, dt: float) -> Float64Array:
        """Process noise, shape (n, n_states, n_states)."""
        d, n_states = self.dimensions, self.n_states
        angle = mean[:, -1] * dt
        Q = np.zeros((len(mean), n_states, n_states))
        Q[:, : 2 * d, : 2 * d] = _chain_noise(2, self.density, dt)
        # acceleration noise: a rotation keeps it isotropic, and only what links position and velocity turns
        link = np.conj(bend(angle)) * dt**2 * self.density[0]
        spread = -2.0 * lag(angle) * dt**3 * self.density[0]
        Q[:, 0, 0] = Q[:, 1, 1] = spread
        for i, j, value in ((0, d, link.real), (1, d + 1, link.real), (0, d + 1, link.imag), (1, d, -link.imag)):
            Q[:, i, j] = Q[:, j, i] = value
        after = arc(mean[:, -1], dt)[0] * (mean[:, d] + 1j * mean[:, d + 1])
        # turn noise: its effect in the basis of the last velocity (along, left of it) times the seconds to go
        basis = np.zeros((len(mean), n_states, 5))
        for row in (0, d):
            column = 0 if row == 0 else 2
            basis[:, row, column], basis[:, row + 1, column] = after.real, after.imag
            basis[:, row, column + 1], basis[:, row + 1, column + 1] = -after.imag, after.real
        basis[:, -1, 4] = 1.0
        Q += self.turn_density * (basis @ turn_moments(angle, dt) @ np.swapaxes(basis, -1, -2))
        return np.asarray(0.5 * (Q + np.swapaxes(Q, -1, -2)))


@dataclass(frozen=True)
class Embedded:
    """A model on some states of a longer vector that several models share; the others are unknown, not zero.

    A state that a model does not have is drawn anew from its prior at every step. So an estimator with several models can mix them
    without claiming that a walker at constant velocity knows his turn rate.

    Attributes
    ----------
    motion : Motion
        The model.
    columns : tuple of int
        Where its states lie in the shared vector.
    prior : tuple of float
        Standard deviations of the shared vector's states; only those that the model does not have count.
    """

    motion: Motion
    columns: tuple[int, ...]
    prior: tuple[float, ...]

    @property
    def dimensions(self) -> int:
        """2 or 3."""
        return self.motion.dimensions

    @property
    def n_states(self) -> int:
        """Length of the shared state vector."""
        return len(self.prior)

    def move(self, mean: Float64Array, dt: float) -> Float64Array:
        """States, shape (..., n_states), ``dt`` later [s]; zero where the model has none."""
        moved = np.zeros_like(mean)
        moved[..., list(self.columns)] = self.motion.move(mean[..., list(self.columns)], dt)
        return moved

    def jacobian(self, mean: Float64Array, dt: float) -> Float64Array:
        """Differentiate `move`, shape (n or 1, n_states, n_states)."""
        return self._spread(self.motion.jacobian(mean[:, list(self.columns)], dt), 0.0)

    def noise(self, mean: Float64Array, dt: float) -> Float64Array:
        """Process noise, shape (n or 1, n_states, n_states), with the prior where the model has no state."""
        return self._spread(self.motion.noise(mean[:, list(self.columns)], dt), 1.0)

    def _spread(self, small: Float64Array, share: float) -> Float64Array:
        """Put matrices of the model's states where they belong, and ``share`` of the prior variance elsewhere."""
        full = np.zeros((len(small), self.n_states, self.n_states))
        full[:, range(self.n_states), range(self.n_states)] = share * np.square(self.prior)
        full[np.ix_(range(len(small)), self.columns, self.columns)] = small
        return full


def _check_density(density: Sequence[float]) -> None:
    if len(density) not in (2, 3) or not all(math.isfinite(q) and q >= 0 for q in density):
        raise ConfigError(
            f"the spectral densities of a motion's noise are {tuple(density)}; give 2 or 3 finite numbers that are not negative"
        )


@lru_cache(maxsize=64)
def _chain_jacobian(order: int, dimensions: int, dt: float) -> Float64Array:
    """Transition matrix of a chain of ``order`` integrators on every axis."""
    chain = np.array([[dt ** (j - i) / math.factorial(j - i) if j >= i else 0.0 for j in range(order)] for i in range(order)])
    F = np.kron(chain, np.eye(dimensions))
    F.setflags(write=False)
    return F


@lru_cache(maxsize=64)
def _chain_noise(order: int, density: tuple[float, ...], dt: float) -> Float64Array:
    """Covariance that white noise at the end of a chain of integrators leaves behind: integrals of powers."""
    last = order - 1
    power = [
        [
            dt ** (2 * last - i - j + 1) / ((2 * last - i - j + 1) * math.factorial(last - i) * math.factorial(last - j))
            for j in range(order)
        ]
        for i in range(order)
    ]
    Q = np.kron(np.array(power), np.diag(density))
    Q.setflags(write=False)
    return Q
