"""Echoes behind other waveforms than FMCW: a tone (CW) and OFDM, with TDM (thesis, figure A.14).

Both follow every echo along its true path from chirp to chirp, whatever a scene says of physics and fidelity, and let it move evenly within
one. As everywhere, the phase of an echo is the conjugate of the physical one: +2 pi f tau, so that a receding target turns forward.

* cw: a sample at time T has the phase 2 pi carrier tau(T).
* ofdm: carrier k of `Waveform.n_sample` has the frequency ``f_min + k / chirp_duration`` with ``f_min = carrier - bandwidth / 2``. A
  symbol sends a known QPSK value on every carrier (`known_symbols`). It comes back turned by 2 pi f_k tau, with tau of the symbol's
  middle, and the whole turns on with the carrier's Doppler frequency during the symbol, which is what makes carriers interfere with each
  other. The carriers' Doppler frequencies differ by up to bandwidth / carrier of that, which is left out: 2e-6 turns in 43 ns at
  10 m/s and 1.5 GHz. The receiver conjugates: samples hold the conjugate symbols, carrier k at the frequency -k. The cyclic prefix is
  longer than any delay, and is taken off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT, Waveform, known_symbols
from radar_sim.propagation.base import NEAR, Float64Array, Physics, Sampling
from radar_sim.propagation.exact import Exact
from radar_sim.propagation.kernels import chunks, times
from radar_sim.propagation.reference import Leg
from radar_sim.scatterers import Echoes

_VALUES = 1 << 19
"""Samples of echoes that are held at once."""


class Tone:
    """Echoes of a continuous wave: those of a sweep that does not sweep.

    Parameters
    ----------
    sampling : Sampling
        When and where samples are taken.
    """

    def __init__(self, sampling: Sampling) -> None:
        self._model = Exact(Physics.all(), sampling)

    def process(self, echoes: Echoes, late: Float64Array | None = None) -> NDArray[np.complex64]:
        """Superpose echoes, as `radar_sim.propagation.base.Propagator.process`."""
        return self._model.process(echoes, late)


class Ofdm:
    """Echoes of OFDM symbols, as samples of each symbol without its cyclic prefix; an echo's mean power is that of an FMCW echo.

    Parameters
    ----------
    sampling : Sampling
        When and where samples are taken.
    """

    def __init__(self, sampling: Sampling) -> None:
        self._sampling, self._since, self._fast = sampling, sampling.since, sampling.fast
        self._frequencies = frequencies(sampling.info.waveform)
        self._symbols = known_symbols(sampling.info.waveform).conj().transpose(1, 0, 2)[:, :, None, :]

    def process(self, echoes: Echoes, late: Float64Array | None = None) -> NDArray[np.complex64]:
        """Superpose echoes, as `radar_sim.propagation.base.Propagator.process`; shape (tx, chirp = symbol, rx, sample)."""
        w = self._sampling.info.waveform
        middle = times(self._since, late)[None, :, :, None, None]
        total = np.zeros((w.n_chirp, w.n_tx, len(self._sampling.rx), w.n_sample), np.complex128)
        for part in chunks(len(echoes), max(_VALUES // total.size, 1)):
            total += self._samples(echoes.select(np.arange(part.start, part.stop)), middle).sum(0)
        return np.ascontiguousarray(total.transpose(1, 0, 2, 3)).astype(np.complex64)

    def _samples(self, echoes: Echoes, middle: Float64Array) -> NDArray[np.complex128]:
        """Compute samples of single echoes, shape (n, chirp, tx, rx, sample)."""
        w = self._sampling.info.waveform
        out, back = Leg(echoes.out, curved=True), Leg(echoes.back, curved=True)
        half = w.chirp_duration / 2
        delay = self._delay(out, back, middle)
        doppler = w.carrier * (self._delay(out, back, middle + half) - self._delay(out, back, middle - half)) / w.chirp_duration
        carriers = np.fft.fft(self._symbols * _phasor(delay * self._frequencies), norm="ortho") * _phasor(doppler * self._fast)
        amplitude = echoes.strength[:, None, None, None, None] / (
            np.maximum(out.length(middle), NEAR) * np.maximum(back.length(middle), NEAR)
        )
        if echoes.envelope is not None:
            amplitude = amplitude * echoes.envelope.transpose(2, 0, 1)[..., None, None]
        return np.asarray(amplitude * carriers)

    def _delay(self, out: Leg, back: Leg, time: Float64Array) -> Float64Array:
        """Delay of every channel, shape (n, chirp, tx, rx, 1) [s]."""
        there = out.length(time) + out.nearer(self._sampling.tx[None, None, :, None, None, :], time, sphere=True)
        again = back.length(time) + back.nearer(self._sampling.rx[None, None, None, :, None, :], time, sphere=True)
        return np.asarray((there + again) / SPEED_OF_LIGHT)


def frequencies(waveform: Waveform) -> Float64Array:
    """Frequencies of OFDM's carriers, shape (n_sample,) [Hz]."""
    return np.asarray(waveform.carrier - waveform.bandwidth / 2 + np.arange(waveform.n_sample) / waveform.chirp_duration, np.float64)


def _phasor(turns: Float64Array) -> NDArray[np.complex128]:
    return np.asarray(np.exp(2j * np.pi * (turns - np.rint(turns))))
