"""Who computes the two Fourier transforms of a frame (thesis, figure A.13): scipy, numpy, FFTW, or integers as an FPGA would.

Every back end windows the samples and transforms them over chirps and samples. Its result is C-contiguous with the axes (tx, speed, rx,
range) and is **valid until the next call**: the memory is used again for the next frame. Copy what has to live longer.
"""

from __future__ import annotations

import importlib
from functools import partial
from typing import Any, Protocol

import numba
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from radar_core import ConfigError
from radar_dsp.config import SpectrumConfig
from radar_dsp.windows import Shape, wrong_shape

Cube = NDArray[np.complex64]
Window = NDArray[np.float64]

_AXES = (1, 3)


class Fft(Protocol):
    """One back end."""

    def process(self, cube: Cube) -> Cube:
        """Window and transform a frame; a `DataError` says that it has another shape than the back end was made for.

        Parameters
        ----------
        cube : ndarray of complex64, shape (n_tx, n_chirp, n_rx, n_sample)
            Samples, finite; C-contiguous is fastest.

        Returns
        -------
        ndarray of complex64, shape (n_tx, n_speed, n_rx, n_range)
            Transform over chirps and samples (2.12, 2.13), C-contiguous, valid until the next call.
        """
        ...


class FloatFft:
    """A library's transform in single precision, one thread.

    ``scipy`` works in place. ``numpy`` is several times slower; before version 2 it computes in double precision. ``fftw`` (pyfftw) is the
    fastest: planned once by measuring, so that two runs of a program may differ in the last bits.

    Parameters
    ----------
    name : str
        ``scipy``, ``numpy`` or ``fftw``; a `ConfigError` says that pyfftw is not installed.
    shape : tuple of int
        Of the frames, (n_tx, n_chirp, n_rx, n_sample).
    speed_window, range_window : ndarray, shape (n_chirp,) and (n_sample,)
        Windows.
    """

    def __init__(self, name: str, shape: Shape, speed_window: Window, range_window: Window) -> None:
        self._buffer = np.empty(shape, np.complex64)
        self._transform: Any = np.fft.fft2 if name == "numpy" else partial(scipy.fft.fft2, overwrite_x=True, workers=1)
        if name == "fftw":
            try:
                pyfftw: Any = importlib.import_module("pyfftw")
            except ImportError:
                raise ConfigError(
                    "SpectrumConfig.fft is 'fftw', which needs pyfftw: pip install handwave[fftw], or choose 'scipy', which is always there"
                ) from None
            self._buffer = pyfftw.empty_aligned(shape, np.complex64)
            # In place: the frame then stays in the cache between the passes, which is a quarter faster than into a second buffer.
            plan = pyfftw.FFTW(self._buffer, self._buffer, axes=_AXES, flags=("FFTW_MEASURE",), threads=1)
            self._transform = lambda buffer, axes: plan()
        # Real and imaginary part as two floats of the same weight: the loop is then a plain product that the compiler turns into vectors.
        self._window = np.repeat(np.outer(speed_window, range_window), 2, axis=1).astype(np.float32)

    def process(self, cube: Cube) -> Cube:
        """Window and transform a frame; see `Fft.process`."""
        if cube.shape != self._buffer.shape:
            raise wrong_shape(cube.shape, self._buffer.shape)
        weigh(np.ascontiguousarray(cube, np.complex64).view(np.float32), self._window, self._buffer.view(np.float32))
        return np.ascontiguousarray(self._transform(self._buffer, axes=_AXES), np.complex64)


@numba.njit(cache=True, nogil=True)
def weigh(cube: Any, window: Any, out: Any) -> None:
    """Put ``cube * window[:, None]`` into ``out``: float32 of shape (tx, chirp, rx, 2 sample), the window of shape (chirp, 2 sample)."""
    n_tx, n_chirp, n_rx, n = cube.shape
    for t in range(n_tx):
        for chirp in range(n_chirp):
            for rx in range(n_rx):
                for s in range(n):
                    out[t, chirp, rx, s] = cube[t, chirp, rx, s] * window[chirp, s]


def make_fft(config: SpectrumConfig, shape: Shape, speed_window: Window, range_window: Window) -> Fft:
    """Make the back end that ``config.fft`` names, planned and ready; parameters as for `FloatFft`, windows of unit energy.

    A `ConfigError` says that pyfftw is missing, or that the fixed-point transform is asked for a length that is not a power of two.
    """
    if config.fft != "fixed":
        return FloatFft(config.fft, shape, speed_window, range_window)
    from radar_dsp.fixed_point import FixedFft  # loaded only where it is chosen

    return FixedFft(config.word_length, shape, speed_window, range_window)
