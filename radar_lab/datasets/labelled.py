"""Recordings with labels to sample files, beside those that are simulated (thesis, section 4.4)."""

from __future__ import annotations

import csv
import dataclasses
import difflib
import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, OWN_GESTURE, ConfigError, DataError, PointCloud, RadarInfo, vocabulary
from radar_core.config import plain
from radar_core.types import Float64Array
from radar_gestures.stage import GestureConfig, feature_settings
from radar_lab.datasets.readings import read_stroke
from radar_lab.datasets.samples import FORMAT, ONE, about_sample, open_folder, pack_clouds, read_sample, sample_path, write_chunk
from radar_lab.evaluation.scoring import TruthSegment

COLUMNS: Final[tuple[str, ...]] = ("start", "end", "gesture", "person")
"""Of a file of labels: start and end in seconds of the recording, one of `GESTURES` or of one's own, number of the person."""
AROUND: Final[float] = 1.0
"""Clouds that long before and after a label are kept [s]: tracks settle, events end."""
_NOWHERE: Final[Float64Array] = np.full(3, np.nan)


@dataclass(frozen=True)
class Moment:
    """What a recording holds at one stamp."""

    cloud: PointCloud  # in the sensor frame
    one: PointCloud | None = None  # of the same frame through the first transmitter alone, where it was asked for
    # Where people truly are, shape (3,), by their numbers, in ``room`` [m]; empty: not known
    places: Mapping[int, Float64Array] = field(default_factory=dict)


@dataclass(frozen=True)
class ImportReport:
    """What `import_labelled` did."""

    # n_written, n_found: new samples; those of them in which the event stage finds the gesture
    n_written: int
    # n_known, n_outside: labels whose samples were there already; labels at times that the recording does not have
    n_known: int
    n_found: int
    n_outside: int


