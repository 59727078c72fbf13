"""Thresholds of CFAR detectors from the wanted probability of a false alarm.

Cells of noise, integrated over n channels, follow a gamma distribution of shape n. Windows correlate neighbouring cells, so that the N
training cells tell less about the noise than N independent ones; an effective number N_eff takes their place. With Hann on both axes 72
cells are worth 23 in an average and 30 in an ordered statistic; ignoring it makes the false-alarm rate 1.4 times what was wanted at 1e-4.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import special

Array = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_TERMS = 24
"""Terms of the expansion in `indicator_covariance`; the largest correlation of neighbours in use, about 0.6, leaves 1e-5."""


class CorrelationModel(Protocol):
    """How the correlation of two cells' powers enters the variance of a noise estimate."""

    def __call__(self, squared: Array) -> Array:
        """Covariance for squared correlation coefficients (any shape), relative to the variance at one."""


def indicator_covariance(squared: Array, quantile: float, n: int) -> Array:
    """Correlation of the events "below the quantile" of two gamma variables.

    Kibble's bivariate gamma distribution, expanded in Laguerre polynomials: integrating a polynomial against the density gives one term.

    Parameters
    ----------
    squared : ndarray, shape (...)
        Squared magnitude of the complex correlation coefficient of the two cells.
    quantile : float
        Probability of the event, between 0 and 1.
    n : int
        Number of integrated channels, the shape of the distribution.

    Returns
    -------
    ndarray, shape (...)
        Correlation coefficient of the two events.
    """
    y = float(special.gammaincinv(n, quantile))
    m = np.arange(1, _TERMS + 1)
    log_scale = special.gammaln(m + 1) + special.gammaln(n) - special.gammaln(n + m)
    part = np.exp(n * np.log(y) - y - special.gammaln(n)) * special.eval_genlaguerre(m - 1, n, y) / m
    coefficient = np.exp(log_scale) * part**2
    independent = quantile * (1 - quantile)
    # What the truncated series misses belongs to (almost) identical cells.
    rest = max(0.0, independent - float(np.sum(coefficient)))
    series = np.sum(coefficient * squared[..., None] ** m, axis=-1) + rest * squared ** (_TERMS + 1)
    return np.asarray(series / independent, np.float64)


def os_false_alarm(factor: Array, rank: Array, n_training: Array, n_effective: Array, n: int) -> Array:
    """Probability that noise exceeds ``factor`` times the ``rank``-th smallest training cell.

    The order statistic's level F(x_(k)) is beta distributed; the mean k/(N+1) is kept, the spread is that of the effective number.

    Parameters
    ----------
    factor, rank, n_training, n_effective : ndarray, shape (m,)
        Threshold factor, rank k, number N of training cells, effective number.
    n : int
        Number of integrated channels.

    Returns
    -------
    ndarray, shape (m,)
        Probability.
    """
    level = _levels(rank, n_training, n_effective, n)
    return np.asarray(special.gammaincc(n, factor[:, None] * level) @ (_WEIGHTS / 2), np.float64)


def _levels(rank: Array, n_training: Array, n_effective: Array, n: int) -> Array:
    mean = rank / (n_training + 1)
    a, b = mean * (n_effective + 1), (1 - mean) * (n_effective + 1)
    u = special.betaincinv(a[:, None], b[:, None], (_NODES + 1) / 2)
    return np.asarray(special.gammaincinv(n, u), np.float64)


def os_factor(false_alarm: float, rank: Array, n_training: Array, n_effective: Array, n: int) -> tuple[Array, Array]:
    """Solve for the threshold factor of an ordered-statistic CFAR.

    Parameters
    ----------
    false_alarm : float
        Wanted probability.
    rank, n_training, n_effective : ndarray, shape (m,)
        As in `os_false_alarm`.
    n : int
        Number of integrated channels.

    Returns
    -------
    tuple of ndarray, shape (m,)
        Threshold over the order statistic, and mean of the order statistic over the mean of the noise.
    """
    level = _levels(rank, n_training, n_effective, n)
    weights = _WEIGHTS / 2
    low, high = np.full(len(rank), -5.0), np.full(len(rank), 40.0)
    for _ in range(40):  # bisection on the logarithm: 45 / 2**40 is far below float32
        middle = (low + high) / 2
        above = special.gammaincc(n, np.exp(middle)[:, None] * level) @ weights > false_alarm
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return np.exp((low + high) / 2), level @ weights / n


def ca_factor(false_alarm: float, n_effective: Array, n: int) -> Array:
    """Threshold over the mean of the training cells for cell averaging: their ratio is F distributed, shape (m,)."""
    # F(2n, 2nN) = N X / Y with X, Y gamma: its survival function is the incomplete beta function at d2 / (d2 + d1 f).
    x = special.betaincinv(n * n_effective, n, false_alarm)
    return np.asarray(n_effective * (1 - x) / x, np.float64)
