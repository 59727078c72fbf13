"""What every importer makes, and how it becomes a bag."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from rclpy.serialization import serialize_message

from radar_core import DataError, PointCloud, Pose, RadarFrame, RadarInfo
from radar_core.config import config, knob
from radar_ros.bags import TYPES, BagWriter
from radar_ros.convert import cloud_to_msg, frame_to_msg, info_to_msg
from radar_sim.messages import truth_to_msg
from radar_sim.truth import Truth

Item = PointCloud | RadarFrame | Truth


@config
class SourceOptions:
    """Where the radar stood; every kind of recording has these options."""

    height: float = knob(1.2, unit="m", low=-100.0, high=100.0, doc="of the radar above the floor")
    yaw: float = knob(0.0, unit="rad", low=-6.3, high=6.3, doc="boresight from the room's x towards its y, left positive")
    tilt: float = knob(0.0, unit="rad", low=-1.57, high=1.57, doc="boresight above the horizon, up positive")

    @property
    def mount(self) -> Pose:
        """Pose of the radar in the room."""
        return Pose(z=self.height, yaw=self.yaw, tilt=self.tilt)


START_NS: Final[int] = 1_000_000_000
"""Stamp of the first frame of recordings that carry no time; not 0, which ROS reads as "no time"."""

SIDECAR: Final[str] = "import.json"
"""File beside the bag's metadata that says where it comes from and which segments it holds."""


@dataclass(frozen=True)
class Segment:
    """A labelled part of a recording.

    Attributes
    ----------
    label : str
        As the original says.
    subject : int
        Who.
    distance : float
        From the radar [m]; NaN: unknown.
    start_ns, end_ns : int
        Stamps of its first and last cloud [ns].
    """

    label: str
    subject: int
    distance: float
    start_ns: int
    end_ns: int


@dataclass
class Tally:
    """What an importer counts while its items are taken: rows it dropped, by reason, segments, and sentences for the user."""

    dropped: Counter[str] = field(default_factory=Counter)
    segments: list[Segment] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Recording:
    """A recording being read.

    Attributes
    ----------
    info : RadarInfo
        The radar.
    items : iterator of PointCloud, RadarFrame or Truth
        In the order of time; read once.
    tally : Tally
        Complete when ``items`` is exhausted.
    """

    info: RadarInfo
    items: Iterator[Item]
    tally: Tally


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
