"""Make one process as slow as it would be on a weaker device: pinned to one core, and given only a share of its time.

A cgroup's quota (cgroup v2, ``cpu.max``) where this machine lets us make one; else SIGSTOP and SIGCONT by turns.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import psutil

QUOTA, TURNS = "cgroup quota", "SIGSTOP and SIGCONT"
PERIOD: Final = 0.009
"""One turn [s]: short beside what a frame takes, so that frames of some milliseconds take longer too, as on a slow device."""
_BEFORE: Final = "-15"  # nice
_CGROUPS: Final = Path("/sys/fs/cgroup")
_TURNS: Final = """
import os, signal, sys, time
pid, times, period, parent = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3]), os.getppid()
signal.signal(signal.SIGTERM, lambda *_: sys.exit())
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
except OSError:
    pass
on, off, before = 0.0, 0.0, time.monotonic()
try:
    while os.getppid() == parent:
        time.sleep(period / times)
        os.kill(pid, signal.SIGSTOP)
        now = time.monotonic()
        on, before = on + now - before, now
        time.sleep(max((times - 1) * on - off, 0.0))  # what came late is made up for
        os.kill(pid, signal.SIGCONT)
        now = time.monotonic()
        off, before = off + now - before, now
except ProcessLookupError:
    pass
finally:
    try:
        os.kill(pid, signal.SIGCONT)
    except ProcessLookupError:
        pass
    print(on, off)
"""


@dataclass
class Slowing:
    """How a process is slowed."""

    how: str  # QUOTA or TURNS
    on: float = 0.0  # share of the time in which it could work; known at the end, of TURNS only


def precede(pid: int) -> None:
    """Let a process that began a session go before those of other sessions, where that is allowed: a device has nothing else to do."""
    with contextlib.suppress(OSError):  # within a session niceness counts, between sessions that of their groups
        _write(Path(f"/proc/{pid}/autogroup"), _BEFORE)


def pin(pid: int, core: int) -> None:
    """Let all threads of a process run on one core only, those that it makes later too."""
    for thread in psutil.Process(pid).threads():
        with contextlib.suppress(ProcessLookupError):  # it has ended meanwhile
            os.sched_setaffinity(thread.id, {core})


@contextlib.contextmanager
def slowed(pid: int, times: float, core: int) -> Iterator[Slowing]:
    """Let a process have one core, and ``1 / times`` of that; the core stays its own afterwards."""
    pin(pid, core)
    group = _quota(pid, times)
    slowing = Slowing(QUOTA if group is not None else TURNS, 1.0 / times)
    if group is None:
        with _turns(pid, times, slowing):
            yield slowing
        return
    try:
        yield slowing
    finally:
        with contextlib.suppress(OSError):
            (group.parent / "cgroup.procs").write_text(str(pid), encoding="utf-8")
        with contextlib.suppress(OSError):
            group.rmdir()


def _quota(pid: int, times: float) -> Path | None:
    """Move a process into a cgroup of its own with a quota; None: this machine does not let us."""
    lines = Path(f"/proc/{pid}/cgroup").read_text(encoding="utf-8").splitlines()
    own = next((_CGROUPS / line.removeprefix("0::/") for line in lines if line.startswith("0::/")), _CGROUPS)
    for parent in (own, own.parent):  # beside its own one: a cgroup with processes may have none below it
        group = parent / f"handwave_{pid}"
        with contextlib.suppress(OSError):
            if "cpu" in (parent / "cgroup.subtree_control").read_text(encoding="utf-8").split():
                group.mkdir()
                _write(group / "cpu.max", f"{round(1e6 * PERIOD / times)} {round(1e6 * PERIOD)}")
                _write(group / "cgroup.procs", str(pid))
                return group
        with contextlib.suppress(OSError):
            group.rmdir()
    return None


def _write(file: Path, text: str) -> None:
    """Write to a file that the kernel has made."""
    with file.open("r+", encoding="utf-8") as opened:
        opened.write(text)


@contextlib.contextmanager
def _turns(pid: int, times: float, slowing: Slowing) -> Iterator[None]:
    """Stop a process and let it go on, by turns, from a process of its own: here something else may be in its way."""
    command = [sys.executable, "-S", "-c", _TURNS, str(pid), str(times), str(PERIOD)]
    turning = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        yield
    finally:
        turning.terminate()
        told, _ = turning.communicate()
        on, off = map(float, told.split() or (0.0, 0.0))  # nothing: it had not begun
        slowing.on = on / (on + off) if on + off else 1.0
