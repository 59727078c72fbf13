"""Phase noise of the oscillator, with range correlation.

The mixer multiplies an echo, delayed by tau, with what the oscillator gives meanwhile. Of the oscillator's phase noise phi it keeps
phi(t) - phi(t - tau), whose spectrum is that of phi times 4 sin^2(pi f tau) (Budge and Burt, *Range correlation effects in radars*, 1993).
Tau is far shorter than the time between samples, so that is tau phi'(t) to within 0.05 dB, and a cube s of small phase noises becomes

    s(t) + j phi'(t) sum_k tau_k s_k(t),

where s_k is echo k. The sum is linear in s, and all it takes is each echo's delay, which is its beat frequency over the slope.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT, ConfigError, Waveform
from radar_sim.effects.base import Moment, Setting, Signal, require_fmcw
from radar_sim.effects.config import PhaseNoiseConfig
from radar_sim.scatterers import Echoes, Float64Array

_BLOCK = 64
"""Samples of a longer chirp that are looked at together; the middle half of each block is used."""
_NEAR = 0.005
"""Below this share of the range, echoes are expected to become no stronger."""


class PhaseNoise:
    """Give every echo, and coupling, the noise skirt that its delay leaves of the oscillator's.

    The oscillator's noise is Gaussian, continuous over the frame from chirp to chirp, and new in each frame. Offsets of more than half the
    sample rate are left out; a skirt that ends beyond the band comes back in at its other end. What the high-pass filter took from
    coupling it takes from its skirt too, though the skirt lies at frequencies that the filter lets pass.

    Raises
    ------
    ConfigError
        When the radar does not sweep, or the noise is too strong to be small against a turn.
    """

    def __init__(self, config: PhaseNoiseConfig, setting: Setting) -> None:
        require_fmcw(
            "phase_noise", setting, "without a sweep samples do not tell delays apart, and what noise is left depends on the delay"
        )
        self._waveform = w = setting.info.waveform
        self._rate = _rate_rms(config, w)
        residual = 2 * w.max_range / SPEED_OF_LIGHT * self._rate
        if residual > 1.0:
            raise ConfigError(
                f"effects.phase_noise leaves {residual:.2g} rad rms on an echo at the largest range, {w.max_range:.3g} m; the model is for "
                "small phases: lower its level",
                key=("effects", "phase_noise", "level"),
            )
        starts = _starts(w)
        self._n = int(scipy.fft.next_fast_len(int(starts[-1, -1]) + w.n_sample, real=True))
        self._index = (starts.T[:, :, None] + np.arange(w.n_sample)).astype(np.intp)
        spectrum = rate_spectrum(config, np.arange(self._n // 2 + 1) / (self._n * w.chirp_duration / w.n_sample))
        self._weight = np.sqrt(spectrum * (self._n * w.n_sample / w.chirp_duration / 2)).astype(np.float32)
        self._delay = DelayWeight(w)

    def process(self, signal: Signal, moment: Moment) -> None:
        """Add the noise skirts."""
        rate = self._draw(moment.rng("phase_noise"))
        skirt = self._delay.process(signal.cube)
        skirt *= 1j * rate[self._index][:, :, None, :]
        signal.cube += skirt

    def size(self, echoes: Echoes) -> str:
        """Level of skirts as they stand in one cell of range and Doppler."""
        if not len(echoes):
            return "no echoes"
        w, far = self._waveform, float(echoes.range.max())
        residual = 2 * far / SPEED_OF_LIGHT * self._rate / math.sqrt(w.n_sample * w.n_chirp)
        below = -20 * math.log10(max(residual, 1e-30))
        return f"skirt {below:.0f} dB below the farthest echo ({far:.2f} m) after integration over samples and chirps"

    def _draw(self, rng: np.random.Generator) -> NDArray[np.float32]:
        """Rate of the phase over the frame, at the rate of the samples, shape (n,) [rad/s]."""
        spectrum = rng.standard_normal((len(self._weight), 2), np.float32).view(np.complex64)[:, 0]
        spectrum *= self._weight
        return np.asarray(scipy.fft.irfft(spectrum, self._n, overwrite_x=True), np.float32)


class DelayWeight:
    """Weight each echo in a cube by its delay, without knowing the echoes: sum_k s_k becomes sum_k tau_k s_k.

    Weighting the bins of a transform by their delay is no way: an echo between two bins leaks into all, and what leaks from near echoes
    into far bins would count for more than the echo. This is the linear map with the least mean square error for echoes anywhere in
    range whose power falls as R^-4. With 64 samples or more the skirt is right to 0.1 dB over the nearer 70 % of the range and 0.5 dB at
    90 %; in the last 3 % it is lost, because there samples cannot tell far from near.
    """

    def __init__(self, waveform: Waveform) -> None:
        n = waveform.n_sample
        whole = n <= 2 * _BLOCK
        scale = n / (waveform.chirp_duration * waveform.slope)  # a beat of the sample rate has this delay
        self._map = np.ascontiguousarray(scale * frequency_map(n if whole else _BLOCK).T).astype(np.complex64)
        self._n = n
        edge = _BLOCK // 4
        # Of each block, from where and to where its results are used: what lies within, and at both ends of the chirp all of it.
        starts = [0] if whole else [*range(0, n - _BLOCK, _BLOCK // 2), n - _BLOCK]
        self._blocks = [(s, s + edge if s else 0, s + _BLOCK - edge) for s in starts]

    def process(self, cube: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Weight, shape (..., sample); times seconds."""
        if len(self._blocks) == 1:
            return np.asarray(cube @ self._map, np.complex64)
        result = np.empty_like(cube)
        for k, (start, first, last) in enumerate(self._blocks):
            end = self._n if k == len(self._blocks) - 1 else last
            np.matmul(cube[..., start : start + _BLOCK], self._map[:, first - start : end - start], out=result[..., first:end])
        return result


