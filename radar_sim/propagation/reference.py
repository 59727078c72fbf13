"""Models in float64: the truth that other models of FMCW are measured against, as `radar_sim.propagation.base` writes it down; and OFDM.

A tone (CW, `Exact` without a sweep) and OFDM (thesis, figure A.14) follow every echo along its true path from chirp to chirp, whatever a
scene says of physics and fidelity, and let it move evenly within one. As everywhere, the phase of an echo is the conjugate of the physical
one: +2 pi f tau, so that a receding target turns forward. A sample of a tone at time T has the phase 2 pi carrier tau(T).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT, Waveform, known_symbols
from radar_sim.propagation.base import NEAR, Float64Array, Physics, Sampling
from radar_sim.propagation.kernels import TINY, chunks, times
from radar_sim.scatterers import Echoes, Motion

_VALUES = 1 << 19
"""Samples of echoes that are held at once."""


class Reference:
    """Compute every sample of every echo on its own; with all physics the delay is that of every sample's own time and of its channel."""

    def __init__(self, physics: Physics, sampling: Sampling) -> None:
        self.physics, self.sampling = physics, sampling
        self._since, self._fast = sampling.since, sampling.fast

    def process(self, echoes: Echoes, late: Float64Array | None = None) -> NDArray[np.complex64]:
        """Superpose echoes, as `Propagator.process`."""
        return self.sums(echoes, late).astype(np.complex64)

    def sums(self, echoes: Echoes, late: Float64Array | None = None) -> NDArray[np.complex128]:
        """Superpose echoes without the last rounding; complex128, shape (tx, chirp, rx, sample) [V]."""

        def samples(some: Echoes) -> NDArray[np.complex128]:
            turns, amplitude = self.phases(some, late)
            return amplitude * _phasor(turns)

        return _superposed(samples, echoes, self.sampling)

    def phases(self, echoes: Echoes, late: Float64Array | None = None) -> tuple[Float64Array, NDArray[np.complex128]]:
        """Phases and amplitudes of single echoes.

        Returns
        -------
        tuple of ndarray
            Phases, broadcastable to (n, chirp, tx, rx, sample) [turns], and amplitudes (n, chirp, tx, 1, 1) [V].
        """
        w, physics = self.sampling.info.waveform, self.physics
        middle = times(self._since, late)[None, :, :, None, None]
        instant = middle + self._fast if physics.doppler_in_chirp else middle
        out, back = Leg(echoes.out, physics.curvature), Leg(echoes.back, physics.curvature)
        path = out.length(instant) + back.length(instant)
        beat = path if physics.range_migration else out.length(None) + back.length(None)
        bent = instant if physics.curvature else None
        side = out.nearer(self.sampling.tx[None, None, :, None, None, :], bent, physics.near_field)
        side = side + back.nearer(self.sampling.rx[None, None, None, :, None, :], bent, physics.near_field)
        delay = (beat + side if physics.squint else beat) / SPEED_OF_LIGHT
        turns = w.carrier * (path + side) / SPEED_OF_LIGHT + w.slope * delay * (self._fast - delay / 2)
        return turns, _amplitude(echoes, out, back, middle if physics.range_migration else None)


class Ofdm:
    """Echoes of OFDM symbols, as samples of each symbol without its cyclic prefix; an echo's mean power is that of an FMCW echo.

    Carrier k of `Waveform.n_sample` has the frequency ``f_min + k / chirp_duration`` with ``f_min = carrier - bandwidth / 2``. A symbol
    sends a known QPSK value on every carrier (`known_symbols`). It comes back turned by 2 pi f_k tau, with tau of the symbol's middle, and
    the whole turns on with the carrier's Doppler frequency during the symbol, which is what makes carriers interfere with each other. The
    carriers' Doppler frequencies differ by up to bandwidth / carrier of that, which is left out: 2e-6 turns in 43 ns at 10 m/s and 1.5 GHz.
    The receiver conjugates: samples hold the conjugate symbols, carrier k at the frequency -k. The cyclic prefix is longer than any delay,
    and is taken off.
    """

    def __init__(self, sampling: Sampling) -> None:
        self._sampling, self._since, self._fast = sampling, sampling.since, sampling.fast
        self._frequencies = frequencies(sampling.info.waveform)
        self._symbols = known_symbols(sampling.info.waveform).conj().transpose(1, 0, 2)[:, :, None, :]

    def process(self, echoes: Echoes, late: Float64Array | None = None) -> NDArray[np.complex64]:
        """Superpose echoes, as `Propagator.process`; shape (tx, chirp = symbol, rx, sample)."""
        middle = times(self._since, late)[None, :, :, None, None]
        return _superposed(lambda some: self._samples(some, middle), echoes, self._sampling).astype(np.complex64)

    def _samples(self, echoes: Echoes, middle: Float64Array) -> NDArray[np.complex128]:
        """Compute samples of single echoes, shape (n, chirp, tx, rx, sample)."""
        w = self._sampling.info.waveform
        out, back = Leg(echoes.out, curved=True), Leg(echoes.back, curved=True)
        half = w.chirp_duration / 2
        delay = self._delay(out, back, middle)
        doppler = w.carrier * (self._delay(out, back, middle + half) - self._delay(out, back, middle - half)) / w.chirp_duration
        carriers = np.fft.fft(self._symbols * _phasor(delay * self._frequencies), norm="ortho") * _phasor(doppler * self._fast)
        return np.asarray(_amplitude(echoes, out, back, middle) * carriers)

    def _delay(self, out: Leg, back: Leg, time: Float64Array) -> Float64Array:
        """Delay of every channel, shape (n, chirp, tx, rx, 1) [s]."""
        there = out.length(time) + out.nearer(self._sampling.tx[None, None, :, None, None, :], time, sphere=True)
        again = back.length(time) + back.nearer(self._sampling.rx[None, None, None, :, None, :], time, sphere=True)
        return np.asarray((there + again) / SPEED_OF_LIGHT)


