"""Nodes say when they compile: numba keeps on disk what it compiles, so it happens once, and `handwave compile` does it beforehand."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

from radar_ros import heartbeat

_ABOUT = {"driver": 10, "baseband": 20, "tracking": 20, "gestures": 5}
"""How long a stage compiles [s]: processor time with an empty cache (4.5, 17.5, 12.4 and 0.9 s), rounded up: others do so beside it."""
_AGAIN = 5.0  # s: between two lines about it
_LONGEST = 120.0  # s: for one loop and those that it needs, before the node is taken for hanging

Say = Callable[[str], None]


class _Teller:
    """Tells of the node that was made last; a process has one."""

    def __init__(self) -> None:
        self.stage = ""
        self._say: Say = print
        self.loops, self._open, self._since, self._told = 0, 0, 0.0, 0.0

    def serve(self, stage: str, say: Say) -> None:
        """Speak for this node from now on."""
        self.stage, self._say, self.loops = stage, say, 0

    def on_start(self, event: object) -> None:
        """Note that a loop is compiled, which may have others compiled for it."""
        now = time.monotonic()
        if not self._open:
            heartbeat.allow(_LONGEST)
        if not self._open and not self.loops:
            self._since = self._told = now
            about = f", about {_ABOUT[self.stage]} s" if self.stage in _ABOUT else ""
            self._say(f"compiling {self.stage}, once{about}; `handwave compile` does it beforehand")
        elif now - self._told > _AGAIN:
            self._told = now
            self._say(f"compiling {self.stage}: {self.loops} loops so far")
        self._open += 1

    def on_end(self, event: object) -> None:
        """Note that a loop is compiled."""
        self._open -= 1
        self.loops += 1
        if not self._open:
            heartbeat.allow()

    def done(self) -> None:
        """Say how long it took, if there was anything."""
        if self.loops:
            self._say(f"compiled {self.stage}: {self.loops} loops in {time.monotonic() - self._since:.0f} s; they are kept")
        self.loops = 0


_teller: _Teller | None = None


def tell(stage: str, say: Say, *, soon: bool = False) -> None:
    """Let ``say`` be told when this process compiles for a stage.

    A process without numba has nothing to tell, unless it is about to load it (``soon``).
    """
    global _teller
    if not soon and "numba" not in sys.modules:
        return
    if _teller is None:
        from numba.core import event

        class Listener(_Teller, event.Listener):
            pass

        _teller = Listener()
        event.register("numba:compile", _teller)  # type: ignore[no-untyped-call]
    _teller.serve(stage, say)


def done() -> None:
    """Say what was compiled since `tell`, if anything was."""
    if _teller is not None:
        _teller.done()
