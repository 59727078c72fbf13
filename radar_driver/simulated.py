"""A simulated radar that sends by itself, as a board does."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from radar_core import RadarInfo
from radar_driver.components import PowerState
from radar_driver.live import Reading
from radar_driver.sources import SimSource

_WARM: Final = 5  # frames


class SimLive:
    """Frames of a scene in their own time; a `radar_driver.live.LiveSource`. The scene begins again where it ends.

    Parameters
    ----------
    scene : str or Path
        Scene file, or one of ours by name.
    radar : str
        Which radar of the scene, where it has several.

    Attributes
    ----------
    info : RadarInfo
        The scene's.
    """

    def __init__(self, scene: str | Path, radar: str = "") -> None:
        self._source = SimSource(scene, radar)
        self.info: RadarInfo = self._source.info
        self._state = PowerState.OFF
        self._interval_ns = round(self._source.interval * 1e9)
        self._start = self._next = 0
        self._skipped = 0

    def power_up(self) -> None:
        """Compile what the scene needs: that must not fall into the measurement."""
        for number in range(_WARM):
            self._source.read(number)
        self._state = PowerState.SUSPENDED

    def resume(self) -> None:
        """Begin now."""
        self._state = PowerState.RUNNING
        self._start, self._next = time.monotonic_ns(), 0

    def suspend(self) -> None:
        """Stop; the scene starts again with the next `resume`."""
        self._state = PowerState.SUSPENDED

    def power_down(self) -> None:
        """Nothing to close."""
        self._state = PowerState.OFF
        self._source.close()

    def read(self, timeout: float) -> Reading | None:
        """Wait until the next frame's acquisition has ended, then simulate it; frames that are late already are left out."""
        due = self._start + (self._next + 1) * self._interval_ns
        wait = (due - time.monotonic_ns()) * 1e-9
        if wait > timeout:
            time.sleep(timeout)
            return None
        time.sleep(max(wait, 0.0))
        newest = max((time.monotonic_ns() - self._start) // self._interval_ns - 1, self._next)
        self._skipped += newest - self._next
        self._next = newest + 1
        frame, truth = self._source.read(newest % self._source.n_frames if self._source.n_frames else newest)
        return Reading(replace(frame, stamp_ns=self._start + newest * self._interval_ns, sequence=newest), truth)

    def report(self) -> Mapping[str, Any]:
        """Say how far up it is, and what was left out."""
        return {"simulator.state": self._state.value, "skipped": self._skipped}
