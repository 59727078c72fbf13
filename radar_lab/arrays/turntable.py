"""Turntable recordings to snapshots: what every channel receives from a corner reflector in known directions (thesis, section 3.2)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import scipy.fft

from radar_core import AntennaArray, ConfigError, DataError, RadarFrame, RadarInfo
from radar_core.checks import require_finite, require_shape
from radar_core.config import config, knob, load_file
from radar_core.types import Complex128Array, Float64Array, IndexArray
from radar_dsp.windows import make_window
from radar_sim.turntable import Axis, Sweep, TurntableFrame, begins

SWEEPS_FILE = "turntable.yaml"
"""In the folder of a recording: what the turntable did."""
_CONTRAST = 10.0
"""A reflector has to stand out by this over the median cell [dB]; below, angles of noise would be fitted."""


@config
class Sweeps:
    """What a turntable did during one recording: the content of ``turntable.yaml`` beside the recording's other files."""

    sweeps: tuple[Sweep, ...] = knob(doc="sweeps in the order of their time")

    def validate(self) -> None:
        """Raise `ConfigError` when there is none."""
        if not self.sweeps:
            raise ConfigError("Sweeps.sweeps is empty; name at least one sweep, e.g. {axis: azimuth, dwell: 1.0}")


@dataclass(frozen=True, eq=False)
class Snapshots:
    """Complex amplitudes of one reflector in all channels, over known directions.

    Raises
    ------
    DataError
        When lengths differ, a number is not finite, or a direction lies behind the array.
    """

    # azimuth, elevation: where the reflector was, in the sensor frame, shape (n_snapshot,) [rad]
    azimuth: Float64Array
    elevation: Float64Array
    sweep: IndexArray  # sweep that each belongs to, shape (n_snapshot,)
    # Spectrum in the reflector's cell; channel v = tx * n_rx + rx. Each row has an unknown factor of its own; shape (n_snapshot, n_channel)
    values: Complex128Array
    range: float = np.inf  # distance of the reflector [m]; infinite: plane waves
    snr: float = field(default=np.nan)  # power in the reflector's cell over that of the median cell [dB]; NaN: not measured

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
    def cosines(self) -> Float64Array:
        """Direction cosines along y and z, shape (n_snapshot, 2)."""
        return np.stack([np.cos(self.elevation) * np.sin(self.azimuth), np.sin(self.elevation)], axis=-1)


def gather(readings: Iterable[TurntableFrame], info: RadarInfo, distance: float = 0.0, nearest: float = 0.5) -> Snapshots:
    """Cut the reflector out of the frames of a turntable; gives one snapshot per frame.

    The reflector stands still: the mean over the chirps is its Doppler cell, and transmitters that take turns need no compensation. One
    range cell, the strongest over all angles and channels, is used throughout, so that the transform turns all channels alike.

    Parameters
    ----------
    readings : iterable of TurntableFrame
        Frames with the directions in which the reflector stood.
    info : RadarInfo
        The radar.
    distance, nearest : float
        Where to look for the reflector, within two range cells, 0: the strongest echo beyond ``nearest``; nearer ones count as coupling
        [m].

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


def _steady(frame: RadarFrame) -> Complex128Array:
    """Mean over the chirps that were not lost, shape (tx, rx, sample)."""
    n_tx, n_chirp = frame.cube.shape[:2]
    present = np.ones((n_chirp, n_tx))
    present.reshape(-1)[frame.missing] = 0.0
    count = present.sum(axis=0)
    if np.any(count == 0):
        raise DataError(f"frame {frame.sequence} lost every chirp of transmitter {int(np.argmin(count))}; record that angle again")
    cube = frame.cube.astype(np.complex128)
    return np.asarray(np.einsum("lt,tlrs->trs", present, np.where(present.T[:, :, None, None] > 0, cube, 0.0)) / count[:, None, None])


def _find(power: Float64Array, info: RadarInfo, distance: float, nearest: float) -> tuple[int, float]:
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


def _between(power: Float64Array) -> float:
    """Maximum of a parabola through three log powers, in cells from the middle one."""
    a, b, c = np.log(np.maximum(power, np.finfo(np.float64).tiny))
    bend = a - 2 * b + c
    return float(np.clip(0.5 * (a - c) / bend, -0.5, 0.5)) if bend < 0 else 0.0


def spherical(array: AntennaArray, cosines: Float64Array, distance: float, wavelength: float) -> Complex128Array:
    """Compute what a reflector at a finite distance adds to the phases of a plane wave.

    Parameters
    ----------
    array : AntennaArray
        Nominal positions.
    cosines : ndarray, shape (n, 2)
        Direction cosines along y and z.
    distance, wavelength : float
        Of the reflector from the array's origin, infinite: nothing is added; of the radar [m].

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


