"""Labelled arm gestures: the mHomeGes and mTransSee data sets."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, NO_GESTURE, ConfigError, DataError
from radar_core.config import config, knob
from radar_core.types import IndexArray
from radar_driver.clouds import amplitude_db, cloud_from_ti, cloud_source_info
from radar_lab.importers.recording import (
    START_NS,
    Item,
    Recording,
    Segment,
    SourceOptions,
    Tally,
    check_offsets,
    field_names,
    load_npz,
    read_rows,
    require_length,
)
from radar_sim.truth import Truth

_FOV: Final = (np.radians(120.0), np.radians(60.0))  # of the radar's antennas, roughly; the data sets do not say
_LONGEST_GAP: Final = 50  # frames: a larger step of the frame number is a counter that was set anew, not a pause
_STREAM: Final = "frame_"  # fields of daily_random.npz begin with this, the person's number follows
_DAILY: Final = "daily"
MHOMEGES: Final[Mapping[str, str]] = {
    "daily": "random",
    "circle": "rotate", "clap": "random", "down": "swipe_down", "knock": "random", "lift": "random",
    "pull": "pull", "push": "push", "up": "swipe_up", "yawn": "random", "z": "random",
}  # fmt: skip
"""Labels of the data set, and our gestures."""
MTRANSSEE: Final[Mapping[str, str]] = {"CR": "rotate", "KO": "random", "PL": "pull", "PS": "push", "UP": "swipe_up"}


@config
class SegmentOptions(SourceOptions):
    """What to take of a data set, and how its segments follow each other."""

    label: str = knob("", doc="only segments with this label; empty: all")
    subject: int = knob(-1, low=-1, high=65535, doc="only segments of this person; -1: all")
    limit: int = knob(0, low=0, high=1_000_000, doc="at most this many segments, spread evenly over those that match; 0: all")
    frame_interval: float = knob(0.1, unit="s", low=1e-3, high=10.0, doc="time between two frames of the recording")
    idle: float = knob(2.0, unit="s", low=0.0, high=60.0, doc="empty clouds after each segment; the originals have nothing between them")
    max_range: float = knob(10.0, unit="m", low=0.1, high=1e3, doc="rows farther away are garbled and left out")
    max_speed: float = knob(9.0, unit="m/s", low=0.1, high=1e3, doc="rows faster than this are garbled and left out")


@dataclass(frozen=True)
class Original:
    """One segment as it was recorded; TI axes."""

    label: str  # as the data set says
    subject: int  # who
    distance: float  # from the radar [m]; NaN: unknown
    frame: IndexArray  # frame number of each point, shape (n,)
    xyz: NDArray[Any]  # right, forward, up, shape (n, 3) [m]
    # speed, intensity: range rate [m/s] and strength, shape (n,)
    speed: NDArray[Any]
    intensity: NDArray[Any]


def read_segments(path: Path, options: SegmentOptions, labels: Mapping[str, str]) -> Recording:
    """Open mHomeGes or mTransSee: segments.npz, daily_random.npz, or a .csv file or a folder of them (one segment a file).

    Raises `DataError` when a field is missing or makes no sense.
    """
    if options.label and options.label not in labels:
        raise ConfigError(f"there is no label {options.label!r} in this data set; choose one of {', '.join(labels)}")
    tally = Tally()
    packed = path.suffix == ".npz"
    originals = _from_npz(path, options) if packed else _from_csv(path, options, labels, tally)
    tally.warnings.append("the clouds between segments are empty and ours: the originals were cut into segments")
    info = cloud_source_info(options.frame_interval, _FOV, options.mount)
    return Recording(info, _items(originals, options, labels, tally), tally)


def _spread(chosen: IndexArray, limit: int) -> IndexArray:
    """At most ``limit`` of the entries, evenly spread."""
    if limit == 0 or len(chosen) <= limit:
        return chosen
    return chosen[np.linspace(0, len(chosen) - 1, limit).astype(np.int64)]


def _from_npz(path: Path, options: SegmentOptions) -> Iterator[Original]:
    streams = [name.removeprefix(_STREAM) for name in field_names(path) if name.startswith(_STREAM)]
    if streams:
        return _streams_of(path, streams, options)
    shapes: dict[str, tuple[int | None, ...]] = dict.fromkeys(
        ("label", "subject", "distance_m", "offset", "frame", "doppler_mm_s", "intensity"), (None,)
    )
    data = load_npz(path, {**shapes, "xyz_mm": (None, 3)}, ("subject", "frame", "xyz_mm", "doppler_mm_s", "intensity"))
    offset = check_offsets(path, data["offset"], len(data["xyz_mm"]))
    require_length(path, data, ("label", "subject", "distance_m"), len(offset) - 1, f"offset describes {len(offset) - 1} segments")
    require_length(path, data, ("frame", "doppler_mm_s", "intensity"), len(data["xyz_mm"]), f"xyz_mm has {len(data['xyz_mm'])} points")
    return _segments_of(data, offset, options)


def _streams_of(path: Path, streams: Sequence[str], options: SegmentOptions) -> Iterator[Original]:
    """Continuous streams without gestures (daily_random.npz), one per person: each is one segment called daily."""
    for stream in streams:
        if not stream.isdigit() or options.label not in ("", _DAILY) or options.subject not in (-1, int(stream)):
            continue
        names = {name: f"{name}_{stream}" for name in ("frame", "xyz_mm", "doppler_mm_s", "intensity")}
        data = load_npz(path, {field: (None, 3) if name == "xyz_mm" else (None,) for name, field in names.items()}, tuple(names.values()))
        frame, xyz, speed, intensity = (data[field] for field in names.values())
        require_length(path, data, tuple(names.values()), len(frame), f"{names['frame']} has {len(frame)}")
        yield Original(_DAILY, int(stream), float("nan"), frame.astype(np.int64), xyz * 1e-3, speed * 1e-3, intensity)


def _segments_of(data: dict[str, NDArray[Any]], offset: IndexArray, options: SegmentOptions) -> Iterator[Original]:
    wanted = np.ones(len(offset) - 1, bool)
    if options.label:
        wanted &= data["label"] == options.label
    if options.subject >= 0:
        wanted &= data["subject"] == options.subject
    for i in _spread(np.flatnonzero(wanted), options.limit):
        rows = slice(offset[i], offset[i + 1])
        frame = data["frame"][rows].astype(np.int64)
        yield Original(
            str(data["label"][i]),
            int(data["subject"][i]),
            float(data["distance_m"][i]),
            np.where(frame > 32767, frame - 65536, frame),  # numbers below the first frame's have wrapped round
            data["xyz_mm"][rows] * 1e-3,
            data["doppler_mm_s"][rows] * 1e-3,
            data["intensity"][rows],
        )


def _from_csv(path: Path, options: SegmentOptions, labels: Mapping[str, str], tally: Tally) -> Iterator[Original]:
    """One segment a file; its label is the part of the path (file name first) that is one of the data set's labels."""
    files = sorted(path.rglob("*.csv")) if path.is_dir() else [path]
    if not files:
        raise DataError(f"{path}: holds neither segments.npz nor .csv files; name the .npz file or a folder with .csv files")
    named = [(file, _label_of(file, labels)) for file in files]
    chosen = [entry for entry in named if not options.label or entry[1] == options.label]
    for i in _spread(np.arange(len(chosen)), options.limit):
        file, label = chosen[i]
        frame, values, dropped = read_rows(file)
        tally.dropped.update(dropped)
        yield Original(label, max(options.subject, 0), float("nan"), frame, values[:, :3], values[:, 3], values[:, 4])


