"""What goes over the line of an exploration server: commands and answers as lines of JSON, frames as bytes behind theirs.

Facts of the protocol, in our own words, from the maker's published client (acconeer-exptool 7.18, BSD-3-Clause-Clear) and its traffic.
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

PORT: Final = 6110
LONGEST: Final = 1 << 16  # bytes of a line; the longest holds the calibration of five sensors
MOST: Final = 4 * 4096  # bytes of a frame: the sensor's memory has 4096 values, each of two 16-bit numbers
_DEEPEST: Final = 16  # lists and objects within each other; answers have five


@dataclass(frozen=True)
class Message:
    """One answer: its line, and the bytes that came behind it."""

    head: dict[str, Any]
    data: bytes = b""

    @property
    def status(self) -> str:
        """What it says of the command that it answers; empty: nothing."""
        return str(self.head.get("status", ""))


def command(name: str, **more: Any) -> bytes:
    """Make the line of a command."""
    return (json.dumps({**more, "cmd": name}, separators=(",", ":")) + "\n").encode("ascii")


class Parser:
    """Cuts a stream of bytes into messages; what is none is skipped and counted, and never more is held than the longest message has.

    Attributes
    ----------
    counts : Counter
        ``messages``; ``refused`` lines that are none; ``garbage_bytes``.
    received : int
        Bytes so far.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.received = 0
        self._text = bytearray()
        self._head: dict[str, Any] | None = None  # its bytes are still to come
        self._size = 0
        self._skipping = False  # within a line that is too long

    @property
    def held(self) -> int:
        """Bytes that wait for the rest of their message."""
        return len(self._text)

    def reset(self) -> None:
        """Forget what has come in part."""
        self._text.clear()
        self._head, self._skipping = None, False

    def feed(self, data: bytes) -> list[Message]:
        """Take in bytes; give the messages that are complete now."""
        self.received += len(data)
        found: list[Message] = []
        for start in range(0, len(data), LONGEST):
            self._text += data[start : start + LONGEST]
            while (message := self._next()) is not None:
                if message.head:
                    found.append(message)
        self.counts["messages"] += len(found)
        return found

    def _next(self) -> Message | None:
        """Take the next message, an empty one for what was skipped; None: more has to come."""
        if self._head is not None:
            if len(self._text) < self._size:
                return None
            message = Message(self._head, bytes(self._text[: self._size]))
            del self._text[: self._size]
            self._head = None
            return message
        end = self._text.find(b"\n")
        if end < 0:
            if len(self._text) > LONGEST:
                self._refuse(len(self._text))
                self._skipping = True
            return None
        if self._skipping or end > LONGEST:
            self._skipping = False
            self._refuse(end + 1)
            return Message({})
        return self._line(end)

    def _line(self, end: int) -> Message:
        line = bytes(self._text[:end])
        start = max(line.find(b'{"'), 0)
        head = _object(line[start:])
        size = 0 if head is None else head.get("payload_size", 0)
        if head is None or not isinstance(size, int) or not 0 <= size <= MOST:
            self._refuse(end + 1)
            return Message({})
        self.counts["garbage_bytes"] += start
        del self._text[: end + 1]
        if not size:
            return Message(head)
        self._head, self._size = head, size
        return Message({})

    def _refuse(self, n_bytes: int) -> None:
        self.counts["refused"] += 1
        self.counts["garbage_bytes"] += n_bytes
        del self._text[:n_bytes]


def _object(line: bytes) -> dict[str, Any] | None:
    """Read the object in a line; None: there is none."""
    if line.count(b"[") + line.count(b"{") > _DEEPEST * 64:
        return None
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def iq(data: bytes, n_sweep: int, n_point: int) -> NDArray[np.complex64] | None:
    """Read a frame, shape (n_sweep, n_point); None: it has another size."""
    if len(data) != 4 * n_sweep * n_point:
        return None
    parts = np.frombuffer(data, "<i2").astype(np.float32).reshape(n_sweep, n_point, 2)
    return np.ascontiguousarray(parts).view(np.complex64)[..., 0]


def whole(value: Any, low: int, high: int) -> int | None:
    """Take a whole number from an answer; None: it is none, or outside."""
    return value if isinstance(value, int) and not isinstance(value, bool) and low <= value <= high else None


def number(value: Any, low: float, high: float) -> float | None:
    """Take a number from an answer; None: it is none, or outside."""
    good = isinstance(value, int | float) and not isinstance(value, bool) and low <= value <= high
    return float(value) if good else None
