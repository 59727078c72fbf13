"""Rehabilitation exercises with a Kinect's joints beside each cloud: the MARS data set."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from radar_core import NO_GESTURE, DataError
from radar_core.config import config, knob
from radar_core.types import Float64Array, IndexArray
from radar_driver.clouds import amplitude_db, cloud_from_ti, cloud_source_info, to_our_axes
from radar_lab.importers.recording import (
    START_NS,
    Item,
    Recording,
    SourceOptions,
    Tally,
    check_offsets,
    load_npz,
    require_length,
    require_numbers,
)
from radar_sim.truth import Truth

_FOV: Final = (np.radians(120.0), np.radians(60.0))  # of the IWR1443's antennas, roughly
_BODY: Final = "SpineBase"
_POINT: Final = ("Frame #", "# Obj", "X", "Y", "Z", "Doppler", "Intensity")  # columns of an original; a time follows, too coarse to use
Places = Float64Array


@config
class MarsOptions(SourceOptions):
    """How to read the recording."""

    frame_interval: float = knob(0.1, unit="s", low=1e-3, high=10.0, doc="time between two frames; the files carry no time")
    hand: Literal["right", "left"] = knob("right", doc="which hand becomes the truth's")
    height: float = knob(1.0, unit="m", low=-100.0, high=100.0, doc="of the radar above the floor; the default puts the feet there")


def read_mars(path: Path, options: MarsOptions) -> Recording:
    """Open one file: packed, e.g. subject1_test.npz, or an original, radar_data_test.csv with kinect_data_test.csv.

    Joints are relative to the radar, as the points are; the feet lie 0.94 m below it, hence the default mount at 1 m. Raises `DataError`
    when a field is missing, or clouds and joints differ in number.
    """
    data = _originals(path) if path.suffix == ".csv" else _packed(path)
    require_length(path, data, ("doppler", "intensity"), len(data["xyz"]), f"xyz has {len(data['xyz'])} points")
    offset = check_offsets(path, data["offset"], len(data["xyz"]))
    expected = (len(offset) - 1, len(data["joints"]))
    if data["joint_xyz"].shape[:2] != expected:
        raise DataError(f"{path}: field joint_xyz has shape {data['joint_xyz'].shape}, but offset and joints ask for {(*expected, 3)}")
    names = [str(name) for name in data["joints"]]
    hand = f"Hand{options.hand.capitalize()}"
    for name in (_BODY, hand):
        if name not in names:
            raise DataError(f"{path}: field joints lacks {name}; it has {', '.join(names)}")
    tracks = {name: options.mount.to_room(to_our_axes(data["joint_xyz"][:, names.index(name)])) for name in (_BODY, hand)}
    subject = re.search(r"subject(\d+)", str(Path(*path.resolve().parts[-4:])))
    tally = Tally()
    tally.warnings.append(f"the file carries no time: frames are taken to be {options.frame_interval * 1e3:g} ms apart")
    info = cloud_source_info(options.frame_interval, _FOV, options.mount)
    items = _items(data, offset, tracks[_BODY], tracks[hand], int(subject[1]) if subject else 0, options.frame_interval)
    return Recording(info, items, tally)


def _packed(path: Path) -> dict[str, NDArray[Any]]:
    shapes: dict[str, tuple[int | None, ...]] = dict.fromkeys(("offset", "doppler", "intensity", "joints"), (None,))
    shapes |= {"xyz": (None, 3), "joint_xyz": (None, None, 3)}
    return load_npz(path, shapes, ("xyz", "doppler", "intensity", "joint_xyz"))


def _originals(path: Path) -> dict[str, NDArray[Any]]:
    """Read the two tables of an original: points, of which those of one frame follow each other, and joints, a row for each frame."""
    names, points = _table(path)
    if names[:7] != list(_POINT):
        raise DataError(f"{path}: has the columns {', '.join(names)[:80]}, expected {', '.join(_POINT)}; is it a radar_data_*.csv?")
    other = path.with_name(path.name.replace("radar", "kinect"))
    if other == path or not other.is_file():
        raise DataError(f"{path}: the joints of the same frames have to lie beside it, in {path.name.replace('radar', 'kinect')}")
    columns, joints = _table(other)
    known = [name.removesuffix("_X") for name in columns if name.endswith("_X")]
    missing = [f"{name}_{axis}" for name in known for axis in "XYZ" if f"{name}_{axis}" not in columns]
    if not known or missing:
        raise DataError(f"{other}: lacks the columns {', '.join(missing) or 'of joints, such as SpineBase_X'}")
    places = np.stack([joints[:, [columns.index(f"{name}_{axis}") for name in known]] for axis in "XYZ"], axis=-1)
    begins = np.flatnonzero(np.diff(points[:, 0], prepend=np.nan) != 0)
    found: dict[str, NDArray[Any]] = {"offset": np.append(begins, len(points)).astype(np.int64), "xyz": points[:, 2:5]}
    return found | {"doppler": points[:, 5], "intensity": points[:, 6], "joints": np.array(known), "joint_xyz": places}


def _table(path: Path) -> tuple[list[str], Float64Array]:
    """Read a heading, and rows of finite numbers of as many columns."""
    try:
        with path.open(encoding="utf-8") as stream:
            names = [name.strip() for name in stream.readline().split(",")]
            lines = [line for line in stream if line.strip()]
        rows = np.loadtxt(lines, delimiter=",", ndmin=2) if lines else np.zeros((0, len(names)))
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read as a table of numbers ({str(error)[:100]})") from None
    if rows.shape[1:] != (len(names),) or not len(rows):
        raise DataError(f"{path}: has {len(names)} names and rows of shape {rows.shape}")
    require_numbers(path, "of the table", rows)
    return names, rows


def _items(data: dict[str, NDArray[Any]], offset: IndexArray, body: Places, hand: Places, subject: int, interval: float) -> Iterator[Item]:
    velocities = [np.gradient(path, interval, axis=0) if len(path) > 1 else np.zeros_like(path) for path in (body, hand)]
    for k in range(len(offset) - 1):
        stamp = START_NS + k * round(interval * 1e9)
        rows = slice(offset[k], offset[k + 1])
        yield cloud_from_ti(stamp, k, data["xyz"][rows], data["doppler"][rows], amplitude_db(data["intensity"][rows]))
        yield Truth(
            stamp_ns=stamp,
            sequence=k,
            frame_id="room",
            person_id=np.array([subject], np.uint32),
            position=body[k : k + 1],
            velocity=velocities[0][k : k + 1],
            hand_position=hand[k : k + 1],
            hand_velocity=velocities[1][k : k + 1],
            gesture=np.array([NO_GESTURE], np.uint8),
            gesture_index=np.zeros(1, np.uint32),
            walking=np.zeros(1, bool),
            drawing=np.zeros(1, bool),
        )
