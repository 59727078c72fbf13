"""Shared memory that killed nodes leave behind: Fast DDS removes what a process had only when that process ends in order."""

from __future__ import annotations

import fcntl
import os
import re
import time
from contextlib import suppress
from pathlib import Path
from typing import Final

_MEMORY: Final = Path("/dev/shm")
_LOCK: Final = re.compile(r"((fastrtps|fastdds)_[0-9a-f]{16})_el")
SETTLED: Final = 3.0
"""Age of a segment at which it is seen whether its owner lives [s]: between making its lock file and locking it there is a moment."""


def sweep() -> int:
    """Remove segments of this user whose owner has gone, as ``fastdds shm clean`` does; returns how many that were."""
    swept = 0
    for lock in _MEMORY.glob("fast*_el"):
        found = _LOCK.fullmatch(lock.name)
        with suppress(OSError):
            about = lock.stat()
            if found and about.st_uid == os.getuid() and time.time() - about.st_ctime > SETTLED and _owner_has_gone(lock):
                (_MEMORY / found[1]).unlink(missing_ok=True)
                lock.unlink()
                swept += 1
    return swept


def _owner_has_gone(lock: Path) -> bool:
    """Whether nobody holds a lock that its owner holds as long as it lives."""
    with lock.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True
