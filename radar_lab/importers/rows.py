"""The originals' text format: frame, points in frame, x, y, z, Doppler, intensity; one point a row."""

from __future__ import annotations

import csv
from collections import Counter
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError

_COLUMNS: Final = 7
_ABSURD: Final = 20.0  # m and m/s: larger coordinates and speeds are rows that the logger garbled


def read_rows(path: Path) -> tuple[NDArray[np.int64], NDArray[np.float64], Counter[str]]:
    """Read a file, leaving out what the logger garbled; a heading is skipped.

    Parameters
    ----------
    path : Path
        The .csv file.

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
                reason = _judge(row, good)
                if reason and not (number == 0 and _is_heading(row)):
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


def _is_heading(row: list[str]) -> bool:
    return any(any(c.isalpha() for c in cell) for cell in row) and not any(cell.strip().isdigit() for cell in row)


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
