"""Opening files that others made: errors name the file and the field."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError


def field_names(path: Path) -> list[str]:
    """Names of the arrays of an .npz file; none when it cannot be read, which `load_npz` explains."""
    try:
        with zipfile.ZipFile(path) as archive:
            return [name.removesuffix(".npy") for name in archive.namelist()]
    except (OSError, zipfile.BadZipFile):
        return []


def load_npz(path: Path, fields: dict[str, tuple[int | None, ...]]) -> dict[str, NDArray[Any]]:
    """Load arrays of an .npz file and check their shapes.

    Parameters
    ----------
    path : Path
        The file.
    fields : dict of str to tuple
        Wanted arrays and their shapes; None stands for any length.

    Returns
    -------
    dict of str to ndarray
        The arrays, shape as asked for.

    Raises
    ------
    DataError
        When the file is no .npz, lacks an array or has one of another shape, or holds pickled objects.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise DataError(f"{path}: is one array, not an .npz archive of {', '.join(fields)}")
            missing = [name for name in fields if name not in archive.files]
            if missing:
                raise DataError(f"{path}: lacks the field {', '.join(missing)} (it has {', '.join(archive.files)}); is it of this kind?")
            arrays = {name: np.asarray(archive[name]) for name in fields}
    except (OSError, ValueError, zipfile.BadZipFile, EOFError) as error:
        if isinstance(error, DataError):
            raise
        raise DataError(f"{path}: cannot be read as .npz ({error}); fetch it again") from None
    for name, shape in fields.items():
        got = arrays[name].shape
        if len(got) != len(shape) or any(w is not None and w != g for w, g in zip(shape, got, strict=True)):
            raise DataError(f"{path}: field {name} has shape {got}, expected {tuple('any' if w is None else w for w in shape)}")
    return arrays


def check_offsets(path: Path, offset: NDArray[Any], n_points: int) -> NDArray[np.int64]:
    """Return the field ``offset``, shape (n + 1,), as integers that never decrease and end with the number of points.

    Raises `DataError` otherwise, naming the first bad entry.
    """
    if offset.dtype.kind not in "iu" or len(offset) < 2:
        raise DataError(f"{path}: field offset is {offset.dtype} of length {len(offset)}, expected whole numbers, one more than frames")
    limits = offset.astype(np.int64)
    bad = np.flatnonzero(np.diff(limits) < 0)
    if len(bad) or limits[0] != 0 or limits[-1] != n_points:
        where = f"decreases at entry {bad[0] + 1}" if len(bad) else f"runs from {limits[0]} to {limits[-1]}"
        raise DataError(f"{path}: field offset {where}, but must rise from 0 to the number of points, {n_points}; fetch the file again")
    return limits


def require_numbers(path: Path, name: str, array: NDArray[Any]) -> None:
    """Raise `DataError` when a field is not numeric or holds a NaN or an infinity, naming file, field and place."""
    if array.dtype.kind not in "iufc":
        raise DataError(f"{path}: field {name} is {array.dtype}, expected numbers")
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        raise DataError(f"{path}: field {name} has {len(bad)} values that are not finite, the first at {tuple(int(i) for i in bad[0])}")
