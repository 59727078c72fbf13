"""What short words cost the Fourier transforms in integers (thesis, figure A.13); docs/research/make_fixed_point_plot.py draws it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from radar_dsp.fixed_point import FixedFft, Window
from radar_dsp.windows import Shape, make_window


@dataclass(frozen=True)
class WordLengthError:
    """What one word length costs."""

    word_length: int  # bits of a real or imaginary word
    floor: float  # mean power of the error over the cells beside a strong echo alone in the frame, relative to the echo's peak [dB]
    spur: float  # the largest error among those cells, relative to the echo's peak [dB]
    # how much of its signal-to-noise ratio a target near the noise floor loses, for each of the levels asked for [dB]
    snr_loss: tuple[float, ...]


def word_length_error(word_length: int, levels: tuple[float, ...], *, size: int = 64, n_trial: int = 64, seed: int = 0) -> WordLengthError:
    """Measure the error of a word of 8 to 16 bits with the default windows on a square frame, over channels of random noise and phases.

    ``levels``: powers of the strongest echo in the frame over the noise, both in a raw sample [dB]: what the word has to span.
    """
    floor, spur = _spurs(word_length, size, n_trial, np.random.default_rng([seed, 1]))
    losses = tuple(_snr_loss(word_length, level, size, n_trial, np.random.default_rng([seed, 2])) for level in levels)
    return WordLengthError(word_length, floor, spur, losses)


def _windows(size: int) -> tuple[Window, Window]:
    return make_window("hann", size), make_window("nuttall", size)


def _both(word_length: int, cube: NDArray[np.complex64]) -> tuple[NDArray[np.complex64], NDArray[np.complex128]]:
    """Transform a frame in integers and in double precision."""
    size = cube.shape[-1]
    speed, distance = _windows(size)
    shape: Shape = (1, size, cube.shape[2], size)
    exact = scipy.fft.fft2(cube.astype(np.complex128) * speed[:, None, None] * distance, axes=(1, 3))
    return FixedFft(word_length, shape, speed, distance).process(cube), exact


def _tone(size: int, speed: Any, distance: Any, phase: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Make unit echoes at fractional cells, one per trial, shape (1, chirp, trial, sample)."""
    i = np.arange(size) / size
    speed, distance = np.broadcast_to(speed, phase.shape), np.broadcast_to(distance, phase.shape)
    turns = np.multiply.outer(i, speed)[:, :, None] + np.multiply.outer(distance, i)
    tone: NDArray[np.complex128] = np.exp(2j * np.pi * (turns + phase[:, None]))[None]
    return tone


def _spurs(word_length: int, size: int, n_trial: int, rng: np.random.Generator) -> tuple[float, float]:
    speed, distance, phase = rng.uniform(0, size, n_trial), rng.uniform(0, size, n_trial), rng.uniform(0, 1, n_trial)
    # Just below a power of two, so that the echo fills the word.
    fixed, exact = _both(word_length, (0.95 * _tone(size, speed, distance, phase)).astype(np.complex64))
    error, peak = np.abs(fixed - exact) ** 2, (np.abs(exact) ** 2).max(axis=(1, 3), keepdims=True)
    cell = np.arange(size)
    away = [np.abs((cell - at[:, None] + size / 2) % size - size / 2) > 5 for at in (speed, distance)]
    # The main lobe is left out: an error there is a change of gain, not a spur.
    beside = (away[0].T[:, :, None] | away[1][None])[None]
    relative = (error / peak)[beside]
    return 10 * math.log10(relative.mean()), 10 * math.log10(relative.max())


def _snr_loss(word_length: int, level: float, size: int, n_trial: int, rng: np.random.Generator) -> float:
    """Of a target 13 dB above the noise in its cell; the strong echo stands still near zero range, as leakage does."""
    speed, distance = _windows(size)
    cell, phase = (size // 4, size // 2), rng.uniform(0, 1, (2, n_trial))
    noise = rng.standard_normal((1, size, n_trial, size, 2)) @ np.array([1, 1j]) * math.sqrt(0.5)
    strong = 10 ** (level / 20) * _tone(size, 0.0, 0.3, phase[0])
    target = 10 ** (13 / 20) / (speed.sum() * distance.sum()) * _tone(size, *cell, phase[1])
    cube = (noise + strong + target).astype(np.complex64)
    wanted = np.exp(2j * np.pi * phase[1])
    snr = []
    for spectrum in _both(word_length, cube):
        value = spectrum[0, cell[0], :, cell[1]] * wanted.conj()
        gain = value.mean()
        snr.append(abs(gain) ** 2 / np.mean(np.abs(value - gain) ** 2))
    return float(10 * np.log10(snr[1] / snr[0]))
