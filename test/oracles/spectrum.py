"""Static removal and integer transforms in plain numpy: what `radar_dsp.spectrum` and `radar_dsp.fixed_point` have to equal."""

import numpy as np
from numpy.typing import NDArray

from radar_dsp.fixed_point import EMPTY, GROWTH, Words, round_shift
from radar_dsp.spectrum import Cube


def remove_static(cube: Cube) -> Cube:
    """Equal `remove_static`, in numpy."""
    seen = cube.any(axis=(2, 3), keepdims=True)
    mean = cube.sum(axis=1, keepdims=True, dtype=np.complex128) / np.maximum(seen.sum(axis=1, keepdims=True), 1)
    still: Cube = cube - mean.astype(np.complex64) * seen
    return still


def transform(
    real: Words,
    imag: Words,
    exponents: NDArray[np.int64],
    bits: int,
    window: NDArray[np.int32],
    cosine: NDArray[np.int32],
    sine: NDArray[np.int32],
    order: NDArray[np.intp],
) -> None:
    """Weight and transform lines of words in place.

    Parameters
    ----------
    real, imag : ndarray of int16, shape (n_line, n)
        Words; replaced by their transforms.
    exponents : ndarray of int64, shape (n_line,)
        Of each line, value = word * 2^exponent; updated.
    bits, window, cosine, sine, order
        As in `Plan`.
    """
    n_line, n = real.shape
    limit, q = (1 << (bits - 1)) - 1, bits - 1
    peak = np.maximum(np.abs(real.astype(np.int64)), np.abs(imag.astype(np.int64))).max(axis=1)
    room = np.where(peak == 0, 0, bits - 1 - np.frexp(peak.astype(np.float64))[1])
    exponents -= room
    parts = [round_shift((words.astype(np.int64) << room[:, None]) * window, q)[:, order] for words in (real, imag)]
    half = 1
    while half < n:
        peak = np.maximum(np.abs(parts[0]), np.abs(parts[1])).max(axis=1)
        reach = (peak * (2048 if half <= 2 else GROWTH)) >> 10
        shift = (reach > limit).astype(np.int64) + (reach > 2 * limit)
        exponents += shift
        c, s = (table[:: n // (2 * half)].astype(np.int64) for table in (cosine, sine))
        (ar, br), (ai, bi) = ((p.reshape(n_line, -1, 2, half)[:, :, 0], p.reshape(n_line, -1, 2, half)[:, :, 1]) for p in parts)
        tr, ti = br * c - bi * s, br * s + bi * c
        sums = [np.stack([(a << q) + t, (a << q) - t], axis=2).reshape(n_line, n) for a, t in ((ar, tr), (ai, ti))]
        parts = [round_shift(total, q + shift[:, None]) for total in sums]
        half *= 2
    exponents[(parts[0] == 0).all(axis=1) & (parts[1] == 0).all(axis=1)] = EMPTY
    real[...], imag[...] = parts
