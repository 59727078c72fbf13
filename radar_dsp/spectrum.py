"""Range-speed spectrum of a frame for each modulation (thesis, 2.12, 2.13 and figure A.14)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Protocol

import numba
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from radar_core import RadarInfo, known_symbols
from radar_dsp.config import SpectrumConfig
from radar_dsp.fft import make_fft
from radar_dsp.windows import make_window

_LARGE, _SMALL = 1e12, 1e-12
"""Sample magnitudes within which float32 powers neither overflow nor vanish, with room for the gain of the transforms."""

Cube = NDArray[np.complex64]
Window = NDArray[np.float64]


class SpectrumGenerator(Protocol):
    """Samples to a range-speed spectrum, one class per modulation.

    Windows have unit energy: white noise of variance s in the samples has power s in every cell. Speed bins are in the order of the
    transform, not shifted: bin 0 is zero speed, the upper half is approaching (negative).

    Attributes
    ----------
    range_window, speed_window : ndarray of float64, shape (n_range,), (n_chirp,)
        What weighs the samples, carriers, or the one value of a tone, and the chirps: they decide how the noise of neighbouring cells
        correlates.
    """

    range_window: Window
    speed_window: Window

    def process(self, cube: Cube) -> Cube:
        """Transform the samples of a frame; a `DataError` says that the cube is not of the radar's shape.

        Parameters
        ----------
        cube : ndarray of complex64, shape (n_tx, n_chirp, n_rx, n_sample)
            Raw samples, finite.

        Returns
        -------
        ndarray of complex64, shape (n_tx, n_speed, n_rx, n_range)
            Complex spectrum per virtual channel, C-contiguous. **It is valid until the next call**, which uses the memory again.
        """
        ...


class FmcwSpectrum:
    """Chirp-sequence FMCW: the transform over the samples is range, the one over the chirps speed (2.12, 2.13).

    A still echo at range R peaks in range bin ``R / range_resolution``. One that recedes with v peaks ``v carrier / slope`` beyond where it
    is in the middle of the chirps (2.14).

    ``static="remove"`` takes out the mean over the chirps, channel by channel and sample by sample, before the windows. That erases
    whatever stands still for the length of a frame: walls, leakage, and **people who sit or stand**, but for what breathes and fidgets.
    Below one speed cell an echo keeps only part of itself (at half a cell it loses 40 % of its amplitude behind a Hann window), at whole
    cells it keeps all. The noise loses its mean too: behind a Hann window a third of its power stays at zero speed, 5/6 in the next cells.

    Parameters
    ----------
    config : SpectrumConfig
        Windows, back end, static clutter; a `ConfigError` says that the back end is not installed or cannot transform this frame.
    info : RadarInfo
        The radar.
    """

    def __init__(self, config: SpectrumConfig, info: RadarInfo) -> None:
        waveform = info.waveform
        self.range_window = make_window(config.range_window, waveform.n_sample)
        self.speed_window = make_window(config.speed_window, waveform.n_chirp)
        self._fft = make_fft(config, info.cube_shape, self.speed_window, self.range_window)
        self._remove = config.static == "remove"

    def process(self, cube: Cube) -> Cube:
        """Transform the samples of a frame; see `SpectrumGenerator.process`."""
        return self._fft.process(remove_static(cube) if self._remove else cube)


class CwSpectrum:
    """A tone: speed, no range. Parameters and errors as for `FmcwSpectrum`; the range window is not used.

    The samples of a stretch are added coherently into one value that keeps the variance of white noise, so there is one range cell and a
    stretch gains ``n_sample`` in signal-to-noise ratio. An echo that turns within a stretch loses amplitude by sinc(2 v chirp_duration /
    wavelength): 10 % at half the unambiguous speed of one transmitter without pauses.
    """

    def __init__(self, config: SpectrumConfig, info: RadarInfo) -> None:
        self.range_window: Window = np.ones(1)
        self.speed_window = make_window(config.speed_window, info.waveform.n_chirp)
        self._fft = make_fft(config, (*info.cube_shape[:3], 1), self.speed_window, self.range_window)
        self._gain = 1 / math.sqrt(max(info.waveform.n_sample, 1))
        self._remove = config.static == "remove"

    def process(self, cube: Cube) -> Cube:
        """Transform the samples of a frame; see `SpectrumGenerator.process`."""
        value = (cube.sum(axis=3, keepdims=True, dtype=np.complex128) * self._gain).astype(np.complex64)
        return self._fft.process(remove_static(value) if self._remove else value)


class OfdmSpectrum:
    """OFDM: known symbols on many carriers; what the channel did to each carrier is its response, whose transform is range.

    Samples of one symbol, cyclic prefix taken off, are transformed into carriers and divided by the known symbols (Sturm and Wiesbeck,
    "Waveform design and signal processing aspects for fusion of wireless communications and radar sensing", 2011). What is left turns by +2
    pi (f_min + k / chirp_duration) tau over the carriers k, as the samples of a chirp do in FMCW, so both transforms, the windows and the
    directions are FMCW's. `RadarFrame` has the conjugate of the physical delay phase, hence the conjugate of the symbols, and carrier k is
    found at the frequency -k. All steps keep the variance of white noise.

    Echoes that move turn within a symbol too, and what they turn spills onto the other carriers: beside an echo of range rate v there is a
    floor about (2 v chirp_duration / wavelength)^2 pi^2 / 3 below it in the carriers, -76 dB at 4 m/s for symbols of 43 ns. Unlike in FMCW,
    that does not move the echo in range: there is no term ``v carrier / slope``.
    Parameters and errors as for `FmcwSpectrum`. The back end ``fixed`` computes range and speed; carriers are always found in float32.
    """

    def __init__(self, config: SpectrumConfig, info: RadarInfo) -> None:
        self._spectrum = FmcwSpectrum(config, info)
        self.range_window, self.speed_window = self._spectrum.range_window, self._spectrum.speed_window
        self._symbols = known_symbols(info.waveform)[:, :, None, :]

    def process(self, cube: Cube) -> Cube:
        """Transform the samples of a frame; see `SpectrumGenerator.process`."""
        carriers = scipy.fft.ifft(cube, axis=3, norm="ortho", workers=1)
        carriers *= self._symbols  # of unit modulus: the same as dividing by the conjugate
        return self._spectrum.process(carriers)


def remove_static(cube: Cube) -> Cube:
    """Subtract the mean over the chirps, per transmitter, receiver and sample: everything that stands still, people included.

    Chirps that are all zero were lost: they do not count, and stay zero.
    """
    moving = np.empty(cube.shape, np.complex64)
    _subtract_mean(np.ascontiguousarray(cube, np.complex64).view(np.float32), moving.view(np.float32))
    return moving


@numba.njit(cache=True, nogil=True)
def _subtract_mean(cube: Any, moving: Any) -> None:
    """Work on float32 of shape (tx, chirp, rx, 2 sample), with sums in float64."""
    n_tx, n_chirp, n_rx, n = cube.shape
    for t in range(n_tx):
        mean, seen, n_seen = np.zeros((n_rx, n)), np.zeros(n_chirp, np.bool_), 0
        for chirp in range(n_chirp):
            nonzero = 0
            for rx in range(n_rx):
                for s in range(n):
                    mean[rx, s] += cube[t, chirp, rx, s]
                    nonzero += cube[t, chirp, rx, s] != 0.0
            seen[chirp] = nonzero > 0
            n_seen += seen[chirp]
        mean32 = (mean / max(n_seen, 1)).astype(np.float32)
        for chirp in range(n_chirp):
            for rx in range(n_rx):
                for s in range(n):
                    moving[t, chirp, rx, s] = cube[t, chirp, rx, s] - mean32[rx, s] if seen[chirp] else np.float32(0.0)


def make_spectrum(config: SpectrumConfig, info: RadarInfo) -> SpectrumGenerator:
    """Make the generator for the modulation of ``info``: FMCW, CW or OFDM; parameters and errors as for `FmcwSpectrum`."""
    kinds: dict[str, Callable[..., SpectrumGenerator]] = {"fmcw": FmcwSpectrum, "cw": CwSpectrum, "ofdm": OfdmSpectrum}
    return kinds[info.waveform.modulation](config, info)


def normalise(cube: NDArray[np.complex64], peak: float) -> tuple[NDArray[np.complex64], int]:
    """Scale a frame by a power of two when its powers would leave float32.

    Parameters
    ----------
    cube : ndarray of complex64, shape (n_tx, n_chirp, n_rx, n_sample)
        Raw samples.
    peak : float
        Largest magnitude of a real or imaginary part.

    Returns
    -------
    tuple of (ndarray of complex64, int)
        The cube, a scaled copy where needed, and the exponent e: the result is the input times 2**-e.
    """
    if peak == 0.0 or _SMALL <= peak <= _LARGE:
        return cube, 0
    exponent = int(np.frexp(peak)[1])
    flat = np.ldexp(np.ascontiguousarray(cube).view(np.float32), -exponent)
    return flat.view(np.complex64).reshape(cube.shape), exponent
