"""Kinematic models of people and hands (thesis, figure A.20), discretised exactly for any time step.

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

from radar_core import ConfigError
from radar_core.types import Float64Array


class Motion(Protocol):
    """A kinematic model in ``dimensions``, 2 (floor plane) or 3, with ``n_states`` states."""

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
        check_density(self.density)

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
        return chain_noise(self.order, self.density, dt)[None]


class ConstantVelocity(_Chain):
    """Velocity drifts under white acceleration, ``density`` in m^2/s^3; state (position, velocity)."""

    order = 2


class ConstantAcceleration(_Chain):
    """Acceleration drifts under white jerk, ``density`` in m^2/s^5; state (position, velocity, acceleration)."""

    order = 3


def check_density(density: Sequence[float]) -> None:
    """Raise `ConfigError` unless there are two or three densities, finite and not negative."""
    if len(density) not in (2, 3) or not all(math.isfinite(q) and q >= 0 for q in density):
        raise ConfigError(f"the spectral densities of a motion's noise are {tuple(density)}; give 2 or 3 finite numbers, none negative")


@lru_cache(maxsize=64)
def _chain_jacobian(order: int, dimensions: int, dt: float) -> Float64Array:
    """Transition matrix of a chain of ``order`` integrators on every axis."""
    chain = np.array([[dt ** (j - i) / math.factorial(j - i) if j >= i else 0.0 for j in range(order)] for i in range(order)])
    F = np.kron(chain, np.eye(dimensions))
    F.setflags(write=False)
    return F


@lru_cache(maxsize=64)
def chain_noise(order: int, density: tuple[float, ...], dt: float) -> Float64Array:
    """Covariance of white noise at the end of a chain of integrators after ``dt`` [s]."""
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
