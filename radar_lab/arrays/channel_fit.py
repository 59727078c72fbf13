"""Least squares behind `radar_lab.arrays.calibration`: gain, phase and shift of channels from one reflector in known directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radar_core import DataError
from radar_core.types import Complex128Array, Float64Array, IndexArray

_STEPS = 50
_UNSEEN = 1e-4
"""A mounting offset is not seen when less than this of its effect is left once phases and shifts are fitted."""


@dataclass(frozen=True, eq=False)
class Channels:
    """Parameters of the live channels."""

    # gain, phase: factor of the amplitude, and phase, shape (n_channel,) [rad]
    gain: Float64Array
    phase: Float64Array
    shift: Float64Array  # along y and z, shape (n_channel, 2) [m]
    offset: Float64Array  # true minus stated (azimuth, elevation) of each sweep, shape (n_sweep, 2) [rad]


@dataclass(frozen=True, eq=False)
class Residual:
    """What a set of parameters leaves."""

    phase: Float64Array  # of measurement over model, shape (n_snapshot, n_channel) [rad]
    level: Float64Array  # of measurement over model, shape (n_snapshot, n_channel) [dB]
    power: Float64Array  # fitted power of each snapshot, shape (n_snapshot,)

    def rms(self, gain: Float64Array) -> float:
        """Weighted rms phase [rad]: noise is the same everywhere, so strong entries know their phase better."""
        weight = self.power[:, None] * gain**2
        return float(np.sqrt((weight * self.phase**2).sum() / weight.sum()))

    def structure(self, sweep: IndexArray) -> float:
        """Correlate the phases of consecutive snapshots of a sweep: near 0 for noise, near 1 for what the model lacks."""
        together = sweep[1:] == sweep[:-1]
        energy = float((self.phase**2).mean())
        product = (self.phase[1:] * self.phase[:-1])[together]
        return float(product.mean()) / energy if product.size and energy > 0 else 0.0


class ChannelFit:
    """The problem that one recording poses.

    With weights that are a product of a snapshot's power and a channel's, least squares falls apart: the weighted mean over the channels,
    taken out of the residual phases, removes the snapshots' unknown phases; what is left is one regression per channel on (1, -k u), with
    the same matrix for all. Phases are residuals against the last parameters, so nothing is unwrapped.

    Parameters
    ----------
    wavenumber : float
        2 pi / wavelength [rad/m].
    positions : ndarray, shape (n_channel, 2)
        Nominal (y, z) of the live channels [m].
    angles : ndarray, shape (n_snapshot, 2)
        Stated (azimuth, elevation) [rad].
    sweep : ndarray of int, shape (n_snapshot,)
        Index of the sweep, from 0.
    values : ndarray of complex128, shape (n_snapshot, n_channel)
        Snapshots of the live channels, as of plane waves.
    observed : tuple of (bool, bool)
        Fit shifts along y and along z.
    """

    def __init__(
        self,
        wavenumber: float,
        positions: Float64Array,
        angles: Float64Array,
        sweep: IndexArray,
        values: Complex128Array,
        observed: tuple[bool, bool],
    ) -> None:
        self.k, self.positions, self.angles, self.sweep, self.values = wavenumber, positions, angles, sweep, values
        self.axes = np.flatnonzero(observed)
        self.n_sweep = int(sweep.max()) + 1

    def cosines(self, offset: Float64Array) -> Float64Array:
        """Direction cosines (n_snapshot, 2) with mounting offsets (n_sweep, 2)."""
        azimuth, elevation = (self.angles + offset[self.sweep]).T
        return np.stack([np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1)

    def _ideal(self, channels: Channels) -> Complex128Array:
        """Model without gains, of unit modulus, shape (n_snapshot, n_channel)."""
        path = self.cosines(channels.offset) @ (self.positions + channels.shift).T
        return np.asarray(np.exp(1j * (channels.phase - self.k * path)))

    def residual(self, channels: Channels) -> Residual:
        """Compare the snapshots with the model; amplitude and phase of each snapshot are fitted on the way."""
        model = self._ideal(channels) * channels.gain
        source = (self.values * model.conj()).sum(axis=1) / (channels.gain**2).sum()
        fitted = source[:, None] * model
        ratio = self.values * fitted.conj()
        level = 20 * np.log10(np.maximum(np.abs(self.values), 1e-30) / np.maximum(np.abs(fitted), 1e-30))
        return Residual(np.angle(ratio), level, np.abs(source) ** 2)

    def solve(self, max_shift: float, offsets: bool) -> Channels:
        """Find the best parameters: mean gain [dB] 0, mean shift 0, phase of the mean phasor 0.

        The first fit is looked for on a grid of shifts up to ``max_shift`` [m]; with ``offsets`` the sweeps' mounting offsets are fitted
        too, and `DataError` is raised when they cannot be told from each other.
        """
        channels = self._start(max_shift)
        for _ in range(_STEPS):
            updated = self._step(channels, offsets)
            moved = max(
                float(np.abs(updated.shift - channels.shift).max() * self.k),
                float(np.abs(updated.phase - channels.phase).max()),
                float(np.abs(np.log(updated.gain / channels.gain)).max()),
                float(np.abs(updated.offset - channels.offset).max()),
            )
            channels = updated
            if moved < 1e-11:
                break
        mean = np.angle(np.exp(1j * channels.phase).mean())
        return Channels(
            channels.gain / np.exp(np.log(channels.gain).mean()),
            np.angle(np.exp(1j * (channels.phase - mean))),
            channels.shift - channels.shift.mean(axis=0),
            channels.offset,
        )

    def _start(self, max_shift: float) -> Channels:
        """Best shift of a grid per channel against the strongest one: a maximum of a periodogram, which no phase error can mislead."""
        n = len(self.positions)
        offset = np.zeros((self.n_sweep, 2))
        power = (np.abs(self.values) ** 2).sum(axis=0)
        u = self.cosines(offset)
        flat = self.values * np.exp(1j * self.k * u @ self.positions.T)
        against = flat * flat[:, [int(np.argmax(power))]].conj()
        # A quarter radian between points at the widest angles: far inside of the main lobe.
        count = 2 * int(np.ceil(max_shift * self.k / 0.5)) + 1
        line = np.linspace(-max_shift, max_shift, count)
        lines = [line if axis in self.axes else np.zeros(1) for axis in range(2)]
        grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
        score = against.T @ np.exp(1j * self.k * u @ grid.T)
        best = np.abs(score).argmax(axis=1)
        return Channels(np.sqrt(power / power.mean()), np.angle(score[np.arange(n), best]), grid[best], offset)

    def _regressors(self, u: Float64Array, power: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Columns (1, -k u) of what is fitted, (n_snapshot, n_par), and the weighted pseudo-inverse (n_par, n_snapshot)."""
        columns = np.column_stack([np.ones(len(u)), -self.k * u[:, self.axes]])
        root = np.sqrt(power)
        scale = np.linalg.norm(root[:, None] * columns, axis=0)
        inverse = np.linalg.pinv(root[:, None] * columns / scale) * root / scale[:, None]
        return columns, inverse

    def _step(self, channels: Channels, offsets: bool) -> Channels:
        """One step of Gauss and Newton on the phases, and of the gains given the phases."""
        left = self.residual(channels)
        _, inverse = self._regressors(self.cosines(channels.offset), left.power)
        phase = self._centred(left.phase, channels.gain)
        move = np.zeros((self.n_sweep, 2))
        if offsets:
            move, effect, _ = self._offset_step(channels, left, phase)
            phase = phase - effect
        change = inverse @ phase
        shift = channels.shift.copy()
        shift[:, self.axes] += change[1:].T
        # Entries add up in phase: unlike a mean of logarithms this is not biased where a channel is weak.
        weighted = left.power[:, None] * 10 ** (left.level / 20) * np.cos(left.phase)
        gain = channels.gain * np.maximum(weighted.sum(axis=0) / left.power.sum(), 1e-6)
        return Channels(gain / np.sqrt((gain**2).mean()), channels.phase + change[0], shift, channels.offset + move)

    @staticmethod
    def _centred(phase: Float64Array, gain: Float64Array) -> Float64Array:
        """Take the weighted mean over the channels (axis 1) out: the unknown phase of each snapshot."""
        weight = gain**2 / (gain**2).sum()
        return np.asarray(phase - np.tensordot(phase, weight, axes=(1, 0))[:, None])

    def _offset_effects(self, channels: Channels, left: Residual) -> tuple[Float64Array, Float64Array, list[tuple[int, int]]]:
        """Effect of each offset on the phases, (n_snapshot, n_channel, n_offset), the part only it explains, and which they are."""
        azimuth, elevation = (self.angles + channels.offset[self.sweep]).T
        slope = np.zeros((2, len(azimuth), 2))
        slope[0, :, 0] = np.cos(elevation) * np.cos(azimuth)
        slope[1] = np.stack([-np.sin(elevation) * np.sin(azimuth), np.cos(elevation)], axis=-1)
        columns, inverse = self._regressors(self.cosines(channels.offset), left.power)
        effects, alone, names = [], [], []
        for sweep in range(self.n_sweep):
            for angle in range(2):
                raw = -self.k * (slope[angle] @ (self.positions + channels.shift).T) * (self.sweep == sweep)[:, None]
                centred = self._centred(raw, channels.gain)
                rest = centred - columns @ (inverse @ centred)
                if np.linalg.norm(rest) > _UNSEEN * np.linalg.norm(raw):
                    effects.append(centred)
                    alone.append(rest)
                    names.append((sweep, angle))
        if not names:
            empty = np.zeros((*left.phase.shape, 0))
            return empty, empty, names
        return np.stack(effects, axis=-1), np.stack(alone, axis=-1), names

    def _offset_step(self, channels: Channels, left: Residual, phase: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Change of the offsets (n_sweep, 2), its effect on the phases, and its variances (n_sweep, 2) in units of the noise."""
        effects, alone, names = self._offset_effects(channels, left)
        move, variance = np.zeros((self.n_sweep, 2)), np.full((self.n_sweep, 2), np.nan)
        if not names:
            return move, np.zeros_like(phase), variance
        root = np.sqrt(left.power[:, None] * channels.gain**2)
        matrix = (root[..., None] * alone).reshape(-1, len(names))
        scale = np.linalg.norm(matrix, axis=0)
        if np.linalg.cond(matrix / scale) > 1e6:
            raise DataError("the mounting offsets of these sweeps cannot be told from each other; calibrate without them")
        solution, *_ = np.linalg.lstsq(matrix / scale, (root * phase).ravel(), rcond=None)
        spread = np.diag(np.linalg.inv((matrix / scale).T @ (matrix / scale))) / scale**2
        for (sweep, angle), value, square in zip(names, solution / scale, spread, strict=True):
            move[sweep, angle], variance[sweep, angle] = value, square
        return move, effects @ (solution / scale), variance

    def condition(self, channels: Channels, left: Residual) -> float:
        """Condition number of the regression on (1, u) with unit columns."""
        columns, _ = self._regressors(self.cosines(channels.offset), left.power)
        weighted = np.sqrt(left.power)[:, None] * columns
        return float(np.linalg.cond(weighted / np.linalg.norm(weighted, axis=0)))

    def deviations(
        self, channels: Channels, left: Residual, offsets: bool
    ) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
        """Derive standard deviations from the residuals.

        Returns
        -------
        tuple of ndarray
            Of gain (n_channel,) [dB], phase (n_channel,) [rad], shift (n_channel, 2) [m] and offset (n_sweep, 2) [rad]; NaN: not fitted, or
            no measurement to spare.
        """
        m, n = left.phase.shape
        offset_variance = np.full((self.n_sweep, 2), np.nan)
        if offsets:
            offset_variance = self._offset_step(channels, left, self._centred(left.phase, channels.gain))[2]
        spare = m * (n - 1) - (n - 1) * (1 + len(self.axes)) - int(np.isfinite(offset_variance).sum())
        weight = channels.gain**2
        noise = float((left.power[:, None] * weight * left.phase**2).sum()) / spare if spare > 0 else np.nan
        _, inverse = self._regressors(self.cosines(channels.offset), left.power)
        covariance = (inverse / left.power) @ inverse.T
        per_channel = noise * (1 / weight - 1 / weight.sum())
        shift = np.full((n, 2), np.nan)
        shift[:, self.axes] = np.sqrt(np.outer(per_channel, np.diag(covariance)[1:]))
        gain = 20 / np.log(10) * np.sqrt(per_channel / left.power.sum())
        return gain, np.sqrt(per_channel * covariance[0, 0]), shift, np.sqrt(noise * offset_variance)
