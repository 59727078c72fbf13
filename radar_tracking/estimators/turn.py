"""The coordinated turn, and integrals along its arc without cancellation at any turn rate."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from radar_core import ConfigError
from radar_core.types import Complex128Array, Float64Array
from radar_tracking.estimators.kinematics import chain_noise, check_density

_SERIES_BELOW = 2.0  # rad: turns smaller than this use series, because their closed forms cancel


def arc(rate: Float64Array, dt: float) -> tuple[Complex128Array, Complex128Array]:
    """Turn a velocity x + j y, and make it a way: exp(j a) and its integral over ``dt`` [1, s], a = rate dt, shape of ``rate`` [rad/s]."""
    half = 0.5 * dt * rate
    return np.exp(2j * half), dt * np.sinc(half / np.pi) * np.exp(1j * half)


def lag(angle: Float64Array) -> Float64Array:
    """Compute (sin a - a) / a^3 of angles [rad], any shape."""
    small = np.abs(angle) < _SERIES_BELOW
    a = np.where(small, 1.0, angle)
    return np.where(small, np.polynomial.polynomial.polyval(np.where(small, angle, 0.0) ** 2, _LAG), (np.sin(a) - a) / a**3)


def bend(angle: Float64Array) -> Complex128Array:
    """Integrate (1 - s) exp(-j a s) over s in 0..1, of angles a [rad], any shape."""
    return np.asarray(0.5 * np.sinc(angle / (2 * np.pi)) ** 2 + 1j * angle * lag(angle))


def _series(first: int, terms: int = 12) -> Float64Array:
    """Coefficients (-1)^k / (2 k + first)! of a power series in the square of the angle."""
    return np.array([(-1.0) ** k / math.factorial(2 * k + first) for k in range(terms)])


_LAG = -_series(3)  # of (sin a - a) / a^3
_RISE = _series(2)  # of (1 - cos a) / a^2


def _moment_series() -> tuple[Float64Array, ...]:
    """Power series, in the square of the angle a, of the integrals over s in 0..1 that `turn_moments` needs.

    With back = s^2 (sin as - as) / (as)^2 = a s^3 lag(as) and left = s^2 (1 - cos as) / (as)^2: of back^2 / a^2, back left / a, left^2,
    back s / a, left s, back / a and left.
    """

    def integral(series: Float64Array, power: int) -> Float64Array:
        return series / (np.arange(len(series)) * 2 + power + 1)

    return (
        integral(np.convolve(_LAG, _LAG), 6),
        integral(np.convolve(_LAG, _RISE), 5),
        integral(np.convolve(_RISE, _RISE), 4),
        integral(_LAG, 4),
        integral(_RISE, 3),
        integral(_LAG, 3),
        integral(_RISE, 2),
    )


_MOMENTS = _moment_series()


def _closed_moments(a: Float64Array) -> tuple[Float64Array, ...]:
    """Return the same integrals as `_moment_series`, for angles that are not small."""
    sin, cos = np.sin(a), np.cos(a)
    s_sin, s_cos = (sin - a * cos) / a**2, (cos - 1 + a * sin) / a**2  # integrals of s sin(a s) and s cos(a s)
    return (
        (0.5 - sin * cos / (2 * a) + a**2 / 3 - 2 * a * s_sin) / a**6,
        ((1 - cos) / a - a / 2 - sin**2 / (2 * a) + a * s_cos) / a**5,
        (1.5 - 2 * sin / a + sin * cos / (2 * a)) / a**4,
        (s_sin - a / 3) / a**3,
        (0.5 - s_cos) / a**2,
        ((1 - cos) / a - a / 2) / a**3,
        (1 - sin / a) / a**2,
    )


def turn_moments(angle: Float64Array, dt: float) -> Float64Array:
    """Integrate what white turn noise of density one does to a unit velocity that ends along the first axis: covariances, shape (n, 5, 5).

    Order: position along and left, velocity along and left, turn rate. Noise with the time s to go moves the end of the arc by
    (along, left) = s^2 (as - sin as, 1 - cos as) / (as)^2, the velocity by (0, s), and the turn rate by 1.
    """
    small = np.abs(angle) < _SERIES_BELOW
    square = np.where(small, angle, 0.0) ** 2
    closed = _closed_moments(np.where(small, 1.0, angle))
    series = (np.polynomial.polynomial.polyval(square, c) for c in _MOMENTS)
    bb, bl, ll, bs, ls, b1, l1 = (np.where(small, x, y) for x, y in zip(series, closed, strict=True))
    M = np.zeros((len(angle), 5, 5))
    M[:, 0, 0], M[:, 1, 1], M[:, 3, 3], M[:, 4, 4] = bb * angle**2 * dt**5, ll * dt**5, dt**3 / 3, dt
    entries = (
        (0, 1, -bl * angle * dt**5),
        (0, 3, -bs * angle * dt**4),
        (0, 4, -b1 * angle * dt**3),
        (1, 3, ls * dt**4),
        (1, 4, l1 * dt**3),
        (3, 4, np.full(len(angle), dt**2 / 2)),
    )
    for i, j, value in entries:
        M[:, i, j] = M[:, j, i] = value
    return M


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
        check_density(self.density)
        check_density((1.0, self.turn_density))
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
        Q[:, : 2 * d, : 2 * d] = chain_noise(2, self.density, dt)
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
