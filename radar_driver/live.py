"""Reads a source: a thread waits for data, the newest frame wins, and a device that went away is opened again."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from typing import Final

from radar_core import HandwaveError
from radar_driver.sources import Reading, Source

_WAIT: Final = 0.2  # s: how long a read may block; so long does it take to stop
_AGAIN: Final = 0.5  # s: from one attempt to open a lost device to the next


class Reader:
    """Reads a source in a thread of its own.

    Parameters
    ----------
    source : Source
        Powered up; the reader resumes it, and powers it up anew when it is lost.
    notify : callable
        Called from the thread when there is something new to `take`, and when `problem` changes.
    again : float
        From one attempt to open a lost device to the next [s].

    Attributes
    ----------
    replaced, counts : int, Counter
        Readings that nobody took before a newer one came; ``reopened`` and ``errors`` since the start.
    """

    def __init__(self, source: Source, notify: Callable[[], None], *, again: float = _AGAIN) -> None:
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
        """Resume the source and read from now on; a `DeviceError` says why it does not resume."""
        self._stop.clear()
        self._source.resume()
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
