"""Parts of a frame, each with its own range, range rate and direction: nearly exact, and nearly as fast as the separable models.

Fast time is a non-uniform Fourier transform whose points may move a little from lane to lane. A tone of x cells, sampled at
m = -N/2 ... N/2 - 1, is the transform of a window about x on a grid of M = 2 N cells, over the window's own transform. If the tone moves by
d cells, the window moves: w(x + d) = w + d w' + d^2 w'' / 2, with d small. So one set of window values serves many lanes (chirps, channels)
that have nearly the same frequency. The window is Kaiser and Bessel's (J. I. Jackson et al., IEEE Trans. Medical Imaging 10, 1991), as
polynomials.
"""

from __future__ import annotations

from dataclasses import astuple
from functools import cache, partial
from itertools import pairwise
from typing import Any, Final

import numpy as np
import scipy.fft
from numpy.polynomial import Chebyshev, Polynomial
from numpy.typing import NDArray
from scipy import special

from radar_core import ConfigError
from radar_sim.propagation.base import NEAR, Float64Array, Physics, Sampling
from radar_sim.propagation.kernels import N_STATE, aside, chunks, cosine, envelope_of, jit, packed, reduced, sine, stop, times
from radar_sim.scatterers import Echoes

_LANES = 512
"""Chirps times channels whose spectra are built at once."""
WIDTH: Final = 6
"""Cells of the grid that a tone is spread over; what folds back is then 1e-5 of it."""
_BETA = np.pi * WIDTH * 0.75
_DEGREE = 10