def parse_sweep(axis: Axis, text: str, dwell: float, settle: float = 0.0) -> Sweep:
    """Read ``start:stop:step`` in degrees, e.g. ``-60:60:1``, and the times of a `Sweep` [s]; `ConfigError` when it is not of that form."""
    try:
        start, stop, step = map(float, text.split(":"))
    except ValueError:
        raise ConfigError(f"--{axis} {text!r}: write start:stop:step in degrees, e.g. -60:60:1") from None
    return Sweep(axis=axis, start=start, stop=stop, step=step, dwell=dwell, settle=settle)


def sweep_options(azimuth: str | None, elevation: str | None, dwell: float, settle: float) -> list[Sweep]:
    """Read what the command line says of the turntable, azimuth first; empty: nothing."""
    given: tuple[tuple[Axis, str | None], ...] = (("azimuth", azimuth), ("elevation", elevation))
    return [parse_sweep(axis, text, dwell, settle) for axis, text in given if text is not None]


def sweeps_of(recordings: Sequence[Path], options: Sequence[Sweep]) -> list[tuple[Sweep, ...]]:
    """Decide what the turntable did during each recording.

    Parameters
    ----------
    recordings : sequence of Path
        Folders of bags.
    options : sequence of Sweep
        From the command line: as many as there are recordings, one each in their order; or all of them in the only recording, one after the
        other; empty: each recording's ``turntable.yaml``.

    Raises
    ------
    ConfigError
        When options and recordings do not match, or nothing says what a turntable did.
    """
    if len(options) == len(recordings):
        return [(option,) for option in options]
    if options and len(recordings) == 1:
        return [tuple(options)]
    if options:
        raise ConfigError(f"{len(options)} sweeps are given for {len(recordings)} recordings; give one sweep each, azimuth first")
    missing = [path for path in recordings if not (path / SWEEPS_FILE).exists()]
    if missing:
        raise ConfigError(
            f"{missing[0]}: nothing says which angles the turntable took; put a {SWEEPS_FILE} there (docs/how-to/calibration.md), or "
            "give --azimuth START:STOP:STEP, --elevation START:STOP:STEP and --dwell SECONDS"
        )
    return [load_file(Sweeps, path / SWEEPS_FILE).sweeps for path in recordings]


def readings(frames: Iterable[RadarFrame], info: RadarInfo, sweeps: tuple[Sweep, ...], first: int = 0) -> Iterator[TurntableFrame]:
    """Say where the reflector was in every frame of a recording, by its time after the first one; frames between dwells are left out.

    The number of the first sweep is ``first``. `DataError` is raised when the sweeps met no frame at more than a tenth of their angles.
    """
    plan = list(zip(sweeps, begins(sweeps), strict=True))
    met = [np.zeros(len(sweep.angles), bool) for sweep in sweeps]
    length = info.waveform.acquisition_ns
    start: int | None = None
    for frame in frames:
        start = frame.stamp_ns if start is None else start
        for number, (sweep, begin) in enumerate(plan):
            angle = _dwell(sweep, (frame.stamp_ns - start) * 1e-9 - begin, length * 1e-9)
            if angle is not None:
                met[number][angle] = True
                azimuth, elevation = sweep.directions()[angle].tolist()
                yield TurntableFrame(azimuth, elevation, first + number, frame)
    for number, seen in enumerate(met):
        if np.mean(seen) < 0.9:
            raise DataError(
                f"sweep {number} ({sweeps[number].axis}) should have {len(seen)} angles, but frames meet only {int(seen.sum())}; "
                "check begin, dwell and settle, and that the recording was not cut short"
            )


def _dwell(sweep: Sweep, since: float, length: float) -> int | None:
    """Index of the angle at which a frame was taken that began ``since`` seconds into the sweep; None: between angles."""
    # Stamps are whole nanoseconds: one that falls on the change of an angle may round to either side.
    index = int(np.floor(since / sweep.dwell + 1e-6))
    into = since - index * sweep.dwell
    if not 0 <= index < len(sweep.angles) or into < sweep.settle - 1e-6 or into + length > sweep.dwell - sweep.settle + 1e-6:
        return None
    return index
