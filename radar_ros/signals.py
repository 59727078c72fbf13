"""How a command is told to stop: Ctrl-C, SIGTERM or a closed terminal, once, after which it tidies up whatever else it is told."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_DEAF: Final = 5.0  # s: after a signal the next ones are ignored for so long, so that nodes are stopped in order
_AGAIN: Final = 0.05  # s: until it is raised again where foreign code swallowed it


class _Told:
    depth = 0  # of blocks that must not be broken and are being run
    waits = False  # whether a signal waits for their end
    number = 0  # of the last signal; 0: none yet
    time = -1e9  # on CLOCK_MONOTONIC [s], when it came


def told() -> int:
    """Return the number of the last signal that told this process to stop; 0: none did."""
    return _Told.number


def stopped() -> int:
    """Exit status of a command that was told to stop before its end: 130 by Ctrl-C, 143 by SIGTERM, 129 when its terminal was closed."""
    return 128 + (_Told.number or signal.SIGINT)


@contextmanager
def unbroken() -> Iterator[None]:
    """Let a signal that `interruptible` would raise at once wait until the block is done: half a record would spoil a recording."""
    _Told.depth += 1
    try:
        yield
    finally:
        _Told.depth -= 1
        if _Told.waits and _Told.depth == 0:
            _Told.waits = False
            raise KeyboardInterrupt


def _stop(number: int, _: Any) -> None:
    now = time.monotonic()
    if now - _Told.time < _DEAF:
        return
    _Told.number, _Told.time = number, now
    _raise()


def _raise(*_: Any) -> None:
    if _Told.depth:
        _Told.waits = True
        return
    raise KeyboardInterrupt


def _lost(unraisable: Any) -> None:
    """Raise it again a little later when it came within a finaliser or a callback of foreign code, where no exception gets out."""
    if isinstance(unraisable.exc_value, KeyboardInterrupt):
        signal.setitimer(signal.ITIMER_REAL, _AGAIN)
    else:
        sys.__unraisablehook__(unraisable)


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise `KeyboardInterrupt` at the first SIGINT, SIGTERM or SIGHUP, and ignore what comes within the next seconds."""
    before = {number: signal.signal(number, _stop) for number in SIGNALS}
    alarm, hook = signal.signal(signal.SIGALRM, _raise), sys.unraisablehook
    sys.unraisablehook = _lost
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        sys.unraisablehook = hook
        signal.signal(signal.SIGALRM, alarm)
        for number, handler in before.items():
            signal.signal(number, handler)