class Blocks:
    """Take range, its rate and acceleration, and directions from the middle of each block of chirps.

    From them follow, for every chirp and channel, the carrier's phase and the beat frequency. The phase is followed exactly; the frequency
    is that of the block's middle and the array's mean, departures from it (migration within the block, array squint) are followed to an
    order of Taylor's series. Fast time is one non-uniform transform per block, whose window values all chirps and channels share.

    Parameters
    ----------
    physics, sampling
        As for every model.
    blocks : int
        Parts of the frame; no more than it has chirps per transmitter.
    order : int
        0, 1 or 2; 2 also follows the change of frequency within a chirp.

    Raises
    ------
    ConfigError
        When there are more blocks than chirps.
    """

    def __init__(self, physics: Physics, sampling: Sampling, blocks: int = 4, order: int = 1) -> None:
        w = sampling.info.waveform
        if blocks > w.n_chirp:
            raise ConfigError(
                f"fidelity.blocks is {blocks}, but a frame has {w.n_chirp} chirps per transmitter; take at most as many blocks, or the "
                "model exact, which follows every chirp",
                key=("fidelity", "blocks"),
            )
        self._since, self._tx, self._rx, self._flags = sampling.since, sampling.tx, sampling.rx, astuple(physics)
        edges = np.rint(np.linspace(0, w.n_chirp, blocks + 1)).astype(int)
        self._parts = [slice(int(a), int(b)) for a, b in pairwise(edges)]
        self._shape = (w.n_tx, w.n_chirp, len(sampling.rx), w.n_sample)
        self._radar = (sampling.wave, self._flags, order, w.n_sample // 2 - w.n_sample / 2)
        self._window = polynomials()
        self._pick, self._undo = undo(w.n_sample)

    def process(self, echoes: Echoes, late: Float64Array | None = None) -> NDArray[np.complex64]:
        """Superpose echoes, as `Propagator.process`."""
        cube = np.zeros(self._shape, np.complex64)
        if not len(echoes):
            return cube
        # By range: neighbours then meet the same part of the grid.
        echoes = echoes.select(np.argsort(echoes.range, kind="stable"))
        out, back = packed(echoes.out), packed(echoes.back)
        when = times(self._since, late).T
        legs, sides = np.empty((2, N_STATE, len(echoes))), np.empty((len(self._tx) + len(self._rx) + 1, 2, len(echoes)))
        for part in self._parts:
            middle = float(self._since[part].mean())
            for leg, state in zip((out, back), legs, strict=True):
                stop(leg, middle, self._flags[3], state)
            for i, element in enumerate(self._tx):
                aside(legs[0], element, self._flags[4], sides[i])
            for i, element in enumerate(self._rx, len(self._tx)):
                aside(legs[1], element, self._flags[4], sides[i])
            sides[-1] = sides[: len(self._tx)].mean(0) + sides[len(self._tx) : -1].mean(0)
            for piece in chunks(part.stop - part.start, max(_LANES // (len(self._tx) * len(self._rx)), 1)):
                chirps = slice(part.start + piece.start, part.start + piece.stop)
                since = np.ascontiguousarray(when[:, chirps] - middle)
                cube[:, chirps] = self._chirps(echoes, (legs, sides, (out[9], back[9])), chirps, since)
        return cube

    def _chirps(self, echoes: Echoes, geometry: tuple[Any, Any, Any], chirps: slice, since: Float64Array) -> NDArray[np.complex64]:
        """Compute some chirps of a block, shape (tx, chirp, rx, sample); ``geometry``: legs, sides and lengths as of `spread`."""
        cells, (n_tx, n_chirp) = grid_cells(self._shape[3]), since.shape
        grid = np.zeros((cells + WIDTH, 2, n_tx, len(self._rx), n_chirp), np.float32)
        spread(*geometry, echoes.strength, envelope_of(echoes)[chirps], self._radar, since, self._window, grid)
        return self._samples(grid)

    def _samples(self, grid: NDArray[np.float32]) -> NDArray[np.complex64]:
        """Spectra of some chirps, shape (cell, 2, tx, rx, chirp), as samples, shape (tx, chirp, rx, sample)."""
        grid[:WIDTH] += grid[-WIDTH:]
        spectra = np.empty((len(grid) - WIDTH, *grid.shape[2:]), np.complex64)
        spectra.real, spectra.imag = grid[:-WIDTH, 0], grid[:-WIDTH, 1]
        samples = scipy.fft.ifft(spectra, axis=0, norm="forward", overwrite_x=True)[self._pick]
        samples *= self._undo[:, None, None, None]
        return np.asarray(samples.transpose(1, 3, 2, 0))


def window(y: Float64Array) -> Float64Array:
    """Value of the window ``y`` cells from its middle, at most half its width."""
    inside = np.sqrt(np.maximum(1 - (2 * y / WIDTH) ** 2, 0.0))
    return np.asarray(special.i0(_BETA * inside) / special.i0(_BETA))


def _cell(i: int, u: Float64Array) -> Float64Array:
    return window(u + (i - WIDTH / 2))


@cache
def polynomials() -> NDArray[np.float32]:
    """Window and its first two derivatives over the cells that it covers, shape (3, WIDTH, degree + 1), for Horner: highest power first.

    The argument is the distance of the first cell from the window's left end, 0 to 1; derivatives are with respect to the tone.
    """
    result = np.zeros((3, WIDTH, _DEGREE + 1), np.float32)
    for i in range(WIDTH):
        fit = Chebyshev.interpolate(partial(_cell, i), _DEGREE, domain=[0, 1]).convert(kind=Polynomial)
        for k, (sign, part) in enumerate(((1, fit), (-1, fit.deriv()), (1, fit.deriv(2)))):
            result[k, i, k:] = sign * part.coef[::-1]
    return result


def grid_cells(n_sample: int) -> int:
    """Cells of the grid: twice the samples, and no fewer than the window's two ends need."""
    return max(2 * n_sample, 2 * WIDTH)


def undo(n_sample: int) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """Where samples -n_sample // 2 ... are in the transform of the grid, and what takes the window off them."""
    m, cells = np.arange(n_sample) - n_sample // 2, grid_cells(n_sample)
    root = np.sqrt(_BETA**2 - (np.pi * WIDTH * m / cells) ** 2)
    return m % cells, (root * special.i0(_BETA) / (WIDTH * np.sinh(root))).astype(np.float32)


@jit
def window_values(polynomials: Any, order: Any, u: Any, values: Any) -> None:
    """Window and as many derivatives as the order asks for: ``values`` (3, WIDTH)."""
    for k in range(order + 1):
        for i in range(values.shape[1]):
            value = polynomials[k, i, 0]
            for p in range(1, polynomials.shape[2]):
                value = value * u + polynomials[k, i, p]
            values[k, i] = value


@jit
def add_window(values: Any, order: Any, lanes: Any, grid: Any, row: Any) -> None:
    """Add lanes (3, n) to WIDTH rows of the grid (cells, n), weighted by window and derivatives."""
    for i in range(WIDTH):
        a, b, c = values[0, i], values[1, i], values[2, i]
        if order == 0:
            for n in range(lanes.shape[1]):
                grid[row + i, n] += a * lanes[0, n]
        elif order == 1:
            for n in range(lanes.shape[1]):
                grid[row + i, n] += a * lanes[0, n] + b * lanes[1, n]
        else:
            for n in range(lanes.shape[1]):
                grid[row + i, n] += a * lanes[0, n] + b * lanes[1, n] + c * lanes[2, n]


@jit
def lane(turn: Any, shift: Any, weight: Any, since: Any, t: Any, v: Any, plans: Any) -> None:
    """Phase [turns], departure in frequency [cells] and amplitude of some chirps of channel v: ``plans[:, v]`` of (3, channels, chirps).

    ``turn`` (3), ``shift`` (2) and ``weight`` (2) are their polynomials in the time from the block's middle.
    """
    t0, t1, t2 = turn
    d0, d1 = shift
    w0, w1 = weight
    for c in range(since.shape[1]):
        s = since[t, c]
        plans[0, v, c] = reduced(t0 + s * (t1 + s * t2))
        plans[1, v, c] = d0 + s * d1
        plans[2, v, c] = w0 + s * w1


@jit
def launch(plans: Any, volts: Any, bend: Any, order: Any, lanes: Any) -> None:
    """Phasors times powers of their departure in frequency, ``lanes`` (3, 2, n), from ``plans`` (3, n)."""
    re, im = np.float32(volts.real), np.float32(volts.imag)
    for n in range(plans.shape[1]):
        x, w = plans[0, n], plans[2, n]
        a, b = w * cosine(x), w * sine(x)
        lanes[0, 0, n], lanes[0, 1, n] = a * re - b * im, a * im + b * re
    if order == 1:
        for n in range(plans.shape[1]):
            d = plans[1, n]
            lanes[1, 0, n], lanes[1, 1, n] = d * lanes[0, 0, n], d * lanes[0, 1, n]
    elif order == 2:
        for n in range(plans.shape[1]):
            d, x, y = plans[1, n], lanes[0, 0, n], lanes[0, 1, n]
            square = np.float32(0.5) * d * d
            lanes[1, 0, n], lanes[1, 1, n] = d * x, d * y
            lanes[2, 0, n], lanes[2, 1, n] = square * x + bend * y, square * y - bend * x


@jit
def spread(legs: Any, sides: Any, lengths: Any, strength: Any, envelope: Any, radar: Any, since: Any, polynomials: Any, grid: Any) -> None:
    """Add echoes to the spectra of some chirps of a block.

    Parameters
    ----------
    legs : ndarray, shape (2, N_STATE, n)
        Legs out and back in the block's middle.
    sides : ndarray, shape (n_tx + n_rx + 1, 2, n)
        By how much legs to the elements are longer, and the rates of that; in the end the means over all channels [m, m/s].
    lengths : tuple of ndarray, shape (n,)
        Of legs out and back in the middle of the frame [m].
    strength, envelope
        As for `radar_sim.propagation.exact.superpose`; the envelope of these chirps.
    radar : tuple
        Wave and flags as for `radar_sim.propagation.exact.superpose`; order to which departures in frequency are followed; by how much
        sample n_sample // 2 is from the middle of the chirp [samples].
    since : ndarray, shape (n_tx, n_chirp)
        Times of the chirps from the block's middle [s].
    polynomials : ndarray of float32, shape (3, WIDTH, degree + 1)
        Of `polynomials`.
    grid : ndarray of float32, shape (cells + WIDTH, 2, tx, rx, chirp)
        Spectra, real and imaginary, to be added to.
    """
    wave, flags, taylor, offset = radar
    carrier, slope, per_c, step = wave
    migration, doppler, squint = flags[0], flags[1], flags[2]
    _, _, n_tx, n_rx, n_chirp = grid.shape
    cells = len(grid) - WIDTH
    flat = grid.reshape(len(grid), -1)
    plans = np.empty((3, n_tx * n_rx, n_chirp), np.float32)
    lanes, values = np.empty((3, 2, n_tx * n_rx * n_chirp), np.float32), np.empty((3, WIDTH), np.float32)
    flat_plans, flat_lanes = plans.reshape(3, -1), lanes.reshape(3, -1)
    for j in range(len(strength)):
        path, rate, half = legs[0, 0, j] + legs[1, 0, j], legs[0, 1, j] + legs[1, 1, j], legs[0, 2, j] + legs[1, 2, j]
        beat, drift = (path, rate) if migration else (lengths[0][j] + lengths[1][j], 0.0)
        mean, turning = sides[-1, 0, j], sides[-1, 1, j]
        frequency = slope * (beat + mean if squint else beat)
        bend = 0.0
        if doppler:
            frequency += carrier * (rate + turning) - slope * per_c * beat * drift
            bend = (carrier * half + slope * drift) * (step * cells) ** 2 / (2 * np.pi)
        x = step * frequency * cells
        x -= cells * np.floor(x / cells)
        first = np.ceil(x - 0.5 * WIDTH)
        window_values(polynomials, taylor, np.float32(first - (x - 0.5 * WIDTH)), values)
        weight = fading(legs, lengths, j, migration)
        for t in range(n_tx):
            for i in range(n_rx):
                side, turn = sides[t, 0, j] + sides[n_tx + i, 0, j], sides[t, 1, j] + sides[n_tx + i, 1, j]
                whole = beat + side if squint else beat
                t0 = carrier * (path + side) - 0.5 * slope * per_c * whole * whole
                t1 = carrier * (rate + turn) - slope * per_c * whole * drift
                d0 = slope * (side - mean) if squint else 0.0
                d1 = slope * drift
                if doppler:
                    d0 += carrier * (turn - turning)
                    d1 += 2 * carrier * half
                turns = (t0 + offset * step * (frequency + d0), t1 + offset * step * d1, carrier * half)
                shift = (step * cells * d0, step * cells * d1)
                lane(turns, shift, weight, since, t, t * n_rx + i, plans)
        if envelope.size:
            fade(envelope, j, plans)
        launch(flat_plans, strength[j], np.float32(bend), taylor, lanes)
        add_window(values, taylor, flat_lanes, flat, int(first) % cells)


@jit
def fading(legs: Any, lengths: Any, j: Any, follows: Any) -> Any:
    """Amplitude over strength in the block's middle and its rate [1/m^2, 1/m^2/s]."""
    if not follows:
        return 1 / (max(lengths[0][j], NEAR) * max(lengths[1][j], NEAR)), 0.0
    out, back = max(legs[0, 0, j], NEAR), max(legs[1, 0, j], NEAR)
    weight = 1 / (out * back)
    rate = (legs[0, 1, j] / out if out > NEAR else 0.0) + (legs[1, 1, j] / back if back > NEAR else 0.0)
    return weight, -weight * rate


@jit
def fade(envelope: Any, j: Any, plans: Any) -> None:
    """Multiply amplitudes ``plans[2]`` (channels, chirps) by the envelope of echo j."""
    per_tx = plans.shape[1] // envelope.shape[1]
    for v in range(plans.shape[1]):
        for c in range(plans.shape[2]):
            plans[2, v, c] *= envelope[c, v // per_tx, j]
