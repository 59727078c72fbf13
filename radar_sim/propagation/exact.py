"""Every echo, chirp and channel with its own path; samples within a chirp by phase recurrence."""

from __future__ import annotations

from dataclasses import astuple
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_sim.propagation.base import NEAR, Float64Array, Physics, Sampling
from radar_sim.propagation.kernels import aside, cosine, envelope_of, follow, jit, packed, reduced, sine, times
from radar_sim.scatterers import Echoes

_LANES = 128
"""Chirps times receivers that are computed side by side."""
_RUN = 64
"""Samples after which the recurrence starts anew from float64."""


class Exact:
    """Follow path, frequency and their changes of every echo, chirp and channel.

    Within a chirp the phase is a parabola in time: the linear part is a recurrence in float32, the quadratic part is taken as that of the
    middle one of some neighbouring chirps. What is left is below 1e-4 rad for anything that a person does.
    """

    def __init__(self, physics: Physics, sampling: Sampling) -> None:
        w = sampling.info.waveform
        self._since, self._tx, self._rx = sampling.since, sampling.tx, sampling.rx
        self._flags, self._wave = astuple(physics), sampling.wave
        self._shape = (w.n_tx, w.n_chirp, len(sampling.rx), w.n_sample)

    def process(self, echoes: Echoes, late: Float64Array | None = None) -> NDArray[np.complex64]:
        """Superpose echoes, as `Propagator.process`."""
        cube = np.zeros(self._shape, np.complex64)
        if len(echoes):
            when = np.ascontiguousarray(times(self._since, late).T)
            legs = packed(echoes.out), packed(echoes.back)
            superpose(*legs, echoes.strength, envelope_of(echoes), self._wave, self._flags, when, self._tx, self._rx, cube)
        return cube


