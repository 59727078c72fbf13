"""Find processes that hang: signs of life (`radar_ros.heartbeat`) do not come, and what a process does meanwhile says what that means."""

from __future__ import annotations

import os
import socket
import struct
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from typing import Final

import psutil

from radar_app.flow import Flows

_LIMIT: Final = 2.0  # s: of silence; four signs of life are missing then, and it can be told within 3 s
_SUSPECT: Final = 0.8  # s: from here on it is counted what a silent process uses of a processor
_LOOP: Final = 1.0  # s: of a processor within that time are an endless loop; less may be a machine with too much to do
_STARVED: Final = 15.0  # s: of silence, for who waits for a processor or for the disk
_BEGIN: Final = 120.0  # s: to the first sign of life: imports on a slow disk
_LATE: Final = 1.0  # s: who looks so late was held up itself, maybe with the whole machine
_CREDENTIALS: Final = struct.Struct("3i")  # pid, uid, gid, as the kernel attaches them
_MESSAGE: Final = 4096  # bytes
_numbers = count()


@dataclass
class _Watched:
    heard: float  # on CLOCK_MONOTONIC [s]
    ready: bool = False  # whether it has begun to work
    limit: float = _LIMIT  # of silence from then on [s]
    suspect: tuple[float, float, int] | None = None  # since when [s], processor time [s] and times its main thread had waited by then
    why: str = ""  # it hangs; empty: it does not
    since: float = 0.0  # when it was last heard before it hung [s]
    handled: tuple[int, int] | None = None  # messages that it has processed, and dropped; None: it does not say


class Watchdog:
    """Hears processes that were started with `variables` in their environment; on Linux. Elsewhere nobody is ever found.

    ``labels`` are those of the nodes, in the order that data flows: who hears nothing although all before it work hangs too (`Flows`).
    """

    def __init__(self, labels: Sequence[str] = ()) -> None:
        self._watched: dict[int, _Watched] = {}
        self._flows = Flows(labels)
        self._looked = time.monotonic()
        self._address = f"handwave-{os.getpid()}-{next(_numbers)}"
        self._socket: socket.socket | None = None
        if sys.platform == "linux":
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
            self._socket.bind(f"\0{self._address}")

    @property
    def variables(self) -> dict[str, str]:
        """What goes into the environment of the processes."""
        return {"NOTIFY_SOCKET": f"@{self._address}", "WATCHDOG_USEC": str(int(_LIMIT * 1e6))} if self._socket is not None else {}

    def hangs(self, pid: int) -> str:
        """Why a process is thought to hang; empty: it is not."""
        return self._watched[pid].why if pid in self._watched else ""

    def alive(self, pid: int) -> bool:
        """Whether a process has begun to work and does not hang."""
        found = self._watched.get(pid)
        return self._socket is None or (found is not None and found.ready and not found.why)

    def look(self, labels: Mapping[int, str]) -> tuple[list[tuple[int, str]], list[tuple[int, float]], float]:
        """See who has begun to hang: pid and why, and who goes on again: pid and how long it hung [s]; and for how long nobody looked [s].

        ``labels`` are those of the processes that live.

        That is 0 where it was looked often enough: a machine that was suspended makes nobody hang.
        """
        now = time.monotonic()
        late, self._looked = now - self._looked, now
        self._watched = {pid: self._watched.get(pid) or _Watched(now) for pid in labels}
        again = [(pid, now - self._watched[pid].since) for pid in self._hear(now) if self._watched[pid].why]
        for pid, _ in again:
            self._watched[pid].why = ""
        if late > _LATE:
            for watched in self._watched.values():
                watched.heard, watched.suspect = now, None
            self._flows.rest(late)
            return [], again, late
        lively = {pid: one.handled for pid, one in self._watched.items() if one.handled and now - one.heard < _SUSPECT}
        told = {labels[pid]: (pid, handled) for pid, handled in lively.items()}
        silent = self._flows.look(told, now)
        found = [(pid, silent[label]) for pid, label in labels.items() if label in silent]
        for pid, watched in self._watched.items():
            if not watched.why and (why := _why(pid, watched, now)):
                watched.why, watched.since = why, watched.heard
                found.append((pid, why))
        return found, again, 0.0

    def _hear(self, now: float) -> set[int]:
        """Take in what has come; returns who sent it."""
        heard = set()
        with suppress(BlockingIOError):
            while self._socket is not None:
                data, attached, _, _ = self._socket.recvmsg(_MESSAGE, socket.CMSG_SPACE(_CREDENTIALS.size))
                pid = _CREDENTIALS.unpack(attached[0][2])[0] if attached else 0
                watched = self._watched.get(pid)
                if watched is None:
                    continue
                heard.add(pid)
                watched.heard, watched.suspect = now, None
                lines = data.split(b"\n")
                watched.ready |= b"READY=1" in lines
                watched.limit = _asked_for(lines, watched.limit)
                watched.handled = _counts(lines)
        return heard

    def close(self) -> None:
        """Hear nobody any more."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _asked_for(lines: Sequence[bytes], limit: float) -> float:
    """Read how long a process may be silent [s]; without a word about it, as before."""
    for line in lines:
        name, _, value = line.partition(b"=")
        if name == b"WATCHDOG_USEC" and value.isdigit() and len(value) <= 12:
            return int(value) * 1e-6
    return limit


def _counts(lines: Sequence[bytes]) -> tuple[int, int] | None:
    """Read how many messages a process has processed, and dropped; None where it says nothing of that."""
    for line in lines:
        name, _, value = line.partition(b"=")
        numbers = value.split()
        if name == b"X_HANDLED" and len(numbers) == 2 and all(number.isdigit() for number in numbers):
            return int(numbers[0]), int(numbers[1])
    return None


def _why(pid: int, watched: _Watched, now: float) -> str:
    """Say why a process hangs; empty: it does not, or nobody knows yet."""
    silent, limit = now - watched.heard, watched.limit if watched.ready else _BEGIN
    if silent < _SUSPECT:
        return ""
    with suppress(psutil.Error):
        process = psutil.Process(pid)
        times, state = process.cpu_times(), process.status()
        used = times.user + times.system
        waits = process.num_ctx_switches().voluntary  # of its main thread
        if watched.suspect is None:
            watched.suspect = now, used, waits
        used -= watched.suspect[1]
        told = f"nothing was heard of it for {silent:.1f} s: "
        if state == psutil.STATUS_STOPPED:
            return told + "a signal has stopped it" if silent >= _LIMIT else ""
        if state in (psutil.STATUS_TRACING_STOP, psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD) or silent < limit:
            return ""  # in a debugger, or at its end
        if state == psutil.STATUS_SLEEPING and (waits == watched.suspect[2] or silent >= _STARVED):
            return told + "it waits for something that does not come (a deadlock?)"
        if used >= _LOOP:
            return told + "it works and comes to no end (an endless loop?)"
        if state != psutil.STATUS_SLEEPING and silent >= max(limit, _STARVED):
            return told + ("it waits for the disk" if state == psutil.STATUS_DISK_SLEEP else "it gets no time of a processor")
    return ""
