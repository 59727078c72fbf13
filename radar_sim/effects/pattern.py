"""Element pattern: what an antenna gives and takes less beside its boresight than on it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from radar_core import AntennaArray, ConfigError, RadarInfo
from radar_core.geometry import cartesian_to_spherical
from radar_sim.effects.base import Moment, Setting
from radar_sim.effects.config import PatternConfig
from radar_sim.scatterers import Echoes, Float64Array


class Pattern:
    """Weaken echoes by the gain of the transmitting element towards their way out and of the receiving one towards their way back.

    Every element has the same gain: a model cos(azimuth)^p cos(elevation)^q that has fallen by ``edge`` at half the field of view, or a
    measured matrix over azimuth and elevation, interpolated linearly in dB; beyond its rim the rim's gain holds (thesis, section 5.2.3).

    Parameters
    ----------
    config : PatternConfig
        Edge or matrix.
    setting : Setting
        The radar: its field of view.

    Raises
    ------
    ConfigError
        When a measured pattern has azimuths but no elevations.
    """

    def __init__(self, config: PatternConfig, setting: Setting) -> None:
        self._gain = _Gain(config, setting.array)

    def process(self, echoes: Echoes, moment: Moment) -> Echoes:
        """Weaken each echo by the gains of both its ways."""
        out = self._gain.process(echoes.out.position)
        if echoes.back is echoes.out:
            return echoes.weakened(out)
        return echoes.weakened(np.sqrt(out * self._gain.process(echoes.back.position)))


class _Gain:
    """One-way gain over direction, prepared for one array."""

    def __init__(self, config: PatternConfig, array: AntennaArray) -> None:
        if config.azimuth and not config.elevation:
            raise ConfigError("Pattern.elevation is empty, but azimuth and gain are given; give the elevations that gain's columns are for")
        self._array, self._edge = array, config.edge
        self._azimuth, self._elevation = np.radians(config.azimuth), np.radians(config.elevation)
        self._table = np.array(config.gain, np.float64)

    def process(self, position: Float64Array) -> Float64Array:
        """Power gain relative to the boresight towards places (n, 3) of the sensor frame, shape (n,)."""
        _, azimuth, elevation = cartesian_to_spherical(position)
        if not self._table.size:
            return self._array.element_gain(azimuth, elevation, self._edge)
        i, u = _between(self._azimuth, azimuth)
        j, v = _between(self._elevation, elevation)
        (i0, i1), (j0, j1), table = i, j, self._table
        level = (1 - u) * ((1 - v) * table[i0, j0] + v * table[i0, j1]) + u * ((1 - v) * table[i1, j0] + v * table[i1, j1])
        gain: Float64Array = 10 ** (level / 10)
        return gain


def _between(grid: Float64Array, x: Float64Array) -> tuple[Sequence[NDArray[np.intp]], Float64Array]:
    """Find the indices of the grid's points on both sides of each x, and the share of the way between them; clamped at the ends."""
    last = len(grid) - 1
    low = np.clip(np.searchsorted(grid, x, side="right") - 1, 0, max(last - 1, 0))
    high = np.minimum(low + 1, last)
    width = np.where(high > low, grid[high] - grid[low], 1.0)
    return (low, high), np.clip((x - grid[low]) / width, 0.0, 1.0)


def two_way_gain(config: PatternConfig, info: RadarInfo, position: Float64Array) -> Float64Array:
    """Gain of transmitting and receiving element relative to the boresight, as a factor of the amplitude.

    Parameters
    ----------
    config : PatternConfig
        Edge or matrix.
    info : RadarInfo
        The field of view.
    position : ndarray, shape (n, 3)
        In the sensor frame [m].

    Returns
    -------
    ndarray of float64, shape (n,)
        Both one-way power gains multiply, so the root of their product is one of them.
    """
    return _Gain(config, info.array).process(position)


def size(config: PatternConfig, setting: Setting, echoes: Echoes) -> str:
    """Say how large the effect is for these echoes."""
    if not len(echoes):
        return "no echoes"
    position = echoes.out.position
    distance = np.sqrt((position**2).sum(-1))
    farthest = int(np.argmin(position[:, 0] / np.maximum(distance, 1e-9)))
    gain = two_way_gain(config, setting.info, position[farthest : farthest + 1])[0]
    return f"{20 * math.log10(max(gain, 1e-15)):.1f} dB two-way at the echo farthest from boresight"
