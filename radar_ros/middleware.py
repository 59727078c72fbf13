"""What the middleware says of a message that it could not give: rcl leaves that in librcutils, where Python does not look."""

from __future__ import annotations

import ctypes
import functools
from pathlib import Path
from typing import Any, Final

_LENGTH: Final = 1024


class _Text(ctypes.Structure):
    _fields_ = (("text", ctypes.c_char * _LENGTH),)


@functools.cache
def _library() -> Any:
    """Librcutils as this process has loaded it; None: it is not found."""
    try:
        lines = Path("/proc/self/maps").read_text(encoding="utf-8").splitlines()
        path = next(line.split(maxsplit=5)[5] for line in lines if "librcutils" in line)
        library = ctypes.CDLL(path)
        library.rcutils_error_is_set.restype = ctypes.c_bool
        library.rcutils_get_error_string.restype = _Text
    except (OSError, StopIteration, AttributeError):
        return None
    return library


def unreadable() -> str:
    """Say what the middleware could not read in this thread since the last time: it drops such bytes without a word; empty: nothing."""
    library = _library()
    if library is None or not library.rcutils_error_is_set():
        return ""
    text = bytes(library.rcutils_get_error_string().text).decode(errors="replace")
    library.rcutils_reset_error()
    return text if "deserializ" in text else ""
