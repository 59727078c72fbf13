"""The two Fourier transforms of a frame in integers, as an FPGA or ASIC computes them, and what short words cost (thesis, figure A.13).

All data are words of 8 to 16 bits for the real and for the imaginary part, held in int16. Each transform is radix 2, decimation in time,
with block floating point (Oppenheim and Weinstein, "Effects of finite register length in digital filters and the fast Fourier transform",
1972): the words of a block share one exponent. Before each stage the largest word says by how much the stage has to be scaled down so that
nothing overflows. A butterfly adds in full precision and is rounded once, to the nearest word and ties to the even one: rounding ties up
would leave a constant, which the next stages gather into a spur. Windows and twiddle factors have the same word length; ones need no
multiplier, so they are exact.

1. The frame is scaled by a power of two, so that its largest part fills the word.
2. Every chirp is scaled up to fill the word, weighted, and transformed.
3. The chirps of a channel are brought to their largest exponent, since the next transform adds them up. This is where a strong echo drives
weak ones in other range cells towards the last bit.
4. The same as 2 for every range cell, over the chirps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError
from radar_dsp.windows import Shape, wrong_shape

Words = NDArray[np.int16]
Window = NDArray[np.float64]

EMPTY = -4096  # exponent of a block of zeros: below all others, so that it does not decide when blocks are aligned
GROWTH = 2490  # 1/1024 of how much a butterfly can grow a part: 1 + sqrt(2), and the twiddle factor's rounding at 8 bits


@dataclass(frozen=True, eq=False)
class Plan:
    """Tables of one transform length, as an FPGA holds them in its memory.

    Attributes
    ----------
    bits : int
        Word length.
    window : ndarray of int32, shape (n,)
        Window over its largest value, ``scale``, times 2^(bits - 1).
    cosine, sine : ndarray of int32, shape (n // 2,)
        Twiddle factors exp(-j 2 pi k / n), times 2^(bits - 1).
    order : ndarray of intp, shape (n,)
        Bit-reversed order of the input.
    """

    bits: int
    window: NDArray[np.int32]
    scale: float
    cosine: NDArray[np.int32]
    sine: NDArray[np.int32]
    order: NDArray[np.intp]


def make_plan(bits: int, window: Window) -> Plan:
    """Make the tables for windowed transforms of ``len(window)`` values; `ConfigError` when that is not a power of two."""
    n = len(window)
    if n & (n - 1):
        raise ConfigError(
            f"SpectrumConfig.fft is 'fixed', which transforms powers of two only, but the waveform has {n} samples or chirps; "
            f"use {1 << (n.bit_length() - 1)} or {1 << n.bit_length()}, or choose fft 'scipy'"
        )
    scale = float(np.abs(window).max())
    turn = np.exp(-2j * np.pi * np.arange(n // 2) / n)
    one = 1 << (bits - 1)
    order = np.zeros(n, np.intp)
    for i in range(n.bit_length() - 1):
        order |= ((np.arange(n) >> i) & 1) << (n.bit_length() - 2 - i)
    window_words, cosine, sine = (np.rint(values * one).astype(np.int32) for values in (window / scale, turn.real, turn.imag))
    return Plan(bits, window_words, scale, cosine, sine, order)


class FixedFft:
    """Back end `radar_dsp.fft.Fft` in integers.

    Parameters
    ----------
    word_length : int
        Bits of the real and of the imaginary word, 8 to 16 (`ConfigError`: it is not).
    shape : tuple of int
        Of the frames, (n_tx, n_chirp, n_rx, n_sample); a `ConfigError` says that one of the lengths to transform is not a power of two.
    speed_window, range_window : ndarray, shape (n_chirp,) and (n_sample,)
        Windows.
    """

    def __init__(self, word_length: int, shape: Shape, speed_window: Window, range_window: Window) -> None:
        if not 8 <= word_length <= 16:
            raise ConfigError(f"SpectrumConfig.word_length is {word_length}; choose 8 to 16 bits")
        self._bits, self._shape = word_length, shape
        self._speed, self._range = make_plan(word_length, speed_window), make_plan(word_length, range_window)
        self._scale = self._speed.scale * self._range.scale

    def process(self, cube: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Window and transform a frame; see `radar_dsp.fft.Fft.process`."""
        if cube.shape != self._shape:
            raise wrong_shape(cube.shape, self._shape)
        if not np.isfinite(cube).all():
            return np.full(cube.shape, np.nan, np.complex64)  # integers have no NaN: it must not look like an echo
        n_tx, n_chirp, n_rx, n_range = self._shape
        real, imag, exponent = quantise(cube.transpose(0, 2, 1, 3).reshape(n_tx * n_rx, n_chirp, n_range), self._bits)
        exponents = np.full(real.shape[:2], exponent, np.int64)
        self._pass(real, imag, exponents, self._range)
        real, imag, exponent_of = align(real, imag, exponents)
        real, imag = (np.ascontiguousarray(words.transpose(0, 2, 1)) for words in (real, imag))
        exponents = np.repeat(exponent_of[:, None], n_range, axis=1)
        self._pass(real, imag, exponents, self._speed)
        unit = np.ldexp(self._scale, exponents)[:, :, None]
        spectrum = np.empty(real.shape, np.complex64)
        spectrum.real, spectrum.imag = real * unit, imag * unit
        return np.ascontiguousarray(spectrum.reshape(n_tx, n_rx, n_range, n_chirp).transpose(0, 3, 1, 2))

    def _pass(self, real: Words, imag: Words, exponents: NDArray[np.int64], plan: Plan) -> None:
        n = real.shape[-1]
        lines = (real.reshape(-1, n), imag.reshape(-1, n), exponents.reshape(-1))
        transform(*lines, plan.bits, plan.window, plan.cosine, plan.sine, plan.order)


def quantise(values: NDArray[np.complex64], bits: int) -> tuple[Words, Words, int]:
    """Turn values into words that share one exponent: real parts, imaginary parts and e, values = words * 2^e."""
    parts = np.ascontiguousarray(values).view(np.float32)
    exponent = int(np.frexp(np.abs(parts).max())[1]) - (bits - 1)
    limit = (1 << (bits - 1)) - 1
    words = np.clip(np.rint(np.ldexp(parts, -exponent)), -limit, limit).astype(np.int16)
    return np.ascontiguousarray(words[..., 0::2]), np.ascontiguousarray(words[..., 1::2]), exponent


def align(real: Words, imag: Words, exponents: NDArray[np.int64]) -> tuple[Words, Words, NDArray[np.int64]]:
    """Bring the lines (block, line, word) of a block to the largest of their exponents (block, line), which is the third result."""
    top: NDArray[np.int64] = exponents.max(axis=1)
    shift = np.minimum(top[:, None] - exponents, 24)[:, :, None]
    as16 = [round_shift(words.astype(np.int64), shift).astype(np.int16) for words in (real, imag)]
    return as16[0], as16[1], top


def round_shift(value: Any, shift: Any) -> Any:
    """``value / 2^shift`` to the nearest integer, ties to the even one."""
    half = (1 << shift) >> 1
    return np.where(np.equal(shift, 0), value, (value + half - 1 + ((value >> shift) & 1)) >> shift)


@numba.njit(cache=True, nogil=True)
def _shift_right(value: Any, shift: Any) -> Any:
    if shift == 0:
        return value
    return (value + (1 << (shift - 1)) - 1 + ((value >> shift) & 1)) >> shift


@numba.njit(cache=True, nogil=True)
def _peak(re: Any, im: Any) -> Any:
    peak = 0
    for i in range(len(re)):
        peak = max(peak, abs(re[i]), abs(im[i]))
    return peak


@numba.njit(cache=True, nogil=True)
def _stage(re: Any, im: Any, half: int, q: int, down: int, cosine: Any, sine: Any) -> None:
    """Butterflies of one stage; sums in full precision, rounded once."""
    n = len(re)
    step = n // (2 * half)
    for k in range(half):
        c, s = np.int64(cosine[k * step]), np.int64(sine[k * step])
        for a in range(k, n, 2 * half):
            b = a + half
            tr, ti = re[b] * c - im[b] * s, re[b] * s + im[b] * c
            ar, ai = re[a] << q, im[a] << q
            re[a], im[a] = _shift_right(ar + tr, down), _shift_right(ai + ti, down)
            re[b], im[b] = _shift_right(ar - tr, down), _shift_right(ai - ti, down)


@numba.njit(cache=True, nogil=True)
def transform(real: Any, imag: Any, exponents: Any, bits: int, window: Any, cosine: Any, sine: Any, order: Any) -> None:
    """Weight and transform lines of words in place, with the tables of a `Plan`.

    Parameters
    ----------
    real, imag : ndarray of int16, shape (n_line, n)
        Words; replaced by their transforms.
    exponents : ndarray of int64, shape (n_line,)
        Of each line, value = word * 2^exponent; updated.
    """
    n_line, n = real.shape
    limit, q = (1 << (bits - 1)) - 1, bits - 1
    re, im = np.empty(n, np.int64), np.empty(n, np.int64)
    for line in range(n_line):
        for i in range(n):
            re[i], im[i] = real[line, i], imag[line, i]
        peak = _peak(re, im)
        if peak == 0:
            exponents[line] = EMPTY
            continue
        room = 0
        while (peak << (room + 1)) <= limit:
            room += 1
        for i in range(n):
            k = order[i]
            re[i] = _shift_right((np.int64(real[line, k]) << room) * window[k], q)
            im[i] = _shift_right((np.int64(imag[line, k]) << room) * window[k], q)
        exponent, half = exponents[line] - room, 1
        while half < n:
            reach = (_peak(re, im) * (2048 if half <= 2 else GROWTH)) >> 10
            shift = 2 if reach > 2 * limit else (1 if reach > limit else 0)
            exponent += shift
            _stage(re, im, half, q, q + shift, cosine, sine)
            half *= 2
        exponents[line] = exponent if _peak(re, im) > 0 else EMPTY
        for i in range(n):
            real[line, i], imag[line, i] = re[i], im[i]
