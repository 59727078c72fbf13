"""Waiting for nodes: as long as they work on it, which takes minutes where loops have to be compiled."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

PATIENCE = 30.0
"""How long nothing may happen [s]; nodes take seconds to start, a minute on a slow disk."""
REMEDY = "if nodes were still compiling, run once: handwave compile"
"""What to do when waiting was in vain."""
_WORK = 0.05  # share of a processor above which a node works; one that is ready and idle takes a hundredth


class Patience:
    """Ends when for so many ``seconds`` no node has worked.

    ``work`` tells the processor time of each node [s]; where nothing is known of them (they run elsewhere), it is empty, and the time
    alone counts.
    """

    def __init__(self, seconds: float = PATIENCE, work: Callable[[], Mapping[str, float]] = dict) -> None:
        self._seconds, self._work = seconds, work
        self._used: dict[str, float] = {}
        self._since = time.monotonic()

    def again(self) -> None:
        """Begin anew: something has happened."""
        self._since = time.monotonic()

    def over(self) -> bool:
        """Whether it has ended."""
        now = time.monotonic()
        if now - self._since <= self._seconds:
            return False
        used = dict(self._work())
        worked = any(time_s - self._used.get(name, 0.0) > _WORK * self._seconds for name, time_s in used.items())
        self._used = used
        if worked:
            self._since = now
        return not worked
