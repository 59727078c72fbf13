"""Range rates beyond the unambiguous ones, by which of their hypotheses the array's phases fit (thesis, figure A.17)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError, RadarInfo
from radar_core.checks import require_finite, require_shape
from radar_core.linalg import solve_spd
from radar_dsp.bounds import measurable

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex64]
_GRID = (17, 5)
"""Points of the search over u_y and u_z: half a beam of the widest array that a field of view leaves unambiguous at eight channels."""
_POLISH = 2  # Gauss-Newton steps from the best point of the grid


@dataclass(frozen=True, eq=False)
class Unfolded:
    """Range rates and motion-compensated snapshots.

    Attributes
    ----------
    speed, fold : ndarray of float64, of int64, shape (n_points,)
        Range rate [m/s], within n_tx times the unambiguous ones; how often 2 max_speed was added to the folded one.
    snapshot : ndarray of complex64, shape (n_points, n_channel)
        Spectrum of the virtual channels with the turn between transmitters taken out.
    confidence : ndarray of float64, shape (n_points,)
        Log-likelihood of the hypothesis taken over the best other one; negative where 0 was kept against a slightly better fit.
    ambiguous : ndarray of bool, shape (n_points,)
        The array cannot tell: the two best hypotheses fit about equally.
    """

    speed: FloatArray
    fold: NDArray[np.int64]
    snapshot: ComplexArray
    confidence: FloatArray
    ambiguous: NDArray[np.bool_]


class Unfolder:
    """Test of the hypotheses v + 2 k max_speed: each turns the transmitters' channels differently, and only the true one fits a plane wave.

    With n_tx transmitters in turn, k and k + n_tx turn them alike; of those the slowest is meant. A wrong hypothesis shifts the echo
    between the transmitters by 2 pi / n_tx, which no direction explains where the array is more than one receiver repeated: `kept_power`
    says how much of the echo's power such a fit keeps. The likelihood ratio takes the larger of the known noise and what the best fit
    leaves over, so that two echoes in one cell, which no single plane wave fits, do not pass for one fast echo.

    Parameters
    ----------
    info : RadarInfo
        The radar, calibration included.
    threshold : float
        Log-likelihood that another hypothesis has to gain over the folded range rate to be taken; a `ConfigError` says that it is negative.
    """

    def __init__(self, info: RadarInfo, threshold: float = 10.0) -> None:
        if not threshold >= 0.0:
            raise ConfigError(f"the threshold of the unfolding is {threshold}; it must be at least 0 (log-likelihood)")
        array, w = info.array, info.waveform
        self.info, self.threshold = info, threshold
        which = measurable(info, "auto")[2:]
        phase = -2 * math.pi / w.wavelength * array.virtual[:, list(which)]
        weight = np.abs(array.response) ** 2
        self._response = np.asarray(array.response / np.sqrt(weight.sum()))
        self._phase = phase - weight @ phase / weight.sum()
        gradient = (weight[:, None] / weight.sum() * self._phase).T @ self._phase
        self._information = solve_spd(gradient, np.eye(len(gradient))) if len(gradient) else gradient
        self._grid = _grid(info, which)
        self._step = 0.25 * w.wavelength / np.maximum(np.ptp(array.virtual[:, list(which)], axis=0), w.wavelength / 2)
        self._conjugate = np.ascontiguousarray(self._steering(self._grid).conj().T.astype(np.complex64))
        self._dof = max(len(phase) - 1 - sum(which), 1)

    def process(self, snapshot: ComplexArray, speed: NDArray[Any], snr: NDArray[Any]) -> Unfolded:
        """Choose a range rate for every detection and compensate its snapshot with it.

        Parameters
        ----------
        snapshot : ndarray of complex64, shape (n_points, n_tx, n_rx)
            Spectrum of the channels at each detection as it came out of the transforms, not motion compensated.
        speed, snr : ndarray, shape (n_points,)
            Folded range rate [m/s]; where it is NaN, nothing is compensated. Signal-to-noise power ratio of the cell, mean of the channels.

        Returns
        -------
        Unfolded
            A range estimated with the folded range rate has to move by ``-2 fold max_speed (carrier / slope - chirp_pause / 2)``: the
            Doppler shift within a chirp is that of the true one.

        Raises
        ------
        DataError
            When the shapes disagree, a snapshot is not finite, or a range rate or ratio is infinite.
        """
        array, w = self.info.array, self.info.waveform
        n = len(snapshot)
        require_shape("snapshot", snapshot, (None, array.n_tx, array.n_rx))
        require_shape("speed", speed, (n,))
        require_shape("snr", snr, (n,))
        require_finite("snapshot", snapshot)
        if np.isinf(speed).any() or np.isinf(snr).any():
            raise DataError("speed or snr holds an infinity; NaN is the mark for what was not measured")
        folded = np.asarray(speed, np.float64)
        tx = np.arange(w.n_tx)
        turn = -4 * math.pi * w.chirp_interval / w.wavelength * np.nan_to_num(folded)
        hypotheses = turn[:, None] - 2 * math.pi / w.n_tx * tx  # (n_points, n_tx): what a turn means under each
        compensation = np.exp(1j * hypotheses[:, :, None] * tx).astype(np.complex64)
        candidates = (snapshot[:, None] * compensation[..., None]).reshape(n, w.n_tx, array.n_tx * array.n_rx)
        likelihood = self._likelihood(candidates, np.asarray(snr, np.float64))
        likelihood[~np.isfinite(folded), 1:] = -np.inf
        chosen, confidence = self._choose(likelihood)
        # The hypothesis stands for its slowest range rate: k modulo n_tx, nearest to what cancels the folded one.
        period = 2 * w.max_speed
        fold = chosen - w.n_tx * np.round((np.nan_to_num(folded) / period + chosen) / w.n_tx).astype(np.int64)
        fold = np.where(np.isfinite(folded) & (chosen > 0), fold, 0)
        return Unfolded(folded + fold * period, fold, candidates[np.arange(n), chosen], confidence, np.abs(confidence) < self.threshold)

    def kept_power(self, azimuth: NDArray[Any], elevation: NDArray[Any]) -> FloatArray:
        """Compute the part of an echo's power that a plane wave still explains under the best wrong hypothesis, shape (n_points,).

        ``azimuth`` and ``elevation`` (n_points,) are true directions [rad]. At 1 the hypotheses cannot be told apart from there; it is 0
        with one transmitter, where there are none.
        """
        w, array = self.info.waveform, self.info.array
        tx = np.arange(w.n_tx)
        snapshot = array.steering(azimuth, elevation, w.wavelength).reshape(-1, 1, array.n_tx, array.n_rx)
        wrong = snapshot * np.exp(-2j * np.pi / w.n_tx * np.outer(tx[1:], tx))[None, :, :, None]
        power = self._power(wrong.reshape(len(snapshot), w.n_tx - 1, array.n_tx * array.n_rx).astype(np.complex64))
        return np.asarray(power.max(axis=1, initial=0.0) / np.sum(np.abs(snapshot) ** 2, axis=(1, 2, 3)))

    def _steering(self, u: FloatArray) -> NDArray[np.complex128]:
        """Steering vectors of unit norm, shape (..., n_channel)."""
        return np.asarray(self._response * np.exp(1j * (u @ self._phase.T)))

    def _power(self, snapshots: ComplexArray) -> FloatArray:
        """Power of the best plane wave in each snapshot, shape (n_points, n_hypotheses): grid, then Gauss-Newton."""
        flat = snapshots.reshape(-1, snapshots.shape[-1])
        if not len(flat):
            return np.zeros(snapshots.shape[:-1])
        beam = flat @ self._conjugate
        power = beam.real**2 + beam.imag**2
        best = np.argmax(power, axis=1)
        highest = power[np.arange(len(flat)), best].astype(np.float64)
        u = self._grid[best]
        for _ in range(_POLISH if u.shape[1] else 0):
            matched = flat * self._steering(u).conj()
            level = matched.sum(axis=1)
            highest = np.maximum(highest, np.abs(level) ** 2)
            strength = np.maximum(np.abs(level) ** 2, np.finfo(np.float64).tiny)
            slope = (level.conj()[:, None] * (matched @ self._phase)).imag / strength[:, None]
            u = u + np.clip(slope @ self._information, -self._step, self._step)
        final = np.abs((flat * self._steering(u).conj()).sum(axis=1)) ** 2
        return np.asarray(np.maximum(highest, final).reshape(snapshots.shape[:-1]))

    def _likelihood(self, candidates: ComplexArray, snr: FloatArray) -> FloatArray:
        """Log-likelihood of every hypothesis up to a constant, shape (n_points, n_tx)."""
        peak = np.max(np.abs(candidates), axis=(1, 2), initial=0.0)
        unit = (candidates / np.where(peak > 0, peak, 1.0)[:, None, None]).astype(np.complex64)
        power = self._power(unit)
        energy = np.sum(np.abs(unit[:, 0]).astype(np.float64) ** 2, axis=1)
        noise = energy / (candidates.shape[2] * (1 + np.maximum(np.nan_to_num(snr), 0.0)))
        left = np.maximum(energy - power.max(axis=1), 0.0) / self._dof
        scale = np.maximum(np.maximum(noise, left), 1e-12)
        return np.asarray(power / scale[:, None])

    def _choose(self, likelihood: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
        """Pick a hypothesis per point, and its log-likelihood over the best other."""
        n, m = likelihood.shape
        if m == 1:
            return np.zeros(n, np.int64), np.zeros(n)
        best = np.argmax(likelihood, axis=1)
        row = np.arange(n)
        chosen = np.where(likelihood[row, best] - likelihood[:, 0] > self.threshold, best, 0)
        others = likelihood.copy()
        others[row, chosen] = -np.inf
        runner_up = others.max(axis=1)
        taken = likelihood[row, chosen]
        return chosen, np.where(np.isfinite(runner_up), taken - np.where(np.isfinite(runner_up), runner_up, 0.0), 0.0)


def _grid(info: RadarInfo, which: tuple[bool, ...]) -> FloatArray:
    """Direction cosines of the search over what the array measures, shape (n_grid, n_axes)."""
    sides = []
    for half, points in zip((info.array.fov_azimuth / 2, info.array.fov_elevation / 2), _GRID, strict=True):
        # A little beyond the field of view: an echo from outside has to fit too, not to be unfolded.
        edge = min(1.0, math.sin(min(half, math.pi / 2)) + 0.1)
        sides.append(np.linspace(-edge, edge, points))
    sides = [side for side, wanted in zip(sides, which, strict=True) if wanted]
    if not sides:
        return np.zeros((1, 0))
    return np.stack([m.ravel() for m in np.meshgrid(*sides, indexing="ij")], axis=1)
