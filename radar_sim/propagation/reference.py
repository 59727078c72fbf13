"""The truth that every other model is measured against: float64, every sample, as `radar_sim.propagation.base` writes it down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT
from radar_sim.propagation.base import NEAR, Float64Array, Physics, Sampling
from radar_sim.propagation.kernels import TINY, chunks, times
from radar_sim.scatterers import Echoes, Motion

_VALUES = 1 << 19
"""Samples of echoes that are held at once."""


class Reference:
    """Compute every sample of every echo on its own.

    Parameters
    ----------
    physics : Physics
        Which simplifications are put right; with all of them the delay is that of every sample's own time and of its channel.
    sampling : Sampling
        When and where samples are taken.
    """

    def __init__(self, physics: Physics, sampling: Sampling) -> None:
        self.physics, self.sampling = physics, sampling
        w = sampling.info.waveform
        self._shape = (w.n_chirp, w.n_tx, len(sampling.rx), w.n_sample)
        self._since, self._fast = sampling.since, sampling.fast

    def process(self, echoes: Echoes, late: Float64Array | None = None) -> NDArray[np.complex64]:
        """Superpose echoes, as `Propagator.process`."""
        return self.sums(echoes, late).astype(np.complex64)

    def sums(self, echoes: Echoes, late: Float64Array | None = None) -> NDArray[np.complex128]:
        """Superpose echoes without the last rounding; complex128, shape (tx, chirp, rx, sample) [V]."""
        total = np.zeros(self._shape, np.complex128)
        for part in chunks(len(echoes), max(_VALUES // total.size, 1)):
            turns, amplitude = self.phases(echoes.select(np.arange(part.start, part.stop)), late)
            total += (amplitude * np.exp(2j * np.pi * (turns - np.rint(turns)))).sum(0)
        return np.ascontiguousarray(total.transpose(1, 0, 2, 3))

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
        where = middle if physics.range_migration else None
        lengths = np.maximum(out.length(where), NEAR) * np.maximum(back.length(where), NEAR)
        amplitude = echoes.strength[:, None, None, None, None] / lengths
        if echoes.envelope is not None:
            amplitude = amplitude * echoes.envelope.transpose(2, 0, 1)[..., None, None]
        return turns, amplitude


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
    norm: Float64Array = np.sqrt((vector**2).sum(-1))
    return norm
