"""rosbag2 recordings (MCAP) through the rosbags library: writing, reading, repairing."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from mcap.records import Channel
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import ReaderError, StoragePlugin, Writer, WriterError
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from radar_core import DataError
from radar_core.paths import share_dir
from radar_ros import qos
from radar_ros.definitions import as_recorded, translator_of
from radar_ros.salvage import door, salvage, write_checksums
from radar_ros.signals import unbroken

TYPES: Mapping[str, str] = {
    "radar/info": "handwave/msg/RadarInfo",
    "radar/pose": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "radar/frame": "handwave/msg/RadarFrame",
    "radar/points": "handwave/msg/PointCloud",
    "tracks": "handwave/msg/TrackArray",
    "zones": "handwave/msg/ZoneArray",
    "people_count": "std_msgs/msg/UInt32",
    "gestures": "handwave/msg/Gesture",
    "gestures/maps": "handwave/msg/GestureMaps",
    "hand": "handwave/msg/HandTrack",
    "hand/value": "std_msgs/msg/Float32",
    "hand/trigger": "std_msgs/msg/Bool",
    "truth": "handwave/msg/Truth",
    "gospa": "handwave/msg/Gospa",
    "stage_status": "handwave/msg/StageStatus",
    "stage_budget": "handwave/msg/StageBudget",
    "tf_static": "tf2_msgs/msg/TFMessage",
    "diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "tracks/markers": "visualization_msgs/msg/MarkerArray",
    "camera/joints": "handwave/msg/JointTruth",
    "hand/residual": "handwave/msg/HandResidual",
    "radar/points2": "sensor_msgs/msg/PointCloud2",
    "camera/color/image_raw": "sensor_msgs/msg/Image",
    "camera/aligned_depth_to_color/image_raw": "sensor_msgs/msg/Image",
    "camera/color/camera_info": "sensor_msgs/msg/CameraInfo",
}
"""Type of every topic that recordings may hold."""

_ON_REQUEST = ("radar/points2", "gestures/maps", "camera/color/image_raw", "camera/aligned_depth_to_color/image_raw")
RECORDED = tuple(topic for topic in TYPES if topic not in _ON_REQUEST)
"""What is recorded unless something else is asked for. Left out is what says nothing that radar/points and tracks do not say, and the
images of a camera: tens of megabytes a second, of people's faces."""


_INCOMPLETE = "handwave_incomplete"
"""Key of the bag's own data that says why it is not all there."""


