"""Files of arrays that are whole or not there."""

from __future__ import annotations

import json
import math
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core.errors import ConfigError, DataError

_PIECE: Final = 1 << 18  # bytes read at once
_MOST_MEMBERS: Final[int] = 64
_COMPRESSIONS: Final[tuple[int, ...]] = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
BROKEN = (
    OSError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, ValueError, TypeError, SyntaxError,
    OverflowError, MemoryError, tokenize.TokenError,
)  # fmt: skip
"""What reading an archive that is cut off, changed or hostile ends with."""


def save_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], what: str) -> None:
    """Write arrays to a compressed ``.npz``; it appears under its name only when complete, and the same arrays give the same bytes.

    Its folder is made. Arrays need no pickle to be read. ``what`` says what the file is, for the message, e.g. ``"model"``.

    Raises
    ------
    DataError
        When the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        from radar_core.files import replacing  # what only reads starts without it

        with replacing(path) as partial, partial.open("wb") as file:
            np.savez_compressed(file, **dict[str, Any](arrays))
    except OSError as error:
        raise DataError(f"{path}: the {what} cannot be written ({error.strerror}); name another place") from None


def load_arrays(path: Path, what: str, advice: str, most_bytes: int = 8_000_000) -> dict[str, NDArray[Any]]:
    """Read a file that `save_arrays` wrote: arrays by name. Nothing in it is executed, sizes are checked before anything is unpacked.

    Messages say ``what`` it should be, e.g. ``"gesture model"``, and as ``advice`` what to do when it is not. Content of more than
    ``most_bytes`` is refused.

    Raises
    ------
    ConfigError
        When the file cannot be read, is too large, or holds anything but plain arrays.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if len(members) > _MOST_MEMBERS or sum(member.file_size for member in members) > most_bytes:
                raise ValueError(f"it holds more than {_MOST_MEMBERS} arrays or {most_bytes // 1_000_000} MB")
            if any(member.compress_type not in _COMPRESSIONS for member in members):
                raise ValueError("it is packed in an unusual way")
            return {member.filename.removesuffix(".npy"): read_array(archive, member, most_bytes) for member in members}
    except BROKEN as error:
        raise ConfigError(f"{path}: not a {what} ({error}); {advice}") from None


def read_array(archive: zipfile.ZipFile, member: zipfile.ZipInfo, most_bytes: int) -> NDArray[Any]:
    """Read one array, or raise one of `BROKEN`; `numpy.load` would set aside what the header asks for before it looks at the data."""
    with archive.open(member) as file:
        version = np.lib.format.read_magic(file)
        if version != (1, 0):
            raise ValueError(f"{member.filename} is an array of npy version {version}, not 1.0")
        shape, fortran, kind = np.lib.format.read_array_header_1_0(file)
        size = math.prod(shape) * kind.itemsize
        if kind.hasobject or any(length < 0 for length in shape) or size > most_bytes:
            raise ValueError(f"{member.filename} holds {kind} {shape}, which is too much, or no array of numbers")
        data = bytearray()
        while len(data) <= size and (piece := file.read(_PIECE)):  # never what a head claims, only what is there
            data += piece
    if size != len(data):
        raise ValueError(f"{member.filename} is not what its header says ({kind} {shape})")
    return np.frombuffer(data, kind).reshape(shape, order="F" if fortran else "C")


def description(version: int, about: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Give the arrays with which a model file begins: ``format``, its version, and ``about``, a description as JSON."""
    text = json.dumps(dict(about), sort_keys=True)
    return {"format": np.array(version, np.int64), "about": np.frombuffer(text.encode(), np.uint8)}


def read_description(arrays: Mapping[str, NDArray[Any]], version: int, advice: str) -> dict[str, Any]:
    """Take the description out of the arrays of a model file; see `description`.

    Raises
    ------
    ConfigError
        When the file is of another version, or version or description are missing or make no sense.
    """
    if missing := {"format", "about"} - arrays.keys():
        raise ConfigError(f"the model lacks {', '.join(map(repr, sorted(missing, reverse=True)))}; {advice}")
    found = arrays["format"]
    if found.shape != () or found.dtype.kind not in "iu" or int(found) != version:
        raise ConfigError(f"model format {found}, but this version of Handwave reads format {version}; {advice}")
    try:
        described = json.loads(arrays["about"].tobytes().decode())
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"the model's description cannot be read ({error}); {advice}") from None
    if not isinstance(described, dict):
        raise ConfigError(f"the model's description is no mapping; {advice}")
    return described


def as_float32(name: str, array: Any, shape: tuple[int, ...], advice: str) -> NDArray[np.float32]:
    """Return an array of real numbers as float32.

    Raises
    ------
    ConfigError
        When it has another shape, holds something else than numbers, or one that is not finite in float32.
    """
    given = np.asarray(array)
    if given.shape != shape or given.dtype.kind not in "fiu":
        raise ConfigError(f"{name} is {given.dtype} {given.shape}, expected float32 {shape}; {advice}")
    if not (np.abs(given) <= np.finfo(np.float32).max).all():
        raise ConfigError(f"{name} has non-finite numbers; {advice}")
    return np.ascontiguousarray(given, np.float32)
