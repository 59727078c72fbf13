"""Print lines of nodes from a thread of its own, which never waits for who reads them: nodes must not stop because a pipe is full."""

from __future__ import annotations

import errno
import os
import select
import sys
import threading
import time
from collections import deque
from typing import Final

from rich.console import Console
from rich.text import Text

from radar_app.exits import note_closed

_MOST: Final = 2000  # lines that wait
_PIECE: Final = select.PIPE_BUF  # bytes: who says that it can be written to takes so many without a wait
_LOOK: Final = 0.2  # s: how often it is looked whether somebody reads again
_END: Final = 1.0  # s: for the last lines to be read
_COLOURS: Final = ("cyan", "green", "magenta", "yellow", "blue", "bright_cyan", "bright_green", "bright_magenta")


class Printer:
    """Prints lines, each with the name of its node in a colour of its own; ``width`` is that of the longest name.

    Where nobody reads, lines wait; what is too much for that is left out, and one line says how many that were.
    """

    def __init__(self, width: int) -> None:
        self._width = width
        self._console = Console()
        self._known: dict[str, str] = {}
        self._lines: deque[bytes] = deque()
        self._left_out = 0
        self._changed = threading.Condition()
        self._closing = self._busy = False
        self._thread = threading.Thread(target=self._write, daemon=True)
        self._thread.start()

    def __call__(self, name: str, line: str) -> None:
        """Print a line, soon."""
        with self._changed:
            if len(self._lines) >= _MOST:
                self._left_out += 1
                return
            if self._left_out:
                text = f"{self._left_out} lines are missing here: they were not read, or the disk was full"
                self._lines.append(self._drawn("handwave", text))
                self._left_out = 0
            self._lines.append(self._drawn(name, line))
            self._changed.notify_all()

    def _drawn(self, name: str, line: str) -> bytes:
        colour = self._known.setdefault(name, _COLOURS[len(self._known) % len(_COLOURS)])
        with self._console.capture() as captured:
            self._console.print(Text.assemble((f"{name:>{self._width}} ", colour), Text.from_ansi(line)), soft_wrap=True)
        return captured.get().encode(sys.stdout.encoding or "utf-8", errors="replace")

    def flush(self, seconds: float = _END) -> None:
        """Wait until all lines are out, at most for so long."""
        end = time.monotonic() + seconds
        with self._changed:
            while (self._lines or self._busy) and (left := end - time.monotonic()) > 0:
                self._changed.wait(left)

    def close(self) -> None:
        """Print what is left, as far as somebody reads it."""
        self.flush()
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join(timeout=2 * _LOOK)

    def _write(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                while not self._lines and not self._closing:
                    self._changed.wait()
                if self._closing:
                    return
                line, self._busy = self._lines.popleft(), True
            if not self._put(line):
                return

    def _put(self, line: bytes) -> bool:
        """Write a line as soon as somebody reads; returns whether it makes sense to go on."""
        try:
            out = sys.stdout.fileno()
        except (OSError, ValueError):  # no file: somebody who takes what is printed within this process
            sys.stdout.write(line.decode(errors="replace"))
            return True
        waiting = select.poll()
        waiting.register(out, select.POLLOUT)
        while line and not self._closing:
            if not waiting.poll(1000 * _LOOK):
                continue
            try:
                line = line[os.write(out, line[:_PIECE]) :]
            except OSError as error:
                if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EAGAIN):
                    note_closed()
                    return False
                with self._changed:  # a full disk may have room again; nodes go on all the same
                    self._left_out += 1
                return True
        return not self._closing
