"""Find nodes that hear nothing although those before them in the graph work: shared memory of the middleware does that now and then."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

_SILENT: Final = 10.0  # s: of silence; the middleware takes up to 3.4 s (measured) to find who has just begun, and longer on a busy machine
_EXPECTED: Final = 10.0  # messages that would have come meanwhile, as they came before
_PAUSE: Final = 1.5  # s: between two signs of life with more messages; a longer pause interrupts a flow
_TRIES: Final = 3  # new starts that did not help are enough


@dataclass
class _Flow:
    """What is known of the messages of one node; times are on CLOCK_MONOTONIC [s]."""

    pid: int
    born: float  # when this process first told a count
    began: float  # since when messages have come without a pause
    rose: float  # when the last ones came; before any did, when it was born
    counts: tuple[int, int] = (0, 0)  # messages that it has processed, and dropped
    interval: float = 0.0  # between two messages, in the mean over a process's life [s]; 0: none has ever been processed
    silent: float = 0.0  # for how long it has told of no more messages [s]; while it tells nothing, as at long work, time does not count
    found: int = 0  # how often it was found since messages came last

    def take(self, pid: int, counts: tuple[int, int], now: float, passed: float) -> None:
        """Take note of what a process says of itself, ``passed`` [s] after the last look."""
        if pid != self.pid:
            self.pid, self.counts, self.silent = pid, (0, 0), 0.0
            self.born = self.began = self.rose = now
        if counts == self.counts:
            self.silent += passed
            return
        if now - self.rose > _PAUSE:
            self.began = now
        if counts[0] > self.counts[0]:
            self.interval = max(now - self.born, 1e-3) / counts[0]
            self.found = 0
        self.counts, self.rose, self.silent = counts, now, 0.0

    def flows(self, now: float) -> bool:
        """Whether messages have come without a pause for as long as a silence has to last."""
        return now - self.rose <= _PAUSE and now - self.began >= _SILENT


class Flows:
    """Hears how many messages each node has handled, and finds those that hear nothing. ``labels`` are in the order that data flows.

    A node is found that has processed messages, now or before it was started again, and gets none any more, while every node before it
    (in its namespace, or below) goes on. So only the first of those that hear nothing is found: the others hear nothing because of it.
    """

    def __init__(self, labels: Sequence[str]) -> None:
        self._labels = tuple(labels)
        self._flows: dict[str, _Flow] = {}
        self._looked = time.monotonic()

    def rest(self, seconds: float) -> None:
        """Let a time [s] not count, in which nobody could be heard."""
        self._looked += seconds
        for flow in self._flows.values():
            flow.born, flow.began, flow.rose = flow.born + seconds, flow.began + seconds, flow.rose + seconds

    def look(self, told: Mapping[str, tuple[int, tuple[int, int]]], now: float) -> dict[str, str]:
        """Take in what is told: process id, messages processed and dropped. Returns who hears nothing any more, and why that is a fault."""
        passed, self._looked = now - self._looked, now
        for label, (pid, counts) in told.items():
            self._flows.setdefault(label, _Flow(pid, now, now, now)).take(pid, counts, now, passed)
        return {label: why for label in told if (why := self._why(label, now))}

    def _why(self, label: str, now: float) -> str:
        flow, before = self._flows[label], self._before(label)
        silent = flow.silent
        if not flow.interval or flow.found >= _TRIES or silent < max(_SILENT, _EXPECTED * flow.interval):
            return ""
        if not before or not all(other.flows(now) for other in before.values()):
            return ""
        flow.found, flow.silent = flow.found + 1, 0.0
        all_of = next(iter(before)) + (" and all nodes between them" if len(before) > 1 else "")
        return f"it has heard nothing for {silent:.1f} s, although {all_of} went on (a fault of the middleware?)"

    def _before(self, label: str) -> dict[str, _Flow]:
        """Find who feeds a node: all before it that have ever worked, in its namespace or below."""
        place = label.rpartition("/")[0]
        names = self._labels[: self._labels.index(label)] if label in self._labels else ()
        near = [name for name in names if not place or name.startswith(f"{place}/")]
        return {name: self._flows[name] for name in near if name in self._flows and self._flows[name].interval}
