"""Turntable recordings to snapshots: what every channel receives from a corner reflector in known directions (thesis, section 3.2)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from radar_core import AntennaArray, ConfigError, DataError, RadarFrame, RadarInfo
from radar_core.checks import require_finite, require_shape
from radar_dsp.windows import make_window

_CONTRAST = 10.0
"""A reflector has to stand out by this over the median cell [dB]; below, angles of noise would be fitted."""


class Reading(Protocol):
    """A frame, where the reflector then was in the sensor frame [rad], and the number of the turntable's sweep."""

    @property
    def azimuth(self) -> float:
        """Azimuth of the reflector [rad]."""
        ...

    @property
    def elevation(self) -> float:
        """Elevation of the reflector [rad]."""
        ...

    @property
    def sweep(self) -> int:
        """Number of the sweep; each has mounting offsets of its own."""
        ...

    @property
    def frame(self) -> RadarFrame:
        """Raw samples."""
        ...


@dataclass(frozen=True, eq=False)
class Snapshots:
    """Complex amplitudes of one reflector in all channels, over known directions.

    Attributes
    ----------
    azimuth, elevation : ndarray of float64, shape (n_snapshot,)
        Where the reflector was, in the sensor frame [rad].
    sweep : ndarray of int64, shape (n_snapshot,)
        Sweep that each belongs to.
    values : ndarray of complex128, shape (n_snapshot, n_channel)
        Spectrum in the reflector's cell; channel v = tx * n_rx + rx. Each row has an unknown factor of its own.
    range : float
        Distance of the reflector [m]; infinite: plane waves.
    snr : float
        Power in the reflector's cell over that of the median cell [dB]; NaN: not measured.

    Raises
    ------
    DataError
        When lengths differ, a number is not finite, or a direction lies behind the array.
    """

    azimuth: NDArray[np.float64]
    elevation: NDArray[np.float64]
    sweep: NDArray[np.int64]
    values: NDArray[np.complex128]
    range: float = np.inf
    snr: float = field(default=np.nan)

    def __post_init__(self) -> None:
        n = len(self.azimuth)
        for name in ("azimuth", "elevation", "sweep"):
            require_shape(f"Snapshots.{name}", getattr(self, name), (n,))
            require_finite(f"Snapshots.{name}", getattr(self, name))
        require_shape("Snapshots.values", self.values, (n, None))
        require_finite("Snapshots.values", self.values)
        if n == 0:
            raise DataError("Snapshots is empty; the recording holds no frame at a known angle")
        if not self.range > 0:
            raise DataError(f"Snapshots.range is {self.range}; it must be positive")
        if np.any(np.abs(self.azimuth) >= np.pi / 2) or np.any(np.abs(self.elevation) >= np.pi / 2):
            raise DataError("Snapshots has directions of 90 degrees and more, behind the array; give radians, within +-90 degrees")

    def __len__(self) -> int:
        return len(self.azimuth)

    @property
    def cosines(self) -> NDArray[np.float64]:
        """Direction cosines along y and z, shape (n_snapshot, 2)."""
        return np.stack([np.cos(self.elevation) * np.sin(self.azimuth), np.sin(self.elevation)], axis=-1)


def gather(readings: Iterable[Reading], info: RadarInfo, distance: float = 0.0, nearest: float = 0.5) -> Snapshots:
    """Cut the reflector out of the frames of a turntable.

    The reflector stands still: the mean over the chirps is its Doppler cell, and transmitters that take turns need no compensation. One
    range cell, the strongest over all angles and channels, is used throughout, so that the transform turns all channels alike.

    Parameters
    ----------
    readings : iterable of Reading
        Frames with the directions in which the reflector stood.
    info : RadarInfo
        The radar.
    distance : float
        Where to look for the reflector [m], within two range cells; 0: the strongest echo beyond ``nearest``.
    nearest : float
        Nearer echoes are taken for coupling [m].

    Returns
    -------
    Snapshots
        One row per frame.

    Raises
    ------
    ConfigError
        When the waveform measures no range.
    DataError
        When a frame contradicts ``info``, has non-finite samples or lost all chirps of a transmitter, or no reflector stands out.
    """
    w = info.waveform
    if w.modulation != "fmcw" or w.n_sample < 8:
        raise ConfigError(
            f"calibration needs chirps to tell the reflector by its range, not {w.modulation!r} with {w.n_sample} samples; use fmcw"
        )
    window = make_window("nuttall", w.n_sample)
    where, profiles = [], []
    for reading in readings:
        reading.frame.check(info)
        where.append((reading.azimuth, reading.elevation, reading.sweep))
        profiles.append(scipy.fft.fft(_steady(reading.frame) * window, axis=-1).reshape(-1, w.n_sample))
    if not where:
        raise DataError("the recording holds no frame at a known angle; check when its sweeps begin, and their dwell")
    profile = np.stack(profiles)
    power = (profile.real**2 + profile.imag**2).mean(axis=(0, 1))
    cell, contrast = _find(power, info, distance, nearest)
    azimuth, elevation, sweep = (np.array(column) for column in zip(*where, strict=True))
    offset = _between(power[cell - 1 : cell + 2])
    return Snapshots(azimuth, elevation, sweep, profile[:, :, cell], (cell + offset) * w.range_resolution, contrast)


