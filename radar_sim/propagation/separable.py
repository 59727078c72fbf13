"""Models that factor slow and fast time: a matrix product for few echoes, a non-uniform Fourier transform for many."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from radar_core import SPEED_OF_LIGHT, ConfigError
from radar_sim.propagation.base import NEAR, Float64Array, Physics, Sampling
from radar_sim.propagation.kernels import TINY, chunks, cosine, jit, reduced, sine, times
from radar_sim.scatterers import Echoes

try:
    import finufft
except ImportError:  # not everywhere is there one to install
    finufft = None

_CHUNK = 4096
"""Echoes whose factors are held at once: 12 MB with the default radar."""
EPS: Final = 1e-5
"""Tolerance asked of finufft; 1e-2 to 1e-6 cost nearly the same, and float32 ends there."""
_MANY = 1 << 16
"""Echoes whose weights are held at once: 4 MB with the default radar."""
_POOLS = ThreadpoolController()
HAS_NUFFT = finufft is not None
"""Whether `Nufft` can be used here."""


def require_separable(model: str, physics: Physics) -> None:
    """Raise `ConfigError` when a model that factors slow and fast time is asked for what does not factor."""
    if not physics.separable:
        wrong = [name for name in ("range_migration", "squint", "curvature", "near_field") if getattr(physics, name)]
        raise ConfigError(
            f"fidelity.model is {model!r}, which cannot show {', '.join(wrong)}; choose blocks or exact (or auto), or leave "
            f"{'it' if len(wrong) == 1 else 'them'} out of effects",
            key=("fidelity", "model"),
        )


class Separable:
    """Superpose echoes as the product of a matrix (tx chirp, n) and a matrix (n, rx sample).

    Of physics only ``doppler_in_chirp`` may be named: it is a shift of the beat frequency and costs nothing.

    Raises
    ------
    ConfigError
        When other physics is named.
    """

    def __init__(self, physics: Physics, sampling: Sampling) -> None:
        require_separable("separable", physics)
        w = sampling.info.waveform
        self._since, self._tx, self._rx = sampling.since, sampling.tx / w.wavelength, sampling.rx / w.wavelength
        self._shape = (w.n_tx, w.n_chirp, len(sampling.rx), w.n_sample)
        self.wave = (w.carrier / SPEED_OF_LIGHT, w.slope / SPEED_OF_LIGHT, w.slope / 2 / SPEED_OF_LIGHT**2, physics.doppler_in_chirp)
        self._fast = sampling.fast

    def process(self, echoes: Echoes, late: Float64Array | None = None) -> NDArray[np.complex64]:
        """Superpose echoes, as `Propagator.process`."""
        n_tx, n_chirp, n_rx, n_sample = self._shape
        since = np.ascontiguousarray(times(self._since, late).T)
        total = np.zeros((n_tx * n_chirp, n_rx * n_sample), np.complex64)
        for part in chunks(len(echoes), _CHUNK):
            n = part.stop - part.start
            slow, fast = np.empty((n, n_tx, n_chirp), np.complex64), np.empty((n, n_rx, n_sample), np.complex64)
            out, back = echoes.out, echoes.back
            legs = (out.position[part], out.velocity[part], back.position[part], back.velocity[part])
            factors(legs, echoes.strength[part], self.wave, since, self._fast, self._tx, self._rx, slow, fast)
            if echoes.envelope is not None:
                slow *= echoes.envelope[:, :, part].transpose(2, 1, 0)
            with _POOLS.limit(limits=1, user_api="blas"):  # with another number of threads rounding differs; at this size they only fight
                product = slow.reshape(n, -1).T @ fast.reshape(n, -1)
            total = product if n == len(echoes) else total + product
        return total.reshape(self._shape)


@jit
def _start(position: Any, velocity: Any) -> Any:
    length = np.sqrt(position[0] ** 2 + position[1] ** 2 + position[2] ** 2)
    safe = max(length, TINY)
    rate = (position[0] * velocity[0] + position[1] * velocity[1] + position[2] * velocity[2]) / safe
    return length, rate, position[1] / safe, position[2] / safe


@jit
def factors(legs: Any, strength: Any, wave: Any, since: Any, fast: Any, tx: Any, rx: Any, a: Any, b: Any) -> None:
    """Fill the factors of n echoes.

    Parameters
    ----------
    legs : tuple of ndarray, shape (n, 3)
        Position [m] and velocity [m/s] of the leg out, the same of the leg back.
    strength : ndarray of complex128, shape (n,)
        As in `Echoes`.
    wave : tuple of (float, float, float, bool)
        Carrier / c, slope / c, slope / 2 c^2; whether motion within a chirp counts.
    since : ndarray, shape (n_tx, n_chirp)
        Times of the chirps from the middle of the frame [s].
    fast : ndarray, shape (n_sample,)
        Times of the samples from the middle of their chirp [s].
    tx, rx : ndarray, shape (n, 2)
        Elements (y, z) [wavelengths].
    a, b : ndarray of complex64, shapes (n, n_tx, n_chirp) and (n, n_rx, n_sample)
        Factors of slow and fast time, to be filled.
    """
    out, out_rate, back, back_rate = legs
    carrier, slope, square, doppler = wave
    beat = np.empty((2, fast.size), np.float32)
    for j in range(len(strength)):
        r1, v1, y1, z1 = _start(out[j], out_rate[j])
        r2, v2, y2, z2 = _start(back[j], back_rate[j])
        path, rate = r1 + r2, v1 + v2
        for t in range(len(tx)):
            steer = tx[t, 0] * y1 + tx[t, 1] * z1
            row = a[j, t]
            for i in range(row.size):
                x = reduced(carrier * rate * since[t, i] - steer)
                row[i] = complex(cosine(x), sine(x))
        frequency = slope * path + (carrier * rate if doppler else 0.0)
        start = carrier * path - square * path * path
        start -= np.rint(start)
        for k in range(fast.size):
            x = reduced(start + frequency * fast[k])
            beat[0, k], beat[1, k] = cosine(x), sine(x)
        volts = strength[j] / (max(r1, NEAR) * max(r2, NEAR))
        for i in range(len(rx)):
            x = reduced(-(rx[i, 0] * y2 + rx[i, 1] * z2))
            here = volts * complex(cosine(x), sine(x))
            re, im = np.float32(here.real), np.float32(here.imag)
            row = b[j, i]
            for k in range(fast.size):
                row[k] = complex(re * beat[0, k] - im * beat[1, k], re * beat[1, k] + im * beat[0, k])


class Nufft:
    """Superpose echoes by a two-dimensional transform per channel: Doppler to chirps, beat frequency to samples.

    It is the separable model to a relative error of about 1e-5. Frames with late chirps or echoes with an envelope do not lie on a grid of
    slow time; the matrix product computes them.

    Raises
    ------
    ConfigError
        When physics is named that does not separate, or finufft is not installed.
    """

    def __init__(self, physics: Physics, sampling: Sampling) -> None:
        require_separable("nufft", physics)
        if not HAS_NUFFT:
            raise ConfigError("fidelity.model 'nufft' needs finufft: pip install finufft; or choose auto", key=("fidelity", "model"))
        w = sampling.info.waveform
        self._direct = Separable(physics, sampling)
        self._tx, self._rx = sampling.tx / w.wavelength, sampling.rx / w.wavelength
        self._shape = (w.n_tx, len(sampling.rx), w.n_chirp, w.n_sample)
        self._wave = self._direct.wave
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
        for part in chunks(len(echoes), _MANY):
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
def transform_inputs(legs: Any, strength: Any, wave: Any, zero: Any, steps: Any, tx: Any, rx: Any, points: Any, weights: Any) -> None:
    """Fill points (2, n) and weights (n_tx, n_rx, n).

    Parameters
    ----------
    legs, strength, wave, tx, rx
        As for `factors`.
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
