"""Recordings of a corner reflector seen from a turntable, for calibrating an array (thesis, section 3.2 and figure 3.3)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT, AntennaArray, ConfigError, DataError, RadarFrame, RadarInfo
from radar_core.config import config, knob
from radar_sim.effects.config import PatternConfig
from radar_sim.effects.echo import Pattern
from radar_sim.propagation.base import strength

Axis = Literal["azimuth", "elevation"]
AXES: Final[tuple[Axis, ...]] = get_args(Axis)


@config
class ChannelErrors:
    """What makes the channels of a real array differ from the drawing; each channel draws its own."""

    gain: float = knob(2.0, unit="dB", low=0.0, high=30.0, doc="rms gain error of a virtual channel")
    phase: float = knob(math.radians(30.0), unit="rad", low=0.0, high=math.pi, doc="rms phase error of a virtual channel")
    shift: float = knob(2e-4, unit="m", low=0.0, high=0.1, doc="rms position error of a virtual element, along y and along z")
    seed: int = knob(0, low=0, high=1 << 62, doc="of the errors")

    def draw(self, array: AntennaArray) -> AntennaArray:
        """Put errors into an array, in place of a calibration that it carries: `AntennaArray.steering` then includes them."""
        n = array.n_tx * array.n_rx
        draws = np.random.Generator(np.random.SFC64([self.seed, 0x7A])).standard_normal((4, n))
        gain, phase = (tuple((rms * draw).tolist()) for rms, draw in zip((self.gain, self.phase), draws, strict=False))
        shift = tuple((y, z) for y, z in (self.shift * draws[2:].T).tolist())
        return dataclasses.replace(array, channel_gain=gain, channel_phase=phase, channel_shift=shift)


@config
class Sweep:
    """One sweep of the turntable: it stands ``dwell`` seconds at each angle, then goes to the next.

    Angles are in degrees, as on a turntable's scale, and say where the radar sees the reflector: left and up are positive. A turntable that
    turns the radar to the left moves the reflector to the right, so its own angles count the other way: give it ``start: 60, step: -1``.
    """

    axis: Axis = knob("azimuth", doc="which angle of the reflector changes")
    start: float = knob(-60.0, unit="deg", low=-89.0, high=89.0, doc="first angle")
    stop: float = knob(60.0, unit="deg", low=-89.0, high=89.0, doc="last angle")
    step: float = knob(1.0, unit="deg", low=-90.0, high=90.0, doc="from one angle to the next; negative: downwards")
    cross: float = knob(0.0, unit="deg", low=-89.0, high=89.0, doc="the other angle, which stays")
    dwell: float = knob(1.0, unit="s", low=1e-3, high=1e4, doc="time at each angle")
    settle: float = knob(0.0, unit="s", low=0.0, high=1e4, doc="frames nearer than this to a change of angle are left out")
    begin: float | None = knob(
        None, unit="s", low=0.0, high=1e6, doc="start of the first angle, after the recording's first frame; empty: after the sweep before"
    )

    def validate(self) -> None:
        """Raise `ConfigError` when the step does not lead from start to stop, or settling leaves no time."""
        if self.step == 0.0 or (self.stop - self.start) * self.step < 0:
            raise ConfigError(f"Sweep.step is {self.step:g} deg; it must lead from start = {self.start:g} to stop = {self.stop:g} deg")
        if 2 * self.settle >= self.dwell:
            raise ConfigError(f"Sweep.settle is {self.settle:g} s of a dwell of {self.dwell:g} s; make it less than half")

    @property
    def angles(self) -> NDArray[np.float64]:
        """Angles in their order, shape (n_angle,) [rad]."""
        n = math.floor((self.stop - self.start) / self.step + 1e-6) + 1
        return np.asarray(np.radians(self.start + self.step * np.arange(n)))

    def directions(self) -> NDArray[np.float64]:
        """Directions in their order, shape (n_angle, 2) = (azimuth, elevation) [rad]."""
        angles = self.angles
        cross = np.full_like(angles, math.radians(self.cross))
        return np.stack([angles, cross] if self.axis == "azimuth" else [cross, angles], axis=-1)


def begins(sweeps: tuple[Sweep, ...]) -> list[float]:
    """When every sweep of a recording begins, after its first frame [s]."""
    times, end = [], 0.0
    for sweep in sweeps:
        times.append(end if sweep.begin is None else sweep.begin)
        end = times[-1] + len(sweep.angles) * sweep.dwell
    return times


@config
class Turntable:
    """A corner reflector in an anechoic chamber and a radar that turns about its array's origin."""

    radar: RadarInfo = RadarInfo()
    errors: ChannelErrors | None = ChannelErrors()
    sweeps: tuple[Sweep, ...] = knob((Sweep(), Sweep(axis="elevation", start=-30.0, stop=30.0)), doc="what the turntable does, in order")
    range: float = knob(3.0, unit="m", low=0.1, high=1e4, doc="distance of the reflector")
    rcs: float = knob(10.0, unit="m^2", low=1e-9, high=1e6, doc="radar cross-section of the reflector")
    snr: float | None = knob(30.0, unit="dB", low=-50.0, high=200.0, doc="of an ideal channel in the reflector's cell; empty: no noise")
    pattern: PatternConfig | None = None
    offset_azimuth: float = knob(0.0, unit="deg", low=-30.0, high=30.0, doc="mounting error: true minus stated azimuth")
    offset_elevation: float = knob(0.0, unit="deg", low=-30.0, high=30.0, doc="mounting error: true minus stated elevation")
    frames: int = knob(1, low=1, high=10000, doc="frames at each angle, evenly over the time that it stands there")
    seed: int = knob(0, low=0, high=1 << 62, doc="of the noise")

    def validate(self) -> None:
        """Raise `ConfigError` when the reflector is out of range, frames do not fit into the dwell, or the waveform has no range."""
        w = self.radar.waveform
        if w.modulation != "fmcw" or w.n_sample == 0:
            raise ConfigError("Turntable.radar.waveform: the turntable is simulated for modulation fmcw with samples; choose that")
        if self.range >= w.max_range:
            raise ConfigError(f"Turntable.range is {self.range:g} m, but the radar sees up to {w.max_range:g} m; choose less")
        if not self.sweeps:
            raise ConfigError("Turntable.sweeps is empty; name at least one sweep, e.g. {axis: azimuth}")
        for sweep in self.sweeps:
            if self.frames * w.frame_interval > sweep.dwell * (1 + 1e-9):
                raise ConfigError(f"Turntable.frames: {self.frames} frames do not fit into a dwell of {sweep.dwell:g} s; make it longer")


