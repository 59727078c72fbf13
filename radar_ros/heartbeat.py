"""Signs of life for whoever started this process, `handwave up` or systemd: datagrams as sd_notify(3) and sd_watchdog_enabled(3) say."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

_PERIOD: Final = 0.5  # s: between two signs of life
_BUSY: Final = 120.0  # s: for work that is known to take long


class _Line:
    socket: socket.socket | None = None
    beaten = -1e9  # on CLOCK_MONOTONIC [s], when it was last


def notify(*assignments: str) -> bool:
    """Send assignments such as ``READY=1``, where somebody asked for them (``NOTIFY_SOCKET``); returns whether they went, or nobody asked.

    They do not go while those of others wait to be read: a datagram socket holds ten.
    """
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address.startswith(("/", "@")):
        return True
    if _Line.socket is None:
        _Line.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        _Line.socket.setblocking(False)  # who does not read must not hold up a node
    with suppress(OSError):
        return bool(_Line.socket.sendto("\n".join(assignments).encode(), address.replace("@", "\0", 1) if address[0] == "@" else address))
    return False


def beat(*more: str) -> None:
    """Tell that this process goes on, and ``more``; called by the executor, so that a callback that does not return silences it."""
    now = time.monotonic()
    if now - _Line.beaten >= _PERIOD and notify("READY=1", "WATCHDOG=1", *more):
        _Line.beaten = now


def allow(seconds: float | None = None) -> None:
    """Ask for patience: this process may be silent for so long [s] from now on; None: as before."""
    usual = os.environ.get("WATCHDOG_USEC", "")
    if usual:
        notify(f"WATCHDOG_USEC={int(seconds * 1e6)}" if seconds is not None else f"WATCHDOG_USEC={usual}", "WATCHDOG=1")


@contextmanager
def busy() -> Iterator[None]:
    """Do what takes long, without being taken for hanging."""
    allow(_BUSY)
    try:
        yield
    finally:
        allow()
