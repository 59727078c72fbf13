"""Files of arrays that are whole or not there."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core.errors import DataError


def save_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], what: str) -> None:
    """Write arrays to a compressed ``.npz``; it appears under its name only when complete, and the same arrays give the same bytes.

    Parameters
    ----------
    path : Path
        The file; its folder is made.
    arrays : mapping
        By name; they need no pickle to be read.
    what : str
        What the file is, for the message, e.g. ``"model"``.

    Raises
    ------
    DataError
        When the file cannot be written.
    """
    partial = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial.open("wb") as file:
            np.savez_compressed(file, **dict[str, Any](arrays))
        partial.replace(path)
    except OSError as error:
        with suppress(OSError):
            partial.unlink()
        raise DataError(f"{path}: the {what} cannot be written ({error.strerror}); name another place") from None
