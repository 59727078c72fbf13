"""Sample files: what simulation writes and training reads."""

from __future__ import annotations

import json
import os
import platform
import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import psutil
from numpy.typing import NDArray

from radar_core import GESTURES, ConfigError, DataError
from radar_gestures.features import FEATURE_NAMES

MANIFEST: Final[str] = "dataset.json"
_COLUMNS: Final[tuple[str, ...]] = ("features", "label", "person", "walked", "missed")


@dataclass(frozen=True, eq=False)
class SampleSet:
    """Labelled samples.

    Attributes
    ----------
    features : ndarray of float64, shape (n, 13)
        As `extract` gives them.
    label : ndarray of int64, shape (n,)
        Index into `GESTURES`.
    person : ndarray of int64, shape (n,)
        Whose; every simulated scene has people of its own.
    walked : ndarray of float64, shape (n,)
        Ground distance moved during the event [m].
    missed : ndarray of int64, shape (10,)
        Gestures performed in the simulation that gave no event, by label.
    settings : mapping
        How the features were made.
    """

    features: NDArray[np.float64]
    label: NDArray[np.int64]
    person: NDArray[np.int64]
    walked: NDArray[np.float64]
    missed: NDArray[np.int64]
    settings: Mapping[str, Any]

    def __post_init__(self) -> None:
        n = len(self.label)
        if self.features.shape != (n, len(FEATURE_NAMES)) or self.person.shape != (n,) or self.walked.shape != (n,):
            raise DataError(
                f"samples: {n} labels, but features {self.features.shape}, person {self.person.shape}, walked {self.walked.shape}"
            )
        if not np.isfinite(self.features).all():
            raise DataError("samples: features has non-finite values")
        if n and not (self.label.min() >= 0 and self.label.max() < len(GESTURES)):
            raise DataError(f"samples: labels must lie in 0..{len(GESTURES) - 1}, found {self.label.min()}..{self.label.max()}")


def open_folder(folder: str | Path, manifest: Mapping[str, Any]) -> Path:
    """Make a data set folder, or check that an existing one was made with the same settings, so that a stopped run can go on.

    What a killed run left half written is removed.

    Raises
    ------
    ConfigError
        When the folder holds samples made with other settings, or cannot be made.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{folder}: this folder cannot be made ({error.strerror}); name another one") from None
    file = folder / MANIFEST
    text = json.dumps(dict(manifest), sort_keys=True, indent=1)
    if not file.exists():
        partial = _partial(file)
        partial.write_text(text + "\n", encoding="utf-8")
        partial.replace(file)
    elif file.read_text(encoding="utf-8").strip() != text:
        raise ConfigError(f"{folder}: holds samples made with other settings (see {MANIFEST}); name another folder, or delete this one")
    for partial in folder.glob("*.part"):
        if _is_left(partial):
            partial.unlink(missing_ok=True)
    return folder


def chunk_path(folder: Path, number: int) -> Path:
    """File of the samples of one simulated scene."""
    return folder / f"chunk_{number:05d}.npz"


def write_chunk(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write one chunk; it appears under its name only when complete, so that a killed run leaves no broken file.

    The same columns give the same bytes: numpy dates the members of every file alike.

    Raises
    ------
    DataError
        When the file cannot be written, as on a full disk.
    """
    partial = _partial(path)
    try:
        with partial.open("wb") as file:
            np.savez(file, **dict[str, Any](columns))
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise DataError(f"{path}: cannot be written ({error.strerror}); make room or rights, then start again: it goes on here") from None


def _partial(path: Path) -> Path:
    """Name that no other process uses, on whatever machine of a cluster that shares the folder."""
    return path.with_suffix(f".{platform.node()}.{os.getpid()}.part")


def _is_left(partial: Path) -> bool:
    """Whether the process that began a file is gone; it must have been one of this machine, of others we cannot know."""
    begun_by = re.fullmatch(rf".*\.{re.escape(platform.node())}\.(\d+)\.part", partial.name)
    return begun_by is not None and not psutil.pid_exists(int(begun_by[1]))


def load_samples(folder: str | Path) -> SampleSet:
    """Read all chunks of a data set.

    Raises
    ------
    DataError
        When the folder is no data set, holds no chunk, or a chunk cannot be read.
    """
    folder = Path(folder)
    chunks = sorted(folder.glob("chunk_*.npz"))
    if not chunks or not (folder / MANIFEST).is_file():
        raise DataError(f"{folder}: no samples here; make some with `handwave train`, or radar_gestures.dataset.generate")
    columns: dict[str, list[NDArray[Any]]] = {name: [] for name in _COLUMNS}
    for path in chunks:
        try:
            with np.load(path, allow_pickle=False) as content:
                for name in _COLUMNS:
                    columns[name].append(content[name])
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise DataError(f"{path}: cannot be read ({error}); delete it and simulate again") from None
    settings = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["settings"]
    missed = np.sum(columns.pop("missed"), axis=0)
    joined = {name: np.concatenate(parts) for name, parts in columns.items()}
    return SampleSet(**joined, missed=np.asarray(missed, np.int64), settings=settings)
