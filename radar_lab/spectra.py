"""What there is to see in raw frames: power over range and range rate, and over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import RadarFrame, RadarInfo
from radar_dsp.config import BasebandConfig
from radar_dsp.coupling import coupling_region
from radar_dsp.kernels import integrate
from radar_dsp.spectrum import make_spectrum

_NOTHING: Final[float] = 1e-37
_MAIN_LOBE: Final[int] = 4  # range cells
_SPAN_DB: Final[float] = 65.0


class Observer:
    """Find what there is to see in the spectra of raw frames.

    Attributes
    ----------
    speed : ndarray of float64, shape (n_speed,)
        Of the rows, ascending [m/s].
    extent : tuple of float
        Left, right, bottom and top edge of a map: range [m] (of a tone, which measures none, 0 to 1), range rate [m/s].
    """

    def __init__(self, info: RadarInfo) -> None:
        config, w = BasebandConfig(), info.waveform
        self._spectrum = make_spectrum(config.spectrum, info)
        half, n = w.max_speed / w.n_chirp, w.n_chirp
        self.speed = (np.arange(n) - n // 2) * 2 * half
        near, far = (0.0, 1.0) if w.modulation == "cw" else (-w.range_resolution / 2, w.max_range - w.range_resolution / 2)
        self.extent = (near, far, float(self.speed[0] - half), float(self.speed[-1] + half))
        # Leakage at range 0 reaches to both ends of the range axis, as far as the main lobe of the widest usual window.
        cells = np.fft.fftshift(coupling_region(config, info), axes=0)
        leaks = np.minimum(np.arange(cells.shape[1]), cells.shape[1] - np.arange(cells.shape[1])) <= _MAIN_LOBE
        self._leakage = np.logical_and.outer(cells.sum(axis=1) > 0, leaks)

    def process(self, frame: RadarFrame) -> NDArray[np.float32]:
        """Power of the range-Doppler map, integrated over the channels without phase, float32 of shape (n_speed, n_range).

        It is in dB over the square of the unit of the samples; -370 where there is nothing.
        """
        cube = frame.cube
        if len(frame.missing):
            cube = cube.copy()
            cube[frame.missing % cube.shape[0], frame.missing // cube.shape[0]] = 0
        power = integrate(self._spectrum.process(cube))
        level: NDArray[np.float32] = 10 * np.log10(np.fft.fftshift(np.maximum(power, np.float32(_NOTHING)), axes=0))
        return level

    def echoes(self, level: NDArray[np.float32]) -> NDArray[np.float32]:
        """Leave out of a map the cells into which transmitters leak, as the baseband does; there is nothing in them then."""
        return np.where(self._leakage, np.float32(10 * math.log10(_NOTHING)), level)


@dataclass(frozen=True)
class Scale:
    """What the colours of the spectra mean [dB]: both ends of the colour bar."""

    low: float
    high: float


def scale_of(maps: Sequence[NDArray[np.float32]], observer: Observer) -> Scale:
    """Find the colours for maps of `Observer.process`: from the noise, or 65 dB below the strongest echo, to that."""
    high = max(float(observer.echoes(level).max()) for level in maps)
    floor = float(np.median(np.stack(maps))) + 2.0
    return Scale(min(max(floor, high - _SPAN_DB), high - 10.0), high)


class Strip:
    """Columns over time, at most ``limit``: where more frames come (``n_frames``), each column keeps the strongest of several.

    Each frame has so many values (``n_values``); a column that did not come yet holds ``empty``.
    """

    def __init__(self, n_frames: int, n_values: int, limit: int, empty: float) -> None:
        self._n_frames = n_frames
        self.values = np.full((n_values, min(n_frames, limit)), empty, np.float32)

    def add(self, sequence: int, values: NDArray[np.floating]) -> None:
        """Put the values of a frame in, shape (n_values,)."""
        column = self.values[:, sequence * self.values.shape[1] // self._n_frames]
        np.maximum(column, values, out=column)
