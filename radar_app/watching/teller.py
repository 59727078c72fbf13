"""What `handwave up` tells: that the graph is ready, who comes and goes, gestures, and that the source has ended."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

from radar_app.watching.health import Health, NodeState
from radar_app.watching.lines import RECORDS, Words
from radar_app.watching.listener import Ears

_FLOW: Final = ("driver", "cloud2", "baseband", "fusion", "tracking", "gestures", "hand", "presence")
"""Nodes that data flows through; the others only have to be there."""
_SOURCES: Final = ("driver", "cloud2")
_PATIENCE: Final = 5.0  # s: all nodes are there and no data comes; then it is said once


class Teller:
    """Tells what happens in the graph of these nodes (full names, without the first slash), a line at a time."""

    def __init__(self, ears: Ears, names: Sequence[str], say: Callable[[str], None]) -> None:
        self._names, self._say = tuple(names), say
        self._spaces = {f"/{name.rpartition('/')[0]}" for name in names}
        self._health = Health(ears, latencies=False)
        self._words = Words()
        self._ready = self._waited = False
        self._met: float | None = None  # when all nodes were there, on CLOCK_MONOTONIC [s]
        self._sources: dict[str, str] = {}  # states of those that were told last
        for what in ("people", "gestures"):
            ears.hear_each(RECORDS[what][0], partial(self._tell, what))

    def _tell(self, what: str, space: str, msg: Any) -> None:
        if space in self._spaces:
            for line in self._words.process(what, space, msg):
                self._say(line)

    def look(self) -> None:
        """See whether something has changed; to be called now and then."""
        if self._ready:
            self._look_at_sources()
        elif set(self._names) <= self._health.heard:
            states = [self._health.state(name) for name in self._names]
            flowing = all(state.state != "waiting" for state in states if _kind(state.name) in _FLOW)
            if flowing:
                self._ready = True
                self._say(f"ready: {_number(len(states))} and data flows{_rate(states)}")
            else:
                self._wait(states)

    def _wait(self, states: Sequence[NodeState]) -> None:
        now = time.monotonic()
        self._met = self._met or now
        if not self._waited and now - self._met > _PATIENCE:
            self._waited = True
            missing = ", ".join(state.name for state in states if state.state == "waiting" and _kind(state.name) in _FLOW)
            self._say(f"{_number(len(states))}; no data yet in {missing}")

    def _look_at_sources(self) -> None:
        for name in self._names:
            if _kind(name) not in _SOURCES:
                continue
            state = self._health.state(name).state
            before = self._sources.get(name, "running")
            if state == before or state in ("silent", "waiting", "idle"):
                continue
            self._sources[name] = state
            if state == "ended":
                self._say(f"the source of {name} has ended; the other nodes wait for more, Ctrl-C stops them")
            elif state == "stale":
                self._say(f"{name} gives no data any more: is the radar still there?")
            elif before in ("ended", "stale"):
                self._say(f"{name} gives data again")


def _kind(name: str) -> str:
    return name.rpartition("/")[2]


def _number(count: int) -> str:
    return "1 node runs" if count == 1 else f"{count} nodes run"


def _rate(states: Sequence[NodeState]) -> str:
    rates = [state.rate for state in states if _kind(state.name) in _SOURCES and state.rate]
    return f", {sum(rates):.0f} frames a second" if rates else ""
