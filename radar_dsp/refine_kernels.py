"""Compiled loops of the maximum-likelihood refinement.

The residual is kept as real and imaginary parts of shape (n_tx, n_chirp, n_rx * n_sample): the inner loops run over receivers and samples
of one chirp at once and hold no sum and no library call, so they become vector code without permission to reorder anything.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
FloatCube = NDArray[np.float32]
ComplexArray = NDArray[np.complex128]
DONE = 0.1
"""A last step below this many standard deviations is convergence: what is left is a small part of it, as the steps shrink tenfold."""


class Model(NamedTuple):
    """What the loops need of a radar; gradients of the phase are over (d, v, u_y, u_z), as in `radar_dsp.bounds.PhaseModel`.

    Entries with a leading axis of two hold for echoes with a direction, and for free ones: each of their channels has its own amplitude.
    """

    wave: FloatArray
    fast: FloatArray
    interval: float
    middle: float
    mean: FloatArray
    mean_tx: FloatArray  # less the mean over all transmitters
    steer: FloatArray  # less its mean
    response: ComplexArray
    information: FloatArray  # (2, 4, 4)
    least: FloatArray  # (2,): energy over noise below which there is no echo
    cells: float
    limit: FloatArray  # longest step: half a cell


@numba.njit(cache=True)
def _phasors(model: Model, distance: float, speed: float) -> ComplexArray:
    """Model of the first chirp, its turn to the next one, and to the next one of the same transmitter, shape (3, n_sample).

    The phase is linear in the chirp's start at every sample, so a recurrence over the chirps is exact, migration included.
    """
    n, n_tx = len(model.wave), len(model.mean_tx)
    out = np.empty((3, n), np.complex128)
    offset = model.mean[0] * distance + model.mean[1] * speed
    for k in range(n):
        first = model.wave[k] * (distance + speed * (model.fast[k] - model.middle)) - offset
        turn = model.wave[k] * speed * model.interval
        out[0, k] = complex(math.cos(first), math.sin(first))
        out[1, k] = complex(math.cos(turn), math.sin(turn))
        out[2, k] = complex(math.cos(n_tx * turn), math.sin(n_tx * turn))
    return out


@numba.njit(cache=True)
def _tile(first: ComplexArray, turn: ComplexArray, amplitude: ComplexArray) -> FloatCube:
    """Real and imaginary parts of phasor and turn, side by side for all receivers, shape (4, n_rx * n_sample): long inner loops."""
    n = len(first)
    out = np.empty((4, len(amplitude) * n), np.float32)
    for rx in range(len(amplitude)):
        for k in range(n):
            value = amplitude[rx] * first[k]
            out[0, rx * n + k], out[1, rx * n + k] = value.real, value.imag
            out[2, rx * n + k], out[3, rx * n + k] = turn[k].real, turn[k].imag
    return out


@numba.njit(cache=True)
def correlate(re: FloatCube, im: FloatCube, model: Model, distance: float, speed: float) -> ComplexArray:
    """Sum residual * conj(model) times (1, gradient over d, gradient over v) over chirps and samples, shape (n_channel, 3)."""
    n_tx, n_chirp, flat = re.shape
    n_sample = len(model.wave)
    n_rx = flat // n_sample
    phasors = _phasors(model, distance, speed)
    first, turn = phasors[0], phasors[2]
    ones = np.ones(n_rx, np.complex128)
    out = np.zeros((n_tx * n_rx, 3), np.complex128)
    for tx in range(n_tx):
        phasor = _tile(first, turn, ones)
        total = np.zeros((4, flat), np.float32)
        for chirp in range(n_chirp):
            start = np.float32((chirp * n_tx + tx) * model.interval - model.middle)
            _accumulate(re[tx, chirp], im[tx, chirp], phasor, start, total)
        for rx in range(n_rx):
            out[tx * n_rx + rx] = _gradient(total[:, rx * n_sample : (rx + 1) * n_sample], model)
        first = first * phasors[1]
    return out


@numba.njit(cache=True)
def _gradient(total: FloatCube, model: Model) -> tuple[complex, complex, complex]:
    """Sum one channel over its samples, plain and times the gradient of the phase over d and v."""
    plain, far, fast = 0j, 0j, 0j
    for k in range(len(model.wave)):
        value, timed = complex(total[0, k], total[1, k]), complex(total[2, k], total[3, k])
        plain += value
        far += model.wave[k] * value
        fast += model.wave[k] * (timed + model.fast[k] * value)
    return plain, far - model.mean[0] * plain, fast - model.mean[1] * plain


@numba.njit(cache=True)
def _accumulate(xr: FloatCube, xi: FloatCube, phasor: FloatCube, start: np.float32, total: FloatCube) -> None:
    """Add one chirp to the sums over chirps, plain and times its start; turn the phasor to the next."""
    pr, pi, qr, qi = phasor[0], phasor[1], phasor[2], phasor[3]
    ar, ai, br, bi = total[0], total[1], total[2], total[3]
    for k in range(len(xr)):
        p, q = pr[k], pi[k]
        real = xr[k] * p + xi[k] * q
        imag = xi[k] * p - xr[k] * q
        ar[k] += real
        ai[k] += imag
        br[k] += start * real
        bi[k] += start * imag
        pr[k] = p * qr[k] - q * qi[k]
        pi[k] = p * qi[k] + q * qr[k]


@numba.njit(cache=True)
def replace(re: FloatCube, im: FloatCube, model: Model, old: FloatArray, was: ComplexArray, new: FloatArray, now: ComplexArray) -> None:
    """Put the echo (d, v, ...) of ``old`` with channel amplitudes ``was`` back into the residual, take that of ``new`` out."""
    n_tx, n_chirp, flat = re.shape
    n_rx = flat // len(model.wave)
    back, out = _phasors(model, old[0], old[1]), _phasors(model, new[0], new[1])
    first, second = back[0], out[0]
    for tx in range(n_tx):
        p = _tile(first, back[2], was[tx * n_rx : (tx + 1) * n_rx])
        q = _tile(second, out[2], -now[tx * n_rx : (tx + 1) * n_rx])
        for chirp in range(n_chirp):
            _mix(re[tx, chirp], im[tx, chirp], p)
            _mix(re[tx, chirp], im[tx, chirp], q)
        first, second = first * back[1], second * out[1]


@numba.njit(cache=True)
def _mix(xr: FloatCube, xi: FloatCube, phasor: FloatCube) -> None:
    """Add a phasor to one chirp and turn it to the next."""
    pr, pi, qr, qi = phasor[0], phasor[1], phasor[2], phasor[3]
    for k in range(len(xr)):
        p, q = pr[k], pi[k]
        xr[k] += p
        xi[k] += q
        pr[k] = p * qr[k] - q * qi[k]
        pi[k] = p * qi[k] + q * qr[k]


@numba.njit(cache=True)
def take_step(
    sums: ComplexArray, model: Model, theta: FloatArray, amplitude: ComplexArray, free: bool, noise: float
) -> tuple[float, float]:
    """Take one Gauss-Newton step in place; return its length in standard deviations and the echo's energy over the noise.

    The gradients are centred, so amplitude and phase separate from the four parameters; the echo's own part of the residual
    drops out of the gradient for the same reason, so it does not matter that the residual lacks it.
    """
    n, n_rx = len(amplitude), len(amplitude) // len(model.mean_tx)
    _match(sums, model, theta, amplitude, free)
    slope = np.zeros(4)
    energy = 0.0
    for c in range(n):
        conj = amplitude[c].conjugate()
        energy += abs(conj) ** 2 * model.cells
        plain = (conj * sums[c, 0]).imag
        slope[0] += (conj * sums[c, 1]).imag
        slope[1] += (conj * sums[c, 2]).imag - (model.mean_tx[c // n_rx] * plain if free else 0.0)
        slope[2] += model.steer[c, 0] * plain
        slope[3] += model.steer[c, 1] * plain
    if not energy > model.least[int(free)] * noise:
        return np.inf, energy / noise
    step = model.information[int(free)] @ slope / energy
    cells = np.max(np.abs(step) / model.limit)
    shrink = 1.0 / max(cells, 1.0)
    # Length in the metric of the bound: step' J step with J = 2 energy / noise / information. Far above the noise, where a standard
    # deviation is less than float32 resolves, a thousandth of a cell will do.
    length = min(math.sqrt(max(2.0 * np.sum(step * slope) / noise, 0.0)), 500.0 * DONE * cells)
    theta += shrink * step
    for c in range(n):
        # A free channel keeps its own phase at the middle of its chirps, which the model counts from the middle of all.
        angle = -model.mean_tx[c // n_rx] * step[1] if free else model.steer[c, 0] * step[2] + model.steer[c, 1] * step[3]
        amplitude[c] *= complex(math.cos(shrink * angle), math.sin(shrink * angle))
    return length, energy / noise


@numba.njit(cache=True)
def _match(sums: ComplexArray, model: Model, theta: FloatArray, amplitude: ComplexArray, free: bool) -> None:
    """Add what the residual still holds of the echo to its channel amplitudes, in place."""
    if free:
        amplitude += sums[:, 0] / model.cells
        return
    match, own, weight = 0j, 0j, 0.0
    steering = np.empty(len(amplitude), np.complex128)
    for c in range(len(amplitude)):
        angle = model.steer[c, 0] * theta[2] + model.steer[c, 1] * theta[3]
        steering[c] = model.response[c] * complex(math.cos(angle), math.sin(angle))
        match += steering[c].conjugate() * sums[c, 0]
        own += steering[c].conjugate() * amplitude[c]
        weight += abs(steering[c]) ** 2
    amplitude[:] = (match / model.cells + own) / weight * steering
