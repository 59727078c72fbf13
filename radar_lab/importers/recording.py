"""What every importer makes, and how it opens files that others made: errors name the file and the field."""

from __future__ import annotations

import csv
import zipfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError, PointCloud, Pose, RadarFrame, RadarInfo
from radar_core.arrays import BROKEN, read_array
from radar_core.config import config, knob
from radar_core.types import Float64Array, IndexArray
from radar_sim.truth import Truth

Item = PointCloud | RadarFrame | Truth

_MOST: Final = 1 << 31  # bytes of one array
_COLUMNS: Final = 7  # of a row of text
_ABSURD: Final = 20.0  # m and m/s: larger coordinates and speeds are rows that the logger garbled


@config
class SourceOptions:
    """Where the radar stood; every kind of recording has these options."""

    height: float = knob(1.2, unit="m", low=-100.0, high=100.0, doc="of the radar above the floor")
    yaw: float = knob(0.0, unit="rad", low=-6.3, high=6.3, doc="boresight from the room's x towards its y, left positive")
    tilt: float = knob(0.0, unit="rad", low=-1.57, high=1.57, doc="boresight above the horizon, up positive")

    @property
    def mount(self) -> Pose:
        """Pose of the radar in the room."""
        return Pose(z=self.height, yaw=self.yaw, tilt=self.tilt)


START_NS: Final[int] = 1_000_000_000
"""Stamp of the first frame of recordings that carry no time; not 0, which ROS reads as "no time"."""


@dataclass(frozen=True)
class Segment:
    """A labelled part of a recording."""

    label: str  # as the original says
    subject: int  # who
    distance: float  # from the radar [m]; NaN: unknown
    # start_ns, end_ns: stamps of its first and last cloud [ns]
    start_ns: int
    end_ns: int


@dataclass
class Tally:
    """What an importer counts while its items are taken: rows it dropped, by reason, segments, and sentences for the user."""

    dropped: Counter[str] = field(default_factory=Counter)
    segments: list[Segment] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Recording:
    """A recording being read."""

    info: RadarInfo  # the radar
    items: Iterator[Item]  # in the order of time; read once
    tally: Tally  # complete when ``items`` is exhausted


def field_names(path: Path) -> list[str]:
    """Names of the arrays of an .npz file; none when it cannot be read, which `load_npz` explains."""
    try:
        with zipfile.ZipFile(path) as archive:
            return [name.removesuffix(".npy") for name in archive.namelist()]
    except (OSError, zipfile.BadZipFile):
        return []


def load_npz(path: Path, fields: dict[str, tuple[int | None, ...]], numbers: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Load arrays of an .npz file and check their shapes.

    Parameters
    ----------
    path : Path
        The file.
    fields : dict of str to tuple
        Wanted arrays and their shapes; None stands for any length.
    numbers : sequence of str
        Those of them that must be finite numbers.

    Raises
    ------
    DataError
        When the file is no .npz, lacks an array or has one of another shape or kind, or holds pickled objects.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = {member.filename.removesuffix(".npy"): member for member in archive.infolist()}
            missing = [name for name in fields if name not in members]
            if missing:
                raise DataError(f"{path}: lacks the field {', '.join(missing)} (it has {', '.join(members)}); is it of this kind?")
            arrays = {name: read_array(archive, members[name], _MOST) for name in fields}
    except DataError:
        raise
    except BROKEN as error:
        raise DataError(f"{path}: cannot be read as .npz ({error}); fetch it again") from None
    for name, shape in fields.items():
        got = arrays[name].shape
        if len(got) != len(shape) or any(w is not None and w != g for w, g in zip(shape, got, strict=True)):
            raise DataError(f"{path}: field {name} has shape {got}, expected {tuple('any' if w is None else w for w in shape)}")
    for name in numbers:
        require_numbers(path, name, arrays[name])
    return arrays


def check_offsets(path: Path, offset: NDArray[Any], n_points: int) -> IndexArray:
    """Return the field ``offset``, shape (n + 1,), as integers that rise from 0 to the number of points, or raise `DataError`."""
    if offset.dtype.kind not in "iu" or len(offset) < 2:
        raise DataError(f"{path}: field offset is {offset.dtype} of length {len(offset)}, expected whole numbers, one more than frames")
    limits = offset.astype(np.int64)
    bad = np.flatnonzero(np.diff(limits) < 0)
    if len(bad) or limits[0] != 0 or limits[-1] != n_points:
        where = f"decreases at entry {bad[0] + 1}" if len(bad) else f"runs from {limits[0]} to {limits[-1]}"
        raise DataError(f"{path}: field offset {where}, but must rise from 0 to the number of points, {n_points}; fetch the file again")
    return limits


def require_length(path: Path, data: dict[str, NDArray[Any]], names: Sequence[str], n: int, where: str) -> None:
    """Raise `DataError` for fields that have not ``n`` entries, which is what ``where`` says."""
    for name in names:
        if len(data[name]) != n:
            raise DataError(f"{path}: field {name} has {len(data[name])} entries but {where}")


def require_numbers(path: Path, name: str, array: NDArray[Any]) -> None:
    """Raise `DataError` when a field is not numeric or holds a NaN or an infinity, naming file, field and place."""
    if array.dtype.kind not in "iufc":
        raise DataError(f"{path}: field {name} is {array.dtype}, expected numbers")
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        raise DataError(f"{path}: field {name} has {len(bad)} values that are not finite, the first at {tuple(int(i) for i in bad[0])}")


def read_rows(path: Path) -> tuple[IndexArray, Float64Array, Counter[str]]:
    """Read the originals' text format, leaving out what the logger garbled; a heading is skipped.

    One point a row: frame, points in frame, x, y, z, Doppler, intensity.

    Returns
    -------
    frame : ndarray of int64, shape (n,)
        Frame number of each point.
    values : ndarray of float64, shape (n, 5)
        Right, forward, up [m], range rate [m/s], intensity.
    dropped : Counter
        Rows left out, by reason.

    Raises
    ------
    DataError
        When the file cannot be read as text or has no good row.
    """
    good: list[tuple[float, ...]] = []
    dropped: Counter[str] = Counter()
    try:
        with path.open(newline="", encoding="utf-8", errors="replace") as stream:
            for number, row in enumerate(csv.reader(stream)):
                heading = number == 0 and any(c.isalpha() for c in "".join(row)) and not any(cell.strip().isdigit() for cell in row)
                reason = _judge(row, good)
                if reason and not heading:
                    dropped[reason] += 1
    except (OSError, csv.Error) as error:
        raise DataError(f"{path}: cannot be read as rows of text ({error})") from None
    if not good:
        raise DataError(
            f"{path}: no row has the columns frame, points in frame, x, y, z, Doppler, intensity ({sum(dropped.values())} rows were "
            "something else); is it of this kind?"
        )
    table = np.array(good)
    return table[:, 0].astype(np.int64), table[:, 2:], dropped


def _judge(row: list[str], good: list[tuple[float, ...]]) -> str:
    """Add a row to the good ones, or say what is wrong with it."""
    if not any(cell.strip() for cell in row):
        return "empty rows"
    if len(row) != _COLUMNS:
        return "garbled rows: not 7 columns"
    try:
        values = tuple(float(cell) for cell in row)
    except ValueError:
        return "garbled rows: not numbers"
    if not np.isfinite(values).all() or values[0] < 0 or values[0] != int(values[0]) or values[6] < 0:
        return "garbled rows: impossible numbers"
    if max(abs(v) for v in values[2:6]) > _ABSURD:
        return "garbled rows: beyond 20 m or 20 m/s"
    good.append(values)
    return ""
