"""Files that survive a crash: whole ones that appear at once, and a journal that only grows."""

from __future__ import annotations

import fcntl
import json
import os
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, Final

from radar_core import DataError
from radar_core.files import replacing

_ADVICE: Final = "make room or rights there; nothing of it was kept"


def write_synced(path: Path, write: Callable[[IO[bytes]], None]) -> None:
    """Write a file so that it is on the disk, under its name and whole, when this returns; after a crash it is whole or not there.

    Raises `DataError` when it cannot be written; nothing that is half written is left then.
    """
    try:
        with replacing(path) as partial, partial.open("wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        sync_folder(path.parent)
    except OSError as error:
        raise DataError(f"{path}: cannot be written ({error.strerror}); {_ADVICE}") from None


def sync_folder(folder: Path) -> None:
    """Bring the names of a folder's files to the disk."""
    number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def encode_line(entry: dict[str, Any]) -> bytes:
    """Write an entry as a line: a checksum (CRC-32, eight hexadecimal digits), a space, JSON, an end of line."""
    text = json.dumps(entry, sort_keys=True).encode()
    return b"%08x " % zlib.crc32(text) + text + b"\n"


def read_journal(path: Path) -> tuple[list[dict[str, Any]], int, list[str]]:
    """Read all entries of a journal.

    A line that a crash cut off can only be the last one, and what it says was never acknowledged. Any other line that is wrong was damaged
    later; it is left out and told, and the others stand.

    Returns
    -------
    tuple
        The entries; where the last whole line ends [bytes]; what is wrong with the file, a line each.

    Raises
    ------
    DataError
        When it cannot be read.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from None
    entries, wrong, end = [], [], 0
    position = 0
    for number, text in enumerate(data.split(b"\n"), 1):
        line = data[position : position + len(text) + 1]  # with its end, where it has one
        position += len(line)
        if not line:
            break
        entry = _decode(line)
        if entry is None:
            wrong.append((number, position))
        else:
            entries.append(entry)
            end = position
    told = [f"{path}:{number}: this line is damaged and left out" for number, after in wrong if after < end]
    if end < len(data):
        told.append(f"{path}: the last write was cut off; {len(data) - end} bytes that nobody was told of are left out")
    return entries, end, told


def _decode(line: bytes) -> dict[str, Any] | None:
    """Read one line; None: it is not whole."""
    checksum, space, text = line[:8], line[8:9], line[9:-1]
    if space != b" " or line[-1:] != b"\n" or checksum != b"%08x" % zlib.crc32(text):
        return None
    try:
        entry = json.loads(text)
    except ValueError:
        return None
    return entry if isinstance(entry, dict) else None


class Journal:
    """A file of entries that only grows; an entry is on the disk when `append` returns.

    While it is open no other process can open it. What a crash left of the last entry is cut away.

    Parameters
    ----------
    path : Path
        The file; it is made, in a folder that exists.

    Attributes
    ----------
    entries : list of dict
        All that it says, in order.
    told : list of str
        What was wrong with the file, a line each.

    Raises
    ------
    DataError
        When it cannot be read or written, or another process has it open.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise DataError(f"{path}: cannot be opened ({error.strerror}); name a folder that you may write to") from None
        try:
            self._lock()
            self.entries, self._end, self.told = read_journal(path)
            self._cut()
            sync_folder(path.parent)
        except OSError as error:
            os.close(self._file)
            raise DataError(f"{path}: cannot be written ({error.strerror}); name a folder that you may write to") from None
        except DataError:
            os.close(self._file)
            raise

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise DataError(f"{self.path.parent}: another process has this session open; end it, or name another folder") from None

    def _cut(self) -> None:
        """Leave nothing behind the last whole line, so that the next one begins a line."""
        if os.fstat(self._file).st_size != self._end:
            os.ftruncate(self._file, self._end)
            os.fsync(self._file)

    def append(self, entry: dict[str, Any]) -> None:
        """Add an entry. Raises `DataError` when it cannot be written; the journal is then as it was before."""
        data = encode_line(entry)
        try:
            self._cut()  # what an append before this one could neither finish nor take back
            _write_all(self._file, data, self._end)
            os.fsync(self._file)
        except OSError as error:
            with suppress(OSError):
                self._cut()
            raise DataError(f"{self.path}: cannot be written ({error.strerror}); {_ADVICE}") from None
        self._end += len(data)
        self.entries.append(entry)

    def close(self) -> None:
        """Let other processes open it; may be called twice."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def _write_all(file: int, data: bytes, offset: int) -> None:
    while data:
        n = os.pwrite(file, data, offset)
        data, offset = data[n:], offset + n
