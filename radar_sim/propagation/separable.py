"""Echoes as one matrix product of slow time and fast time: the cheapest model for few echoes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from radar_core import SPEED_OF_LIGHT, ConfigError
from radar_sim.propagation.base import NEAR, Float64Array, Physics, Sampling
from radar_sim.propagation.kernels import TINY, chunks, cosine, jit, reduced, sine, times
from radar_sim.scatterers import Echoes

_CHUNK = 4096
"""Echoes whose factors are held at once: 12 MB with the default radar."""
_POOLS = ThreadpoolController()


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

    Parameters
    ----------
    physics : Physics
        Only ``doppler_in_chirp`` may be named: it is a shift of the beat frequency and costs nothing.
    sampling : Sampling
        When and where samples are taken.

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
        self._wave = (w.carrier / SPEED_OF_LIGHT, w.slope / SPEED_OF_LIGHT, w.slope / 2 / SPEED_OF_LIGHT**2, physics.doppler_in_chirp)
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
            factors(legs, echoes.strength[part], self._wave, since, self._fast, self._tx, self._rx, slow, fast)
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
