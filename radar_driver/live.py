"""Devices that send by themselves: a thread reads, the newest frame wins, and a device that went away is opened again."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

from radar_core import HandwaveError, PointCloud, RadarFrame, RadarInfo

_WAIT: Final = 0.2  # s: how long a read may block; so long does it take to stop
_AGAIN: Final = 0.5  # s: from one attempt to open a lost device to the next


@dataclass(frozen=True, eq=False)
class Reading:
    """What a device gave.

    Attributes
    ----------
    data : RadarFrame or PointCloud
        Its stamp is the start of the acquisition on CLOCK_MONOTONIC [ns], its sequence counts what the device made: a gap is a loss.
    truth : Any
        What is true then; None: unknown, as for every real device.
    """

    data: RadarFrame | PointCloud
    truth: Any = None


class LiveSource(Protocol):
    """A device that sends by itself once resumed. Its methods are called from one thread at a time.

    Attributes
    ----------
    info : RadarInfo
        What the radar is; known before `power_up`, but for the calibration.
    """

    info: RadarInfo

    def power_up(self) -> None:
        """Open and set up the device, suspended; a `DeviceError` leaves it powered down."""
        ...

    def resume(self) -> None:
        """Let it send; what it still had from before is thrown away."""
        ...

    def suspend(self) -> None:
        """Let it be silent; may be called twice."""
        ...

    def power_down(self) -> None:
        """Let go of everything; may be called twice, and never fails."""
        ...

    def read(self, timeout: float) -> Reading | None:
        """Wait for what comes next.

        Parameters
        ----------
        timeout : float
            How long at most [s].

        Returns
        -------
        Reading or None
            None: nothing came.

        Raises
        ------
        DeviceError
            ``gone``: the device has to be powered up anew; otherwise reading may go on.
        """
        ...

    def report(self) -> Mapping[str, Any]:
        """Say what is known of the device: states, temperature, counts; called from any thread."""
        ...


class Reader:
    """Reads a live source in a thread of its own.

    Parameters
    ----------
    source : LiveSource
        Powered up; the reader resumes it, and powers it up anew when it is lost.
    notify : callable
        Called from the thread when there is something new to `take`, and when `problem` changes.
    again : float
        From one attempt to open a lost device to the next [s].

    Attributes
    ----------
    replaced : int
        Readings that nobody took before a newer one came.
    counts : Counter
        ``reopened``, ``errors``: since the start.
    """

    def __init__(self, source: LiveSource, notify: Callable[[], None], *, again: float = _AGAIN) -> None:
        self._source, self._notify, self._again = source, notify, again
        self._lock = threading.Lock()
        self._newest: Reading | None = None
        self._problem = ""
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self.replaced = 0
        self.counts: Counter[str] = Counter()

    @property
    def problem(self) -> str:
        """Why nothing comes; empty: all is well."""
        with self._lock:
            return self._problem

    def start(self) -> None:
        """Resume the source and read from now on.

        Raises
        ------
        DeviceError
            When the source does not resume.
        """
        self._source.resume()
        self._stop.clear()
        self._thread = threading.Thread(target=self._work, name="device reader", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Suspend the source; the thread has ended when this returns. May be called twice."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def take(self) -> Reading | None:
        """Give the newest reading, once."""
        with self._lock:
            newest, self._newest = self._newest, None
        return newest

    def _work(self) -> None:
        try:
            self._loop()
        except Exception as error:
            self._say(f"nothing is read any more, because of a fault of this program ({error!r}): start the driver again")
            self._rest()
            raise

    def _loop(self) -> None:
        lost = False
        while not self._stop.is_set():
            try:
                if lost:
                    self._source.power_up()
                    self._source.resume()
                    self.counts["reopened"] += 1
                    lost = False
                reading = self._source.read(_WAIT)
            except HandwaveError as error:
                self.counts["errors"] += 1
                self._say(str(error))
                if lost or getattr(error, "gone", False):
                    lost = True
                    self._source.power_down()
                    self._stop.wait(self._again)
            else:
                if reading is not None:
                    self._put(reading)
        if not lost:
            self._rest()

    def _rest(self) -> None:
        try:
            self._source.suspend()
        except HandwaveError as error:
            self._say(str(error))

    def _put(self, reading: Reading) -> None:
        with self._lock:
            self.replaced += self._newest is not None
            self._newest, self._problem = reading, ""
        self._notify()

    def _say(self, problem: str) -> None:
        with self._lock:
            self._problem = problem
        self._notify()


def monotonic_ns() -> int:
    """Read the clock on which devices stamp [ns]."""
    return time.monotonic_ns()
