"""Public recordings to bags that `handwave replay` understands."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from rclpy.serialization import serialize_message

from radar_core import DataError, PointCloud, RadarFrame
from radar_lab.importers import open_original
from radar_lab.importers.recording import Recording, Segment
from radar_ros.bags import TYPES, BagWriter
from radar_ros.messages.convert import cloud_to_msg, frame_to_msg, info_to_msg
from radar_ros.messages.truth import truth_to_msg

SIDECAR: Final[str] = "import.json"
"""File beside the bag's metadata that says where it comes from and which segments it holds."""


@dataclass(frozen=True)
class ImportReport:
    """What an import did.

    Attributes
    ----------
    kind : str
        Of recording.
    source, bag : Path
        From where, to where.
    messages : mapping of str to int
        Messages written, by topic.
    points : int
        Points in all clouds.
    duration : float
        From the first to the last stamp [s].
    dropped : mapping of str to int
        Rows (packets, frames) of the original that are not in the bag, by reason.
    labels : mapping of str to int
        Segments by label.
    warnings : tuple of str
        What to be careful about.
    """

    kind: str
    source: Path
    bag: Path
    messages: Mapping[str, int]
    points: int
    duration: float
    dropped: Mapping[str, int]
    labels: Mapping[str, int]
    warnings: tuple[str, ...]

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


def write_bag(recording: Recording, kind: str, source: Path, out: Path, options: Mapping[str, Any]) -> ImportReport:
    """Write a recording into a new bag, one item at a time.

    Parameters
    ----------
    recording : Recording
        To read.
    kind : str
        For the report.
    source, out : Path
        For the report, and the folder of the new bag.
    options : mapping of str to Any
        What the user asked for; kept beside the bag.

    Returns
    -------
    ImportReport
        The counts.

    Raises
    ------
    DataError
        When the source turns out unreadable or empty (the unfinished bag is removed), or ``out`` exists.
    """
    writer = BagWriter(out)
    try:
        with writer:
            points, first, last = _write_items(writer, recording)
        if first is None or last is None:
            raise DataError(f"{source}: there is nothing in it to import; check the file and the options {dict(options)}")
    except BaseException:
        shutil.rmtree(out, ignore_errors=True)
        raise
    tally = recording.tally
    labels = Counter(segment.label for segment in tally.segments)
    report = ImportReport(
        kind, source, out, dict(writer.counts), points, (last - first) * 1e-9, dict(tally.dropped), dict(labels), tuple(tally.warnings)
    )
    _write_sidecar(report, options, tally.segments)
    return report


def _write_items(writer: BagWriter, recording: Recording) -> tuple[int, int | None, int | None]:
    """Write all items; number of points, first and last stamp."""
    points, first, last = 0, None, None
    for item in recording.items:
        if first is None:
            first = item.stamp_ns
            writer.write("/radar/info", TYPES["radar/info"], first, serialize_message(info_to_msg(recording.info, first)))
        last = item.stamp_ns
        if isinstance(item, PointCloud):
            points += len(item)
            topic, msg = "radar/points", cloud_to_msg(item)
        elif isinstance(item, RadarFrame):
            item.check(recording.info)
            topic, msg = "radar/frame", frame_to_msg(item)
        else:
            topic, msg = "truth", truth_to_msg(item)
        writer.write(f"/{topic}", TYPES[topic], item.stamp_ns, serialize_message(msg))
    return points, first, last


def _write_sidecar(report: ImportReport, options: Mapping[str, Any], segments: list[Segment]) -> None:
    """Say beside the bag where it comes from; JSON has no NaN, so an unknown distance is null."""
    described = [{k: None if v != v else v for k, v in asdict(segment).items()} for segment in segments]
    content = {
        "kind": report.kind,
        "source": report.source.name,
        "options": dict(options),
        "dropped": report.dropped,
        "warnings": report.warnings,
        "segments": described,
    }
    (report.bag / SIDECAR).write_text(json.dumps(content, indent=1, default=str) + "\n", encoding="utf-8")


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
        Knobs of the kind's options, e.g. ``min_speed=0.1``.

    Returns
    -------
    ImportReport
        What was written, what was dropped, and what to be careful about.

    Raises
    ------
    ConfigError
        When there is no such kind or option, or its value makes no sense.
    DataError
        When the source is missing or garbled, naming file and field; or when ``out`` exists.
    """
    recording = open_original(kind, source, **options)
    return write_bag(recording, kind, Path(source), Path(out), options)
