"""Moving scatterers to beat signals: radar equation and chirp-sequence FMCW with TDM (thesis, sections 2.1.3, 2.2 and 2.3).

Other modulations are in `radar_sim.modulation`.

A sample at time T, ``t`` after its chirp began, has the phase 2 pi (f_min tau(T) + slope tau(T) t). The residual video phase, pi slope
tau^2, is left out as in (2.11): at 6 m it is 0.11 rad and changes by 0.004 rad from one range bin to the next. Three models, chosen by name
in `Scene.model`, differ in how they follow tau through a frame; docs/simulator.md has what each costs and gives.

* separable: range, range rate and direction are those of the middle of the frame. The sum over the scatterers is then one matrix product.
* blocks: the same in each of `Scene.blocks` parts of the frame.
* exact: float64; every chirp with the scatterers where they then are, moving evenly within the chirp, and the true path from each
  transmitter by way of the scatterer to each receiver: range migration, acceleration, array squint and near field are all in.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT, RadarInfo

Float64Array = NDArray[np.float64]
IMPEDANCE = 50.0
"""Ohm: what turns watts into volts. A sample z carries the power abs(z)^2 / IMPEDANCE at the receiver's input; the receiver's gain is 1."""
NEAR = 0.05
"""The radar equation has no meaning nearer than this [m]: amplitudes stop rising."""

Model = Callable[[RadarInfo, Float64Array, Float64Array], NDArray[np.complex64]]
"""Of the radar, positions (2 n_blocks + 1, n, 3) in the sensor frame [m] and strengths (n,), a frame of shape (tx, chirp, rx, sample) [V].

