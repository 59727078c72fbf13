"""Push, pull and wave from one channel: by how what moves comes nearer and goes away again, without any angle and without training."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radar_core import GESTURES, DataError
from radar_core.config import config, knob
from radar_gestures.gesture import Gesture
from radar_tracking.presence import Presence


@config
class ChannelGestureConfig:
    """Which motion is which gesture."""

    speed: float = knob(0.2, unit="m/s", low=0.05, high=5.0, doc="slower motion is rest")
    fast: float = knob(0.6, unit="m/s", low=0.05, high=10.0, doc="greatest speed of a gesture, at least; arms are moved about more slowly")
    rest: float = knob(0.25, unit="s", low=0.05, high=2.0, doc="rest that ends a gesture")
    stroke: float = knob(0.12, unit="m", low=0.01, high=1.0, doc="way of a push or pull, at least")
    longest: float = knob(0.9, unit="m", low=0.1, high=3.0, doc="way of one stroke, at most; who goes farther walks")
    swing: float = knob(0.03, unit="m", low=0.005, high=0.5, doc="way of one swing of a wave, at least")
    swings: int = knob(4, low=3, high=20, doc="swings that make a wave")
    duration: float = knob(3.0, unit="s", low=0.3, high=10.0, doc="a gesture takes at most so long")
    others: float = knob(0.3, low=0.0, high=1.0, doc="share of the way that may go against a push or a pull")


@dataclass
class _Motion:
    """One motion, from rest to rest."""

    start_ns: int
    end_ns: int
    ways: list[float]  # m: strokes in turn, receding positive
    fastest: float  # m/s


class ChannelGestures:
    """Names the motions that `radar_tracking.presence.PresenceDetector` sees; one thread at a time."""

    def __init__(self, settings: ChannelGestureConfig | None = None) -> None:
        self._config = settings or ChannelGestureConfig()
        self._motion: _Motion | None = None
        self._before: int | None = None

    def reset(self) -> None:
        """Forget a motion that has begun."""
        self._motion, self._before = None, None

    def process(self, presence: Presence) -> Gesture | None:
        """Take what one frame tells; gives the gesture that has ended, if it is one. Stamps that go back begin anew.

        A `DataError` says that something moves with a speed that is no number.
        """
        if presence.moving and not np.isfinite(presence.speed):
            raise DataError(f"Presence.speed of frame {presence.sequence} is not finite")
        stamp = presence.stamp_ns
        step = 0.0 if self._before is None else (stamp - self._before) * 1e-9
        if step < 0 or step > self._config.duration:
            self.reset()
            step = 0.0
        self._before = stamp
        if presence.moving and abs(presence.speed) >= self._config.speed:
            self._go_on(stamp, presence.speed, step)
            return None
        if self._motion is None or (stamp - self._motion.end_ns) * 1e-9 < self._config.rest:
            return None
        ended, self._motion = self._motion, None
        return self._named(ended, stamp)

    def _go_on(self, stamp: int, speed: float, step: float) -> None:
        way = speed * step
        if self._motion is None:
            self._motion = _Motion(stamp, stamp, [way], abs(speed))
            return
        self._motion.end_ns, self._motion.fastest = stamp, max(self._motion.fastest, abs(speed))
        if self._motion.ways[-1] * way < 0:
            self._motion.ways.append(way)
        else:
            self._motion.ways[-1] += way

    def _named(self, motion: _Motion, stamp: int) -> Gesture | None:
        """Name a motion; None: it is no gesture that one channel tells."""
        limits, ways = self._config, np.array(motion.ways)
        longest = float(np.abs(ways).max())
        if (motion.end_ns - motion.start_ns) * 1e-9 > limits.duration or longest > limits.longest or motion.fastest < limits.fast:
            return None
        swings = int((np.abs(ways) >= limits.swing).sum())
        if swings >= limits.swings:
            name = "wave"
        elif longest >= limits.stroke and np.abs(ways).sum() - longest <= limits.others * longest:
            name = "push" if ways[np.abs(ways).argmax()] < 0 else "pull"
        else:
            return None
        shares = np.full(len(GESTURES), np.nan)
        given = GESTURES.index(name), name, float("nan"), shares, motion.start_ns, motion.end_ns, np.full(0, np.nan)
        return Gesture(stamp, "room", 0, *given)