def _label_of(file: Path, labels: Mapping[str, str]) -> str:
    known = {label.lower(): label for label in labels}
    for part in (file.stem, *(parent.name for parent in file.parents)):
        for token in part.replace("-", "_").split("_"):
            if token.lower() in known:
                return known[token.lower()]
    return "unknown"


def _items(originals: Iterable[Original], options: SegmentOptions, labels: Mapping[str, str], tally: Tally) -> Iterator[Item]:
    interval_ns = round(options.frame_interval * 1e9)
    n_idle = round(options.idle / options.frame_interval)
    sequence = 0
    for index, original in enumerate(originals):
        sane = _sane(original, options, tally)
        elapsed = frames_elapsed(sane.frame)
        length = int(elapsed[-1]) + 1 if len(elapsed) else 0
        if length == 0:
            tally.dropped["segments without a usable point"] += 1
            continue
        bounds = np.searchsorted(elapsed, np.arange(length + 1))
        gesture = GESTURES.index(labels.get(sane.label, "random"))
        start = START_NS + sequence * interval_ns
        tally.segments.append(Segment(sane.label, sane.subject, sane.distance, start, start + (length - 1) * interval_ns))
        for k in range(length + n_idle):
            stamp = START_NS + sequence * interval_ns
            rows = slice(bounds[k], bounds[k + 1]) if k < length else slice(0, 0)
            yield cloud_from_ti(stamp, sequence, sane.xyz[rows], sane.speed[rows], amplitude_db(sane.intensity[rows]))
            yield _truth(sane, stamp, sequence, gesture if k < length else NO_GESTURE, index)
            sequence += 1


def _sane(original: Original, options: SegmentOptions, tally: Tally) -> Original:
    """Leave out garbled rows and placeholders; what is not finite never gets this far."""
    distance = np.linalg.norm(original.xyz, axis=1)
    empty = distance == 0
    good = ~empty & (distance <= options.max_range) & (np.abs(original.speed) <= options.max_speed)
    tally.dropped["rows at the radar itself: placeholders"] += int(empty.sum())
    tally.dropped["garbled rows: beyond max_range or max_speed"] += int((~good & ~empty).sum())
    own = {name: getattr(original, name)[good] for name in ("frame", "xyz", "speed", "intensity")}
    return replace(original, **own)


def frames_elapsed(frame: IndexArray) -> IndexArray:
    """Frames since the first row, never decreasing: where the counter goes back or jumps far, it was set anew, and the next frame follows.

    ``frame`` holds the frame number of each row, shape (n,), in the order of recording; the result starts at 0.
    """
    step = np.diff(frame, prepend=frame[:1])
    step[(step < 0) | (step > _LONGEST_GAP)] = 1
    return np.cumsum(step)


def _truth(original: Original, stamp: int, sequence: int, gesture: int, index: int) -> Truth:
    """Say that the person stands before the radar at the distance that the data set states; height, side and hand are not known."""
    return Truth(
        stamp_ns=stamp,
        sequence=sequence,
        frame_id="room",
        person_id=np.array([original.subject], np.uint32),
        position=np.array([[original.distance, 0.0, np.nan]]),
        velocity=np.zeros((1, 3)),
        hand_position=np.full((1, 3), np.nan),
        hand_velocity=np.full((1, 3), np.nan),
        gesture=np.array([gesture], np.uint8),
        gesture_index=np.array([index], np.uint32),
        walking=np.zeros(1, bool),
        drawing=np.zeros(1, bool),
    )
