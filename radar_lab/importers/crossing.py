"""Dense clouds of walkers: one_person.npz and two_people.npz of the mmWave_radar_tracking recordings."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError, PointCloud
from radar_core.config import config, knob
from radar_core.types import IndexArray
from radar_driver.clouds import cloud_from_ti, cloud_source_info
from radar_lab.importers.recording import Recording, SourceOptions, Tally, check_offsets, load_npz, require_length

_HEIGHT: Final = 0.7  # m: the recorded z is range * sin(elevation) plus this (to 0.03 mm): the radar's height over its floor
_FOV: Final = (np.radians(100.0), np.radians(35.0))  # all points lie within +-50 deg and +-17 deg, but for a few


@config
class CrossingOptions(SourceOptions):
    """What to take of the recording."""

    min_speed: float = knob(0.1, unit="m/s", low=0.0, high=20.0, doc="keep only points whose range rate is faster; 0 keeps the furniture")
    floor: float = knob(
        90.0, unit="dB", low=-200.0, high=200.0, doc="snr is the recorded power less this; no point is weaker, the true floor is unknown"
    )
    height: float = knob(_HEIGHT, unit="m", low=-100.0, high=100.0, doc="of the radar above the floor; the default is the recording's")


def read_crossing(path: Path, options: CrossingOptions) -> Recording:
    """Open one of the files.

    The recorded times are those at which a logger polled the radar every 50 ms: several frames share one, others wait. Frames are numbered
    without gap, so their stamps are the straight line through (frame number, time): regular, strictly rising, the logger's clock.
    The recorded z counts from the floor 0.7 m below the radar; here it counts from the radar, and the mount says 0.7 m.

    Raises
    ------
    DataError
        When a field is missing, has another shape or holds a NaN.
    """
    shapes: dict[str, tuple[int | None, ...]] = {"offset": (None,), "time_ms": (None,), "frame_number": (None,), "points": (None, 8)}
    data = load_npz(path, shapes, ("time_ms", "frame_number", "points"))
    offset = check_offsets(path, data["offset"], len(data["points"]))
    require_length(path, data, ("frame_number", "time_ms"), len(offset) - 1, f"offset describes {len(offset) - 1} frames")
    stamps, spread = _regular_stamps(path, data["frame_number"], data["time_ms"])
    interval = float(np.median(np.diff(stamps) / np.diff(data["frame_number"]))) * 1e-9
    tally = Tally()
    tally.warnings.append(
        f"frames are {interval * 1e3:.2f} ms apart by a straight line through the logger's times, which scatter by {spread:.0f} ms about it"
    )
    info = cloud_source_info(interval, _FOV, options.mount)
    return Recording(info, _clouds(data, offset, stamps, options, tally), tally)


def _regular_stamps(path: Path, number: NDArray[Any], time_ms: NDArray[Any]) -> tuple[IndexArray, float]:
    """Fit stamps [ns] to frame numbers, both (n_frames,); also the standard deviation of the recorded times about the line [ms]."""
    if len(number) < 2 or (np.diff(number) <= 0).any():
        raise DataError(f"{path}: field frame_number must hold at least two frames and rise from each to the next")
    count = (number - number[0]).astype(np.float64)
    elapsed = (time_ms - time_ms[0]).astype(np.float64)
    slope, start = np.polyfit(count, elapsed, 1)
    if slope <= 0:
        raise DataError(f"{path}: field time_ms does not rise over the recording")
    line = slope * count + start
    stamps = np.round((line + float(time_ms[0])) * 1e6).astype(np.int64)
    return stamps, float(np.std(elapsed - line))


def _clouds(
    data: dict[str, NDArray[Any]], offset: IndexArray, stamps: IndexArray, options: CrossingOptions, tally: Tally
) -> Iterator[PointCloud]:
    points, number = data["points"], data["frame_number"]
    for k, stamp in enumerate(stamps):
        frame = points[offset[k] : offset[k + 1]]
        moving = frame[np.abs(frame[:, 6]) > options.min_speed] if options.min_speed > 0 else frame
        tally.dropped["points slower than min_speed"] += len(frame) - len(moving)
        place, speed, power = moving[:, :3] - np.array([0.0, 0.0, _HEIGHT]), moving[:, 6], moving[:, 7] - options.floor
        sequence = int(number[k] - number[0])
        yield cloud_from_ti(int(stamp), sequence, place, speed, power, noise=options.floor, spherical=moving[:, 3:6])