@cache
def typestore() -> Typestore:
    """Message types of ROS 2 Jazzy and of this package."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for path in sorted((share_dir() / "msg").glob("*.msg")):
        types.update(get_types_from_msg(path.read_text(encoding="utf-8"), f"handwave/msg/{path.stem}"))
    store.register(types)
    return store


def free_folder(wanted: Path) -> Path:
    """Return the folder itself, or with the first free number behind it."""
    path, number = wanted, 2
    while path.exists():
        path, number = wanted.with_name(f"{wanted.name}_{number}"), number + 1
    return path


def was_cut_off(path: Path) -> bool:
    """Whether a folder holds a recording whose writer was killed."""
    return path.is_dir() and not (path / "metadata.yaml").exists() and any(path.glob("*.mcap"))


def recorded_qos(profile: QoSProfile) -> Qos:
    """Express a profile as a bag records it."""
    deadline, lifespan, lease = (
        QosTime(*divmod(time.nanoseconds, 10**9)) for time in (profile.deadline, profile.lifespan, profile.liveliness_lease_duration)
    )
    return Qos(
        QosHistory(int(profile.history)),
        profile.depth,
        QosReliability(int(profile.reliability)),
        QosDurability(int(profile.durability)),
        deadline,
        lifespan,
        QosLiveliness(int(profile.liveliness)),
        lease,
        profile.avoid_ros_namespace_conventions,
    )


class BagWriter:
    """Writes messages into a new bag; what is written survives a crash up to the last `flush`.

    A `DataError` says that the folder (``path``) exists already or cannot be made.

    Attributes
    ----------
    counts : dict
        Messages of each topic so far.
    offered : dict
        QoS that publishers of a topic offer, by its full name, for topics that have no message yet; others are as this package offers them.
        `ros2 bag play` offers the same: without, latched topics would reach nobody who waits for them.
    incomplete : str
        Why the bag does not hold all that it was to hold; its metadata says so then (`incomplete`). Empty: it does. A ``with`` block that
        ends in an exception sets it.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self.incomplete = ""
        self.counts: dict[str, int] = {}
        self.offered: dict[str, Sequence[Qos]] = {}
        self._connections: dict[str, Any] = {}
        try:
            self._writer = Writer(self.path, version=9, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
            storage: Any = self._writer.storage  # rosbags' MCAP writer, whose chunks `flush` closes
            self._storage = storage
        except (WriterError, OSError) as error:
            raise DataError(f"{path}: cannot record there ({error}); choose a folder that does not exist yet") from None
        # rosbag2's own name for the first file, so that its reindex finds it after a crash.
        named = self.path / f"{self.path.name}_0.mcap"
        self._storage.path.rename(named)
        write_checksums(storage)
        self._storage.path = named

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: Any) -> None:
        if kind is not None:
            self.incomplete = "what wrote it was stopped before its end"
        self.close()

    def write(self, topic: str, msgtype: str, stamp_ns: int, data: bytes, definition: str = "") -> None:
        """Append one serialised message.

        Parameters
        ----------
        topic, msgtype : str
            Full name, with the leading slash, and type, e.g. ``handwave/msg/RadarFrame``.
        stamp_ns : int
            Time of recording [ns].
        data : bytes
            The message in CDR, as ROS sends it.
        definition : str
            How the message is defined, where that may be another version's; empty: as here.
        """
        with unbroken(), self._naming():
            if topic not in self._connections:
                store = as_recorded(msgtype, definition) if definition else typestore()
                profiles = list(self.offered.get(topic, ())) or ([recorded_qos(qos.offered(local(topic)))] if local(topic) in TYPES else [])
                self._connections[topic] = self._writer.add_connection(topic, msgtype, typestore=store, offered_qos_profiles=profiles)
                self.counts[topic] = 0
            self._writer.write(self._connections[topic], stamp_ns, data)
            self.counts[topic] += 1

    def put(self, topic: str, stamp_ns: int, msg: Any) -> None:
        """Append one message of this version, of the type that `TYPES` gives the topic."""
        self.write(topic, TYPES[local(topic)], stamp_ns, serialize_message(msg))

    def flush(self) -> None:
        """Bring everything to the file; a crash from now on does not lose it."""
        with unbroken(), self._naming():
            if self._storage.chunk.msgs:
                self._storage.close_chunk()
            self._storage.bio.flush()

    def close(self) -> None:
        """Finish the bag; may be called twice. Where the disk is full it stays without its end, for `repair`."""
        if self._writer.storage is None:
            return
        if self.incomplete:
            self._writer.set_custom_data(_INCOMPLETE, self.incomplete)
        with unbroken(), self._naming():
            try:
                self._writer.close()
            except OSError:
                self.abandon()
                raise

    def abandon(self) -> None:
        """Leave the bag as it is, without its end, for `repair`."""
        self._writer.storage = None
        with suppress(OSError):
            self._storage.bio.close()  # here, because Python would try once more at its end, and complain

    @contextmanager
    def _naming(self) -> Iterator[None]:
        """Let an `OSError` name the bag: what fails is a write, which knows no name."""
        try:
            yield
        except OSError as error:
            error.filename = error.filename or str(self.path)
            raise


@dataclass(frozen=True)
class Recorded:
    """One recorded message: topic, type, time [ns], CDR bytes."""

    topic: str
    msgtype: str
    stamp_ns: int
    data: bytes


@contextmanager
def open_bag(path: Path) -> Iterator[AnyReader]:
    """Open a bag for reading; a `DataError` says that there is none, or that a crash cut it off and it needs `repair`."""
    path = Path(path)
    if was_cut_off(path):
        raise DataError(f"{path}: the recording was cut off (no metadata.yaml); recover it with: handwave repair {path}")
    with door(path):
        reader = AnyReader([path], default_typestore=typestore())
        reader.open()
    try:
        yield reader
    finally:
        reader.close()


def read(path: Path, topics: Iterable[str] | None = None) -> Iterator[Recorded]:
    """Messages of a bag in the order of their times, of these topics (names without namespace, e.g. ``radar/frame``) or of all.

    Raises
    ------
    DataError
        When it cannot be read, or an older version of this package recorded messages that cannot be translated.
    """
    wanted = None if topics is None else set(topics)
    with open_bag(path) as reader:
        with door(path):
            connections = [c for c in reader.connections if wanted is None or local(c.topic) in wanted]
            translate = {c.id: translator_of(path, c, typestore()) for c in connections}
        for connection, stamp, data in raw_messages(reader, path, connections):
            change = translate[connection.id]
            with door(path):
                given = bytes(data) if change is None else change(bytes(data))
            yield Recorded(connection.topic, connection.msgtype, stamp, given)


