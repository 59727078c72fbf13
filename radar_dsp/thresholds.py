"""Thresholds of CFAR detectors from the wanted probability of a false alarm.

Windows correlate neighbouring cells of the spectrum, so training cells tell less about the noise than as many independent ones, and even
the cell under test is a little like its neighbours behind the guard. A design for white noise is therefore wrong by up to a factor of two.
Here the false-alarm probability of any detector is an expectation over the training cells,

    P = E[ P(cell > factor * level(training) | training) ],

whose inner probability is known in closed form: given the training cells, the cell under test is Gaussian per channel, its power over n
channels noncentral chi-squared. The expectation is a weighted mean over training cells drawn from an exponentially tilted distribution, in
which the low noise levels that cause alarms are usual; the draws are seeded, so the same configuration gives the same threshold.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import special

from radar_core.linalg import canonical_eigh

Array = NDArray[np.float64]
Level = Callable[[NDArray[np.floating]], Array]
"""Noise level per draw, shape (n_draws,), from powers of the training cells, shape (n_draws, n_training)."""

NUMBERS = 2_000_000  # complex normal numbers per threshold: small windows, whose levels spread more, get more draws
_DEPENDENT = 1e-3  # share of the cell's variance that its training cells foretell, below which they count as independent


def ca_factor(false_alarm: float, n_effective: Array, n: int) -> Array:
    """Threshold over the mean of independent training cells: their ratio is F distributed, shape (m,)."""
    # F(2n, 2nN) = N X / Y with X, Y gamma: its survival function is the incomplete beta function at d2 / (d2 + d1 f).
    x = special.betaincinv(n * n_effective, n, false_alarm)
    return np.asarray(n_effective * (1 - x) / x, np.float64)


def effective_number(correlation: NDArray[np.complex128]) -> float:
    """Count the independent cells whose mean power varies as much as that of these.

    ``correlation`` has the correlation coefficients of the noise between the cells, shape (n_training, n_training).
    """
    return float(len(correlation) ** 2 / np.sum(np.abs(correlation) ** 2))


def design(correlation: NDArray[np.complex128], level: Level, false_alarm: float, n: int, numbers: int = NUMBERS) -> tuple[float, float]:
    """Solve for the threshold factor of a detector.

    Parameters
    ----------
    correlation : ndarray of complex128, shape (1 + n_training, 1 + n_training)
        Correlation coefficients of the noise; the first row is the cell under test.
    level : callable
        The detector's noise level.
    false_alarm : float
        Wanted probability.
    n, numbers : int
        Number of integrated channels; effort: how many complex normal numbers are drawn.

    Returns
    -------
    tuple of float
        Threshold over the level, and mean of the level over the mean power of the noise.
    """
    value, vector = canonical_eigh(correlation[1:, 1:])
    use = value > 1e-7 * value[-1]
    value, vector = value[use], vector[:, use]
    guess = float(ca_factor(false_alarm, np.array([effective_number(correlation[1:, 1:])]), n)[0])
    tilt = _tilt(value, len(correlation) - 1, guess, n)
    draws = int(np.clip(numbers / (n * len(value)), 500, 20_000))
    white = _white(max(numbers, draws * n * len(value)))[: draws * n * len(value)].reshape(draws * n, len(value))
    tilted = white * np.sqrt(value / (1 + tilt * value) / 2).astype(np.float32)
    # Density over tilted density: per component exp(tilt |y|^2) / (1 + tilt value).
    energy = (tilted.real**2 + tilted.imag**2).reshape(draws, -1).sum(axis=1, dtype=np.float64)
    weight = np.exp(tilt * energy - n * np.sum(np.log1p(tilt * value))) / draws
    training = tilted @ vector.T.astype(np.complex64)
    power = (training.real**2 + training.imag**2).reshape(draws, n, -1).mean(axis=1)
    # What the training cells foretell of the cell under test, per component of the draw.
    foretell = (correlation[0, 1:] @ vector.conj()) / value
    known = float(np.sum(np.abs(foretell) ** 2 * value))
    noncentral = None
    if known > _DEPENDENT:
        mean = tilted @ foretell.astype(np.complex64)
        noncentral = (np.abs(mean) ** 2).reshape(draws, n).sum(axis=1, dtype=np.float64)
    factor = _solve(level(power), weight, false_alarm, n, noncentral, 1 - known if known > _DEPENDENT else 1.0, guess)
    cells = (white[: 500 * n] * np.sqrt(value / 2).astype(np.float32)) @ vector.T.astype(np.complex64)
    return factor, float(np.mean(level((cells.real**2 + cells.imag**2).reshape(500, n, -1).mean(axis=1))))


@functools.lru_cache(maxsize=2)
def _white(n: int) -> NDArray[np.complex64]:
    """Complex normal numbers of variance two, shape (n,); the same for every pattern of an array, which saves half the time."""
    return np.random.Generator(np.random.SFC64(0)).standard_normal(2 * n, np.float32).view(np.complex64)


def _tilt(value: Array, n_training: int, factor: float, n: int) -> float:
    """Exponent per unit of power that makes the noise levels behind alarms usual: a fixed point of the tail's slope."""
    tilt = 0.0
    for _ in range(30):
        mean = float(np.sum(value / (1 + tilt * value))) / n_training
        x = n * factor * mean
        tail = max(float(special.gammaincc(n, x)), 1e-300)
        slope = min(1.0, math.exp((n - 1) * math.log(x) - x - math.lgamma(n) - math.log(tail)))
        tilt = 0.5 * tilt + 0.5 * slope * factor / n_training
    return tilt


def _solve(level: Array, weight: Array, false_alarm: float, n: int, noncentral: Array | None, variance: float, guess: float) -> float:
    """Secant steps on logarithms: the tail is nearly a power of the factor."""

    def log_rate(log_factor: float) -> float:
        x = n * math.exp(log_factor) * level / variance
        tail = special.gammaincc(n, x) if noncentral is None else 1 - special.chndtr(2 * x, 2 * n, 2 * noncentral / variance)
        return math.log(max(float(np.sum(weight * np.maximum(tail, 0.0))), 1e-300)) - math.log(false_alarm)

    low, high = math.log(guess), math.log(guess) + 0.1
    at_low, at_high = log_rate(low), log_rate(high)
    for _ in range(12):
        if abs(at_high) < 1e-4 or at_high == at_low:
            break
        step = float(np.clip(-at_high * (high - low) / (at_high - at_low), -1.0, 1.0))
        low, at_low = high, at_high
        high += step
        at_high = log_rate(high)
    return math.exp(high)
