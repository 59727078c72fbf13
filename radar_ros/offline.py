"""The library on recordings and scenes, without a running graph; writes the same messages that the nodes would."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

import yaml
from rclpy.serialization import deserialize_message, serialize_message

from radar_core import ConfigError, DataError, PointCloud, RadarFrame, RadarInfo
from radar_core.config import load, nearest, nest, plain
from radar_core.files import write_whole
from radar_core.mounting import MountCalibration
from radar_dsp.context import CalibratedBasebandConfig
from radar_lab.pipeline import Pipeline, PipelineConfig, PipelineResult
from radar_ros import qos
from radar_ros.bags import TYPES, BagWriter, Recorded, contents, local, read, require_topics
from radar_ros.messages.convert import (
    cloud_from_msg,
    cloud_to_msg,
    frame_from_msg,
    frame_to_msg,
    from_time,
    info_from_msg,
    info_to_msg,
    mount_to_transform,
)
from radar_ros.messages.gestures import gesture_to_msg
from radar_ros.messages.tracks import hand_to_msg, tracks_to_msg
from radar_ros.messages.truth import truth_to_msg
from radar_ros.signals import unbroken
from radar_sim import SimulatedFrame, Simulator, load_scene

_FLUSH = 50
"""Frames after which a recording is brought to the file, so that a crash costs no more."""


def parse(data: bytes, topic: str) -> Any:
    """Make a message from its bytes, by the topic's name within the namespace; a `DataError` says that they make none."""
    try:
        return deserialize_message(data, qos.message_class(TYPES[topic]))
    except Exception as error:
        raise DataError(f"a message of {topic} cannot be read ({error or type(error).__name__}): the recording is damaged") from None


@dataclass(frozen=True)
class Recording:
    """What a bag (``path``) holds for processing: the radar, and whether raw frames or ready clouds (``topic``)."""

    path: Path
    info: RadarInfo
    topic: Literal["radar/frame", "radar/points"]

    def __len__(self) -> int:
        return sum(count for topic, count in contents(self.path).items() if local(topic) == self.topic)

    def messages(self) -> Iterator[tuple[int, RadarFrame | PointCloud]]:
        """Yield recording time [ns] and frame or cloud, in order; a `DataError` says that the radar changes within the bag."""
        for item in read(self.path, ("radar/info", self.topic)):
            name = local(item.topic)
            msg = parse(item.data, name)
            if name == "radar/info":
                if info_from_msg(msg) != self.info:
                    raise DataError(f"{self.path}: radar/info changes within the recording; cut it where the radar was changed")
            else:
                yield item.stamp_ns, frame_from_msg(msg) if name == "radar/frame" else cloud_from_msg(msg)


def open_recording(path: Path) -> Recording:
    """Look at a bag; a `DataError` says that it holds neither raw frames nor clouds with their radar's info."""
    names = require_topics(path, ("radar/info", "radar/frame"), ("radar/info", "radar/points"))
    info = info_from_msg(parse(first_info(path).data, "radar/info"))
    return Recording(Path(path), info, "radar/frame" if "radar/frame" in names else "radar/points")


def raw_frames(recording: Recording, seconds: float) -> Iterator[RadarFrame]:
    """Yield the raw frames of a recording's first seconds; a `DataError` says that it holds clouds only."""
    if recording.topic != "radar/frame":
        raise DataError(f"{recording.path} holds no raw frames; record radar/info and radar/frame")
    begin: int | None = None
    for _, item in recording.messages():
        begin = item.stamp_ns if begin is None else begin
        if (item.stamp_ns - begin) * 1e-9 > seconds:
            return
        if isinstance(item, RadarFrame):
            yield item


def first_info(path: Path) -> Recorded:
    """Return the first message of radar/info in a bag that has one."""
    return next(iter(read(path, ("radar/info",))))


def pipeline_config(parameters: Mapping[str, Mapping[str, Any]]) -> PipelineConfig:
    """Make the library's configuration from parameters of the nodes (per node, names with dots and values): both have the same names.

    Raises
    ------
    ConfigError
        Naming what there is not.
    """
    stages = [stage.name for stage in fields(PipelineConfig)]
    given: dict[str, Any] = {}
    for node, values in parameters.items():
        if node not in stages:
            raise ConfigError(f"there is no stage {node!r}{nearest(node, stages)} to process with; stages: {', '.join(stages)}")
        # consistency of tracking is for the diagnostics of a running node
        given[node] = nest({name: value for name, value in values.items() if (node, name.split(".")[0]) != ("tracking", "consistency")})
    return load(PipelineConfig, given, "--param")


