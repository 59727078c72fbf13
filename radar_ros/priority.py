"""Giving way on a busy machine: who shows or judges results leaves the processors to who makes them; who records would lose some."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path


def give_way(nice: int) -> None:
    """Raise this process's niceness, and that of its session where it has one of its own.

    Niceness counts within a session, and Linux shares processors among sessions first (autogroup). The session of somebody's shell is
    never touched, only that of a service or of a job of its own.
    """
    os.nice(nice)
    if os.getsid(0) == os.getpid():
        with suppress(OSError):
            Path("/proc/self/autogroup").write_text(str(nice), encoding="utf-8")
