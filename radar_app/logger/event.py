"""One detected gesture as the logger keeps it: maps, clouds, raw frames, and who it was of; and its file."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_app.logger.journal import write_synced
from radar_core import DataError, PointCloud, RadarFrame, RadarInfo
from radar_core.config import plain
from radar_core.types import Float64Array
from radar_gestures.maps import FeatureMaps
from radar_lab.datasets.labelled import in_sensor
from radar_lab.datasets.samples import info_of, pack_clouds, unpack_clouds

FORMAT: Final = 1
"""Of the files of events; a file of another one is refused."""
_MAPS: Final = ("speed", "micro_doppler", "azimuth", "elevation", "distance")
_NUMBERS: Final = ("track_id", "start_ns", "end_ns", "decided_ns")


@dataclass(frozen=True, eq=False)
class LoggedEvent:
    """One detected gesture of one person.

    Attributes
    ----------
    info : RadarInfo
        The radar.
    track_id : int
        Whose, as tracking counts.
    start_ns, end_ns, decided_ns : int
        First and last moment of fast motion, and the cloud at which it was decided [ns].
    guess : str
        What the graph called it; empty: nothing.
    confidence : float
        Probability of that; NaN: not known.
    maps : FeatureMaps
        Micro-Doppler, azimuth, elevation and distance.
    clouds : sequence of PointCloud
        From some time before the event to some time after it, in the sensor frame.
    position : ndarray of float64, shape (n_clouds, 3)
        Where the person was at each cloud, in ``room`` [m]; NaN: not followed then.
    frames : sequence of RadarFrame
        The raw frames of that time; empty: none came.
    """

    info: RadarInfo
    track_id: int
    start_ns: int
    end_ns: int
    decided_ns: int
    guess: str
    confidence: float
    maps: FeatureMaps
    clouds: Sequence[PointCloud]
    position: Float64Array
    frames: Sequence[RadarFrame] = ()


def write_event(path: Path, number: int, event: LoggedEvent) -> None:
    """Write an event into a file, which is whole and on the disk when this returns. Raises `DataError` when it cannot be written."""
    columns: dict[str, Any] = {
        "format": np.array(FORMAT),
        "number": np.array(number),
        "radar": np.array(json.dumps(plain(event.info), sort_keys=True)),
        **{name: np.array(getattr(event, name), np.int64) for name in _NUMBERS},
        "guess": np.array(event.guess),
        "confidence": np.array(event.confidence),
        "maps_ns": np.asarray(event.maps.stamp_ns, np.int64),
        **{f"maps_{name}": np.asarray(getattr(event.maps, name), np.float32) for name in _MAPS},
        "stamp_ns": np.array([cloud.stamp_ns for cloud in event.clouds], np.int64),
        **pack_clouds([in_sensor(cloud, event.info) for cloud in event.clouds]),
        "position": np.asarray(event.position, np.float64).reshape(-1, 3),
        **_pack_frames(event.frames),
    }
    write_synced(path, lambda file: np.savez(file, **columns))


def read_event(path: Path, *, raw: bool = False) -> LoggedEvent:
    """Read the file of an event, its raw frames only with ``raw``. Raises `DataError` when it cannot be read."""
    try:
        with np.load(path, allow_pickle=False) as content:
            wanted = [name for name in content.files if raw or not name.startswith(("cube", "frame_"))]
            columns = {name: content[name] for name in wanted}
        return _event_of(columns, path)
    except DataError:
        raise
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise DataError(f"{path}: cannot be read ({error}); delete it to go on without this event") from None


def _event_of(columns: Mapping[str, NDArray[Any]], path: Path) -> LoggedEvent:
    if int(columns["format"]) != FORMAT:
        raise DataError(f"{path}: has format {int(columns['format'])}, this version reads {FORMAT}; open it with the version that wrote it")
    info = info_of(columns)
    numbers: dict[str, Any] = {name: int(columns[name]) for name in _NUMBERS}
    maps = FeatureMaps(columns["maps_ns"], *(columns[f"maps_{name}"] for name in _MAPS))
    return LoggedEvent(
        info=info,
        **numbers,
        guess=str(columns["guess"]),
        confidence=float(columns["confidence"]),
        maps=maps,
        clouds=unpack_clouds(columns),
        position=columns["position"],
        frames=_unpack_frames(columns, info.frame_id) if "cube" in columns else (),
    )


def _pack_frames(frames: Sequence[RadarFrame]) -> dict[str, NDArray[Any]]:
    """Lay raw frames out as arrays: chirps that frame ``i`` lost are ``offset[i]`` to ``offset[i + 1]``; nothing without frames."""
    if not frames:
        return {}
    return {
        "cube": np.stack([frame.cube for frame in frames]),
        "frame_ns": np.array([frame.stamp_ns for frame in frames], np.int64),
        "frame_sequence": np.array([frame.sequence for frame in frames], np.int64),
        "frame_missing_offset": np.cumsum([0, *(len(frame.missing) for frame in frames)]),
        "frame_missing": np.concatenate([frame.missing for frame in frames]),
    }


def _unpack_frames(columns: Mapping[str, NDArray[Any]], frame_id: str) -> tuple[RadarFrame, ...]:
    stamps, sequences, offset = (columns[name].tolist() for name in ("frame_ns", "frame_sequence", "frame_missing_offset"))
    missing = columns["frame_missing"]
    return tuple(
        RadarFrame(cube, stamps[k], sequences[k], frame_id, missing[offset[k] : offset[k + 1]]) for k, cube in enumerate(columns["cube"])
    )
