"""The event detector: start and end of a gesture (thesis, section 4.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from radar_core import ConfigError
from radar_core.config import config, knob
from radar_gestures.activation import Rests


@config
class EventConfig:
    """Knobs of the event detector. All durations are in seconds, so a lower frame rate or lost frames change nothing."""

    threshold: float = knob(0.8, unit="m/s", low=0.0, high=20.0, doc="radial speed above which a motion starts")
    release: float = knob(0.45, unit="m/s", low=0.0, high=20.0, doc="radial speed above which a motion that lasts min_duration goes on")
    min_duration: float = knob(0.16, unit="s", low=0.0, high=10.0, doc="motion before an event starts; each cloud counts one interval")
    quiet: float = knob(0.25, unit="s", low=0.0, high=10.0, doc="an event ends when there was no motion for that long")
    bridge: float = knob(0.15, unit="s", low=0.0, high=10.0, doc="longest pause that does not interrupt a motion that is still starting")
    max_duration: float = knob(1.4, unit="s", low=0.1, high=10.0, doc="a longer event is closed; the next one needs a quiet time first")
    max_gap: float = knob(0.5, unit="s", low=0.01, high=10.0, doc="after a longer silence of the sensor everything starts anew")

    def validate(self) -> None:
        """Raise `ConfigError` when an event could never be long enough, or ends at a higher speed than it starts."""
        if self.release > self.threshold:
            raise ConfigError(f"EventConfig: release ({self.release:g} m/s) must not be above threshold ({self.threshold:g} m/s)")
        if self.min_duration >= self.max_duration:
            raise ConfigError(f"EventConfig: min_duration ({self.min_duration:g} s) must be below max_duration ({self.max_duration:g} s)")


@dataclass(frozen=True)
class Event:
    """A motion that may be a gesture: from the first to the last sample above the threshold [ns].

    ``rested_ns``: for how long nothing was above ``threshold`` before it [ns].
    """

    start_ns: int
    end_ns: int
    rested_ns: int = 0


class EventDetector:
    """Cuts the speed signal of one track into events.

    A motion starts with the first speed above ``threshold``. It is dropped when a pause longer than ``bridge`` comes before it has lasted
    ``min_duration``; after that only ``quiet`` seconds below ``release`` end it (the thesis has one threshold and 0.2 s; a hand that turns
    round, as in push-pull, is that slow for longer). At ``max_duration`` it ends at once, and nothing new starts before
    ``quiet`` seconds of rest: somebody who walks gives one event, not one every ``max_duration``.

    A motion lasts from its first fast cloud to its last and one interval of the clouds more, as in the thesis, where ten frames at 50 Hz
    are 0.2 s; without that a slow sensor, which sees less of a motion than there is, would miss short ones. The interval is the shortest
    so far, so that lost clouds lengthen nothing. One fast cloud alone is never a motion.
    """

    def __init__(self, config: EventConfig) -> None:
        self._config = config
        self._bridge_ns = round(config.bridge * 1e9)
        self._min_ns = round(config.min_duration * 1e9)
        self._quiet_ns = round(config.quiet * 1e9)
        self._max_ns = round(config.max_duration * 1e9)
        self._gap_ns = round(config.max_gap * 1e9)
        self._rests = Rests(self._bridge_ns)
        self._start: int | None = None
        self._last_above = 0
        self._last_stamp: int | None = None
        self._interval_ns = 0
        self._wait_for_rest = False

    @property
    def active(self) -> bool:
        """Whether a motion is under way that is long enough to become an event."""
        if self._start is None:
            return False
        lasted = self._last_above - self._start
        return lasted + (self._interval_ns if lasted else 0) >= self._min_ns  # one fast cloud alone is an outlier at any rate

    def process(self, stamp_ns: int, speed: float) -> Event | None:
        """Take the speed [m/s] at ``stamp_ns`` (either sign; NaN counts as rest) and return the event that ended with it, if any."""
        self._follow(stamp_ns)
        self._rests.process(stamp_ns, math.isfinite(speed) and abs(speed) > self._config.threshold)
        above = abs(speed) > (self._config.release if self.active else self._config.threshold)
        if self._wait_for_rest:
            self._wait_for_rest = above or stamp_ns - self._last_above < self._quiet_ns
            if above:
                self._last_above = stamp_ns
            return None
        if above:
            self._last_above = stamp_ns
            if self._start is None:
                self._start = stamp_ns
        return self._close(stamp_ns)

    def _follow(self, stamp_ns: int) -> None:
        """Learn the interval of the clouds, and start anew when time jumps."""
        if self._last_stamp is not None:
            step = stamp_ns - self._last_stamp
            if not 0 < step <= self._gap_ns:
                self._start, self._wait_for_rest, self._interval_ns = None, False, 0
                self._rests.clear()
            else:  # the shortest, because lost clouds make it look longer
                self._interval_ns = min(step, self._interval_ns or step)
        self._last_stamp = stamp_ns

    def _close(self, stamp_ns: int) -> Event | None:
        if self._start is None:
            return None
        event = Event(self._start, self._last_above, self._rests.before(self._start))
        rest = stamp_ns - self._last_above
        if not self.active:
            if rest > self._bridge_ns:
                self._start = None
            return None
        if stamp_ns - self._start >= self._max_ns:
            self._start, self._wait_for_rest = None, True
            return event
        if rest >= self._quiet_ns:
            self._start = None
            return event
        return None
