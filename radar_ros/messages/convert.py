"""Between the library's dataclasses and ROS messages, without loss and without Python loops over points.

Here are the types of `radar_core`; the results of each stage have a module of their own, so that the plumbing imports no stage.
"""

from __future__ import annotations

import array
import math
from collections.abc import Mapping
from typing import Any, Final

import handwave.msg
import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from radar_core import AntennaArray, CloudComposite, CloudSource, DataError, PointCloud, Pose, Quality, RadarFrame, RadarInfo, Waveform
from radar_core.cloud import ARRAY_FIELDS

_NANOSECONDS: Final = 1_000_000_000
_WAVEFORM: Final = {name: name for name in ("modulation", "n_chirp", "code_seed", "n_sample")} | {
    "carrier": "carrier_hz",
    "bandwidth": "bandwidth_hz",
    "chirp_duration": "chirp_s",
    "chirp_pause": "pause_s",
    "frame_interval": "frame_interval_s",
}
_ARRAY: Final = {"gain": "gain_dbi", "tx_power": "tx_power_dbm", "fov_azimuth": "fov_azimuth_rad", "fov_elevation": "fov_elevation_rad"}
_MOUNT: Final = {"x": "mount_x_m", "y": "mount_y_m", "z": "mount_z_m", "yaw": "mount_yaw_rad", "tilt": "mount_tilt_rad"}
MOST_POINTS: Final = 1 << 16
"""Points of a cloud that is taken from others; a radar gives hundreds, an imaging radar thousands."""
CLOUD2_FIELDS: Final = ("x", "y", "z", "range", "radial_speed", "azimuth", "elevation", "snr")
"""Fields of the PointCloud2 on radar/points2."""


