"""One person who walks, boxes, squats or jumps: the RadHAR data set (Singh et al., "RadHAR", mmNets 2019; TI IWR1443, about 30 Hz)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError, PointCloud
from radar_core.config import config, knob
from radar_core.geometry import cartesian_to_spherical
from radar_core.types import Float64Array, IndexArray
from radar_driver.clouds import cloud_source_info, make_cloud
from radar_lab.importers.recording import START_NS, Recording, SourceOptions, Tally, check_offsets, load_npz, require_length

_FOV: Final = (np.radians(120.0), np.radians(60.0))  # of the IWR1443's antennas, roughly
_INTERVAL: Final = 1 / 30  # s: of the frames, whatever their stamps say
_NUMBER: Final = re.compile(r"^\s*(secs|nsecs|point_id|x|y|z|velocity|intensity): *(\S+)\s*$", re.MULTILINE)
_FIELDS: Final = ("secs", "nsecs", "point_id", "x", "y", "z", "velocity", "intensity")


@config
class RadharOptions(SourceOptions):
    """Which recording to read, and how."""

    recording: str = knob("0", doc="which one of a file with several: its number, or its name")
    stamps: Literal["recorded", "regular"] = knob("recorded", doc="recorded: as the computer took them, in pairs; regular: every 1/30 s")
    height: float = knob(1.0, unit="m", low=-100.0, high=100.0, doc="of the radar above the floor; not published")


def recordings(path: Path) -> list[tuple[str, str]]:
    """Name and activity of every recording of a packed file, in order."""
    data = load_npz(path, {"name": (None,), "activity": (None,)}, ())
    require_length(path, data, ("activity",), len(data["name"]), f"there are {len(data['name'])} names")
    return [(str(name), str(activity)) for name, activity in zip(data["name"], data["activity"], strict=True)]


def read_radhar(path: Path, options: RadharOptions) -> Recording:
    """Open one recording: of a packed file (.npz), or an original (.txt, the radar's ROS messages as text).

    Axes are as ours: x forward, y left, z up; range rates are positive for what recedes. Exactly one person is there.

    Raises
    ------
    DataError
        When a field is missing or has another shape, the text has no point, or there is no such recording.
    """
    stamp, offset, table = _text(path) if path.suffix == ".txt" else _packed(path, options.recording)
    if options.stamps == "regular":
        stamp = np.round(np.arange(len(stamp)) * _INTERVAL * 1e9).astype(np.int64)
    tally = Tally()
    back = int(np.sum(np.diff(stamp) <= 0))
    if back:
        tally.warnings.append(f"{back} of {len(stamp)} frames have stamps that do not rise")
    info = cloud_source_info(_INTERVAL, _FOV, options.mount)
    return Recording(info, _clouds(stamp - stamp[0] + START_NS, offset, table), tally)


def _packed(path: Path, wanted: str) -> tuple[IndexArray, IndexArray, Float64Array]:
    names = [name for name, _ in recordings(path)]
    shapes: dict[str, tuple[int | None, ...]] = dict.fromkeys(("recording", "stamp_ms", "offset", "doppler_mm_s", "intensity_cdb"), (None,))
    shapes |= {"xyz_mm": (None, 3)}
    data = load_npz(path, shapes, tuple(shapes))
    offset = check_offsets(path, data["offset"], len(data["xyz_mm"]))
    require_length(path, data, ("recording", "stamp_ms"), len(offset) - 1, f"offset describes {len(offset) - 1} frames")
    require_length(path, data, ("doppler_mm_s", "intensity_cdb"), len(data["xyz_mm"]), f"xyz_mm has {len(data['xyz_mm'])} points")
    number = names.index(wanted) if wanted in names else int(wanted) if wanted.isdigit() else -1
    frames = np.flatnonzero(data["recording"] == number)
    if not 0 <= number < len(names) or not len(frames):
        raise DataError(f"{path}: no recording {wanted!r}; it has {len(names)}, from 0 ({names[0]}) to {len(names) - 1} ({names[-1]})")
    if frames[-1] - frames[0] != len(frames) - 1:
        raise DataError(f"{path}: the frames of recording {number} do not stand together; fetch the file again")
    points = slice(offset[frames[0]], offset[frames[-1] + 1])
    speed, strength = 1e-3 * data["doppler_mm_s"][points], 1e-2 * data["intensity_cdb"][points]
    table = np.column_stack([1e-3 * data["xyz_mm"][points], speed, strength])
    return data["stamp_ms"][frames].astype(np.int64) * 1_000_000, offset[frames[0] : frames[-1] + 2] - points.start, table


def _text(path: Path) -> tuple[IndexArray, IndexArray, Float64Array]:
    """Read points that ``rostopic echo`` printed; the first of each frame has ``point_id: 0``."""
    try:
        found = _NUMBER.findall(path.read_text(encoding="utf-8"))
        columns = [[float(value) for name, value in found if name == field] for field in _FIELDS]
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read as points of text ({error})") from None
    if not columns[0] or len({len(column) for column in columns}) > 1:
        lengths = ", ".join(f"{len(column)} {field}" for field, column in zip(_FIELDS, columns, strict=True))
        raise DataError(f"{path}: expected points with {', '.join(_FIELDS)}, and as many of each; it has {lengths}")
    table = np.column_stack(columns)
    if not np.isfinite(table).all():
        raise DataError(f"{path}: {int((~np.isfinite(table)).sum())} numbers are not finite")
    first = np.flatnonzero(np.diff(table[:, 2], prepend=np.inf) <= 0)
    stamp = table[first, 0].astype(np.int64) * 1_000_000_000 + table[first, 1].astype(np.int64)
    return stamp, np.append(first, len(table)).astype(np.int64), table[:, 3:]


def _clouds(stamp: IndexArray, offset: IndexArray, table: Float64Array) -> Iterator[PointCloud]:
    for k, (start, stop) in enumerate(pairwise(offset)):
        position, values = table[start:stop, :3], table[start:stop, 3:]
        distance, azimuth, elevation = cartesian_to_spherical(position)
        measured: dict[str, NDArray[Any]] = {"range": distance, "azimuth": azimuth, "elevation": elevation}
        measured |= {"radial_speed": values[:, 0], "snr": values[:, 1], "noise": np.zeros(len(values))}
        yield make_cloud(int(stamp[k]), k, "radar", position, measured)
