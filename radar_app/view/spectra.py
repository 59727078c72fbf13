"""Raw frames to what the feed keeps of them: range-Doppler maps, some a second, and frames, both only where somebody wants them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from radar_app.view.feed import Feed
from radar_app.view.records import RangeDoppler
from radar_core import RadarFrame, RadarInfo
from radar_dsp.config import SpectrumConfig
from radar_dsp.spectrum import make_spectrum

MAPS: Final = 5.0
"""Range-Doppler maps per second."""

_FLOOR: Final = 1e-30  # power of a cell in which there is nothing at all


class RangeDopplerMaker:
    """Make the range-Doppler map of raw frames: the powers of all virtual channels added, over their median.

    A `ConfigError` says that the radar gives no frames that can be transformed.
    """

    def __init__(self, info: RadarInfo) -> None:
        self.info = info
        self._spectrum = make_spectrum(SpectrumConfig(), info)

    def process(self, frame: RadarFrame) -> RangeDoppler:
        """Transform one frame; a `DataError` says that it does not fit the radar."""
        spectrum = self._spectrum.process(np.ascontiguousarray(frame.cube, np.complex64))
        power = (spectrum.real**2 + spectrum.imag**2).sum(axis=(0, 2), dtype=np.float64)
        level = 10 * np.log10(np.fft.fftshift(power, axes=0).T + _FLOOR)
        waveform = self.info.waveform
        return RangeDoppler(
            frame.frame_id, (level - np.median(level)).astype(np.float32), level.shape[0] * waveform.range_resolution, waveform.max_speed
        )


class FrameTaker:
    """Puts of the raw frames of one topic into a feed what somebody wants of them."""

    def __init__(self, feed: Feed) -> None:
        self._feed = feed
        self._last = -np.inf
        self._maker: RangeDopplerMaker | None = None
        self._tried: RadarInfo | None = None

    def take(self, now: float, frame: Callable[[], RadarFrame]) -> None:
        """Take in what ``frame`` returns, which is asked only where it is wanted; ``now`` is the time by which maps are made [s]."""
        mapped = self._feed.wanted("range_doppler") and not 0 <= now - self._last < 1.0 / MAPS
        if not (mapped or self._feed.wanted("frames")):
            return
        taken = frame()
        if self._feed.wanted("frames"):
            self._feed.put("frames", taken.stamp_ns, taken)
        if mapped:
            self._last = now
            self._look_at(self._feed.radars.get(taken.frame_id))
            if self._maker is not None:
                self._feed.put("range_doppler", taken.stamp_ns, self._maker.process(taken))

    def _look_at(self, info: RadarInfo | None) -> None:
        """Be ready for what the radar is, where its frames can be transformed."""
        if info is None or info == self._tried:
            return
        self._tried, self._maker = info, None
        if info.waveform.n_sample:
            self._maker = RangeDopplerMaker(info)


def wanted(feed: Feed) -> bool:
    """Whether somebody wants raw frames, or maps of them."""
    return feed.wanted("frames") or feed.wanted("range_doppler")
