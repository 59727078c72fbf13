"""Window functions by scipy's names, and what a window does to noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radar_core.errors import ConfigError

_COSINES = {
    "boxcar": (1.0,),
    "hann": (0.5, 0.5),
    "hamming": (0.54, 0.46),
    "blackman": (0.42, 0.5, 0.08),
    "nuttall": (0.3635819, 0.4891775, 0.1365995, 0.0106411),
    "blackmanharris": (0.35875, 0.48829, 0.14128, 0.01168),
}
"""Cosine series of the usual windows: scipy.signal, which makes all others, takes a third of a second to import."""


def make_window(name: str, n: int) -> NDArray[np.float64]:
    """Make a window of unit energy, so that the transform of white noise keeps the variance of its samples.

    Parameters
    ----------
    name : str
        A name of `scipy.signal.get_window`; parameters follow after colons, e.g. ``"kaiser:8.6"``.
    n : int
        Length.

    Returns
    -------
    ndarray of float64, shape (n,)
        Window with a sum of squares of one.

    Raises
    ------
    ConfigError
        When scipy does not know the window or its parameters.
    """
    if name in _COSINES:
        turn = 2 * np.pi * np.arange(n) / n
        values = sum((-1) ** k * a * np.cos(k * turn) for k, a in enumerate(_COSINES[name])) if n > 1 else np.ones(1)
    else:
        from scipy.signal import get_window

        label, *parameters = name.split(":")
        try:
            values = np.asarray(get_window((label, *map(float, parameters)) if parameters else label, n), np.float64)
        except (ValueError, TypeError) as error:
            raise ConfigError(f"window {name!r}: {error}; use a name of scipy.signal.get_window, parameters after colons") from None
    energy = float(np.sum(values**2))
    if not np.isfinite(energy) or energy <= 0.0:
        raise ConfigError(f"window {name!r} has no energy at length {n}; choose another")
    return np.asarray(values / np.sqrt(energy), np.float64)


def noise_correlation(window: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Correlation coefficient between cells of windowed white noise, over their distance in bins (circular).

    Parameters
    ----------
    window : ndarray, shape (n,)
        Window of unit energy.

    Returns
    -------
    ndarray of complex128, shape (n,) = lag
        E[V(m) V*(m - lag)] / E[|V|^2].
    """
    return np.asarray(np.fft.fft(window**2), np.complex128)


def response(window: NDArray[np.float64], offset: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Transform of the windowed unit tone, seen ``offset`` bins beside the tone's frequency.

    Parameters
    ----------
    window : ndarray, shape (n,)
        Window.
    offset : ndarray, shape (...)
        Distance in bins, bin minus tone.

    Returns
    -------
    ndarray of complex128, shape (...)
        Complex response.
    """
    n = len(window)
    result: NDArray[np.complex128] = np.exp(-2j * np.pi / n * offset[..., None] * np.arange(n)) @ window
    return result
