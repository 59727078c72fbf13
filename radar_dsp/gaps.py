"""Chirps that a device lost, filled in from the other chirps of the same transmitter.

A lost chirp that stays zero takes the term ``w_m a`` out of the transform over the chirps, for an echo of amplitude a and a window w:
``|w_m a|^2`` is spread over all Doppler cells, against a peak of ``|a sum(w)|^2``. Behind a Hann window of 64 chirps a lost chirp in the
middle leaves a floor 30 dB below the peak. A chirp filled in with a relative error e leaves ``|e|^2`` of that.

- ``zero``: the chirps stay zero.
- ``cubic``: the polynomial through the four nearest chirps. Its error grows with the fourth power of the phase step from chirp to chirp, so
  it suits echoes below a fifth of the unambiguous speed, and makes those of faster echoes worse than zero does.
- ``autoregressive``: linear prediction from both sides. In a range cell the chirps are a few echoes of constant speed, and p of them obey
  ``x[n] + h[1] x[n-1] + ... + h[p] x[n-p] = 0`` exactly, at any speed. The coefficients of each range cell come from the chirps that are
  there, of all channels, forward and backward (modified covariance method: Marple, "Digital Spectral Analysis", 1987, chapter 8); the lost
  chirps are those with the least prediction errors (Janssen, Veldhuis and Vries, "Adaptive interpolation of discrete-time signals that can
  be modeled as autoregressive processes", IEEE Trans. ASSP 34, 1986).
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from radar_core import RadarInfo, known_symbols
from radar_dsp.config import Missing
from radar_dsp.kernels import cholesky, solve
from radar_dsp.spectrum import normalise

Cube = NDArray[np.complex64]
Mask = NDArray[np.bool_]
Complexes = NDArray[np.complex128]

ORDER = 6  # most coefficients of the prediction: a person's parts in one range cell, and what leaks from others
MOST_LOST = 0.5  # largest share of a transmitter's chirps that is filled in: beyond it there is more guessed than measured
LONGEST = 0.25  # longest gap, as a share of a transmitter's chirps, over which a person's movement can be predicted to about the noise
_PIVOTS = (1e-14, 1e-300)  # least pivots, see `kernels.cholesky`
LOADING = 1e-9  # diagonal loading of the equations, relative to the power of the cell: far below the noise beside the strongest coupling


class Gaps:
    """Fill in the chirps that a device lost, by one of the methods of this module."""

    def __init__(self, method: Missing, info: RadarInfo) -> None:
        self._method, self._shape = method, info.cube_shape
        # OFDM: each symbol carries another code, so only what the channel did to the carriers goes on from symbol to symbol.
        self._symbols = known_symbols(info.waveform)[:, :, None, :] if info.waveform.modulation == "ofdm" else None

    def process(self, cube: Cube, missing: NDArray[np.uint32]) -> bool:
        """Fill in lost chirps.

        Parameters
        ----------
        cube : ndarray of complex64, shape (n_tx, n_chirp, n_rx, n_sample)
            Raw samples, C-contiguous; the lost chirps are overwritten. A transmitter that lost more than half of its chirps gets zeros
            there. So does a frame with a non-finite sample, which is refused where its powers are looked at.
        missing : ndarray of uint32, shape (n_missing,)
            Numbers ``l * n_tx + t`` of the lost chirps, as in `RadarFrame`.

        Returns
        -------
        bool
            Whether the points can be relied on: no transmitter lost more than half of its chirps, or more than a quarter in a row.
        """
        n_tx, n_chirp = self._shape[:2]
        lost = np.zeros((n_tx, n_chirp), np.bool_)
        lost[missing % n_tx, missing // n_tx] = True
        cube[lost] = 0
        filled = lost.mean(axis=1) <= MOST_LOST
        reliable = bool(filled.all()) and max(map(longest_gap, lost)) <= LONGEST * n_chirp
        wanted = lost & filled[:, None]
        if self._method == "zero" or not wanted.any():
            return reliable
        samples = cube.view(np.float32)
        peak = max(float(samples.max()), -float(samples.min()))
        if np.isfinite(peak) and peak > 0.0:
            scaled, exponent = normalise(cube, peak)
            found = self._fill(scaled, wanted, lost)
            cube[wanted] = np.ldexp(found.view(np.float32), exponent).view(np.complex64) if exponent else found
        return reliable

    def _fill(self, cube: Cube, wanted: Mask, lost: Mask) -> Cube:
        """Find the samples of the wanted chirps, shape (n_wanted, n_rx, n_sample)."""
        if self._symbols is not None:
            cube = scipy.fft.ifft(cube, axis=3, norm="ortho", workers=1) * self._symbols
        found = cubic(cube, wanted, lost) if self._method == "cubic" else autoregressive(cube, wanted, lost)
        if self._symbols is not None:
            symbols = np.broadcast_to(self._symbols, (*lost.shape, 1, self._shape[3]))[wanted]
            found = scipy.fft.fft(found * symbols.conj(), axis=2, norm="ortho", workers=1)
        return np.ascontiguousarray(found, np.complex64)


def longest_gap(lost: Mask) -> int:
    """Longest run of lost chirps of one transmitter; ``lost`` of shape (n_chirp,)."""
    edges = np.flatnonzero(np.diff(lost.astype(np.int8), prepend=0, append=0))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


def cubic(cube: Cube, wanted: Mask, lost: Mask) -> Cube:
    """Lost chirps on the polynomial through the four nearest ones of their transmitter; beyond the first or last of them, that one.

    ``wanted`` and ``lost``, shape (n_tx, n_chirp), say which chirps of ``cube`` (n_tx, n_chirp, n_rx, n_sample) to find, and which to find
    none from. The result, shape (n_wanted, n_rx, n_sample), is in the order of the transmitters, then the chirps.
    """
    found = np.empty((int(wanted.sum()), *cube.shape[2:]), np.complex64)
    for i, (tx, chirp) in enumerate(np.argwhere(wanted)):
        kept = np.flatnonzero(~lost[tx])
        first = min(max(int(np.searchsorted(kept, chirp)) - 2, 0), max(len(kept) - 4, 0))
        nodes = kept[first : first + 4] if kept[0] < chirp < kept[-1] else kept[[0 if chirp < kept[0] else -1]]
        weight = [np.prod([(chirp - other) / (node - other) for other in nodes if other != node]) for node in nodes]
        found[i] = np.tensordot(np.array(weight, np.float32), cube[tx, nodes], 1)
    return found


def autoregressive(cube: Cube, wanted: Mask, lost: Mask) -> Cube:
    """Lost chirps by linear prediction, range cell by range cell; parameters and result as `cubic`.

    Where the gaps leave too few complete stretches for `ORDER` coefficients, there are fewer; where they leave not even two chirps side
    by side, the chirps stay zero.
    """
    profile = scipy.fft.fft(cube, axis=3, norm="ortho", workers=1)
    order = usable_order(lost)
    if order == 0:
        return np.zeros((int(wanted.sum()), *cube.shape[2:]), np.complex64)
    real, imag = (np.ascontiguousarray(part, np.float64) for part in (profile.real, profile.imag))
    moments = covariance(real, imag, lost, order)
    place = np.argwhere(wanted)
    found = fill_in(real, imag, moments[0] + 1j * moments[1], place[:, 0], place[:, 1], LOADING)
    return np.asarray(scipy.fft.ifft(found.astype(np.complex64), axis=2, norm="ortho", workers=1))


def usable_order(lost: Mask) -> int:
    """Most coefficients, up to `ORDER` and a quarter of the chirps, for which there are twice as many stretches without a gap."""
    n_chirp = lost.shape[1]
    for order in range(min(ORDER, max(n_chirp // 4, 1), n_chirp - 1), 0, -1):
        stretches = sum(int(np.sum(np.convolve(row, np.ones(order + 1, np.intp), "valid") == 0)) for row in lost)
        if stretches >= min(2 * order, n_chirp - order):
            return order
    return 0


@numba.njit(cache=True, nogil=True)
def covariance(real: Any, imag: Any, lost: Any, order: int) -> Any:
    """Moments R[i, j] = sum of conj(x[n-i]) x[n-j] over all stretches without a gap, all channels, forward and backward.

    ``real`` and ``imag`` are range profiles, shape (n_tx, n_chirp, n_rx, n_range); chirps that are ``lost`` (n_tx, n_chirp) count for
    nothing. Gives real and imaginary parts, shape (2, order + 1, order + 1, n_range); Hermitian.
    """
    n_tx, n_chirp, n_rx, n_range = real.shape
    forward = np.zeros((2, order + 1, order + 1, n_range))
    for t in range(n_tx):
        for n in range(order, n_chirp):
            if np.any(lost[t, n - order : n + 1]):
                continue
            for rx in range(n_rx):
                for i in range(order + 1):
                    ar, ai = real[t, n - i, rx], imag[t, n - i, rx]
                    for j in range(i + 1):
                        br, bi = real[t, n - j, rx], imag[t, n - j, rx]
                        re, im = forward[0, i, j], forward[1, i, j]
                        for r in range(n_range):
                            re[r] += ar[r] * br[r] + ai[r] * bi[r]
                            im[r] += ar[r] * bi[r] - ai[r] * br[r]
    both = np.empty((2, order + 1, order + 1, n_range))
    for i in range(order + 1):
        for j in range(i + 1):
            # A stretch read backward and conjugated obeys the same equation.
            for r in range(n_range):
                both[0, i, j, r] = both[0, j, i, r] = forward[0, i, j, r] + forward[0, order - j, order - i, r]
                both[1, i, j, r] = forward[1, i, j, r] + forward[1, order - j, order - i, r]
                both[1, j, i, r] = -both[1, i, j, r]
    return both


@numba.njit(cache=True, nogil=True)
def coefficients(moments: Any, loading: float) -> Any:
    """Prediction-error filter of one range cell, h[0] = 1, shape (order + 1,); ``moments`` of shape (order + 1, order + 1)."""
    order = moments.shape[0] - 1
    power = 0.0
    for i in range(order + 1):
        power += moments[i, i].real / (order + 1)
    matrix, right = np.empty((order, order), np.complex128), np.empty((order, 1), np.complex128)
    for i in range(order):
        for j in range(order):
            matrix[i, j] = moments[i + 1, j + 1]
        matrix[i, i] += loading * power
        right[i, 0] = -moments[i + 1, 0]
    cholesky(matrix, *_PIVOTS)
    solve(matrix, right)
    h = np.ones(order + 1, np.complex128)
    h[1:] = right[:, 0]
    return h


@numba.njit(cache=True, nogil=True)
def weight(h: Any, n_chirp: int, m: int, k: int) -> Any:
    """Entry (m, k) of the quadratic form of all prediction errors of a transmitter, forward and backward."""
    order = len(h) - 1
    total = 0j
    for n in range(max(m, k, order), min(m, k, n_chirp - 1 - order) + order + 1):
        total += np.conj(h[n - m]) * h[n - k]
    for n in range(max(m, k) - order, min(m, k) + 1):
        if 0 <= n < n_chirp - order:
            total += h[m - n] * np.conj(h[k - n])
    return total


@numba.njit(cache=True, nogil=True)
def fill_in(real: Any, imag: Any, moments: Any, tx: Any, chirp: Any, loading: float) -> Any:
    """Range profiles of lost chirps that give the least prediction errors, shape (n_wanted, n_rx, n_range).

    Parameters
    ----------
    real, imag : ndarray of float64, shape (n_tx, n_chirp, n_rx, n_range)
        Range profiles, zero where a chirp is lost.
    moments : ndarray of complex128, shape (order + 1, order + 1, n_range)
        Of `covariance`.
    tx, chirp : ndarray of intp, shape (n_wanted,)
        Chirps to find, ordered by transmitter.
    loading : float
        Relative to the power of the cell.
    """
    n_chirp, n_rx, n_range = real.shape[1:]
    order = moments.shape[0] - 1
    found = np.zeros((len(tx), n_rx, n_range), np.complex128)
    for r in range(n_range):
        h = coefficients(moments[:, :, r], loading)
        start = 0
        while start < len(tx):
            stop = start
            while stop < len(tx) and tx[stop] == tx[start]:
                stop += 1
            own = chirp[start:stop]
            matrix, right = np.zeros((len(own), len(own)), np.complex128), np.zeros((len(own), n_rx), np.complex128)
            for i in range(len(own)):
                for j in range(len(own)):
                    if abs(own[i] - own[j]) <= order:
                        matrix[i, j] = weight(h, n_chirp, own[i], own[j])
                for k in range(max(own[i] - order, 0), min(own[i] + order, n_chirp - 1) + 1):
                    factor = weight(h, n_chirp, own[i], k)
                    for rx in range(n_rx):  # lost chirps are zero and add nothing
                        right[i, rx] -= factor * complex(real[tx[start], k, rx, r], imag[tx[start], k, rx, r])
            cholesky(matrix, *_PIVOTS)
            solve(matrix, right)
            found[start:stop, :, r] = right
            start = stop
    return found