def to_time(stamp_ns: int) -> Time:
    """Nanoseconds to a ROS time."""
    return Time(sec=stamp_ns // _NANOSECONDS, nanosec=stamp_ns % _NANOSECONDS)


def from_time(time: Any) -> int:
    """Convert a ROS time to nanoseconds."""
    return int(time.sec) * _NANOSECONDS + int(time.nanosec)


def header(stamp_ns: int, frame_id: str) -> Header:
    """Make a message header."""
    return Header(stamp=to_time(stamp_ns), frame_id=frame_id)


def pack(values: NDArray[Any], code: str) -> array.array[Any]:
    """Copy an array of any shape, in C order, into the buffer that messages take fastest; ``code`` is a type code of `array.array`."""
    packed = array.array(code)
    packed.frombytes(np.ascontiguousarray(values, np.dtype(code)).reshape(-1).view(np.uint8))  # type: ignore[arg-type]
    return packed


def unpack(field: Any, dtype: Any) -> NDArray[Any]:
    """Copy a message's array into a numpy array, shape (n,), that may be written to."""
    return np.frombuffer(field, dtype).copy() if len(field) else np.empty(0, dtype)


def pack_all(item: Any, codes: Mapping[str, str]) -> dict[str, array.array[Any]]:
    """Pack the arrays of a dataclass that its message calls the same: name to type code."""
    return {name: pack(getattr(item, name), code) for name, code in codes.items()}


def unpack_all(msg: Any, codes: Mapping[str, str]) -> dict[str, Any]:
    """Unpack these arrays, shape (n,) each."""
    return {name: unpack(getattr(msg, name), code) for name, code in codes.items()}


def to_fields(item: Any, names: Mapping[str, str]) -> dict[str, Any]:
    """Fields of a message from those of a dataclass; ``names``: what the dataclass calls them, to what the message does."""
    return {theirs: getattr(item, ours) for ours, theirs in names.items()}


def from_fields(msg: Any, names: Mapping[str, str]) -> dict[str, Any]:
    """Fields of a dataclass from those of a message, by the same ``names``."""
    return {ours: getattr(msg, theirs) for ours, theirs in names.items()}


def info_to_msg(info: RadarInfo, stamp_ns: int) -> handwave.msg.RadarInfo:
    """Describe a radar in a message."""
    places = {"tx": np.asarray(info.array.tx, np.float64), "rx": np.asarray(info.array.rx, np.float64)}
    return handwave.msg.RadarInfo(
        header=header(stamp_ns, info.frame_id),
        channel_error=pack(_channel_error(info.array), "d"),
        full_scale=info.full_scale,
        **{f"{kind}_{axis}_m": pack(place[:, i], "d") for kind, place in places.items() for i, axis in enumerate("yz")},
        **to_fields(info.waveform, _WAVEFORM),
        **to_fields(info.array, _ARRAY),
        **to_fields(info.mount, _MOUNT),
    )


def mount_to_transform(info: RadarInfo, stamp_ns: int) -> TransformStamped:
    """Say for tf where a radar stands: its frame in ``room``."""
    x, y, z, w = info.mount.quaternion
    place = Vector3(x=info.mount.x, y=info.mount.y, z=info.mount.z)
    transform = Transform(translation=place, rotation=Quaternion(x=x, y=y, z=z, w=w))
    return TransformStamped(header=header(stamp_ns, "room"), child_frame_id=info.frame_id, transform=transform)


def info_from_msg(msg: Any) -> RadarInfo:
    """Read a radar's description.

    Raises
    ------
    ConfigError
        When the description makes no sense.
    """
    error = np.asarray(msg.channel_error, np.float64)
    if len(error) % 4:
        raise DataError(f"radar/info has {len(error)} calibration values; expected four per virtual channel, or none")
    error = error.reshape(4, -1)
    return RadarInfo(
        frame_id=msg.header.frame_id,
        waveform=Waveform(n_tx=len(msg.tx_y_m), **from_fields(msg, _WAVEFORM)),
        array=AntennaArray(
            tx=_pairs(msg.tx_y_m, msg.tx_z_m),
            rx=_pairs(msg.rx_y_m, msg.rx_z_m),
            channel_gain=tuple(error[0].tolist()),
            channel_phase=tuple(error[1].tolist()),
            channel_shift=_pairs(error[2], error[3]),
            **from_fields(msg, _ARRAY),
        ),
        mount=Pose(**from_fields(msg, _MOUNT)),
        full_scale=msg.full_scale,
    )


def _channel_error(array: AntennaArray) -> NDArray[np.float64]:
    """Gains, phases and shifts of all channels; empty for an ideal array, zeros for a kind that alone is left out."""
    if not (array.channel_gain or array.channel_phase or array.channel_shift):
        return np.empty(0)
    error = np.zeros((4, array.n_tx * array.n_rx))
    for rows, given in ((0, array.channel_gain), (1, array.channel_phase), (slice(2, 4), np.transpose(array.channel_shift))):
        if len(given):
            error[rows] = given
    return error.ravel()


def _pairs(first: Any, second: Any) -> tuple[tuple[float, float], ...]:
    if len(first) != len(second):
        broken = f"{len(first)} y but {len(second)} z coordinates of elements"
        raise DataError(f"radar/info gives {broken}; its driver is broken or of another version")
    return tuple((float(y), float(z)) for y, z in zip(first, second, strict=True))


def frame_to_msg(frame: RadarFrame) -> handwave.msg.RadarFrame:
    """Put a raw frame into a message."""
    return handwave.msg.RadarFrame(
        header=header(frame.stamp_ns, frame.frame_id),
        sequence=frame.sequence,
        data=pack(np.ascontiguousarray(frame.cube).view(np.float32), "f"),
        missing_chirps=pack(frame.missing, "I"),
        **dict(zip(("n_tx", "n_chirp", "n_rx", "n_sample"), frame.cube.shape, strict=True)),
    )


def frame_from_msg(msg: Any) -> RadarFrame:
    """Take a raw frame out of a message; the cube is a view of the message's buffer, read only.

    Raises
    ------
    DataError
        When the data's length contradicts the shape.
    """
    shape = (msg.n_tx, msg.n_chirp, msg.n_rx, msg.n_sample)
    samples = np.frombuffer(msg.data, np.complex64) if len(msg.data) % 2 == 0 and len(msg.data) else np.empty(0, np.complex64)
    if samples.size != math.prod(shape) or len(msg.data) % 2:
        raise DataError(
            f"frame {msg.sequence} of {msg.header.frame_id!r} says {shape} (tx, chirp, rx, sample) but carries {len(msg.data)} floats, "
            f"not {2 * math.prod(shape)}; its driver is broken or of another version"
        )
    missing = unpack(msg.missing_chirps, np.uint32)
    return RadarFrame(samples.reshape(shape), from_time(msg.header.stamp), msg.sequence, msg.header.frame_id, missing)


def cloud_to_msg(cloud: PointCloud) -> handwave.msg.PointCloud:
    """Put a point cloud into a message; a `CloudComposite` stays one."""
    arrays = {name: pack(getattr(cloud, name), "f") for name in ARRAY_FIELDS}
    head = header(cloud.stamp_ns, cloud.frame_id)
    msg = handwave.msg.PointCloud(header=head, sequence=cloud.sequence, every=cloud.every, quality=int(cloud.quality), **arrays)
    if isinstance(cloud, CloudComposite):
        msg.sensor = pack(cloud.sensor, "i")
        msg.sources = [_source_to_msg(source) for source in cloud.sources]
    return msg


def cloud_from_msg(msg: Any) -> PointCloud:
    """Take a point cloud out of a message: a `CloudComposite` where the message names the sensors that it was merged from.

    Raises
    ------
    DataError
        When it has more points than a radar gives, its arrays differ in length, or points name a sensor that is not among the sources.
    ConfigError
        When a sensor's mount makes no sense.
    """
    longest = max(len(getattr(msg, name)) for name in (*ARRAY_FIELDS, "sensor", "sources"))
    if longest > MOST_POINTS:
        raise DataError(f"cloud {msg.sequence} has {longest} points, more than a radar gives ({MOST_POINTS}); its sender is broken")
    named: dict[str, Any] = {name: unpack(getattr(msg, name), np.float32) for name in ARRAY_FIELDS}
    stamp_ns, frame_id = from_time(msg.header.stamp), msg.header.frame_id
    named |= {"quality": Quality(msg.quality), "every": stride(msg)}
    sensor = unpack(msg.sensor, np.int32)
    if not msg.sources:
        if len(sensor):
            raise DataError(
                f"cloud {msg.sequence} says for {len(sensor)} points which sensor saw them, but names no sensors (sources); "
                "whatever fused it is broken or of another version"
            )
        return PointCloud(stamp_ns, msg.sequence, frame_id, **named)
    sources = tuple(_source_from_msg(source) for source in msg.sources)
    return CloudComposite(stamp_ns, msg.sequence, frame_id, **named, sensor=sensor, sources=sources)


def stride(msg: Any) -> int:
    """How much larger the sequence of the next cloud or tracks is; 0, in recordings without the field, means 1."""
    return max(int(msg.every), 1)


def _source_to_msg(source: CloudSource) -> handwave.msg.CloudSource:
    head, mount = header(source.stamp_ns, source.frame_id), to_fields(source.mount, _MOUNT)
    return handwave.msg.CloudSource(header=head, sequence=source.sequence, quality=int(source.quality), every=source.every, **mount)


def _source_from_msg(msg: Any) -> CloudSource:
    return CloudSource(
        msg.header.frame_id, Pose(**from_fields(msg, _MOUNT)), from_time(msg.header.stamp), msg.sequence, Quality(msg.quality), stride(msg)
    )


def cloud_to_cloud2(cloud: PointCloud) -> PointCloud2:
    """Make a PointCloud2 for rviz and everything else that knows nothing of radar."""
    points = np.empty(len(cloud), [(name, "<f4") for name in CLOUD2_FIELDS])
    for name in CLOUD2_FIELDS:
        points[name] = getattr(cloud, name)
    return points_to_cloud2(cloud.stamp_ns, cloud.frame_id, points)


def points_to_cloud2(stamp_ns: int, frame_id: str, points: NDArray[Any]) -> PointCloud2:
    """Make a PointCloud2 of points with any fields.

    Parameters
    ----------
    stamp_ns, frame_id : int, str
        Of its header.
    points : structured ndarray, shape (n_points,)
        Fields of four bytes, one after the other, x, y and z among them: floats, and whole numbers with a sign. Unsigned ones are declared
        as floats, as PCL and rviz have the bytes of a colour.
    """
    kinds = {"f": PointField.FLOAT32, "i": PointField.INT32, "u": PointField.FLOAT32}
    fields = [(name, place[1], kinds[place[0].kind]) for name, place in (points.dtype.fields or {}).items()]
    return PointCloud2(
        header=header(stamp_ns, frame_id),
        height=1,
        width=len(points),
        fields=[PointField(name=name, offset=offset, datatype=kind, count=1) for name, offset, kind in fields],
        is_bigendian=False,
        point_step=points.dtype.itemsize,
        row_step=points.dtype.itemsize * len(points),
        data=pack(points.view(np.uint8), "B"),
        is_dense=not any(bool(np.isnan(points[name]).any()) for name in "xyz"),
    )
