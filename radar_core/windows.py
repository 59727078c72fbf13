"""Shapes of windows and tapers, by scipy's names."""

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


def window_shape(name: str, n: int) -> NDArray[np.float64]:
    """Make a window as it is defined, for transforms (periodic), with no particular scale.

    Parameters
    ----------
    name : str
        A name of `scipy.signal.get_window`; parameters follow after colons, e.g. ``"kaiser:8.6"``.
    n : int
        Length.

    Returns
    -------
    ndarray of float64, shape (n,)
        Window; finite, and not zero everywhere.

    Raises
    ------
    ConfigError
        When scipy does not know the window or its parameters, or it is zero everywhere at this length.
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
    return np.asarray(values, np.float64)
