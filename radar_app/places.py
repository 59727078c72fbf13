"""Where nodes write besides what they are told to: ROS's logs and compiled loops. On a disk that is read-only or full, somewhere else.

Without a place for logs no ROS node starts, and without one for compiled loops numba refuses to be imported.
"""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

import radar_core
from radar_app.exits import say

_MEMORY: Final = Path("/dev/shm")
_PACKAGES: Final = Path(radar_core.__file__).parents[1]


def writable(env: Mapping[str, str]) -> dict[str, str]:
    """Make an environment of one that has HOME or ROS_LOG_DIR, in which nodes can write; one line says what goes elsewhere."""
    result, home = dict(env), Path(env.get("HOME") or "/")
    logs = Path(env.get("ROS_LOG_DIR") or Path(env.get("ROS_HOME") or home / ".ros") / "log")
    if (reason := _refused(logs)) and (place := _other(env, "logs")):
        say(f"{logs}: {reason}; ROS's logs go to {place}")
        result["ROS_LOG_DIR"] = str(place)
    cache = env.get("NUMBA_CACHE_DIR")
    usual = (
        [Path(cache)] if cache else [_PACKAGES / "radar_dsp" / "__pycache__", Path(env.get("XDG_CACHE_HOME") or home / ".cache") / "numba"]
    )
    reasons = [_refused(place) for place in usual]
    if all(reasons) and (place := _other(env, "compiled")):
        say(f"{usual[0]}: {reasons[0]}; compiled loops go to {place}")
        result["NUMBA_CACHE_DIR"] = str(place)
        _take_along(place)
    return result


def _other(env: Mapping[str, str], what: str) -> Path | None:
    """Find a place that can be written to; None: there is none."""
    folders = (Path(env.get("TMPDIR") or "/tmp") / f"handwave-{os.getuid()}", _MEMORY / f"handwave-{os.getuid()}")
    return next((folder / what for folder in folders if _ours(folder) and not _refused(folder / what)), None)


def _ours(folder: Path) -> bool:
    """Whether a folder, which is made where it is not there, is ours alone: what others put there would be run."""
    with suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return False


def _refused(folder: Path) -> str:
    """Why files cannot be written into a folder, which is made where it is not there; empty: they can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"room")
            file.flush()
    except OSError as error:
        return error.strerror or str(error)
    return ""


def _take_along(place: Path) -> None:
    """Copy loops that were compiled before: compiling takes minutes."""
    from numba.core.caching import _CacheLocator

    for source in _PACKAGES.glob("radar_*/**/__pycache__/*.nb[ic]"):
        folder = place / _CacheLocator.get_suitable_cache_subpath(str(source.parents[1] / "any.py"))  # type: ignore[no-untyped-call]
        folder.mkdir(exist_ok=True)
        if not (folder / source.name).exists():
            shutil.copyfile(source, folder / source.name)
