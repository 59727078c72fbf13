"""Who computes the two Fourier transforms of a frame (thesis, figure A.13): scipy, numpy, FFTW, or integers as an FPGA would.

Every back end windows the samples and transforms them over chirps and samples. Its result is C-contiguous with the axes (tx, speed, rx,
range) and is **valid until the next call**: the memory is used again for the next frame. Copy what has to live longer.
"""

from __future__ import annotations

import importlib
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
        """Window and transform a frame.

        Parameters
        ----------
        cube : ndarray of complex64, shape (n_tx, n_chirp, n_rx, n_sample)
            Samples, finite; C-contiguous is fastest.

        Returns
        -------
        ndarray of complex64, shape (n_tx, n_speed, n_rx, n_range)
            Transform over chirps and samples (2.12, 2.13), C-contiguous, valid until the next call.

        Raises
        ------
        DataError
            When the cube has another shape than the back end was made for.
        """
        ...


class ScipyFft:
    """`scipy.fft` in place, one thread: the default.

    Parameters
    ----------
    shape : tuple of int
        Of the frames, (n_tx, n_chirp, n_rx, n_sample).
    speed_window, range_window : ndarray, shape (n_chirp,) and (n_sample,)
        Windows.
    """

    def __init__(self, shape: Shape, speed_window: Window, range_window: Window) -> None:
        self._windowing = Windowing(np.empty(shape, np.complex64), speed_window, range_window)

    def process(self, cube: Cube) -> Cube:
        """Window and transform a frame; see `Fft.process`."""
        spectrum: Cube = scipy.fft.fft2(self._windowing.process(cube), axes=_AXES, overwrite_x=True, workers=1)
        return spectrum


class NumpyFft:
    """`numpy.fft`, several times slower; numpy before 2 computes it in double precision. Parameters as for `ScipyFft`."""

    def __init__(self, shape: Shape, speed_window: Window, range_window: Window) -> None:
        self._windowing = Windowing(np.empty(shape, np.complex64), speed_window, range_window)

    def process(self, cube: Cube) -> Cube:
        """Window and transform a frame; see `Fft.process`."""
        return np.ascontiguousarray(np.fft.fft2(self._windowing.process(cube), axes=_AXES), np.complex64)


class FftwFft:
    """FFTW by way of pyfftw, planned once by measuring (FFTW_MEASURE), one thread; the fastest. Parameters as for `ScipyFft`.

    The plan depends on what was measured, so two runs of a program may differ in the last bits; scipy's results do not.

    Raises
    ------
    ConfigError
        When pyfftw is not installed.
    """

    def __init__(self, shape: Shape, speed_window: Window, range_window: Window) -> None:
        try:
            pyfftw: Any = importlib.import_module("pyfftw")
        except ImportError:
            raise ConfigError(
                "SpectrumConfig.fft is 'fftw', which needs pyfftw: pip install handwave[fftw], or choose 'scipy', which is always there"
            ) from None
        buffer = pyfftw.empty_aligned(shape, np.complex64)
        # In place: the frame then stays in the cache between the passes, which is a quarter faster than into a second buffer.
        self._plan = pyfftw.FFTW(buffer, buffer, axes=_AXES, flags=("FFTW_MEASURE",), threads=1)
        self._windowing = Windowing(buffer, speed_window, range_window)

    def process(self, cube: Cube) -> Cube:
        """Window and transform a frame; see `Fft.process`."""
        spectrum = self._windowing.process(cube)
        self._plan.execute()
        return spectrum


class Windowing:
    """Multiply a frame with its two windows into a buffer that is used again and again.

    Parameters
    ----------
    buffer : ndarray of complex64, shape (n_tx, n_chirp, n_rx, n_sample)
        Where the products go; C-contiguous.
    speed_window, range_window : ndarray, shape (n_chirp,) and (n_sample,)
        Windows.
    """

    def __init__(self, buffer: Cube, speed_window: Window, range_window: Window) -> None:
        self._buffer, self._floats = buffer, buffer.view(np.float32)
        # Real and imaginary part as two floats of the same weight: the loop is then a plain product that the compiler turns into vectors.
        self._window = np.repeat(np.outer(speed_window, range_window), 2, axis=1).astype(np.float32)

    def process(self, cube: Cube) -> Cube:
        """Fill the buffer with ``cube`` times the windows and return it; `DataError` for a cube of another shape."""
        if cube.shape != self._buffer.shape:
            raise wrong_shape(cube.shape, self._buffer.shape)
        weigh(np.ascontiguousarray(cube, np.complex64).view(np.float32), self._window, self._floats)
        return self._buffer


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
    """Make the back end that ``config.fft`` names.

    Parameters
    ----------
    config : SpectrumConfig
        ``fft``, and for the fixed-point one ``word_length``.
    shape : tuple of int
        Of the frames, (n_tx, n_chirp, n_rx, n_sample).
    speed_window, range_window : ndarray, shape (n_chirp,) and (n_sample,)
        Windows of unit energy.

    Returns
    -------
    Fft
        The back end, planned and ready.

    Raises
    ------
    ConfigError
        When pyfftw is missing, or the fixed-point transform is asked for a length that is not a power of two.
    """
    if config.fft == "fixed":
        from radar_dsp.fixed_point import FixedFft  # loaded only where it is chosen

        return FixedFft(config.word_length, shape, speed_window, range_window)
    backends: dict[str, type[ScipyFft] | type[NumpyFft] | type[FftwFft]] = {"scipy": ScipyFft, "numpy": NumpyFft, "fftw": FftwFft}
    return backends[config.fft](shape, speed_window, range_window)
