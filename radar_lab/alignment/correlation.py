"""How long errors stay alike: integrated autocorrelation time, and stretches of time that are independent of each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]

_SECOND = 1e9  # ns
_WINDOW = 5.0  # correlation times that are summed over (Sokal 1997)
_LENGTH = 8.0  # correlation times in one stretch
_STRETCHES = 12  # at least that many stretches, if correlation times allow
_LONGEST = 0.2  # of the whole time: correlations that last longer cannot be told from a trend


def integrated_time(stamp_ns: IndexArray, residual: Float64Array, weight: Float64Array) -> float:
    """Measure the time over which one independent error is spread: the sum of the autocorrelation over all lags [s].

    The sum ends where it is several times the lag (Sokal's window): beyond, it would be noise. Lags are times, so gaps do no harm.

    Parameters
    ----------
    stamp_ns : ndarray of int64, shape (n,)
        Ascending [ns].
    residual : ndarray of float64, shape (n, d)
        Of unit variance.
    weight : ndarray of float64, shape (n,)
        How much each counts.

    Returns
    -------
    float
        At least the time between two samples; that for independent errors.
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
    """Cut time into stretches whose sums are nearly independent.

    Parameters
    ----------
    stamp_ns : ndarray of int64, shape (n,)
        Ascending [ns].
    correlation_time : float
        Integrated autocorrelation time [s].

    Returns
    -------
    group : ndarray of int64, shape (n,)
        Number of each sample's stretch.
    longest : float
        Correlation time over the length of a stretch.
    """
    since = (stamp_ns - stamp_ns[0]) / _SECOND
    span = max(float(since[-1]), 1e-9) * (1 + 1e-9)
    length = min(_LENGTH * correlation_time, span / _STRETCHES)
    length = max(length, 2.0 * correlation_time, 1e-9)
    return np.floor(since / length).astype(np.int64), min(0.5, 0.5 * correlation_time / length)
