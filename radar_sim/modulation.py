"""Echoes of moving scatterers behind other waveforms than FMCW: a tone (CW) and OFDM, with TDM (thesis, figure A.14).

Both models follow every scatterer along its true path from chirp to chirp, like `radar_sim.propagation.exact`, and let it move evenly
within one. As everywhere, the phase of an echo is the conjugate of the physical one: +2 pi f tau, so that a receding target turns forward.

* cw: a sample at time T has the phase 2 pi carrier tau(T).
* ofdm: carrier k of `Waveform.n_sample` has the frequency ``f_min + k / chirp_duration`` with ``f_min = carrier - bandwidth / 2``. A
  symbol sends a known QPSK value on every carrier (`known_symbols`). It comes back turned by 2 pi f_k tau, with tau of the symbol's
  middle, and the whole turns on with the carrier's Doppler frequency during the symbol, which is what makes carriers interfere with each
  other. The carriers' Doppler frequencies differ by up to bandwidth / carrier of that, which is left out: 2e-6 turns in 43 ns at
  10 m/s and 1.5 GHz. The receiver conjugates: samples hold the conjugate symbols, carrier k at the frequency -k. The cyclic prefix is
  longer than any delay, and is taken off.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT, RadarInfo, Waveform, known_symbols
from radar_sim.propagation import IMPEDANCE, Float64Array, Model, paths
from radar_sim.scene import Coupling


def tone(info: RadarInfo, positions: Float64Array, strengths: Float64Array) -> NDArray[np.complex64]:
    """Echoes of a continuous wave.

    Parameters
    ----------
    info : RadarInfo
        The radar.
    positions : ndarray, shape (2 n_tx n_chirp + 1, n, 3)
        In the sensor frame [m]: where every stretch of the tone begins, in its middle, and where the next one begins.
    strengths : ndarray, shape (n,)
        See `radar_sim.propagation.strength` [V m^2].

    Returns
    -------
    ndarray of complex64, shape (tx, chirp, rx, sample)
        Samples [V].
    """
    w = info.waveform
    cube = np.zeros((w.n_chirp, w.n_tx, info.array.n_rx, w.n_sample), np.complex128)
    t = np.arange(w.n_sample) / w.n_sample * w.chirp_duration
    for delay, drift, amplitude in paths(info, positions, strengths):
        cube += amplitude[..., None] * _phasor(w.carrier * (delay[..., None] + drift[..., None] * t))
    return _frame(cube)


def ofdm(info: RadarInfo, positions: Float64Array, strengths: Float64Array) -> NDArray[np.complex64]:
    """Echoes of OFDM symbols, as samples of each symbol without its cyclic prefix.

    Parameters
    ----------
    info, positions, strengths
        As for `tone`; an echo's mean power over a symbol is that of an FMCW echo.

    Returns
    -------
    ndarray of complex64, shape (tx, chirp = symbol, rx, sample)
        Samples [V].
    """
    w = info.waveform
    cube = np.zeros((w.n_chirp, w.n_tx, info.array.n_rx, w.n_sample), np.complex128)
    symbols = known_symbols(w).conj().transpose(1, 0, 2)[:, :, None, :]
    since_middle = (np.arange(w.n_sample) / w.n_sample - 0.5) * w.chirp_duration
    for delay, drift, amplitude in paths(info, positions, strengths):
        middle = delay + drift * w.chirp_duration / 2
        carriers = symbols * _phasor(middle[..., None] * _frequencies(w))
        doppler = _phasor(w.carrier * drift[..., None] * since_middle)
        cube += amplitude[..., None] * np.fft.fft(carriers, norm="ortho") * doppler
    return _frame(cube)


def ofdm_leakage(coupling: Coupling, info: RadarInfo) -> NDArray[np.complex64]:
    """Leakage from the transmitters into the receivers, shape (tx, symbol, 1, sample) [V]; it differs by symbol because the code does."""
    w = info.waveform
    power = 1e-3 * 10 ** ((info.array.tx_power + coupling.level) / 10)
    turned = known_symbols(w).conj() * _phasor(2 * coupling.distance / SPEED_OF_LIGHT * _frequencies(w))
    samples: NDArray[np.complex128] = math.sqrt(power * IMPEDANCE) * np.fft.fft(turned, norm="ortho")
    return samples[:, :, None, :].astype(np.complex64)


def _frequencies(waveform: Waveform) -> Float64Array:
    return waveform.carrier - waveform.bandwidth / 2 + np.arange(waveform.n_sample) / waveform.chirp_duration


def _phasor(turns: Float64Array) -> NDArray[np.complex128]:
    result: NDArray[np.complex128] = np.exp(2j * np.pi * (turns - np.rint(turns)))
    return result


def _frame(cube: NDArray[np.complex128]) -> NDArray[np.complex64]:
    return np.ascontiguousarray(cube.transpose(1, 0, 2, 3)).astype(np.complex64)


MODELS: Final[dict[str, Model]] = {"cw": tone, "ofdm": ofdm}
"""Of every modulation but FMCW, which has three."""