@dataclass(frozen=True, eq=False)
class TurntableFrame:
    """One frame from the turntable and what its scale says."""

    azimuth: float  # where the reflector is said to be, in the sensor frame [rad]; mounting errors are not in
    elevation: float
    sweep: int  # number of the sweep
    frame: RadarFrame


class TurntableSimulator:
    """Make the frames of a turntable.

    Parameters
    ----------
    config : Turntable
        Reflector, sweeps and errors.

    Attributes
    ----------
    info : RadarInfo
        What the driver would say: the nominal array, no calibration.
    array : AntennaArray
        The array that really stands there, with its errors; None of the frames tells it.
    n_frames : int
        Number of frames.
    """

    def __init__(self, config: Turntable) -> None:
        self.config = config
        nominal = dataclasses.replace(config.radar.array, channel_gain=(), channel_phase=(), channel_shift=())
        self.info = dataclasses.replace(config.radar, array=nominal)
        self.array = config.errors.draw(nominal) if config.errors is not None else config.radar.array
        self._plan = self._make_plan()
        self.n_frames = len(self._plan)

    def _make_plan(self) -> list[tuple[float, int, float, float]]:
        """Time [s], sweep, azimuth and elevation [rad] of every frame."""
        frames, timed = self.config.frames, zip(self.config.sweeps, begins(self.config.sweeps), strict=True)
        return [
            (begin + (i + j / frames) * sweep.dwell, number, azimuth, elevation)
            for number, (sweep, begin) in enumerate(timed)
            for i, (azimuth, elevation) in enumerate(sweep.directions().tolist())
            for j in range(frames)
        ]

    def process(self, sequence: int) -> TurntableFrame:
        """Simulate one frame: samples in volts at 50 ohm, and the stated direction, of the configuration and ``sequence`` only.

        Raises
        ------
        DataError
            When there is no such frame.
        """
        if not 0 <= sequence < self.n_frames:
            raise DataError(f"there is no frame {sequence}: the turntable gives frames 0 to {self.n_frames - 1}")
        time, sweep, azimuth, elevation = self._plan[sequence]
        true = (azimuth + math.radians(self.config.offset_azimuth), elevation + math.radians(self.config.offset_elevation))
        cube = np.repeat(self._echo(*true)[:, None], self.info.waveform.n_chirp, axis=1)
        if self.config.snr is not None:
            cube += self._noise(self.config.snr, sequence)
        frame = RadarFrame(cube.astype(np.complex64), round(time * 1e9), sequence, self.info.frame_id)
        return TurntableFrame(azimuth, elevation, sweep, frame)

    def __iter__(self) -> Iterator[TurntableFrame]:
        """All frames in order."""
        return (self.process(sequence) for sequence in range(self.n_frames))

    def _amplitude(self) -> float:
        """Of an ideal channel's samples with the reflector straight ahead [V]."""
        return float(strength(self.info, np.array([self.config.rcs]))[0]) / self.config.range**2

    def _echo(self, azimuth: float, elevation: float) -> NDArray[np.complex128]:
        """Make one chirp of every channel, shape (tx, rx, sample), from the true path from element to reflector to element.

        An element's shift acts as for a plane wave: of a spherical one its square would matter, which is less than a micrometre.
        """
        w, array = self.info.waveform, self.array
        u = np.array([math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation)])
        tx, rx = (np.insert(np.asarray(elements, np.float64), 0, 0.0, axis=-1) for elements in (array.tx, array.rx))
        to, back = (np.linalg.norm(self.config.range * u - elements, axis=-1) for elements in (tx, rx))
        path = to[:, None] + back[None, :]
        if array.channel_shift:
            path = path - (np.asarray(array.channel_shift) @ u[1:]).reshape(path.shape)
        tau = path[..., None] / SPEED_OF_LIGHT
        t = np.arange(w.n_sample) / w.n_sample * w.chirp_duration
        turns = (w.carrier - w.bandwidth / 2) * tau + w.slope * tau * t
        amplitude = self._amplitude() * array.response.reshape(path.shape)[..., None]
        if self.config.pattern is not None:
            amplitude = amplitude * Pattern(self.config.pattern, self.info).gain(self.config.range * u[None])[0]
        return np.asarray(amplitude * np.exp(2j * np.pi * (turns - np.rint(turns))))

    def _noise(self, snr: float, sequence: int) -> NDArray[np.complex128]:
        w = self.info.waveform
        power = self._amplitude() ** 2 * w.n_chirp * w.n_sample / 10 ** (snr / 10)
        rng = np.random.Generator(np.random.SFC64([self.config.seed, sequence, 0x7B]))
        parts = rng.standard_normal((*self.info.cube_shape[:3], 2 * w.n_sample)) * math.sqrt(power / 2)
        return parts.view(np.complex128)
