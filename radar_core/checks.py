"""Checks at the door: shapes and finiteness, with errors that name the field."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from radar_core.errors import DataError


def require_shape(name: str, array: NDArray[np.generic], shape: Sequence[int | None]) -> None:
    """Raise `DataError`, naming the field, unless ``array`` has the given shape; None stands for any length of an axis."""
    if len(array.shape) != len(shape) or any(w is not None and w != g for w, g in zip(shape, array.shape, strict=True)):
        wanted = tuple("any" if w is None else w for w in shape)
        raise DataError(f"{name} has shape {array.shape}, expected {wanted}")


def require_finite(name: str, array: NDArray[np.generic]) -> None:
    """Raise `DataError` when ``array`` holds a NaN or an infinity, naming the field, the count and the first place."""
    finite = np.isfinite(array)
    if not finite.all():
        bad = np.argwhere(~finite)
        raise DataError(f"{name} has {len(bad)} non-finite values, the first at index {tuple(int(i) for i in bad[0])}")


def require_every(name: str, every: int) -> None:
    """Raise `DataError` unless ``every``, by how much sequences grow from one result to the next, is a whole number of at least 1."""
    if not (isinstance(every, (int, np.integer)) and every >= 1):
        raise DataError(f"{name} is {every}; expected a whole number of at least 1: every so many'th frame is used")
