"""Range-speed spectrum of a frame (thesis, 2.12 and 2.13) and its non-coherent integration."""

from __future__ import annotations

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from radar_core import RadarInfo
from radar_dsp.config import SpectrumConfig
from radar_dsp.windows import make_window

_LARGE, _SMALL = 1e12, 1e-12
"""Sample magnitudes within which float32 powers neither overflow nor vanish, with room for the gain of the transforms."""


class Spectrum:
    """Windowed two-dimensional Fourier transform of every virtual channel.

    Windows have unit energy: white noise of variance s in the samples has power s in every cell. Speed bins are in the order of the
    transform, not shifted: bin 0 is zero speed, the upper half is approaching (negative).

    Parameters
    ----------
    config : SpectrumConfig
        Windows.
    info : RadarInfo
        The radar.
    """

    def __init__(self, config: SpectrumConfig, info: RadarInfo) -> None:
        waveform = info.waveform
        self.range_window = make_window(config.range_window, waveform.n_sample)
        self.speed_window = make_window(config.speed_window, waveform.n_chirp)
        self._window = (self.speed_window[:, None, None] * self.range_window[None, None, :]).astype(np.float32)

    def process(self, cube: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Transform the samples of a frame.

        Parameters
        ----------
        cube : ndarray of complex64, shape (n_tx, n_chirp, n_rx, n_sample)
            Raw samples.

        Returns
        -------
        ndarray of complex64, shape (n_tx, n_speed, n_rx, n_range)
            Complex spectrum per virtual channel.
        """
        spectrum: NDArray[np.complex64] = scipy.fft.fft2(cube * self._window, axes=(1, 3), overwrite_x=True)
        return spectrum


def integrate(spectrum: NDArray[np.complex64]) -> NDArray[np.float32]:
    """Non-coherent integration: mean power over the virtual channels, shape (n_speed, n_range).

    The thesis sums; the mean differs by a constant and keeps the noise floor in the unit of the samples' power.
    """
    n_tx, n_speed, n_rx, n_range = spectrum.shape
    power = np.zeros((n_speed, n_range), np.float32)
    # Channel by channel: the partial results stay in the cache, and the order of the sum is fixed.
    for tx in range(n_tx):
        for rx in range(n_rx):
            channel = spectrum[tx, :, rx, :]
            power += channel.real**2
            power += channel.imag**2
    power *= np.float32(1.0 / (n_tx * n_rx))
    return power


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
