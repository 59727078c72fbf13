"""Echoes as a non-uniform Fourier transform: the cheapest model for many echoes."""

from __future__ import annotations

from typing import Any, Final

import finufft
import numpy as np
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT
from radar_sim.propagation.base import NEAR, Float64Array, Physics, Sampling
from radar_sim.propagation.kernels import TINY, chunks, cosine, jit, reduced, sine
from radar_sim.propagation.separable import Separable, require_separable
from radar_sim.scatterers import Echoes

EPS: Final = 1e-5
"""Tolerance asked of finufft; 1e-2 to 1e-6 cost nearly the same, and float32 ends there."""
_CHUNK = 1 << 16
"""Echoes whose weights are held at once: 4 MB with the default radar."""


class Nufft:
    """Superpose echoes by a two-dimensional transform per channel: Doppler to chirps, beat frequency to samples.

    It is the separable model to a relative error of about 1e-5. Frames with late chirps or echoes with an envelope do not lie on a grid of
    slow time; the matrix product computes them.

    Parameters
    ----------
    physics, sampling
        As for `Separable`.

    Raises
    ------
    ConfigError
        When physics is named that does not separate.
    """

    def __init__(self, physics: Physics, sampling: Sampling) -> None:
        require_separable("nufft", physics)
        w = sampling.info.waveform
        self._direct = Separable(physics, sampling)
        self._tx, self._rx = sampling.tx / w.wavelength, sampling.rx / w.wavelength
        self._shape = (w.n_tx, len(sampling.rx), w.n_chirp, w.n_sample)
        self._wave = (w.carrier / SPEED_OF_LIGHT, w.slope / SPEED_OF_LIGHT, w.slope / 2 / SPEED_OF_LIGHT**2, physics.doppler_in_chirp)
        # finufft numbers its outputs from -(n // 2): weights carry the phase of output 0.
        self._zero = (np.ascontiguousarray(sampling.since[w.n_chirp // 2]), float(sampling.fast[w.n_sample // 2]))
        self._steps = (w.slow_interval, w.chirp_duration / w.n_sample)
        n_channel = w.n_tx * len(sampling.rx)
        self._plan = finufft.Plan(1, (w.n_chirp, w.n_sample), n_channel, EPS, 1, dtype="complex64", nthreads=1)
        self._cube = np.empty((n_channel, w.n_chirp, w.n_sample), np.complex64)

    def process(self, echoes: Echoes, late: Float64Array | None = None) -> NDArray[np.complex64]:
        """Superpose echoes, as `Propagator.process`."""
        if late is not None or echoes.envelope is not None or len(echoes) == 0:
            return self._direct.process(echoes, late)
        total: NDArray[np.complex64] | None = None
        for part in chunks(len(echoes), _CHUNK):
            doppler, beat, weights = self.weights(echoes, part)
            self._plan.setpts(doppler, beat)
            self._plan.execute(weights, self._cube)
            total = self._cube if total is None else total + self._cube
        assert total is not None
        return total.reshape(self._shape).swapaxes(1, 2).copy()  # the plan writes to the same array next time

    def weights(self, echoes: Echoes, part: slice) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.complex64]]:
        """Points of the transform, shape (n,) twice [rad per chirp and per sample], and weights, shape (tx rx, n) [V]."""
        n = part.stop - part.start
        points, weights = np.empty((2, n), np.float32), np.empty((self._shape[0], self._shape[1], n), np.complex64)
        out, back = echoes.out, echoes.back
        legs = (out.position[part], out.velocity[part], back.position[part], back.velocity[part])
        transform_inputs(legs, echoes.strength[part], self._wave, self._zero, self._steps, self._tx, self._rx, points, weights)
        return points[0], points[1], weights.reshape(-1, n)


@jit
def transform_inputs(
    legs: Any,
    strength: Any,
    wave: Any,
    zero: Any,
    steps: Any,
    tx: Any,
    rx: Any,
    points: Any,
    weights: Any,
) -> None:
    """Fill points (2, n) and weights (n_tx, n_rx, n).

    Parameters
    ----------
    legs, strength, wave, tx, rx
        As for `radar_sim.propagation.separable.factors`.
    zero : tuple of (ndarray, float)
        When output 0 is: the chirp's middle for each transmitter, from the middle of the frame, and the sample from there [s].
    steps : tuple of float
        From chirp to chirp of a transmitter, from sample to sample [s].
    points, weights : ndarray of float32 and complex64
        To be filled.
    """
    out, out_rate, back, back_rate = legs
    carrier, slope, square, doppler = wave
    middle, sample = zero
    n = len(strength)
    state = np.empty((8, n))
    for j in range(n):
        r1 = np.sqrt(out[j, 0] ** 2 + out[j, 1] ** 2 + out[j, 2] ** 2)
        r2 = np.sqrt(back[j, 0] ** 2 + back[j, 1] ** 2 + back[j, 2] ** 2)
        per1, per2 = 1 / max(r1, TINY), 1 / max(r2, TINY)
        rate = (out[j, 0] * out_rate[j, 0] + out[j, 1] * out_rate[j, 1] + out[j, 2] * out_rate[j, 2]) * per1
        rate += (back[j, 0] * back_rate[j, 0] + back[j, 1] * back_rate[j, 1] + back[j, 2] * back_rate[j, 2]) * per2
        path, shift = r1 + r2, carrier * rate
        beat = slope * path + (shift if doppler else 0.0)
        points[0, j] = reduced(shift * steps[0]) * np.float32(2 * np.pi)
        points[1, j] = reduced(beat * steps[1]) * np.float32(2 * np.pi)
        start = carrier * path - square * path * path + beat * sample
        state[0, j], state[1, j] = start - np.rint(start), shift
        state[2, j], state[3, j] = out[j, 1] * per1, out[j, 2] * per1
        state[4, j], state[5, j] = back[j, 1] * per2, back[j, 2] * per2
        near = max(r1, NEAR) * max(r2, NEAR)
        state[6, j], state[7, j] = strength[j].real / near, strength[j].imag / near
    for t in range(len(tx)):
        for i in range(len(rx)):
            row = weights[t, i]
            for j in range(n):
                turns = state[0, j] + state[1, j] * middle[t] - tx[t, 0] * state[2, j] - tx[t, 1] * state[3, j]
                x = reduced(turns - rx[i, 0] * state[4, j] - rx[i, 1] * state[5, j])
                c, s, re, im = cosine(x), sine(x), np.float32(state[6, j]), np.float32(state[7, j])
                row[j] = complex(re * c - im * s, re * s + im * c)