The positions are taken at even steps over the acquisition, both ends included."""


def strength(info: RadarInfo, rcs: Float64Array) -> Float64Array:
    """Amplitude of an echo times the square of its range, by the radar equation (2.4) on the boresight.

    Parameters
    ----------
    info : RadarInfo
        Transmit power and gain.
    rcs : ndarray, shape (n,)
        Radar cross-sections [m^2].

    Returns
    -------
    ndarray of float64, shape (n,)
        Strength [V m^2].
    """
    array, wavelength = info.array, info.waveform.wavelength
    power = 1e-3 * 10 ** ((array.tx_power + 2 * array.gain) / 10) * wavelength**2 / (4 * math.pi) ** 3
    return np.sqrt(power * IMPEDANCE * rcs)


def visible(info: RadarInfo, position: Float64Array) -> NDArray[np.bool_]:
    """Which positions (n, 3) of the sensor frame echo at all: before the array, and for FMCW nearer than `Waveform.max_range`.

    The array lies in a plane that shields what is behind it. The receiver has an ideal anti-aliasing filter: a beat frequency above the
    sample rate is gone, it does not fold back. A tone has no such limit, and OFDM's echoes beyond it do fold back.
    """
    limit = info.waveform.max_range if info.waveform.modulation == "fmcw" else math.inf
    seen: NDArray[np.bool_] = (position[:, 0] > 0) & ((position**2).sum(-1) < limit**2)
    return seen


def separable(info: RadarInfo, positions: Float64Array, strengths: Float64Array) -> NDArray[np.complex64]:
    """Echoes with range, range rate and direction constant within each part of the frame, as one matrix product a part.

    Parameters
    ----------
    info : RadarInfo
        The radar.
    positions : ndarray, shape (2 n_blocks + 1, n, 3)
        In the sensor frame at even steps over the acquisition [m]: edges and middles of the parts.
    strengths : ndarray, shape (n,)
        See `strength` [V m^2].

    Returns
    -------
    ndarray of complex64, shape (tx, chirp, rx, sample)
        Samples [V].
    """
    n_blocks = (len(positions) - 1) // 2
    w = info.waveform
    cube = np.empty((w.n_tx, w.n_chirp, info.array.n_rx * w.n_sample), np.complex64)
    edges = np.rint(np.linspace(0, w.n_chirp, n_blocks + 1)).astype(int)
    for b in range(n_blocks):
        chirps = np.arange(edges[b], edges[b + 1])
        slow, fast = _factors(info, positions[2 * b : 2 * b + 3], strengths, (b + 0.5) / n_blocks, n_blocks, chirps)
        for tx in range(w.n_tx):
            np.matmul(slow[tx], fast, out=cube[tx, edges[b] : edges[b + 1]])
    return cube.reshape(info.cube_shape)


def _factors(
    info: RadarInfo, positions: Float64Array, strengths: Float64Array, middle: float, n_blocks: int, chirps: NDArray[np.int_]
) -> tuple[NDArray[np.complex64], NDArray[np.complex64]]:
    """Slow time (tx, chirp, n) and fast time (n, rx sample) of one part of the frame; ``middle`` is its middle, 0 to 1 of the frame."""
    w, array = info.waveform, info.array
    length = _norm(positions)
    distance = np.maximum(length[1], 1e-9)
    delay = 2 * distance / SPEED_OF_LIGHT
    doppler = 2 * (length[2] - length[0]) * n_blocks / (w.acquisition_time * w.wavelength)
    # Phases count from the middle of a chirp, where the frequency is the carrier: so Doppler and range separate. Doppler within a chirp is
    # a shift of the beat frequency and costs nothing.
    t = (np.arange(w.n_sample) / w.n_sample - 0.5) * w.chirp_duration
    beat = _phasor((w.slope * delay + doppler)[:, None] * t + (w.carrier * delay)[:, None])
    since = chirps * w.slow_interval + w.chirp_duration / 2 - middle * w.acquisition_time
    turn = np.arange(w.n_tx) * w.chirp_interval
    direction = positions[1, :, 1:] / distance[:, None]
    path_tx = np.asarray(array.tx, np.float64) @ direction.T / w.wavelength
    path_rx = direction @ np.asarray(array.rx, np.float64).T / w.wavelength
    amplitude = (strengths / np.maximum(distance, NEAR) ** 2).astype(np.float32)
    rx = _phasor(-path_rx) * amplitude[:, None]
    slow = _phasor(since[:, None] * doppler) * _phasor(turn[:, None] * doppler - path_tx)[:, None, :]
    return slow, (rx[:, :, None] * beat[:, None, :]).reshape(len(distance), -1)


def exact(info: RadarInfo, positions: Float64Array, strengths: Float64Array) -> NDArray[np.complex64]:
    """Echoes with the true path of every chirp and channel.

    Parameters
    ----------
    info : RadarInfo
        The radar.
    positions : ndarray, shape (2 n_tx n_chirp + 1, n, 3)
        In the sensor frame [m]: where every chirp begins, in its middle, and where the next one begins.
    strengths : ndarray, shape (n,)
        See `strength` [V m^2].

    Returns
    -------
    ndarray of complex64, shape (tx, chirp, rx, sample)
        Samples [V]; computed in float64.
    """
    w = info.waveform
    cube = np.zeros((w.n_chirp, w.n_tx, info.array.n_rx, w.n_sample), np.complex128)
    t = np.arange(w.n_sample) / w.n_sample * w.chirp_duration
    for delay, drift, amplitude in paths(info, positions, strengths):
        tau = delay[..., None] + drift[..., None] * t
        phase = (w.carrier - w.bandwidth / 2) * tau + w.slope * tau * t
        cube += amplitude[..., None] * np.exp(2j * np.pi * (phase - np.rint(phase)))
    return np.ascontiguousarray(cube.transpose(1, 0, 2, 3)).astype(np.complex64)


def paths(info: RadarInfo, positions: Float64Array, strengths: Float64Array) -> Iterator[tuple[Float64Array, Float64Array, Float64Array]]:
    """Follow every scatterer through the frame.

    Parameters
    ----------
    info, positions, strengths
        As for `exact`.

    Yields
    ------
    tuple of ndarray of float64, each of shape (chirp, tx, rx)
        Delay of the true path at the beginning of each chirp [s], its rate of change during the chirp, amplitude [V].
    """
    w, array = info.waveform, info.array
    tx, rx = (np.insert(np.asarray(elements, np.float64), 0, 0.0, axis=-1) for elements in (array.tx, array.rx))
    for n, strength_n in enumerate(strengths):
        start = positions[:-1:2, n].reshape(w.n_chirp, w.n_tx, 3)
        end = positions[2::2, n].reshape(w.n_chirp, w.n_tx, 3)
        begins, ends = (_norm(p - tx)[..., None] + _norm(p[:, :, None, :] - rx) for p in (start, end))
        delay, drift = begins / SPEED_OF_LIGHT, (ends - begins) / (SPEED_OF_LIGHT * w.chirp_interval)
        yield delay, drift, strength_n / np.maximum(begins / 2, NEAR) ** 2


def _norm(vector: Float64Array) -> Float64Array:
    norm: Float64Array = np.sqrt((vector**2).sum(-1))
    return norm


def _phasor(turns: Float64Array) -> NDArray[np.complex64]:
    """exp(j 2 pi turns); whole turns are dropped in float64 before the cheap float32 sine and cosine."""
    phase = ((turns - np.rint(turns)) * (2 * np.pi)).astype(np.float32)
    result = np.empty(phase.shape, np.complex64)
    np.cos(phase, out=result.real)
    np.sin(phase, out=result.imag)
    return result