def frequencies(waveform: Waveform) -> Float64Array:
    """Frequencies of OFDM's carriers, shape (n_sample,) [Hz]."""
    return np.asarray(waveform.carrier - waveform.bandwidth / 2 + np.arange(waveform.n_sample) / waveform.chirp_duration, np.float64)


def _superposed(samples: Callable[[Echoes], NDArray[np.complex128]], echoes: Echoes, sampling: Sampling) -> NDArray[np.complex128]:
    """Sum samples of single echoes, (n, chirp, tx, rx, sample); shape (tx, chirp, rx, sample)."""
    w = sampling.info.waveform
    total = np.zeros((w.n_chirp, w.n_tx, len(sampling.rx), w.n_sample), np.complex128)
    for part in chunks(len(echoes), max(_VALUES // total.size, 1)):
        total += samples(echoes.select(np.arange(part.start, part.stop))).sum(0)
    return np.ascontiguousarray(total.transpose(1, 0, 2, 3))


def _phasor(turns: Float64Array) -> NDArray[np.complex128]:
    return np.asarray(np.exp(2j * np.pi * (turns - np.rint(turns))))


def _amplitude(echoes: Echoes, out: Leg, back: Leg, time: Float64Array | None) -> NDArray[np.complex128]:
    """Amplitudes of single echoes, shape (n, chirp, tx, 1, 1) [V]; by lengths of the legs at a time as `Leg` takes it."""
    lengths = np.maximum(out.length(time), NEAR) * np.maximum(back.length(time), NEAR)
    amplitude = echoes.strength[:, None, None, None, None] / lengths
    if echoes.envelope is not None:
        amplitude = amplitude * echoes.envelope.transpose(2, 0, 1)[..., None, None]
    return np.asarray(amplitude)


@dataclass
class Leg:
    """One leg of some echoes, along its parabola (curved) or at the length and rate of the middle of the frame.

    Times are arrays (1, chirp, tx, 1, sample or 1) [s], or None for the middle of the frame; results have echoes along the first axis.
    """

    motion: Motion
    curved: bool

    def place(self, time: Float64Array | None) -> Float64Array:
        """Where it is, with (x, y, z) along a last axis [m]."""
        p, v, a = (x[:, None, None, None, None, :] for x in (self.motion.position, self.motion.velocity, self.motion.acceleration))
        if time is None:
            return p
        t = time[..., None]
        return np.asarray(p + t * (v + (0.5 * t) * a))

    def length(self, time: Float64Array | None) -> Float64Array:
        """How long it is [m]."""
        if time is None or self.curved:
            return _norm(self.place(time))
        p, v = self.motion.position, self.motion.velocity
        start = _norm(p)
        rate = (p * v).sum(-1) / np.maximum(start, TINY)
        spread = (slice(None), None, None, None, None)
        return np.asarray(start[spread] + rate[spread] * time)

    def nearer(self, elements: Float64Array, time: Float64Array | None, sphere: bool) -> Float64Array:
        """By how much the leg to an element (..., 2) = (y, z) is longer than that to the middle of the array [m]."""
        place = self.place(time)
        length = _norm(place)
        if not sphere:
            return np.asarray(-(place[..., 1:] * elements).sum(-1) / np.maximum(length, TINY))
        sides = place[..., 1:] - elements
        return np.asarray(np.sqrt(place[..., 0] ** 2 + (sides**2).sum(-1)) - length)


def _norm(vector: Float64Array) -> Float64Array:
    return np.asarray(np.sqrt((vector**2).sum(-1)))
