"""Consistency of filters: NIS and NEES against chi-square (Bar-Shalom, Li and Kirubarajan 2001, section 5.4)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammainccinv, gammaincinv

from radar_core import ConfigError, DataError
from radar_core.checks import require_finite, require_shape
from radar_core.config import config, knob
from radar_core.linalg import solve_spd
from radar_core.types import Float64Array

State = Literal["consistent", "over-confident", "under-confident", "unknown"]
_BINS = 50  # of the window: what is older than the window leaves in steps of a fiftieth of it
_SECOND = 1_000_000_000  # ns
_HUGE = 1e150  # a larger NIS says no more than this one, and sums of these are still numbers


def chi_square_band(dof: ArrayLike, quantile: float = 0.999) -> tuple[Float64Array, Float64Array]:
    """Bounds of a chi-square variable over its degrees of freedom.

    Parameters
    ----------
    dof : array_like
        Degrees of freedom, positive: of a sum, that of all its terms.
    quantile : float
        Probability of the band, the rest in equal tails.

    Returns
    -------
    low, high : ndarray of float64
        Shape of ``dof``; both go to 1 as ``dof`` grows.
    """
    half, tail = np.asarray(dof, np.float64) / 2, (1 - quantile) / 2
    return np.asarray(gammaincinv(half, tail) / half), np.asarray(gammainccinv(half, tail) / half)


@config
class ConsistencyConfig:
    """Limits beyond which a filter counts as inconsistent.

    The chi-square band alone is for a perfect model: people accelerate, and errors of one body's echoes hang together for tenths of a
    second, so that over ten seconds every real tracker leaves a band of a few per cent. `low` and `high` say what is harmless: at 2 the
    standard deviations are wrong by a factor of 1.4, and a gate made for 99 % of the measurements still takes 90 % (two dimensions). A
    ratio is suspicious only when it is outside both.
    """

    window: float = knob(10.0, unit="s", low=0.1, high=3600.0, doc="time over which the mean is taken")
    quantile: float = knob(0.999, low=0.5, high=1 - 1e-9, doc="probability of the chi-square band")
    low: float = knob(0.5, low=0.0, high=1.0, doc="means of NIS per degree of freedom down to this are accepted")
    high: float = knob(2.0, low=1.0, high=1e6, doc="means of NIS per degree of freedom up to this are accepted")
    min_samples: int = knob(20, low=1, high=10**6, doc="fewer in the window say nothing")
    enter_after: float = knob(2.0, unit="s", low=0.0, high=3600.0, doc="a warning begins when the mean has been outside for this long")
    leave_after: float = knob(5.0, unit="s", low=0.0, high=3600.0, doc="a warning ends when the mean has been inside for this long")

    def validate(self) -> None:
        """Raise `ConfigError` when a warning could not begin within a window."""
        if self.enter_after > self.window:
            raise ConfigError(f"enter_after = {self.enter_after:g} s is longer than window = {self.window:g} s; make the window longer")


@dataclass(frozen=True)
class Consistency:
    """NIS of a filter over a window.

    Attributes
    ----------
    ratio : float
        Sum of NIS over sum of degrees of freedom in the window; 1 is expected. NaN: no samples.
    low, high : float
        Accepted: chi-square band of the samples, widened to the tolerances; NaN: no samples.
    samples : int
        In the window.
    state : str
        ``over-confident``: the filter believes to know more than it does (ratio above `high`); ``under-confident``: the opposite;
        ``unknown``: too few samples. Changes only after the hysteresis.
    """

    ratio: float
    low: float
    high: float
    samples: int
    state: State

    @property
    def warning(self) -> str:
        """Warning for the user; empty when the filter is consistent."""
        if self.state not in ("over-confident", "under-confident"):
            return ""
        knob_hint = "raise" if self.state == "over-confident" else "lower"
        return (
            f"the filter is {self.state}: NIS is {self.ratio:.2g} x what it expects, {self.low:.2g} to {self.high:.2g} are accepted; "
            f"{knob_hint} its measurement or process noise"
        )


class ConsistencyMonitor:
    """Watch the NIS of a filter over a sliding window; memory is bounded, and nothing is summed up for longer than the window."""

    def __init__(self, config: ConsistencyConfig | None = None) -> None:
        self.config = config or ConsistencyConfig()
        self._bin_ns = max(round(self.config.window * _SECOND / _BINS), 1)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._sums = np.zeros((_BINS, 3))  # NIS, degrees of freedom, samples
        self._newest: int | None = None
        self._stamp_ns = 0
        self._state: State = "unknown"
        self._verdict: State = "unknown"
        self._since_ns: int | None = None

    def process(self, stamp_ns: int, nis: Float64Array, dof: NDArray[np.integer]) -> Consistency:
        """Take in the innovations of one cloud.

        Parameters
        ----------
        stamp_ns : int
            Of the cloud [ns]; one that goes back starts everything anew.
        nis : ndarray of float64, shape (n_tracks,)
            Normalised innovations squared of the tracks that were updated; may be empty.
        dof : ndarray of int, shape (n_tracks,)
            Their degrees of freedom.

        Returns
        -------
        Consistency
            Of the window that ends at the stamp.

        Raises
        ------
        DataError
            When shapes disagree, NIS is not finite or negative, or a degree of freedom is not positive.
        """
        _check(nis, dof)
        if self._newest is not None and stamp_ns < self._stamp_ns:
            self.reset()
        self._stamp_ns = stamp_ns
        self._add(stamp_ns // self._bin_ns, nis, dof)
        total, freedom, samples = self._sums.sum(axis=0).tolist()
        if not samples:
            return Consistency(math.nan, math.nan, math.nan, 0, self._settle(stamp_ns, "unknown"))
        band = chi_square_band(freedom, self.config.quantile)
        low, high = min(float(band[0]), self.config.low), max(float(band[1]), self.config.high)
        ratio = total / freedom
        return Consistency(ratio, low, high, int(samples), self._settle(stamp_ns, self._judge(ratio, low, high, int(samples))))

    def _add(self, number: int, nis: Float64Array, dof: NDArray[np.integer]) -> None:
        """Put samples into the bin of the present and empty those that have left the window."""
        passed = _BINS if self._newest is None else min(number - self._newest, _BINS)
        self._sums[[(number - k) % _BINS for k in range(passed)]] = 0.0
        self._newest = number
        self._sums[number % _BINS] += (float(np.minimum(nis, _HUGE).sum()), float(dof.sum()), len(nis))

    def _judge(self, ratio: float, low: float, high: float, samples: int) -> State:
        """Say what this moment alone looks like."""
        if samples < self.config.min_samples:
            return "unknown"
        return "over-confident" if ratio > high else "under-confident" if ratio < low else "consistent"

    def _settle(self, stamp_ns: int, verdict: State) -> State:
        """Follow the verdict once it has lasted."""
        if self._since_ns is None or verdict != self._verdict:
            self._verdict, self._since_ns = verdict, stamp_ns
        wait = self.config.enter_after if verdict in ("over-confident", "under-confident") else self.config.leave_after
        if self._state == "unknown" and verdict == "consistent":
            wait = 0.0  # good news about what nothing was known of needs no delay
        if stamp_ns - self._since_ns >= round(wait * _SECOND):
            self._state = verdict
        return self._state


def _check(nis: Float64Array, dof: NDArray[np.integer]) -> None:
    require_shape("nis", nis, (None,))
    require_shape("dof", dof, (len(nis),))
    require_finite("nis", nis)
    if len(nis) and nis.min() < 0:
        raise DataError(f"nis has {nis.min():g}; it is a square and cannot be negative")
    if len(dof) and dof.min() < 1:
        raise DataError(f"dof has {dof.min()}; a measurement has at least one component")


def nees(error: Float64Array, covariance: Float64Array) -> Float64Array:
    """Normalised estimation error squared, ``e^T P^-1 e``; chi-square of n_states degrees of freedom for a consistent filter.

    Parameters
    ----------
    error : ndarray of float64, shape (..., n_states)
        Estimate minus truth.
    covariance : ndarray of float64, shape (..., n_states, n_states)
        What the filter believes its covariance to be.

    Returns
    -------
    ndarray of float64, shape (...)
        Not negative but for rounding.

    Raises
    ------
    DataError
        When shapes disagree or a value is not finite.
    SingularError
        When a covariance is not positive definite or too close to singular.
    """
    if error.ndim < 1 or covariance.shape != (*error.shape, error.shape[-1]):
        raise DataError(f"error has shape {error.shape} but covariance {covariance.shape}; expected (..., n) and (..., n, n)")
    require_finite("error", error)
    require_finite("covariance", covariance)
    return np.asarray(np.einsum("...i,...i->...", error, solve_spd(covariance, error[..., None])[..., 0]))