def _steady(frame: RadarFrame) -> NDArray[np.complex128]:
    """Mean over the chirps that were not lost, shape (tx, rx, sample)."""
    n_tx, n_chirp = frame.cube.shape[:2]
    present = np.ones((n_chirp, n_tx))
    present.reshape(-1)[frame.missing] = 0.0
    count = present.sum(axis=0)
    if np.any(count == 0):
        raise DataError(f"frame {frame.sequence} lost every chirp of transmitter {int(np.argmin(count))}; record that angle again")
    cube = frame.cube.astype(np.complex128)
    return np.asarray(np.einsum("lt,tlrs->trs", present, np.where(present.T[:, :, None, None] > 0, cube, 0.0)) / count[:, None, None])


def _find(power: NDArray[np.float64], info: RadarInfo, distance: float, nearest: float) -> tuple[int, float]:
    """Range cell of the reflector, and how far it stands out [dB]."""
    resolution, n = info.waveform.range_resolution, len(power)
    cells = np.arange(n)
    near = np.abs(cells * resolution - distance) <= 2 * resolution if distance > 0 else cells * resolution >= nearest
    candidates = np.flatnonzero(near & (cells >= 1) & (cells < n - 1))
    if len(candidates) == 0:
        raise ConfigError(f"the reflector is said to be at {distance:g} m, but the radar sees up to {info.waveform.max_range:g} m")
    cell = int(candidates[np.argmax(power[candidates])])
    floor = float(np.median(power))
    contrast = 10 * np.log10(power[cell] / floor) if floor > 0 else (np.inf if power[cell] > 0 else -np.inf)
    if contrast < _CONTRAST:
        raise DataError(
            f"no reflector stands out: the strongest cell, at {cell * resolution:.2f} m, is {contrast:.1f} dB over the median; put up a "
            "larger reflector, or say how far it is"
        )
    return cell, float(contrast)


def _between(power: NDArray[np.float64]) -> float:
    """Maximum of a parabola through three log powers, in cells from the middle one."""
    a, b, c = np.log(np.maximum(power, np.finfo(np.float64).tiny))
    bend = a - 2 * b + c
    return float(np.clip(0.5 * (a - c) / bend, -0.5, 0.5)) if bend < 0 else 0.0


def spherical(array: AntennaArray, cosines: NDArray[np.float64], distance: float, wavelength: float) -> NDArray[np.complex128]:
    """Compute what a reflector at a finite distance adds to the phases of a plane wave.

    Parameters
    ----------
    array : AntennaArray
        Nominal positions.
    cosines : ndarray, shape (n, 2)
        Direction cosines along y and z.
    distance : float
        Of the reflector from the array's origin [m]; infinite: nothing is added.
    wavelength : float
        Wavelength [m].

    Returns
    -------
    ndarray of complex128, shape (n, n_channel)
        Phasors. Their phase is about 2 pi / lambda (|p|^2 - (p.u)^2) / 2 R for each of the two elements of a channel.
    """
    if not np.isfinite(distance):
        return np.ones((len(cosines), array.n_tx * array.n_rx), np.complex128)
    legs = []
    for elements in (np.asarray(array.tx, np.float64), np.asarray(array.rx, np.float64)):
        along = cosines @ elements.T
        square = (elements**2).sum(-1)
        # sqrt(R^2 - 2 R p.u + p^2) - (R - p.u), written without the difference of two large numbers
        leg = np.sqrt(distance**2 - 2 * distance * along + square)
        legs.append((square - along**2) / (leg + distance - along))
    extra = (legs[0][:, :, None] + legs[1][:, None, :]).reshape(len(cosines), -1)
    return np.asarray(np.exp(2j * np.pi / wavelength * extra))