def baseband_config(parameters: Mapping[str, Mapping[str, Any]], namespace: str = "") -> CalibratedBasebandConfig:
    """Make the configuration of the baseband that a command puts raw frames through; no other stage has parameters there.

    They are those of ``baseband``, or of the baseband in the radar's ``namespace``, e.g. ``left/baseband``, which win.

    Raises
    ------
    ConfigError
        Naming what there is not.
    """
    for node in parameters:
        if node.rpartition("/")[2] != "baseband":
            raise ConfigError(f"there is no stage {node!r} to set here; stages: baseband")
    own = {**parameters.get("baseband", {}), **parameters.get(f"{namespace}/baseband", {})}
    return load(CalibratedBasebandConfig, nest(own), "--param")


def process_recording(
    path: Path, config: PipelineConfig | None = None, warn: Callable[[str], object] = lambda text: None
) -> Iterator[tuple[int, PipelineResult]]:
    """Run the library over a bag; recording time [ns] and results of every frame (or cloud); ``warn`` is told what the radar lacks."""
    recording = open_recording(path)
    pipeline = Pipeline(recording.info, config)
    if pipeline.warning:
        warn(pipeline.warning)
    for stamp_ns, item in recording.messages():
        yield stamp_ns, pipeline.process(item) if isinstance(item, RadarFrame) else pipeline.process_cloud(item)


def remounted(item: Recorded, mount: MountCalibration | None) -> Recorded:
    """Put a measured mount into a recorded message of ``radar/info`` or ``tf_static``; every other message stays as it is."""
    kind = local(item.topic)
    if mount is None or kind not in ("radar/info", "tf_static"):
        return item
    msg = parse(item.data, kind)
    if kind == "radar/info":
        msg = info_to_msg(mount.applied(info_from_msg(msg)), from_time(msg.header.stamp))
    for transform in getattr(msg, "transforms", ()):
        if mount.names(transform.child_frame_id):
            transform.transform = mount_to_transform(RadarInfo(mount=mount.mount), 0).transform
    return replace(item, data=serialize_message(msg))


def copy_info(path: Path, writer: BagWriter, mount: MountCalibration | None = None) -> None:
    """Write the radar's description of one bag into another, which can be replayed only with it; with its mount where it was measured."""
    item = remounted(first_info(path), mount)
    writer.write("/radar/info", item.msgtype, item.stamp_ns, item.data)


def write_results(writer: BagWriter, stamp_ns: int, result: PipelineResult) -> None:
    """Write one frame's results as the nodes would publish them."""
    messages: list[tuple[str, Any]] = [("radar/points", cloud_to_msg(result.cloud)), ("tracks", tracks_to_msg(result.tracks))]
    messages += [("gestures", gesture_to_msg(gesture)) for gesture in result.gestures]
    if result.hand is not None:
        messages.append(("hand", hand_to_msg(result.hand)))
    for topic, msg in messages:
        writer.put(f"/{topic}", stamp_ns, msg)


def simulators(scene: str | Path) -> list[Simulator]:
    """Make one simulator for every radar of a scene; a `ConfigError` says that the scene makes no sense."""
    loaded = load_scene(scene)
    first = Simulator(loaded)
    return [first, *(Simulator(first.scene, radar.frame_id) for radar in loaded.radars[1:])]


def simulate(radars: Sequence[Simulator], out: Path) -> Iterator[SimulatedFrame]:
    """Simulate a scene into a new bag of raw frames, info and truth, as fast as it goes; yields each frame once it is written.

    Several ``radars``, as `simulators` gives them, write into the namespaces that their frame_ids begin with. A `DataError` says that the
    bag exists already.
    """
    spaces = [f"/{radar.radar.namespace}".rstrip("/") for radar in radars]
    order = sorted((round((r.radar.trigger_offset + k * r.interval) * 1e9), i, k) for i, r in enumerate(radars) for k in range(r.n_frames))
    with BagWriter(Path(out)) as writer:
        write_whole(Path(out) / "scene.yaml", yaml.safe_dump(plain(radars[0].scene), sort_keys=False))
        for radar, space in zip(radars, spaces, strict=True):
            writer.put(f"{space}/radar/info", 0, info_to_msg(radar.info, 0))
        for stamp, i, sequence in order:
            with unbroken():  # a signal in the middle of a foreign function is no KeyboardInterrupt any more
                simulated = radars[i].process(sequence)
            writer.put(f"{spaces[i]}/radar/frame", stamp, frame_to_msg(simulated.frame))
            writer.put(f"{spaces[i]}/truth", simulated.truth.stamp_ns, truth_to_msg(simulated.truth))
            if sequence % _FLUSH == 0:
                writer.flush()
            yield simulated
