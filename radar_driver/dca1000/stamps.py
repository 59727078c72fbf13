"""When a frame began, from when its packets came."""

from __future__ import annotations

from typing import Final

from radar_core import Waveform
from radar_driver.dca1000.packets import RawFrame

_DRIFT: Final = 1e-4  # of the time since the last frame: two crystals differ by less


class Stamps:
    """Estimates the starts of acquisitions on the clock of the packets.

    A packet comes after its samples, sometimes late, never early, and frames follow each other by the sensor's crystal: of what a packet
    says and what the frame before says, the earlier is right. More than half a frame between both is another beginning.

    Parameters
    ----------
    waveform : Waveform
        Frame interval and acquisition.
    """

    def __init__(self, waveform: Waveform) -> None:
        self._interval = waveform.frame_interval * 1e9
        self._acquisition = waveform.acquisition_ns
        self._last: tuple[int, float] | None = None

    def of(self, raw: RawFrame) -> int:
        """Estimate the start of a frame's acquisition [ns]."""
        measured = raw.arrived_ns - raw.sent / len(raw.data) * self._acquisition
        stamp = measured
        if self._last is not None and raw.number > self._last[0]:
            passed = (raw.number - self._last[0]) * self._interval
            expected = self._last[1] + passed
            if abs(measured - expected) < self._interval / 2:
                stamp = min(measured, expected + passed * _DRIFT)
        self._last = (raw.number, stamp)
        return round(stamp)
