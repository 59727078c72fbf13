"""Simulated and recorded frames as a source: each comes when its acquisition has ended on the user's clock."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from radar_core import ConfigError, HandwaveError, RadarFrame, RadarInfo
from radar_driver.sources import Context, Reading

if TYPE_CHECKING:
    from radar_sim import Truth

_WARM: Final = 5  # frames
_REST: Final = 8  # parts of an interval; the next frame is made after the first one, so that the last can be published undisturbed
_LEAD: Final = 2.5  # times what a frame takes to make, and a quarter of an interval: so late that those who work on the last one are done


class Frames(Protocol):
    """Frames that can be had in any order.

    Attributes
    ----------
    info : RadarInfo
        What the radar is and where it stands.
    n_frames : int or None
        How many there are; None: no end.
    interval, delay : float
        From one frame to the next by the device's own clock, and from the start to the first one [s].
    """

    info: RadarInfo
    n_frames: int | None
    interval: float
    delay: float

    def frame(self, number: int) -> tuple[RadarFrame, Truth | None]:
        """Frame ``number`` (from 0) and, where known, what is true in its middle; stamps count from the start."""

    def close(self) -> None:
        """Let go of what is held; may be called twice."""


class Paced:
    """Frames in their own time; a `radar_driver.sources.Source`. They begin again where they end.

    A frame is given once its acquisition has ended. The next one is made as late as is safe, because others work on the last one until
    then. Frames that are late are left out and counted. A clock that stands at 0 (simulated time that nobody has told yet) or goes back
    makes no loss.

    Parameters
    ----------
    frames : Frames
        What to give; a `ConfigError` says that there is no frame.
    context : Context
        The clock, the pace.
    """

    def __init__(self, frames: Frames, context: Context) -> None:
        if frames.n_frames == 0:
            raise ConfigError("there is no frame: the scene or recording is shorter than one frame interval; make it longer")
        self.info: RadarInfo = frames.info
        self._frames, self._context = frames, context
        self._interval = round(frames.interval * 1e9 / context.rate)
        self._delay = round(frames.delay * 1e9 / context.rate)
        self._state = "off"
        self._position = self._turn = 0  # which frame comes next, and how often they have begun again
        self._count = self._skipped = 0  # frames given or skipped, and skipped
        self._span = 0.0  # what frames took lately at the most [ns]
        self._start = self._done = 0  # when `resume` was, and frames due since then that were given or skipped
        self._ready: tuple[int, tuple[RadarFrame, Truth | None] | HandwaveError] | None = None  # place, frame or why there is none

    def power_up(self) -> None:
        """Make a few frames: loops that are compiled now do not delay the first ones."""
        for number in range(min(_WARM, self._frames.n_frames or _WARM)):
            self._frames.frame(number)
        self._state = "suspended"

    def resume(self) -> None:
        """Begin now, with the frame that comes next."""
        self._state = "running"
        self._start, self._done = self._context.clock(), 0

    def suspend(self) -> None:
        """Stop; the place is kept."""
        self._state = "suspended"

    def power_down(self) -> None:
        """Let go of the frames."""
        self._state, self._ready = "off", None
        self._frames.close()

    def read(self, timeout: float) -> Reading | None:
        """Wait until the next frame's acquisition has ended."""
        end = time.monotonic() + timeout
        while True:
            elapsed = self._elapsed()
            due = elapsed // self._interval  # acquisitions that have ended
            if due > self._done:
                return self._give(due)
            wait = (self._done + 1) * self._interval - elapsed
            if self._ready is None or self._ready[0] != self._position:
                lead = max(self._interval / 4, _LEAD * self._span) if self._span else self._interval
                wait = self._done * self._interval + round(max(self._interval / _REST, self._interval - lead)) - elapsed
                if wait <= 0:
                    self._ready = (self._position, self._make(self._position))
                    continue
            left = end - time.monotonic()
            if left <= 0:
                return None
            time.sleep(min(wait * 1e-9, left, self._context.nap))

    def _elapsed(self) -> int:
        """Time since the first acquisition began [ns]."""
        now = self._context.clock()
        elapsed = now - self._start
        if self._start == 0 or elapsed < (self._done - 1) * self._interval:
            self._start, self._done, elapsed = now, 0, 0
        return elapsed - self._delay

    def _give(self, due: int) -> Reading:
        """Give the frame whose acquisition ended last."""
        skipped, self._done = due - self._done - 1, due
        self._skipped += skipped
        self._advance(skipped)
        position, turn, count = self._position, self._turn, self._count
        self._advance(1)  # also past a frame that cannot be read
        made = self._ready[1] if self._ready is not None and self._ready[0] == position else self._make(position)
        self._ready = None
        if isinstance(made, HandwaveError):
            raise made
        frame, truth = made
        stamp = self._start + self._delay + (due - 1) * self._interval
        if truth is not None:
            began, ended = (np.where(t > 0, t + stamp - frame.stamp_ns, t) for t in (truth.gesture_start_ns, truth.gesture_end_ns))
            middle = stamp + self.info.waveform.acquisition_ns // 2
            truth = replace(truth, stamp_ns=middle, sequence=count, gesture_start_ns=began, gesture_end_ns=ended)
        return Reading(replace(frame, stamp_ns=stamp, sequence=count), truth, turn)

    def _make(self, position: int) -> tuple[RadarFrame, Truth | None] | HandwaveError:
        """Make a frame; an error is for when the frame is due, so that it comes once."""
        began = time.monotonic_ns()
        try:
            return self._frames.frame(position)
        except HandwaveError as error:
            return error
        finally:
            self._span = max(time.monotonic_ns() - began, 0.98 * self._span)

    def _advance(self, count: int) -> None:
        self._count += count
        self._position += count
        if self._frames.n_frames is not None:
            turns, self._position = divmod(self._position, self._frames.n_frames)
            self._turn += turns

    def report(self) -> Mapping[str, Any]:
        """Say how far up it is, and what was left out."""
        return {"state": self._state, "skipped": self._skipped}
