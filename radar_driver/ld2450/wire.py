"""Bytes of the LD2450: reports of three targets between ``AA FF 03 00`` and ``55 CC``, answers between ``FD FC FB FA`` and ``04 03 02 01``.

Facts from the maker's serial protocol (V1.03) and manual, checked with the reports that are printed there.
"""

from __future__ import annotations

import struct
from collections import Counter
from typing import Final, NamedTuple

REPORT: Final = b"\xaa\xff\x03\x00"
END: Final = b"\x55\xcc"
COMMAND: Final = b"\xfd\xfc\xfb\xfa"
COMMAND_END: Final = b"\x04\x03\x02\x01"
LENGTH: Final = 30  # bytes of a report
LONGEST: Final = 64  # bytes between an answer's length and its end; the longest that is known has 28
ENABLE, DISABLE, ONE, SEVERAL, FIRMWARE = 0xFF, 0xFE, 0x80, 0x90, 0xA0
"""Words of commands: begin and end of the configuration, follow one target or three, tell the firmware. An answer adds 0x100."""


class Target(NamedTuple):
    """One target as the board has it: `slot` 0 to 2; `x` and `y` [m], `speed` [m/s], size of a range cell [m]."""

    slot: int
    x: float
    y: float
    speed: float
    cell: float


class Report(NamedTuple):
    """A report: its targets, and how many bytes of the stream came up to its end."""

    targets: tuple[Target, ...]
    end: int


class Answer(NamedTuple):
    """The answer to a command: its word, whether it was done, and what it says."""

    word: int
    done: bool
    value: bytes


def command(word: int, value: bytes = b"") -> bytes:
    """Write a command."""
    return COMMAND + struct.pack("<HH", 2 + len(value), word) + value + COMMAND_END


def firmware(value: bytes) -> str:
    """Read the version of the answer to ``FIRMWARE``, e.g. ``V1.02.22062416``; empty: it says none."""
    if len(value) < 8:
        return ""
    _, minor, major, build = struct.unpack_from("<HBBI", value)
    return f"V{major:x}.{minor:02x}.{build:08x}"


def _signed(raw: int) -> int:
    """Read a number whose highest bit is set where it is positive."""
    return raw - 0x8000 if raw & 0x8000 else -raw


class Parser:
    """Finds reports and answers in a stream of bytes, whatever is between them; never raises, and keeps no more than one of them.

    Attributes
    ----------
    received : int
        Bytes so far.
    counts : Counter
        ``reports``, ``answers``, ``refused`` (a beginning without its end), ``garbage_bytes``.
    """

    def __init__(self) -> None:
        self._held = bytearray()
        self.received = 0
        self.counts: Counter[str] = Counter()

    @property
    def held(self) -> int:
        """Bytes that wait for more."""
        return len(self._held)

    def reset(self) -> None:
        """Forget what waits; for a line that was interrupted."""
        self._held.clear()

    def feed(self, data: bytes) -> list[Report | Answer]:
        """Take in the next bytes, however many; give what is complete now, in the order of the stream."""
        found: list[Report | Answer] = []
        for start in range(0, len(data), LONGEST):
            piece = data[start : start + LONGEST]
            self._held += piece
            self.received += len(piece)
            while (one := self._next()) is not None:
                found.append(one)
        return found

    def _next(self) -> Report | Answer | None:
        while True:
            places = [at for at in (self._held.find(REPORT), self._held.find(COMMAND)) if at >= 0]
            if not places:
                self._discard(max(len(self._held) - 3, 0))  # the last bytes may begin one
                return None
            self._discard(min(places))
            size = self._size()
            if size == 0 or len(self._held) < abs(size):
                return None
            if size > 0:
                one = self._read(bytes(self._held[:size]))
                if one is not None:
                    del self._held[:size]
                    return one
            self.counts["refused"] += 1
            self._discard(1)

    def _size(self) -> int:
        """Bytes of what begins at the front; 0: not known yet, -1: too long to be true."""
        if self._held.startswith(REPORT):
            return LENGTH
        if len(self._held) < 6:
            return 0
        length = struct.unpack_from("<H", self._held, 4)[0]
        return 10 + length if 4 <= length <= LONGEST else -1

    def _read(self, data: bytes) -> Report | Answer | None:
        """Read what begins and should end here; None: it does not."""
        if data.startswith(REPORT):
            if not data.endswith(END):
                return None
            self.counts["reports"] += 1
            rows = struct.iter_unpack("<4H", data[4:28])
            targets = [(slot, row) for slot, row in enumerate(rows) if any(row)]
            found = (Target(k, _signed(x) * 1e-3, _signed(y) * 1e-3, _signed(v) * 1e-2, cell * 1e-3) for k, (x, y, v, cell) in targets)
            return Report(tuple(found), self.received - len(self._held) + LENGTH)
        if not data.endswith(COMMAND_END):
            return None
        self.counts["answers"] += 1
        word, status = struct.unpack_from("<2H", data, 6)
        return Answer(word & 0xFF, status == 0, data[10:-4])

    def _discard(self, count: int) -> None:
        self.counts["garbage_bytes"] += count
        del self._held[:count]
