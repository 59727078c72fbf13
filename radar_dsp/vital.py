"""Breath and pulse of somebody who sits or lies still: from the phase of the range cells about the person."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError, RadarFrame, RadarInfo
from radar_core.config import config, knob
from radar_core.windows import window_shape
from radar_dsp.phase import way_of

Complex = NDArray[np.complex64]
Float64Array = NDArray[np.float64]

_LOOK: Final = 1.0  # s: from one look to the next
_REACH: Final = 0.4  # m: nearer and farther than the place by that much a chest may be
_STEP: Final = 0.1  # s: of the way that is looked at
_GAP: Final = 0.5  # s: without frames for longer, the window begins anew
_CHEST: Final = (1e-4, 1.5e-2)  # m: standard deviation of a chest's way; less is noise, more is no breath
_PULSE: Final = 3e-5  # m: a pulse moves a chest by more
_BAND: Final = (0.05, 2.5)  # Hz: what a breath is compared with
_HARMONICS: Final = 2.2  # Hz: as far as harmonics of breath are taken out
_FINE: Final = 8  # a spectrum's points are so many times finer than its resolution


@config
class VitalConfig:
    """What counts as breath and pulse."""

    window: float = knob(30.0, unit="s", low=10.0, high=120.0, doc="over which rates are taken; half of it has to pass first")
    breath_low: float = knob(0.1, unit="Hz", low=0.05, high=1.0, doc="slowest breath")
    breath_high: float = knob(0.5, unit="Hz", low=0.1, high=2.0, doc="fastest breath")
    heart_low: float = knob(0.8, unit="Hz", low=0.3, high=3.0, doc="slowest pulse")
    heart_high: float = knob(2.0, unit="Hz", low=0.5, high=4.0, doc="fastest pulse")
    regular: float = knob(0.4, low=0.0, high=1.0, doc="share of the motion that is breath and its harmonics, for its rate to be given")
    clear: float = knob(30.0, low=1.0, high=1e6, doc="power of the pulse over the median of its band, for its rate to be given")
    moved: float = knob(0.3, unit="m", low=0.05, high=2.0, doc="whose place changes by more begins anew")

    def validate(self) -> None:
        """Raise `ConfigError` when a band is empty."""
        for name in ("breath", "heart"):
            if getattr(self, f"{name}_low") >= getattr(self, f"{name}_high"):
                raise ConfigError(f"VitalConfig.{name}_low must be less than {name}_high")


@dataclass(frozen=True)
class VitalSigns:
    """What one look tells.

    Attributes
    ----------
    stamp_ns, sequence : int
        Middle of the acquisition [ns] and number of the newest frame.
    distance : float
        Of the place that is looked at [m].
    breath, heart : float
        Rates [Hz]; NaN: not seen.
    motion : float
        Standard deviation of the way of what moves there [m]; NaN: not enough frames yet.
    """

    stamp_ns: int
    sequence: int
    distance: float
    breath: float
    heart: float
    motion: float


class VitalMonitor:
    """Follows breath and pulse of one person.

    All channels and range cells about the person tell one way (`radar_dsp.phase.way_of`). Breath is the strongest line in the spectrum of
    its speed. Pulse is the strongest line of what is left of the speed when breath and its harmonics are taken out by least squares.
    Directions are not used: who is at the same distance, within 0.4 m, is mixed in.

    Parameters
    ----------
    config : VitalConfig
        What to look for.
    info : RadarInfo
        The radar; a `ConfigError` says that it gives no frames of chirps.
    """

    def __init__(self, config: VitalConfig, info: RadarInfo) -> None:
        w = info.waveform
        if w.n_sample < 4 or w.modulation != "fmcw":
            raise ConfigError("breath and pulse need raw frames of chirps with at least four samples")
        self._config, self._info = config, info
        self._window = window_shape("hann", w.n_sample)
        self._origin = np.asarray(info.mount.origin)
        self._seen: deque[tuple[int, Complex]] = deque(maxlen=max(round(config.window / w.frame_interval), 8))
        self._place: Float64Array | None = None
        self._looked_ns = 0

    def process(self, frame: RadarFrame, place: Float64Array) -> VitalSigns | None:
        """Take one frame and where the person is in it.

        Parameters
        ----------
        frame : RadarFrame
            Of this radar, else a `DataError`; finite.
        place : ndarray, shape (3,)
            Of the person's body, in ``room`` [m].

        Returns
        -------
        VitalSigns or None
            None: no look is due; there is one a second.
        """
        frame.check(self._info)
        place = np.asarray(place, np.float64)
        if place.shape != (3,) or not np.isfinite(place).all():
            raise DataError(f"place is {place}; it has to be three finite numbers")
        stamp = frame.stamp_ns + self._info.waveform.acquisition_ns // 2
        gap = stamp - self._seen[-1][0] if self._seen else 0
        moved = self._place is None or math.dist(place, self._place) > self._config.moved
        if self._place is None or moved or (self._seen and not 0 < gap <= _GAP * 1e9):
            self._begin(place, stamp)
        lost = np.unique(frame.missing // frame.cube.shape[0])
        chirps = np.delete(frame.cube, lost, axis=1) if len(lost) else frame.cube
        if chirps.shape[1]:
            mean = chirps.mean(axis=1, dtype=np.complex128)
            self._seen.append((stamp, (mean @ self._transform).reshape(-1).astype(np.complex64)))
        if stamp - self._looked_ns < _LOOK * 1e9:
            return None
        self._looked_ns = stamp
        return VitalSigns(stamp, frame.sequence, self._distance, *self._look())

    def _begin(self, place: Float64Array, stamp: int) -> None:
        """Look at the range cells about a place from now on."""
        w = self._info.waveform
        self._seen.clear()
        self._place, self._looked_ns = place, stamp
        self._distance = math.dist(place, self._origin)
        cells = np.arange(w.n_sample)
        cells = cells[np.abs(cells * w.range_resolution - self._distance) <= max(_REACH, w.range_resolution)]
        turn = np.exp(-2j * np.pi * np.outer(np.arange(w.n_sample), cells) / w.n_sample)
        self._transform = self._window[:, None] * turn

    def _look(self) -> tuple[float, float, float]:
        """Rates of breath and pulse [Hz], and how much the chest moves [m]."""
        time = np.array([stamp - self._seen[0][0] for stamp, _ in self._seen]) * 1e-9 if self._seen else np.empty(0)
        if len(time) < 8 or time[-1] < self._config.window / 2 or not self._transform.size:
            return math.nan, math.nan, math.nan
        series = np.stack([cells for _, cells in self._seen])
        even = np.arange(0.0, time[-1], _STEP)
        way = np.interp(even, time, way_of(series, self._info.waveform.wavelength))
        way -= np.polyval(np.polyfit(even, way, 1), even)
        motion = float(way.std())
        if not _CHEST[0] <= motion <= _CHEST[1]:
            return math.nan, math.nan, motion
        speed = np.diff(way) / _STEP
        breath, share = self._breath(speed)
        heart = self._heart(speed, breath)
        return (breath if share >= self._config.regular else math.nan), heart, motion

    def _breath(self, speed: Float64Array) -> tuple[float, float]:
        """Rate of the strongest line [Hz], and the share of the speed's power that it and its first harmonic have."""
        rate, power = _spectrum(speed)
        band = (rate >= self._config.breath_low) & (rate <= self._config.breath_high)
        best = float(rate[np.where(band, power, 0.0).argmax()])
        wide, whole = 2 / (len(speed) * _STEP), (rate >= _BAND[0]) & (rate <= _BAND[1])
        own = (np.abs(rate - best) <= wide) | (np.abs(rate - 2 * best) <= wide)
        return best, float(power[own & whole].sum() / max(power[whole].sum(), 1e-300))

    def _heart(self, speed: Float64Array, breath: float) -> float:
        """Rate of the pulse [Hz]; NaN: no line is clear."""
        rest = speed
        for half in (0.5, 0.05):  # of the resolution: first coarsely, then finely
            bases = breath + np.linspace(-half, half, 11) / (len(speed) * _STEP)
            rests = [_without(speed, base, max(int(_HARMONICS / base), 1)) for base in bases.tolist()]
            best = int(np.argmin([other.var() for other in rests]))
            breath, rest = float(bases[best]), rests[best]
        rate, power = _spectrum(rest)
        band = (rate >= self._config.heart_low) & (rate <= self._config.heart_high)
        best = int(np.where(band, power, 0.0).argmax())
        size = 4 * math.sqrt(power[best]) / len(speed) / (2 * np.pi * rate[best])  # of the way; behind a Hann window a line keeps half
        clear = power[best] > self._config.clear * float(np.median(power[band]))
        return float(rate[best]) if clear and size > _PULSE else math.nan


def _spectrum(values: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Rates [Hz] and powers of a series of step `_STEP`."""
    size = _FINE * len(values)
    power = np.abs(np.fft.rfft(values * np.hanning(len(values)), size)) ** 2
    return np.asarray(np.fft.rfftfreq(size, _STEP), np.float64), np.asarray(power, np.float64)


def _without(values: Float64Array, base: float, count: int) -> Float64Array:
    """Take a line and its harmonics out of a series, ``count`` lines in all, by least squares."""
    angle = 2 * np.pi * base * _STEP * np.outer(np.arange(len(values)), np.arange(1, count + 1))
    lines = np.column_stack([np.cos(angle), np.sin(angle), np.ones(len(values))])
    return np.asarray(values - lines @ np.linalg.lstsq(lines, values, rcond=None)[0], np.float64)
