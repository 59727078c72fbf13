"""Files that are there as a whole, or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Write a file under another name beside ``path``, which takes its place at the end; whatever goes wrong, nothing half done is left."""
    path = Path(path)
    partial = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        yield partial
        os.replace(partial, path)
    finally:
        with suppress(OSError):
            partial.unlink()


def write_whole(path: str | Path, text: str) -> None:
    """Write a text file in UTF-8: all of it, or nothing. Raises `OSError` when it cannot be written."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")