@jit
def superpose(out: Any, back: Any, strength: Any, envelope: Any, wave: Any, flags: Any, when: Any, tx: Any, rx: Any, cube: Any) -> None:
    """Fill a cube.

    Parameters
    ----------
    out, back : ndarray, shape (11, n)
        Legs as `radar_sim.propagation.kernels.packed` lays them out.
    strength : ndarray of complex128, shape (n,)
        As in `Echoes`.
    envelope : ndarray of float32, shape (n_chirp, n_tx, n) or (0, 0, 0)
        As in `Echoes`; empty: none.
    wave : tuple of float
        Carrier / c, slope / c, 1 / c and the time from sample to sample.
    flags : tuple of bool
        `Physics`.
    when : ndarray, shape (n_tx, n_chirp)
        Times of the chirps from the middle of the frame [s].
    tx, rx : ndarray, shape (n, 2)
        Elements (y, z) [m].
    cube : ndarray of complex64, shape (tx, chirp, rx, sample)
        To be filled [V].
    """
    n_tx, n_chirp, n_rx, n_sample = cube.shape
    width = max(_LANES // n_rx, 1)
    legs, phases, lanes = np.empty((2, 11, width)), np.empty((3, n_rx, width)), np.empty((4, n_rx * width), np.float32)
    instant, sides = np.empty(width), np.empty((2, 2, width))
    bend, sums = np.empty((2, n_sample), np.float32), np.empty((n_sample, 2, n_rx * width), np.float32)
    for t in range(n_tx):
        for first in range(0, n_chirp, width):
            sums[:] = 0.0
            for c in range(width):  # lanes beyond the last chirp repeat it; nobody reads them
                instant[c] = when[t, min(first + c, n_chirp - 1)]
            for j in range(len(strength)):
                follow(out, j, instant, flags[3], legs[0])
                follow(back, j, instant, flags[3], legs[1])
                aside(legs[0], tx[t], flags[4], sides[0])
                square = prepare(legs, out[9, j] + back[9, j], wave, flags, rx, sides, phases)
                for k in range(n_sample):
                    x = reduced(square * (k - 0.5 * n_sample) ** 2)
                    bend[0, k], bend[1, k] = cosine(x), sine(x)
                weigh(legs, (out[9, j], back[9, j]), j, envelope, flags[0], first, t, phases)
                for begin in range(0, n_sample, _RUN):
                    launch(phases, strength[j], begin - 0.5 * n_sample, lanes)
                    recur(lanes, bend, begin, min(begin + _RUN, n_sample), sums)
            for c in range(min(width, n_chirp - first)):
                for i in range(n_rx):
                    for k in range(n_sample):
                        cube[t, first + c, i, k] = complex(sums[k, 0, i * width + c], sums[k, 1, i * width + c])


@jit
def prepare(legs: Any, path0: Any, wave: Any, flags: Any, rx: Any, sides: Any, phases: Any) -> Any:
    """Phase in the middle of each chirp [turns] and its change from sample to sample, ``phases`` (2, rx, chirps); return its bend."""
    migration, doppler, squint = flags[0], flags[1], flags[2]
    carrier, slope, per_c, step = wave
    width = phases.shape[2]
    for i in range(len(rx)):
        aside(legs[1], rx[i], flags[4], sides[1])
        for c in range(width):
            path, rate = legs[0, 0, c] + legs[1, 0, c], legs[0, 1, c] + legs[1, 1, c]
            side, turning = sides[0, 0, c] + sides[1, 0, c], sides[0, 1, c] + sides[1, 1, c]
            beat = (path if migration else path0) + (side if squint else 0.0)
            drift = (rate if migration else 0.0) + (turning if squint else 0.0)
            phases[0, i, c] = carrier * (path + side) - 0.5 * slope * per_c * beat * beat
            frequency = slope * beat
            if doppler:
                frequency += carrier * (rate + turning) - slope * per_c * beat * drift
            phases[1, i, c] = step * frequency
    if not doppler:
        return 0.0
    c = width // 2
    bend = carrier * (legs[0, 2, c] + legs[1, 2, c])
    if migration:
        drift = legs[0, 1, c] + legs[1, 1, c]
        bend += slope * drift * (1.0 - 0.5 * per_c * drift)
    return bend * step * step


@jit
def launch(phases: Any, strength: Any, m: Any, lanes: Any) -> None:
    """Start the recurrence ``m`` samples from the middle of the chirps: ``lanes`` (4, lanes) = start and turn, each cosine and sine."""
    turns, steps, weights = phases[0].ravel(), phases[1].ravel(), phases[2].ravel()
    re, im = strength.real, strength.imag
    for n in range(turns.size):
        x, y = reduced(turns[n] + m * steps[n]), reduced(steps[n])
        c, s = cosine(x), sine(x)
        a, b = np.float32(re * weights[n]), np.float32(im * weights[n])
        lanes[0, n], lanes[1, n] = a * c - b * s, a * s + b * c
        lanes[2, n], lanes[3, n] = cosine(y), sine(y)


@jit
def weigh(legs: Any, lengths: Any, j: Any, envelope: Any, follows: Any, first: Any, t: Any, phases: Any) -> None:
    """Amplitude of each lane over its strength, ``phases[2]`` [1/m^2]; ``lengths`` are those of the middle of the frame."""
    for c in range(phases.shape[2]):
        out, back = (legs[0, 0, c], legs[1, 0, c]) if follows else lengths
        weight = 1 / (max(out, NEAR) * max(back, NEAR))
        if envelope.size:
            weight *= envelope[min(first + c, len(envelope) - 1), t, j]
        for i in range(phases.shape[1]):
            phases[2, i, c] = weight


@jit
def recur(lanes: Any, bend: Any, begin: Any, end: Any, sums: Any) -> None:
    """Add samples ``begin`` to ``end`` of all lanes to ``sums`` (sample, 2, lanes); ``lanes`` is left at the end."""
    re, im, turn_re, turn_im = lanes[0], lanes[1], lanes[2], lanes[3]
    for k in range(begin, end):
        c, s = bend[0, k], bend[1, k]
        sum_re, sum_im = sums[k, 0], sums[k, 1]
        for n in range(re.size):
            a, b, x, y = re[n], im[n], turn_re[n], turn_im[n]
            sum_re[n] += a * c - b * s
            sum_im[n] += a * s + b * c
            re[n] = a * x - b * y
            im[n] = a * y + b * x
