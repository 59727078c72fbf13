"""Where the files that come with Handwave lie: scenes, models, launch files, rviz set-ups."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from radar_core.config import nearest
from radar_core.errors import ConfigError


def share_dir() -> Path:
    """Folder that holds ``config/``, ``launch/`` and ``rviz/``: the checkout, else an ament prefix, else the environment.

    Raises
    ------
    ConfigError
        When none of the places has it.
    """
    checkout = Path(__file__).resolve().parent.parent
    if (checkout / "package.xml").is_file():
        return checkout
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p] + [Path(sys.prefix)]
    for prefix in prefixes:
        if (prefix / "share" / "handwave" / "config").is_dir():
            return prefix / "share" / "handwave"
    raise ConfigError(f"the files that come with Handwave are in none of {', '.join(map(str, prefixes))}; install the package again")


def find_config(name: str | Path, folder: str, suffix: str) -> Path:
    """Path of a configuration that the user named: a file of theirs, or one of ours by its bare name.

    Parameters
    ----------
    name : str or Path
        Path to a file, or a bare name such as ``"demo"``.
    folder : str
        Folder of ours below ``config/``, e.g. ``"scenes"``.
    suffix : str
        File suffix of ours, e.g. ``".yaml"``.

    Raises
    ------
    ConfigError
        Listing the names we have.
    """
    path = Path(name)
    if path.is_file():
        return path
    ours = share_dir() / "config" / folder
    if path.parent == Path() and (ours / f"{path.name}{suffix}").is_file():
        return ours / f"{path.name}{suffix}"
    known = sorted(p.name.removesuffix(suffix) for p in ours.glob(f"*{suffix}"))
    said = f"{name}{nearest(name, known)}: there is no such file, nor one of ours by that name"
    raise ConfigError(f"{said} ({folder}: {', '.join(known)})")
