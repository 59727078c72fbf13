"""A radar at the level of detections: point targets become points of a cloud, and no sample is simulated.

It has what shapes clouds of people most: cells, a threshold, fading, the nearer of two echoes that hides the weaker one beside it, leakage
into the next Doppler cells, errors by signal-to-noise ratio, folded range rates, and coupling. It has no walls, no clutter and no false
alarms. Networks learn from it what arms do, and from `radar_sim` what radars make of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from radar_core import RadarInfo
from radar_core.types import BoolArray, Float64Array

_THRESHOLD, _EDGE = 5.0, 1.0  # dB per channel, as the default baseband has about, and how far it spreads
_LEAK: Final = ((0, 0.0), (-1, -6.0), (1, -6.0), (-2, -31.0), (2, -31.0))
"""Doppler cells beside an echo's own, and its level there [dB]: a Hann window."""
_HIDES: Final = (1.5, 1.0)  # cells in range and in speed within which the stronger of two echoes hides the other
_CELL_ERROR: Final = 0.35  # cells: error of range and speed at 0 dB
_SURFACE, _GLINT = 0.02, 0.02  # m, rad: what no signal takes away of the errors of range and direction
_WIDEST_ERROR: Final = 0.4  # rad
_FLATTEST: Final = 0.05  # wavelengths: least spread of the elements that tells directions
_SPECKLE, _GLITTER = 0.7, 1.5  # how much of the fading of many scatterers a part of a body has, and more of it [dB]
_COUPLING_CELLS, _COUPLING_RANGE, _COUPLING_SPEED = 2.5, 0.25, 0.2  # the baseband's default: cells, or m and m/s
_BEAM: Final = (100.0, 75.0)  # deg off the boresight, in azimuth and elevation, at which a way is 12 dB weaker
_REFERENCE, _NEAREST = 2.0, 0.3  # m: levels are those at the reference; nearer than the nearest they grow no more


@dataclass(frozen=True, eq=False)
class Targets:
    """Point targets at T times, from the sensor; every array of shape (T, n_targets).

    Attributes
    ----------
    range, azimuth, elevation : ndarray of float64
        [m], [rad], [rad]; in ``room``, from the sensor's place.
    rate : ndarray of float64
        Range rate [m/s].
    level : ndarray of float64
        Signal-to-noise ratio per channel that the target would have 2 m away on the boresight [dB].
    """

    range: Float64Array
    azimuth: Float64Array
    elevation: Float64Array
    rate: Float64Array
    level: Float64Array


@dataclass(frozen=True, eq=False)
class Echoes:
    """What a cloud holds of `Targets`, in one Doppler cell beside their own; shapes (T, n_targets).

    Attributes
    ----------
    found : ndarray of bool
        Whether there is a point; the others hold what it would be.
    range, azimuth, elevation, rate, snr : ndarray of float64
        As measured: [m], [rad], [rad], [m/s], [dB]; without two rows of elements the elevation is the sensor's tilt.
    """

    found: BoolArray
    range: Float64Array
    azimuth: Float64Array
    elevation: Float64Array
    rate: Float64Array
    snr: Float64Array


class PointRadar:
    """Makes points of targets.

    Parameters
    ----------
    info : RadarInfo
        The radar.
    rng : Generator
        Fading and errors come from it.
    """

    def __init__(self, info: RadarInfo, rng: np.random.Generator) -> None:
        wave, places = info.waveform, info.array.virtual / info.waveform.wavelength
        self._rng, self._mount = rng, info.mount
        self._cell = np.array([wave.range_resolution, wave.speed_resolution])
        self._fastest = wave.max_speed
        self._wide, self._high = (float(np.ptp(places[:, axis])) > 1e-3 for axis in (0, 1))
        spread = np.maximum(places.std(axis=0), _FLATTEST)
        self._direction_error = 1.0 / (2.0 * math.pi * spread * math.sqrt(2.0 * len(places)))

    def process(self, targets: Targets) -> Iterator[Echoes]:
        """Make one cloud for each of the T times; gives its points cell by cell, see `_LEAK`."""
        snr = self._levels(targets)
        above = snr > self._rng.normal(_THRESHOLD, _EDGE, snr.shape)
        seen = above & ~self._coupled(targets) & ~self._hidden(targets, snr, above)
        for cells, loss in _LEAK:
            yield self._measured(targets, seen & (snr + loss > _THRESHOLD), snr + loss, cells)

    def _levels(self, targets: Targets) -> Float64Array:
        """Signal-to-noise ratios of a cloud [dB]: distance, antenna and fading."""
        shape, rng = targets.range.shape, self._rng
        turn = np.degrees(targets.azimuth - self._mount.yaw), np.degrees(targets.elevation - self._mount.tilt)
        pattern = -12.0 * sum((own / width) ** 2 for own, width in zip(turn, _BEAM, strict=True))
        fading = _SPECKLE * 10.0 * np.log10(rng.exponential(1.0, shape) + 0.05) + rng.normal(0.0, _GLITTER, shape)
        return np.asarray(targets.level + pattern + fading - 40.0 * np.log10(np.maximum(targets.range, _NEAREST) / _REFERENCE))

    def _coupled(self, targets: Targets) -> BoolArray:
        """Which echoes lie where the baseband suppresses coupling."""
        near, slow = max(_COUPLING_RANGE, _COUPLING_CELLS * self._cell[0]), max(_COUPLING_SPEED, self._cell[1])
        return np.asarray((targets.range < near) & (np.abs(targets.rate) < slow))

    def _hidden(self, targets: Targets, snr: Float64Array, above: BoolArray) -> BoolArray:
        """Which echoes a stronger one beside them hides: of these a cloud has one point."""
        taken = np.zeros(snr.shape, bool)
        order, row = np.argsort(-snr, axis=1, kind="stable"), np.arange(len(snr))
        place = targets.range / self._cell[0], targets.rate / self._cell[1]
        for column in order.T:
            shows = above[row, column] & ~taken[row, column]
            beside = snr < snr[row, column][:, None]
            for own, reach in zip(place, _HIDES, strict=True):
                beside &= np.abs(own - own[row, column][:, None]) < reach
            taken |= beside & shows[:, None]
        return taken

    def _measured(self, targets: Targets, found: BoolArray, snr: Float64Array, cells: int) -> Echoes:
        weaker = 1.0 / np.sqrt(np.maximum(10.0 ** (snr / 10.0), 0.3))
        away = targets.range + self._error(np.hypot(_CELL_ERROR * self._cell[0] * weaker, _SURFACE))
        half = 0.5 * self._cell[1]
        rate = targets.rate + cells * self._cell[1] + np.clip(self._error(_CELL_ERROR * self._cell[1] * weaker), -half, half)
        rate = (rate + self._fastest) % (2.0 * self._fastest) - self._fastest
        azimuth = np.full_like(away, self._mount.yaw)
        if self._wide:
            azimuth = targets.azimuth + self._error(np.hypot(np.minimum(self._direction_error[0] * weaker, _WIDEST_ERROR), _GLINT))
        elevation = np.full_like(away, self._mount.tilt)
        if self._high:
            elevation = targets.elevation + self._error(np.minimum(self._direction_error[1] * weaker, _WIDEST_ERROR))
        return Echoes(found, away, azimuth, elevation, rate, snr)

    def _error(self, std: Float64Array) -> Float64Array:
        return np.asarray(self._rng.normal(0.0, 1.0, std.shape) * std)