def read_labels(path: str | Path, start_ns: int, own: Sequence[str] = ()) -> tuple[TruthSegment, ...]:
    """Read a file of labels: comma-separated, with `COLUMNS` in its first line; ordered by start.

    The recording's seconds begin at ``start_ns``: the stamp of its first cloud [ns]; ``own`` are gestures of one's own that it may name
    beside the ten. Raises `DataError` when the file cannot be read,
    naming line and column of what makes no sense.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: the labels cannot be read ({error})") from None
    reader = csv.DictReader(text.splitlines(), skipinitialspace=True)
    missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
    if missing:
        raise DataError(f"{path}:1: the first line has to name the columns {','.join(COLUMNS)}; it lacks {', '.join(missing)}")
    known = vocabulary(own)
    rows = [_segment(row, f"{path}:{reader.line_num}", start_ns, known) for row in reader]
    return tuple(sorted(rows, key=lambda s: (s.start_ns, s.person_id)))


def _segment(row: Mapping[str, str | None], where: str, start_ns: int, known: Sequence[str]) -> TruthSegment:
    start, end = (_number(row[name], name, where) for name in ("start", "end"))
    person = _number(row["person"], "person", where)
    gesture = (row["gesture"] or "").strip()
    if gesture not in known:
        near = difflib.get_close_matches(gesture, known, n=1)
        hint = f" (did you mean {near[0]!r}?)" if near else ""
        raise DataError(f"{where}: gesture is {gesture!r}{hint}; choose one of {', '.join(known)}, or name it as your own")
    if not 0.0 <= start < end:
        raise DataError(f"{where}: start is {start:g} and end {end:g}; give seconds of the recording, the end after the start")
    if person < 0 or person != int(person):
        raise DataError(f"{where}: person is {person:g}; give a whole number from 0")
    number, name = (GESTURES.index(gesture), "") if gesture in GESTURES else (OWN_GESTURE, gesture)
    return TruthSegment(int(person), number, start_ns + round(start * 1e9), start_ns + round(end * 1e9), name)


def _number(text: str | None, name: str, where: str) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or abs(value) > 1e9:
        raise DataError(f"{where}: {name} is {text!r}, which is no number")
    return value


def import_labelled(
    folder: str | Path,
    info: RadarInfo,
    moments: Iterable[Moment],
    labels: Sequence[TruthSegment],
    *,
    source: str,
    config: GestureConfig | None = None,
    one_tx: bool = False,
) -> ImportReport:
    """Cut the labelled gestures out of a recording and add each to a data set as a sample of its own.

    Labels of several recordings of the same radar may go into one folder. What is there already stays, and is not added again.

    Parameters
    ----------
    folder : str or Path
        Data set; it is made.
    info : RadarInfo
        The radar.
    moments, labels : iterable of Moment, sequence of TruthSegment
        The recording, in order of time; what was performed, when and by whom.
    source : str
        What the recording is called, to know its samples again.
    config : GestureConfig or None
        Knobs of events and features; None: the defaults.
    one_tx : bool
        Whether moments hold clouds of one transmitter that are to be kept.

    Raises
    ------
    ConfigError
        When the folder holds samples of another radar or made with other settings, or there is no label.
    DataError
        When stamps go back, or a file cannot be written.
    """
    if not labels:
        raise ConfigError(f"{source}: there is no label, so there is nothing to import")
    return import_cuts(folder, info, cut_out(moments, labels), source=source, config=config, one_tx=one_tx)


def import_cuts(
    folder: str | Path,
    info: RadarInfo,
    cuts: Iterable[tuple[TruthSegment, list[Moment]]],
    *,
    source: str,
    config: GestureConfig | None = None,
    one_tx: bool = False,
) -> ImportReport:
    """Add gestures to a data set that are cut out already.

    ``cuts`` are labels, each with the moments around it; the rest is as of `import_labelled`.
    """
    config = config or GestureConfig()
    place = open_recorded(folder, info, config, one_tx)
    known = {str(read_sample(path)["hash"]) for path in sorted(place.glob("sample_*.npz"))}
    number = next_number(place)
    written = found = outside = repeated = 0
    for label, cut in cuts:
        inside = [moment for moment in cut if label.start_ns <= moment.cloud.stamp_ns <= label.end_ns]
        digest = _digest(source, label, info, config)
        if not inside or digest in known:
            outside += not inside
            repeated += bool(inside)
            continue
        columns = recorded_columns(number, label, cut, info, config, one_tx) | {"hash": np.array(digest)}
        write_chunk(sample_path(place, number), columns, compressed=True)
        known.add(digest)
        number, written, found = number + 1, written + 1, found + bool(columns["found"])
    return ImportReport(written, repeated, found, outside)


def open_recorded(folder: str | Path, info: RadarInfo, config: GestureConfig, one_tx: bool = False) -> Path:
    """Make a data set of recorded samples, or go on with one; arguments and errors as of `import_labelled`."""
    manifest = {"format": FORMAT, "recorded": True, "settings": feature_settings(config), "radar": plain(info), "one_tx": one_tx}
    return open_folder(folder, manifest)


def next_number(place: Path) -> int:
    """Return the number of the next sample of a data set."""
    return max((int(path.stem.removeprefix("sample_")) for path in place.glob("sample_*.npz")), default=-1) + 1


def cut_out(moments: Iterable[Moment], labels: Sequence[TruthSegment]) -> Iterator[tuple[TruthSegment, list[Moment]]]:
    """Give every label the moments from `AROUND` before its start to `AROUND` after its end, in the order in which they end.

    Only what is under way is kept in memory, however long the recording. Raises `DataError` when stamps go back.
    """
    around = round(AROUND * 1e9)
    waiting = sorted(labels, key=lambda label: label.start_ns, reverse=True)
    under_way: list[tuple[TruthSegment, list[Moment]]] = []
    last: int | None = None
    for moment in moments:
        stamp = moment.cloud.stamp_ns
        if last is not None and stamp < last:
            raise DataError(
                f"cloud {moment.cloud.sequence} is {(last - stamp) * 1e-9:g} s older than the one before; cut the recording there"
            )
        last = stamp
        while waiting and stamp >= waiting[-1].start_ns - around:
            under_way.append((waiting.pop(), []))
        over = [entry for entry in under_way if stamp > entry[0].end_ns + around]
        under_way = [entry for entry in under_way if stamp <= entry[0].end_ns + around]
        yield from over
        for _, own in under_way:
            own.append(moment)
    yield from under_way
    yield from ((label, []) for label in reversed(waiting))


def _digest(source: str, label: TruthSegment, info: RadarInfo, config: GestureConfig) -> str:
    """SHA-256 over what makes a recorded sample."""
    gesture = label.own or label.label
    described = [FORMAT, source, label.person_id, gesture, label.start_ns, label.end_ns, plain(info), feature_settings(config)]
    return hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()


def recorded_columns(
    number: int, label: TruthSegment, cut: list[Moment], info: RadarInfo, config: GestureConfig, one_tx: bool
) -> dict[str, NDArray[Any]]:
    """Columns of a file, as `synthesis.simulate_sample` describes them; what nobody knows is NaN, ``scene`` is empty."""
    clouds = [moment.cloud for moment in cut]
    position = np.array([moment.places.get(label.person_id, _NOWHERE) for moment in cut], np.float64).reshape(-1, 3)
    columns = {
        **about_sample(number, label.name, 0, label.person_id, None, info, config, AROUND),
        "stamp_ns": np.array([cloud.stamp_ns for cloud in clouds], np.int64),
        **pack_clouds([in_sensor(cloud, info) for cloud in clouds]),
        **read_stroke(info, clouds, position, label, config, padded=False).columns,
        "position": position,
        **dict.fromkeys(("velocity", "hand_position", "hand_velocity"), np.full(position.shape, np.nan)),
    }
    if one_tx:
        single = [moment.one for moment in cut if moment.one is not None]
        if len(single) < len(cut):
            raise DataError(
                f"{len(cut) - len(single)} of {len(cut)} moments have no cloud of one transmitter; give it, or leave one_tx out"
            )
        columns |= pack_clouds([in_sensor(cloud, info) for cloud in single], ONE)
    return columns


def in_sensor(cloud: PointCloud, info: RadarInfo) -> PointCloud:
    """Return the same points with x, y, z in the sensor frame: some recordings hold clouds that were levelled already."""
    if cloud.frame_id != "room":
        return cloud
    x, y, z = info.mount.from_room(cloud.position).astype(np.float32).T
    return dataclasses.replace(cloud, frame_id=info.frame_id, x=x.copy(), y=y.copy(), z=z.copy())
