"""What clouds say about the radar, for whoever watches it: noise floor, points per frame, frames of doubtful quality."""

from __future__ import annotations

from collections import Counter, deque
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import PointCloud, Quality

FLAWS: Final = {
    Quality.SATURATED: ("saturated_frames", "saturated: less gain, or less of a reflector near the radar; points may be false"),
    Quality.MISSING_CHIRPS: ("frames_with_missing_chirps", "with missing chirps: look at the link to the device; points are noisier"),
    Quality.INCOMPLETE: ("incomplete_frames", "with so many missing chirps that points are not reliable: mend the link to the device"),
    Quality.NO_SIGNAL: ("frames_without_signal", "all zero: does the device transmit?"),
    Quality.CAPPED: ("capped_frames", "with more than max_detections; the weakest were left out"),
}
"""What may be wrong with a frame: its name in the diagnostics, and what to say and do."""


class Tally:
    """What the clouds since the last report say about the radar."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Begin a new period."""
        self._clouds = 0
        self._points = 0
        self._flawed: Counter[Quality] = Counter()
        self._noise: deque[NDArray[np.float32]] = deque(maxlen=1000)  # the end of a period never comes when simulated time stands still

    def add(self, cloud: PointCloud) -> None:
        """Count one cloud."""
        self._clouds += 1
        self._points += len(cloud)
        self._flawed.update(flaw for flaw in FLAWS if flaw in cloud.quality)
        self._noise.append(cloud.noise[np.isfinite(cloud.noise)])

    def report(self) -> tuple[dict[str, Any], list[str]]:
        """Values for the diagnostics, and what to warn of; the noise floor is the median over the points [dB], unknown without any."""
        noise = np.concatenate(self._noise) if self._noise else np.empty(0, np.float32)
        values: dict[str, Any] = {
            "noise_floor_db": f"{float(np.median(noise)):.1f}" if len(noise) else "unknown",
            "points_per_frame": f"{self._points / self._clouds:.1f}" if self._clouds else "unknown",
        }
        values |= {key: self._flawed[flaw] for flaw, (key, _) in FLAWS.items()}
        return values, [f"{self._flawed[flaw]} of {self._clouds} frames {text}" for flaw, (_, text) in FLAWS.items() if self._flawed[flaw]]