def frequency_map(n: int) -> NDArray[np.complex128]:
    """Linear map of n samples that multiplies tones by their frequency, in least mean squares.

    For tones of frequency f and power p(f) = (|f| + near)^-4, that is G R^-1 with R = sum p e e^H, G = sum f p e e^H; shape (n, n).
    Frequencies count as shares of the sample rate, from 0 to 1.
    """
    per_bin = 16
    low = np.linspace(-0.8 * _NEAR, 0.1, 2000, endpoint=False)  # a little below 0, where approaching echoes near the radar may beat
    f = np.concatenate([low, np.linspace(0.1, 1.0, max(2000, per_bin * n))])
    p = np.gradient(f) / (np.abs(f) + _NEAR) ** 4
    # Both are Toeplitz: one row each of lags.
    lags = np.exp(2j * math.pi * np.outer(np.arange(n), f))
    index = np.arange(n)[:, None] - np.arange(n)
    correlation, product = (np.where(index >= 0, row[abs(index)], row[abs(index)].conj()) for row in (lags @ p, lags @ (f * p)))
    correlation += 1e-9 * correlation[0, 0].real * np.eye(n)
    return np.asarray(np.linalg.solve(correlation.T, product.T).T, np.complex128)


def level(config: PhaseNoiseConfig, offset: Float64Array) -> Float64Array:
    """Single-sideband level L at offsets from the carrier, shape (...) [1/Hz relative to the carrier]."""
    away = np.maximum(np.maximum(np.abs(offset), config.corner), 1e-3)
    return np.asarray(np.maximum(10 ** (config.level / 10) * (config.offset / away) ** 2, 10 ** (config.floor / 10)), np.float64)


def rate_spectrum(config: PhaseNoiseConfig, offset: Float64Array) -> Float64Array:
    """Two-sided power spectral density of the phase's rate, (2 pi f)^2 L(f), shape (...) [rad^2/s^2/Hz]."""
    return np.asarray((2 * math.pi * offset) ** 2 * level(config, offset), np.float64)


def _rate_rms(config: PhaseNoiseConfig, w: Waveform) -> float:
    """Rms of the phase's rate within the receiver's band [rad/s]."""
    half = w.n_sample / w.chirp_duration / 2
    offset = (np.arange(4096) + 0.5) / 4096 * half
    return math.sqrt(2 * half * float(rate_spectrum(config, offset).mean()))


def _starts(w: Waveform) -> NDArray[np.int64]:
    """First sample of each chirp on the frame's time axis, shape (n_chirp, n_tx).

    Chirps begin on whole samples, and pauses of more than four chirps are cut: phase noise has then long forgotten what it was.
    """
    rate = w.n_sample / w.chirp_duration
    interval = w.chirp_duration + min(w.chirp_pause, 4 * w.chirp_duration)
    order = np.arange(w.n_chirp)[:, None] * w.n_tx + np.arange(w.n_tx)
    return np.asarray(np.rint(order * (interval * rate)), np.int64)
