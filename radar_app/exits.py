"""How every command ends: in one line and with the right status, whatever ended it.

Status 0: done, or a command that runs until Ctrl-C (``up``, ``record``, ``watch``, ``listen``) got it. 1: something went wrong that is
described above the end. 2: what the user gave makes no sense. 74: the disk is full. 129: the terminal was closed. 130: Ctrl-C before the
end. 141: whoever read the output has gone. 143: SIGTERM before the end.
"""

from __future__ import annotations

import atexit
import errno
import os
import select
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Final, NoReturn, TextIO

from radar_ros.signals import SIGNALS, interruptible, stopped, told

FULL: Final = 74
"""Exit status when the disk is full (EX_IOERR of sysexits.h)."""
CLOSED: Final = 128 + signal.SIGPIPE
"""Exit status when whoever read the output has gone, as shells count it."""
USAGE: Final = 2
"""Exit status when what the user gave makes no sense."""

_READ: Final = 1.0  # s: for who reads a full pipe
_NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_PATHS: Final = (errno.ENOENT, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.ENAMETOOLONG)
_WHO: Final = {signal.SIGINT: "by Ctrl-C", signal.SIGTERM: "by SIGTERM", signal.SIGHUP: "because its terminal was closed"}


class _Output:
    gone = False  # whether writing to stdout failed in a thread


class Ended(BaseException):
    """What ended a command, past Typer, which would make status 130 or 1 of it without a word."""


def finish(command: Callable[[], None]) -> NoReturn:
    """Run a command and exit with its status; one line says what ended it, where that was not its own end.

    A fault of this program is not hidden: its traceback is shown.
    """
    with interruptible():
        try:
            status = _status(command)
        except KeyboardInterrupt:  # came while the end was being told
            status = stopped()
    _let_go()
    exec("")  # clears a note of Python's: after a KeyboardInterrupt within an exec like this it ends by SIGINT, whatever the status
    atexit.register(_deaf)
    sys.exit(status)


def _deaf() -> None:
    """Ignore signals from now on: Python is about to end, and would answer with a traceback."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def _status(command: Callable[[], None]) -> int:
    status = 0
    error: BaseException | None = None
    try:
        command()
    except SystemExit as end:
        status, error = _number(end), end
    except BaseException as end:
        error = end
    if error is not None:
        status = _explained(error, status)
    try:
        sys.stdout.flush()
    except (OSError, ValueError) as end:
        status = _explained(end, status)
    return status


def _number(end: SystemExit) -> int:
    if end.code is None or isinstance(end.code, int):
        return end.code or 0
    say(str(end.code))
    return 1


def _explained(error: BaseException, status: int) -> int:
    """Say in one line what ended a command; returns its exit status. What nobody expected is raised again."""
    causes = list(_causes(error))
    if any(isinstance(cause, BrokenPipeError) for cause in causes) and (pipe_closed() or status == 1):  # rich and Typer exit with 1
        _silence()
        return CLOSED
    full = next((cause for cause in causes if isinstance(cause, OSError) and cause.errno in _NO_ROOM), None)
    if full is not None:
        _silence(only_if_full=True)
        say(_full(full))
        return FULL
    if isinstance(error, SystemExit) and not any(isinstance(cause.__cause__, KeyboardInterrupt) for cause in causes):
        return status  # of a command that has said what there is to say; Typer makes 130 of a signal, without a word
    if any(isinstance(cause, KeyboardInterrupt) for cause in causes) or told():
        say(f"stopped {_WHO.get(signal.Signals(told() or signal.SIGINT), '')}")
        return stopped()
    from radar_core import HandwaveError

    fault = next((cause for cause in causes if isinstance(cause, OSError) and cause.errno in _PATHS and cause.filename), None)
    if isinstance(error, HandwaveError):
        say(str(error))
    elif isinstance(error, (Ended, OSError)) and fault is not None:
        say(f"{os.fsdecode(fault.filename)}: {fault.strerror}; check the path")
    else:
        raise error.__cause__ if isinstance(error, Ended) and error.__cause__ is not None else error
    return USAGE


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    """List an error and what led to it."""
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        yield error
        error = error.__cause__ or error.__context__


def _full(error: OSError) -> str:
    where = f"{os.fsdecode(error.filename)}: " if error.filename else ""
    return f"{where}the disk is full, or a limit of size is reached ({error.strerror}); make room and start again"


def say(text: str) -> None:
    """Tell the user on stderr, where there still is one, and where it is read."""
    reader = select.poll()
    with suppress(OSError, ValueError):
        reader.register(sys.stderr.fileno(), select.POLLOUT)
        if not reader.poll(1000 * _READ):
            return
    with suppress(OSError, ValueError):
        print(f"handwave: {text}", file=sys.stderr, flush=True)


def note_closed() -> None:
    """Note that writing failed because whoever read this process's output has gone; for threads, whose errors end nothing."""
    _Output.gone = True


def pipe_closed() -> bool:
    """Whether whoever read this process's output has gone: ``head`` has its lines."""
    if _Output.gone:
        return True
    with suppress(OSError, ValueError):
        poll = select.poll()
        poll.register(sys.stdout.fileno(), 0)  # only errors
        return any(what & (select.POLLERR | select.POLLHUP | select.POLLNVAL) for _, what in poll.poll(0))
    return False


def _let_go() -> None:
    """Let what can no longer be written go nowhere: Python flushes both outputs at its end, and makes status 120 of a failure."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            _to_nowhere(stream)


def _to_nowhere(stream: TextIO) -> None:
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def _silence(*, only_if_full: bool = False) -> None:
    """Let nothing more be written to stdout: Python flushes it at its end, and would complain."""
    try:
        sys.stdout.flush()
        if only_if_full:
            return
    except (OSError, ValueError):
        pass
    _to_nowhere(sys.stdout)
