"""Where the echoes of a frame come from: a plain look at samples, to say what an effect moves."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT, RadarInfo
from radar_core.linalg import first_max

_CELLS = 32
"""Strongest cells that are looked at."""
_DIRECTIONS = np.linspace(-1.0, 1.0, 181)
"""Sines of azimuth that are compared."""


def places(cubes: NDArray[np.complex128], info: RadarInfo, *, moving: bool) -> NDArray[np.float64]:
    """Find the middle of the strongest echoes of each frame.

    Range-Doppler cells count by the square of their power, as a detector follows peaks: an echo 8 dB below another weighs 2.5 %, and what
    lies in side lobes nothing. The azimuth of a cell is that of the strongest beam of the first transmitter's receivers. Radars whose
    samples are no beats (CW, OFDM) have cells of speed only; theirs are places of direction at a distance of 1.

    Parameters
    ----------
    cubes : ndarray of complex128, shape (frame, tx, chirp, rx, sample)
        Samples without noise.
    info : RadarInfo
        Whose they are.
    moving : bool
        Leave out what stands still during a frame, as who follows people does.

    Returns
    -------
    ndarray of float64, shape (frame, 2)
        (x, y) in the sensor's plane [m]; NaN where nothing comes back.
    """
    return np.array([_place(cube, info, moving) for cube in cubes]).reshape(-1, 2)


def displacement(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Rms distance between the places of two looks, over the rms range of the first; infinite where only one of them finds something.

    Parameters
    ----------
    one, other : ndarray of float64, shape (frame, 2)
        Of `places`.
    """
    seen = np.isfinite(one).all(-1)
    if (seen != np.isfinite(other).all(-1)).any():
        return math.inf
    return float(np.linalg.norm(one[seen] - other[seen]) / np.linalg.norm(one[seen])) if seen.any() else 0.0


def _place(cube: NDArray[np.complex128], info: RadarInfo, moving: bool) -> NDArray[np.float64]:
    w = info.waveform
    if moving:
        cube = cube - cube.mean(axis=1, keepdims=True)
    if w.modulation == "fmcw":
        spectrum = np.fft.fft2(cube * np.hanning(w.n_chirp)[:, None, None] * np.hanning(w.n_sample), axes=(1, 3))
        ranges = np.arange(w.n_sample) * w.range_resolution
    else:
        spectrum, ranges = np.fft.fft(cube * np.hanning(w.n_chirp)[:, None, None], axis=1), np.ones(cube.shape[-1])
    power = (np.abs(spectrum) ** 2).sum(axis=(0, 2))
    if not power.max() > 0.0:
        return np.full(2, np.nan)
    strongest = np.argsort(power, axis=None, kind="stable")[-_CELLS:]
    doppler, column = np.unravel_index(strongest, power.shape)
    weight = (power[doppler, column] / power.max()) ** 2
    lateral = np.array([y for y, _ in info.array.rx]) * (2 * math.pi * w.carrier / SPEED_OF_LIGHT)
    beams = np.abs(spectrum[0, doppler, :, column] @ np.exp(1j * lateral[:, None] * _DIRECTIONS))
    sine = _DIRECTIONS[first_max(beams, 1)]  # of two that are equally strong, the same on every machine
    span = ranges[column]
    across = np.stack([span * np.sqrt(1.0 - sine**2), span * sine], axis=-1)
    return np.asarray(np.average(across, axis=0, weights=weight))
