"""Reads the points of any ``sensor_msgs/PointCloud2``: whatever fields, types, strides and byte order the message declares."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError

_TYPES: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""numpy's names of ``PointField.datatype``."""
_MOST: Final = 1 << 24  # points; a cloud of a radar has thousands at most


def read_fields(msg: Any, names: Mapping[str, str], topic: str) -> dict[str, NDArray[np.float64]]:
    """Read some fields of a cloud.

    Parameters
    ----------
    msg : PointCloud2
        Or anything with its attributes.
    names : mapping of str to str
        What a value is called here, to the message's name of it; empty ones are left out.
    topic : str
        For error messages.

    Returns
    -------
    dict of str to ndarray of float64, shape (n_points,)
        In the order of the message, rows one after another.

    Raises
    ------
    DataError
        Naming topic and field, when the message lacks a field or contradicts itself.
    """
    wanted = {ours: theirs for ours, theirs in names.items() if theirs}
    rows = _size(msg, topic)
    if math.prod(rows) == 0:
        return {ours: np.empty(0) for ours in wanted}
    chosen = {ours: _field(msg, theirs, topic) for ours, theirs in wanted.items()}
    order = ">" if msg.is_bigendian else "<"
    formats, offsets = [order + _TYPES[field.datatype] for field in chosen.values()], [field.offset for field in chosen.values()]
    layout = np.dtype({"names": list(wanted), "formats": formats, "offsets": offsets, "itemsize": msg.point_step})
    points = np.ndarray(rows, layout, buffer=memoryview(msg.data), strides=(msg.row_step, msg.point_step))
    with np.errstate(invalid="ignore"):  # signalling NaNs
        return {ours: points[ours].astype(np.float64).ravel() for ours in wanted}


def _size(msg: Any, topic: str) -> tuple[int, int]:
    """Give rows and columns of the cloud; refuse sizes that contradict each other."""
    rows, columns = int(msg.height), int(msg.width)
    if rows * columns == 0:
        return rows, columns
    if rows * columns > _MOST:
        raise DataError(f"{topic}: a cloud of {rows} x {columns} points is more than a radar gives ({_MOST})")
    if msg.point_step < 1 or msg.row_step < columns * msg.point_step:
        steps = f"point_step {msg.point_step} and row_step {msg.row_step}"
        raise DataError(f"{topic}: {steps} do not fit {columns} points in a row: a broken publisher")
    needed = (rows - 1) * msg.row_step + columns * msg.point_step
    if len(msg.data) < needed:
        raise DataError(f"{topic}: data has {len(msg.data)} bytes, but {rows} x {columns} points need {needed}; its publisher is broken")
    return rows, columns


def _field(msg: Any, name: str, topic: str) -> Any:
    """Find a field that holds one number a point."""
    found = [field for field in msg.fields if field.name == name]
    if not found:
        there = ", ".join(field.name for field in msg.fields) or "none"
        raise DataError(f"{topic}: has no field {name!r}; it has: {there}. Name one of these in the parameter, or '' if it is not measured")
    if len(found) > 1:
        raise DataError(f"{topic}: field {name!r} is there {len(found)} times; its publisher is broken")
    (field,) = found
    if field.datatype not in _TYPES:
        raise DataError(f"{topic}: field {name!r} has the datatype {field.datatype}, which PointField does not know (1 to 8)")
    if field.count > 1:  # some publishers leave it 0 for 1
        raise DataError(f"{topic}: field {name!r} has {field.count} numbers a point; choose one that has one")
    size = np.dtype(_TYPES[field.datatype]).itemsize
    end = field.offset + size
    if end > msg.point_step:
        raise DataError(f"{topic}: field {name!r} ends at byte {end} of a point of {msg.point_step} (point_step): a broken publisher")
    return field
