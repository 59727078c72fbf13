"""Noise, leakage and saturation from raw frames."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import RadarFrame, RadarInfo

Float64Array = NDArray[np.float64]

_KEPT: Final = 32  # frames whose spectra count, evenly spread over all: more do not make a median much better
_EMPTY: Final = 0.01  # of the upper quartile: range bins with less hold no noise, as the upper half of a filtered or analytic signal
_NEAR: Final = 2  # range bins that count as zero range: the main lobe of a Hann window is two bins to either side
_AT_LIMIT: Final = 1 - 1e-6


@dataclass(frozen=True, eq=False)
class Levels:
    """Powers in the frames' unit squared.

    Attributes
    ----------
    noise : ndarray, shape (n_rx,)
        Noise of one sample, of every receiver.
    near : float
        What stands still at zero range, as the square of its amplitude in the samples; mean over channels.
    """

    noise: Float64Array
    near: float


class Spectra:
    """Gathers what the health of a receiver chain shows in, frame by frame; ``peak`` is the largest real or imaginary part so far."""

    def __init__(self, info: RadarInfo) -> None:
        w = info.waveform
        self._info = info
        self._range = _hann(w.n_sample)
        self._doppler = _hann(w.n_chirp)
        self._cubes: list[NDArray[np.complex64]] = []
        self._whole, self._stride = 0, 1  # frames without lost chirps so far; of how many one is kept
        self._parts = self._full = 0
        self.peak = 0.0

    @property
    def reference(self) -> float:
        """Power of a tone whose amplitude is full scale [dB]; 0 where full scale is unknown."""
        return 20 * math.log10(self._info.full_scale) if self._info.full_scale else 0.0

    @property
    def saturated(self) -> float | None:
        """Share of samples of which a part is at full scale; None: full scale is unknown."""
        return self._full / self._parts if self._info.full_scale and self._parts else None

    def add(self, frame: RadarFrame) -> None:
        """Take in a frame; the samples of chirps that were lost do not count."""
        cube = frame.cube
        n_tx, n_chirp = cube.shape[:2]
        kept = np.ones(n_tx * n_chirp, bool)
        kept[frame.missing] = False
        parts = cube.transpose(1, 0, 2, 3).reshape(n_tx * n_chirp, *cube.shape[2:])[kept]
        if parts.size:
            size = np.maximum(np.abs(parts.real), np.abs(parts.imag))
            self.peak = max(self.peak, float(size.max()))
            self._parts += size.size
            self._full += int(np.count_nonzero(size >= self._info.full_scale * _AT_LIMIT)) if self._info.full_scale else 0
        if kept.all():
            self._keep(cube)

    def _keep(self, cube: NDArray[np.complex64]) -> None:
        """Keep it for later, because a transform takes so long that the next frame might be missed."""
        if self._whole % self._stride == 0:
            self._cubes.append(cube)
        self._whole += 1
        if len(self._cubes) > _KEPT:
            del self._cubes[1::2]
            self._stride *= 2

    def measure(self) -> Levels | None:
        """Give the levels of all frames so far; None: every frame lost chirps."""
        if not self._cubes:
            return None
        found = [self._transform(cube) for cube in self._cubes]
        return Levels(np.mean([floor for floor, _ in found], axis=0), float(np.mean([leak for _, leak in found])))

    def _transform(self, cube: NDArray[np.complex64]) -> tuple[Float64Array, float]:
        # Windows of unit power keep the noise what it is a sample; the leakage is a tone, whose amplitude their sum makes.
        spectrum = np.fft.fft(cube * self._range, axis=-1)
        still = (spectrum * self._doppler[:, None, None]).sum(axis=1) / (self._range.sum() * self._doppler.sum())
        power = np.abs(np.fft.fft(spectrum * self._doppler[:, None, None], axis=1)) ** 2
        bins = np.abs(still[..., np.arange(-1, _NEAR) % still.shape[-1]]) ** 2
        return _floor(power / ((self._range**2).sum() * (self._doppler**2).sum())), float(bins.max(axis=-1).mean())


def _hann(n: int) -> Float64Array:
    """Hann window of n samples whose ends are not zero; two samples or one stay as they are."""
    return np.hanning(n + 2)[1:-1] if n > 2 else np.ones(n)


def _floor(power: Float64Array) -> Float64Array:
    """Noise power per receiver from powers, shape (tx, speed, rx, range), whose mean over noise alone is the noise power of a sample.

    Each receiver's cells of one range are exponentially distributed where they hold noise only, so that their mean is their median over ln
    2; echoes are few and move it little. The median over ranges does the same once more for ranges full of echoes.
    """
    n_tx, n_speed, n_rx, n_range = power.shape
    cells = np.median(power.transpose(2, 3, 0, 1).reshape(n_rx, n_range, n_tx * n_speed), axis=-1) / math.log(2)
    held = cells > _EMPTY * np.quantile(cells, 0.75, axis=-1, keepdims=True)
    return np.array([np.median(row[mask]) if mask.any() else 0.0 for row, mask in zip(cells, held, strict=True)])
