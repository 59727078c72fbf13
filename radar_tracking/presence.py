"""Whether somebody is there, from raw frames of any radar, of one channel too: what moves, and what only breathes."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from radar_core import ConfigError, DataError, RadarFrame, RadarInfo
from radar_core.config import config, knob
from radar_core.windows import window_shape
from radar_dsp.phase import circle_centre

Complex = NDArray[np.complex64]
Float64Array = NDArray[np.float64]

_BLOCK: Final = 0.05  # s: frames within it become one sample of what moves slowly; a chest turns the phase by a radian in it at most
_EMPTY: Final = 0.01  # of the upper quartile: range cells with less hold no noise
_LOOK: Final = 0.5  # s: from one look at what breathes to the next
_CHEST: Final = (1e-4, 1.5e-2)  # m: standard deviation of a chest's way; less is noise, more is no breath
_BAND: Final = (0.05, 2.0)  # Hz: what a breath is compared with


@config
class PresenceConfig:
    """When somebody counts as there."""

    near: float = knob(0.3, unit="m", low=0.0, high=100.0, doc="what is nearer is leakage")
    far: float = knob(100.0, unit="m", low=0.1, high=1e4, doc="what is farther does not count")
    false_alarm: float = knob(1e-6, low=1e-12, high=0.1, doc="wanted probability of a false alarm on noise, per frame")
    margin: float = knob(3.0, unit="dB", low=0.0, high=60.0, doc="above the threshold for noise, because receivers have more than noise")
    drift: float = knob(-40.0, unit="dB", low=-100.0, high=0.0, doc="slow changes so far below what stands still are the radar's own")
    hold: float = knob(7.0, unit="s", low=0.0, high=600.0, doc="how long who moved counts as there; breath is seen after half the window")
    walk: float = knob(0.25, unit="m/s", low=0.01, high=10.0, doc="what is faster is no chest: breathing is looked for anew")
    window: float = knob(12.0, unit="s", low=4.0, high=60.0, doc="over which breathing is looked for")
    breath_low: float = knob(0.1, unit="Hz", low=0.05, high=1.0, doc="slowest breath")
    breath_high: float = knob(0.7, unit="Hz", low=0.1, high=2.0, doc="fastest breath")
    regular: float = knob(0.5, low=0.0, high=1.0, doc="share of the chest's motion that is in one rate, for the rate to be given")

    def validate(self) -> None:
        """Raise `ConfigError` when a range is empty."""
        for low, high in (("near", "far"), ("breath_low", "breath_high")):
            if getattr(self, low) >= getattr(self, high):
                raise ConfigError(f"PresenceConfig.{low} must be less than {high}")


@dataclass(frozen=True)
class Presence:
    """What one frame, and those of the window before it, tell.

    Attributes
    ----------
    stamp_ns, sequence : int
        Middle of the acquisition [ns]; of the frame.
    present, moving, still : bool
        Somebody is there; something moves in this frame; something moves slowly, as a chest does.
    distance : float
        Of what moves most, else of what breathes [m]; NaN: nobody.
    speed : float
        Mean range rate of what moves, receding positive [m/s]; NaN: nothing moves.
    breathing : float
        Rate of breath [Hz]; NaN: not seen.
    level : float
        What moves most in this frame, over the noise [dB].
    """

    stamp_ns: int
    sequence: int
    present: bool
    moving: bool
    still: bool
    distance: float
    speed: float
    breathing: float
    level: float


class PresenceDetector:
    """Says of each frame whether somebody is there.

    Fast motion: the variance of a range cell over the chirps of a frame, against the median of all cells, which holds noise; both are chi
    square on noise. Slow motion: the variance of the frames' means over the window, against the noise of such means and the radar's own
    drift. Breath: the way of the strongest such cell, from its phase about the centre of the circle that a moving echo makes beside
    standing ones.

    Parameters
    ----------
    config : PresenceConfig
        What to look for.
    info : RadarInfo
        The radar; a `ConfigError` says that it gives no frames, or that its frames are too small.
    """

    def __init__(self, config: PresenceConfig, info: RadarInfo) -> None:
        w = info.waveform
        if w.n_sample < 4 or w.n_chirp < 4 or w.modulation != "fmcw":
            raise ConfigError("presence needs raw frames of a chirp sequence with at least four chirps and four samples")
        self._config, self._info, self._wave = config, info, w.wavelength
        self._window = window_shape("hann", w.n_sample).astype(np.float32)
        place = np.arange(w.n_sample) * w.range_resolution
        self._place, self._used = place, (place >= config.near) & (place <= config.far)
        if self._used.sum() < 3:
            raise ConfigError(f"presence: between near and far lie {int(self._used.sum())} of the radar's range cells, but it takes three")
        n_channel = info.array.n_tx * info.array.n_rx
        self._freedom = 2 * n_channel * (w.n_chirp - 1)
        rate = config.false_alarm / w.n_sample
        above = 10 ** (config.margin / 10)
        self._fast = above * float(chi2.isf(rate, self._freedom)) / self._freedom
        self._per_block = max(round(_BLOCK / w.frame_interval), 1)
        self._step = self._per_block * w.frame_interval
        self._length = max(round(config.window / self._step), 8)
        slow = 2 * n_channel * (self._length - 1)
        self._slow = above * float(chi2.isf(rate, slow)) / slow
        self._reset()

    def _reset(self) -> None:
        self._means: deque[Complex] = deque(maxlen=self._length)
        self._part: list[Complex] = []
        self._noise = math.nan
        self._moved_ns: int | None = None
        self._last: tuple[int, int] | None = None
        self._since = 0
        self._slow_found: tuple[bool, float, float] = (False, math.nan, math.nan)

    def process(self, frame: RadarFrame) -> Presence:
        """Look at one frame; frames that are missing, or go back, begin the slow part anew. A `DataError`: it is not of this radar."""
        frame.check(self._info)
        if self._last is not None and (frame.stamp_ns <= self._last[0] or frame.sequence - self._last[1] > self._length):
            self._reset()
        self._last = frame.stamp_ns, frame.sequence
        n_tx, n_chirp, n_rx, n_sample = frame.cube.shape
        cells = np.fft.fft(frame.cube * self._window, axis=-1).transpose(0, 2, 1, 3).reshape(n_tx * n_rx, n_chirp, n_sample)
        if len(frame.missing):
            lost = np.unique(frame.missing // n_tx)
            cells = np.delete(cells, lost, axis=1)
            if cells.shape[1] < 4:
                raise DataError(f"frame {frame.sequence} lacks {len(lost)} of its {n_chirp} chirps")
        mean = cells.mean(axis=1)
        rest = cells - mean[:, None]
        moved = (np.abs(rest) ** 2).sum(axis=(0, 1), dtype=np.float64) / (len(cells) * (cells.shape[1] - 1))
        moving, level, where, speed = self._moves(moved, rest)
        stamp = frame.stamp_ns + self._info.waveform.acquisition_ns // 2
        if moving:
            self._moved_ns = stamp
        self._keep(mean.astype(np.complex64), cells.shape[1], moving and abs(speed) > self._config.walk)
        still, chest, rate = self._slow_found
        held = self._moved_ns is not None and stamp - self._moved_ns <= self._config.hold * 1e9
        distance = where if moving else chest if still else math.nan
        speed = speed if moving else math.nan
        return Presence(stamp, frame.sequence, moving or held or still, moving, still, distance, speed, rate, level)

    def _moves(self, moved: Float64Array, rest: Complex) -> tuple[bool, float, float, float]:
        """Whether something moves, how much over the noise [dB], where [m], how fast [m/s]."""
        holds = moved > _EMPTY * np.quantile(moved, 0.75)
        noise = float(np.median(moved[holds])) if holds.any() else 0.0
        if noise <= 0.0:
            return False, 0.0, math.nan, math.nan
        self._noise = noise if math.isnan(self._noise) else min(noise, 1.05 * self._noise)  # who fills half of the cells raises the median
        ratio = np.where(self._used & holds, moved / self._noise, 0.0)
        best = int(ratio.argmax())
        if ratio[best] <= self._fast:
            return False, 10 * math.log10(max(ratio[best], 1e-10)), math.nan, math.nan
        cells = np.flatnonzero(ratio > self._fast)
        turn = (rest[:, 1:, cells] * rest[:, :-1, cells].conj()).sum()
        speed = float(np.angle(turn)) * self._wave / (4 * np.pi * self._info.waveform.slow_interval)
        return True, 10 * math.log10(ratio[best]), float(self._place[best]), speed

    def _keep(self, mean: Complex, n_chirp: int, walks: bool) -> None:
        """Gather what moves slowly; who walks hides it."""
        if walks:
            self._means.clear()
            self._part.clear()
            self._slow_found = (False, math.nan, math.nan)
            return
        self._part.append(mean)
        if len(self._part) < self._per_block:
            return
        self._means.append(np.mean(self._part, axis=0))
        self._part.clear()
        self._since += 1
        if self._since * self._step >= _LOOK and len(self._means) * 2 >= self._length:
            self._since = 0
            self._slow_found = self._breathes(np.stack(self._means), self._noise / (n_chirp * self._per_block))

    def _breathes(self, means: Complex, noise: float) -> tuple[bool, float, float]:
        """Whether something moves slowly, where [m], and how fast it breathes [Hz]; ``means`` over (time, channel, range)."""
        still = means.mean(axis=0)
        moved = (np.abs(means - still) ** 2).mean(axis=0).mean(axis=0) * len(means) / (len(means) - 1)
        floor = noise * self._slow + 10 ** (self._config.drift / 10) * (np.abs(still) ** 2).mean(axis=0)
        ratio = np.where(self._used, moved / np.maximum(floor, 1e-300), 0.0)
        if ratio.max() <= 1 or not noise > 0:
            return False, math.nan, math.nan
        best = int(np.where(ratio > 1, moved, 0.0).argmax())
        series = means[:, :, best]
        channel = int((np.abs(series - series.mean(axis=0)) ** 2).sum(axis=0).argmax())
        return True, float(self._place[best]), self._rate(series[:, channel].astype(np.complex128))

    def _rate(self, series: NDArray[np.complex128]) -> float:
        """Rate of the way that an echo's phase tells [Hz]; NaN: it is no breath."""
        way = np.unwrap(np.angle(series - circle_centre(series))) * self._wave / (4 * np.pi)
        time = np.arange(len(way)) * self._step
        way = way - np.polyval(np.polyfit(time, way, 1), time)
        if not _CHEST[0] <= way.std() <= _CHEST[1]:
            return math.nan
        size = 8 * len(way)
        power = np.abs(np.fft.rfft(way * np.hanning(len(way)), size)) ** 2
        rate = np.fft.rfftfreq(size, self._step)
        band = (rate >= self._config.breath_low) & (rate <= self._config.breath_high)
        best = int(np.where(band, power, 0.0).argmax())
        around = np.abs(rate - rate[best]) <= 2 / (len(way) * self._step)
        all_ = (rate >= _BAND[0]) & (rate <= _BAND[1])
        share = power[around & all_].sum() / max(power[all_].sum(), 1e-300)
        return float(rate[best]) if share >= self._config.regular else math.nan