def raw_messages(reader: AnyReader, path: Path, connections: Sequence[Any]) -> Iterator[tuple[Any, int, bytes]]:
    """Give connection, time [ns] and bytes of the messages of some connections, in order; a `DataError` says that the file is damaged."""
    messages = iter(reader.messages(connections=connections)) if connections else iter(())
    left = sum(connection.msgcount for connection in connections)
    while True:
        with door(path):
            found = next(messages, None)
            if found is None and left > 0:
                raise DataError(f"{path}: {left} messages are not where the index says; recover the others with: handwave repair {path}")
        if found is None:
            return
        left -= 1
        yield found


def local(topic: str) -> str:
    """Name of a topic within its namespace: ``/left/radar/frame`` is ``radar/frame``."""
    parts = topic.strip("/").split("/")
    names = ("/".join(parts[start:]) for start in range(len(parts)))
    return next((name for name in names if name in TYPES), topic.strip("/"))


def incomplete(path: Path) -> str:
    """Say why a bag does not hold all that it was to hold, as `BagWriter` wrote it; empty: nobody says so."""
    with suppress(Exception):  # a damaged file says nothing
        about = yaml.safe_load((Path(path) / "metadata.yaml").read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
        return str((about.get("custom_data") or {}).get(_INCOMPLETE, ""))
    return ""


def contents(path: Path) -> dict[str, int]:
    """Count the messages of every topic of a bag; a `DataError` says that it cannot be read."""
    with open_bag(path) as reader, door(path):
        counts: dict[str, int] = {}
        for connection in sorted(reader.connections, key=lambda c: c.topic):  # several publishers: several connections
            counts[connection.topic] = counts.get(connection.topic, 0) + connection.msgcount
        return counts


def require_topics(path: Path, *alternatives: tuple[str, ...]) -> tuple[str, ...]:
    """Return the first set of topics that a bag holds completely; a `DataError` lists what it holds instead."""
    held = {local(topic) for topic, count in contents(path).items() if count}
    for names in alternatives:
        if set(names) <= held:
            return names
    wanted = " or ".join(" + ".join(names) for names in alternatives)
    raise DataError(f"{path}: needs {wanted}, but holds {', '.join(sorted(held)) or 'nothing'}; record again with these topics")


def repair(path: Path) -> dict[str, int]:
    """Recover a recording that a crash cut off, in place; the damaged file is kept as ``*.damaged``, a whole one is left alone.

    Returns the recovered messages per topic, none when nothing had to be done. A `DataError` says that there is nothing to recover.
    """
    path = Path(path)
    files = sorted(path.glob("*.mcap")) if path.is_dir() else []
    if not files:
        raise DataError(f"{path}: holds no .mcap file; nothing to recover")
    if _is_whole(path):
        return {}
    rescue = path.with_name(f"{path.name}.rescue")
    shutil.rmtree(rescue, ignore_errors=True)
    try:
        counts = _rescue(files, rescue)
        with unbroken():
            for file in files:
                file.rename(file.with_suffix(".mcap.damaged"))
            (rescue / f"{rescue.name}_0.mcap").rename(path / f"{path.name}_0.mcap")
            (rescue / "metadata.yaml").rename(path / "metadata.yaml")
    finally:
        shutil.rmtree(rescue, ignore_errors=True)
    return counts


def _rescue(files: Sequence[Path], rescue: Path) -> dict[str, int]:
    """Write all that can be read of files into a new bag, whose metadata names the bag that it belongs to."""
    with BagWriter(rescue) as writer:
        for file in files:
            for schema, channel, message in salvage(file):
                if channel.topic not in writer.offered:  # reading it takes a hundred times as long as writing a message
                    writer.offered[channel.topic] = _offered(channel)
                try:
                    definition = schema.data.decode() if schema.encoding == "ros2msg" else ""
                    writer.write(channel.topic, schema.name, message.log_time, message.data, definition)
                except OSError:
                    raise
                except Exception as error:
                    raise DataError(f"{file}: {channel.topic} cannot be read ({error}); its definition is damaged") from None
    if not writer.counts:
        raise DataError(f"{', '.join(map(str, files))}: nothing can be recovered: no whole message is in it")
    about = rescue / "metadata.yaml"
    text = about.read_text(encoding="utf-8").replace(f"{rescue.name}_0.mcap", f"{rescue.name.removesuffix('.rescue')}_0.mcap")
    about.write_text(text, encoding="utf-8")
    return writer.counts


def _offered(channel: Channel) -> list[Qos]:
    """QoS that a channel of a recording was written with; none where that is not known."""
    try:
        return parse_qos(channel.metadata.get("offered_qos_profiles", ""))
    except (ReaderError, KeyError, TypeError):
        return []


def _is_whole(path: Path) -> bool:
    """Whether every message of a bag can be read."""
    try:
        with open_bag(path) as reader:  # not `read`: a whole recording is whole, whichever version made it
            return sum(1 for _ in raw_messages(reader, path, reader.connections)) == sum(contents(path).values())
    except DataError:
        return False
