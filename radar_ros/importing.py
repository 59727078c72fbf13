"""Public recordings to bags that `handwave replay` understands."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from radar_core import DataError, PointCloud, RadarFrame
from radar_core.files import write_whole
from radar_lab.importers import open_original
from radar_lab.importers.recording import Recording
from radar_ros.bags import BagWriter
from radar_ros.messages.convert import cloud_to_msg, frame_to_msg, info_to_msg
from radar_ros.messages.truth import truth_to_msg

SIDECAR: Final[str] = "import.json"
"""File beside the bag's metadata that says where it comes from and which segments it holds."""


@dataclass(frozen=True)
class ImportReport:
    """What an import did."""

    kind: str  # of recording
    source: Path
    bag: Path
    messages: Mapping[str, int]  # written, by topic
    points: int  # in all clouds
    duration: float  # from the first to the last stamp [s]
    dropped: Mapping[str, int]  # rows (packets, frames) of the original that are not in the bag, by reason
    labels: Mapping[str, int]  # segments by label
    warnings: tuple[str, ...]  # what to be careful about

    def __str__(self) -> str:
        lines = [f"{self.source.name} ({self.kind}) -> {self.bag}: {self.duration:.2f} s"]
        lines += [f"  {topic}: {count}" for topic, count in sorted(self.messages.items())]
        if self.points:
            lines.append(f"  points: {self.points}")
        if self.labels:
            lines.append("  segments: " + ", ".join(f"{label} {count}" for label, count in sorted(self.labels.items())))
        lines += [f"  left out: {count} {reason}" for reason, count in sorted(self.dropped.items()) if count]
        lines += [f"  careful: {warning}" for warning in self.warnings]
        return "\n".join(lines)


def import_recording(kind: str, source: Path, out: Path, **options: Any) -> ImportReport:
    """Turn a recording into a rosbag2 bag (MCAP) with radar/info and radar/points or radar/frame, and truth where there is some.

    The same source and options give the same messages. Nothing is left behind when the source cannot be read to its end.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    source : Path
        File, or folder where the kind has several files.
    out : Path
        Folder of the new bag; must not exist.
    **options : Any
        Knobs of the kind's options, e.g. ``min_speed=0.1``; kept beside the bag.

    Raises
    ------
    ConfigError
        When there is no such kind or option, or its value makes no sense.
    DataError
        When the source is missing, empty or garbled, naming file and field; or when ``out`` exists.
    """
    recording, source, out = open_original(kind, source, **options), Path(source), Path(out)
    writer = BagWriter(out)
    try:
        with writer:
            points, first, last = _write_items(writer, recording)
        if first is None or last is None:
            raise DataError(f"{source}: there is nothing in it to import; check the file and the options {options}")
    except BaseException:
        shutil.rmtree(out, ignore_errors=True)
        raise
    tally, duration = recording.tally, (last - first) * 1e-9
    labels, warnings = Counter(segment.label for segment in tally.segments), tuple(tally.warnings)
    # JSON has no NaN, so an unknown distance is null.
    segments = [{k: None if v != v else v for k, v in asdict(segment).items()} for segment in tally.segments]
    content = {"kind": kind, "source": source.name, "options": options, "dropped": dict(tally.dropped), "warnings": warnings}
    write_whole(out / SIDECAR, json.dumps({**content, "segments": segments}, indent=1, default=str) + "\n")
    return ImportReport(kind, source, out, dict(writer.counts), points, duration, dict(tally.dropped), dict(labels), warnings)


def _write_items(writer: BagWriter, recording: Recording) -> tuple[int, int | None, int | None]:
    """Write all items; number of points, first and last stamp."""
    points, first, last = 0, None, None
    for item in recording.items:
        if first is None:
            first = item.stamp_ns
            writer.put("/radar/info", first, info_to_msg(recording.info, first))
        last = item.stamp_ns
        if isinstance(item, PointCloud):
            points += len(item)
            writer.put("/radar/points", last, cloud_to_msg(item))
        elif isinstance(item, RadarFrame):
            item.check(recording.info)
            writer.put("/radar/frame", last, frame_to_msg(item))
        else:
            writer.put("/truth", last, truth_to_msg(item))
    return points, first, last
