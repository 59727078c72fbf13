"""Between the library's dataclasses and ROS messages, without loss and without Python loops over points.

Here are the types of `radar_core`; the results of each stage have a module of their own, so that the plumbing imports no stage.
"""

from __future__ import annotations

import array
import math
from typing import Any, Final

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from handwave.msg import CloudSource as CloudSourceMsg
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarFrame as RadarFrameMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from radar_core import AntennaArray, CloudComposite, CloudSource, DataError, PointCloud, Pose, Quality, RadarFrame, RadarInfo, Waveform
from radar_core.cloud import ARRAY_FIELDS

_NANOSECONDS: Final = 1_000_000_000
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
    """Copy an array into the buffer type that messages take fastest.

    Parameters
    ----------
    values : ndarray, shape (...)
        Flattened in C order.
    code : str
        Type code of `array.array`: f, d, i, I, B.
    """
    return array.array(code, np.ascontiguousarray(values, np.dtype(code)).tobytes())


def unpack(field: Any, dtype: Any) -> NDArray[Any]:
    """Copy a message's array into a numpy array, shape (n,), that may be written to."""
    return np.frombuffer(field, dtype).copy() if len(field) else np.empty(0, dtype)


def info_to_msg(info: RadarInfo, stamp_ns: int) -> RadarInfoMsg:
    """Describe a radar in a message."""
    w, a, m = info.waveform, info.array, info.mount
    tx, rx = np.asarray(a.tx, np.float64), np.asarray(a.rx, np.float64)
    return RadarInfoMsg(
        header=header(stamp_ns, info.frame_id),
        modulation=w.modulation,
        carrier_hz=w.carrier,
        bandwidth_hz=w.bandwidth,
        chirp_s=w.chirp_duration,
        pause_s=w.chirp_pause,
        frame_interval_s=w.frame_interval,
        n_chirp=w.n_chirp,
        code_seed=w.code_seed,
        n_sample=w.n_sample,
        tx_y_m=pack(tx[:, 0], "d"),
        tx_z_m=pack(tx[:, 1], "d"),
        rx_y_m=pack(rx[:, 0], "d"),
        rx_z_m=pack(rx[:, 1], "d"),
        gain_dbi=a.gain,
        tx_power_dbm=a.tx_power,
        fov_azimuth_rad=a.fov_azimuth,
        fov_elevation_rad=a.fov_elevation,
        channel_error=pack(_channel_error(a), "d"),
        full_scale=info.full_scale,
        mount_x_m=m.x,
        mount_y_m=m.y,
        mount_z_m=m.z,
        mount_yaw_rad=m.yaw,
        mount_tilt_rad=m.tilt,
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
        waveform=Waveform(
            modulation=msg.modulation,
            code_seed=msg.code_seed,
            carrier=msg.carrier_hz,
            bandwidth=msg.bandwidth_hz,
            chirp_duration=msg.chirp_s,
            chirp_pause=msg.pause_s,
            frame_interval=msg.frame_interval_s,
            n_tx=len(msg.tx_y_m),
            n_chirp=msg.n_chirp,
            n_sample=msg.n_sample,
        ),
        array=AntennaArray(
            tx=_pairs(msg.tx_y_m, msg.tx_z_m),
            rx=_pairs(msg.rx_y_m, msg.rx_z_m),
            gain=msg.gain_dbi,
            tx_power=msg.tx_power_dbm,
            fov_azimuth=msg.fov_azimuth_rad,
            fov_elevation=msg.fov_elevation_rad,
            channel_gain=tuple(error[0].tolist()),
            channel_phase=tuple(error[1].tolist()),
            channel_shift=_pairs(error[2], error[3]),
        ),
        mount=Pose(x=msg.mount_x_m, y=msg.mount_y_m, z=msg.mount_z_m, yaw=msg.mount_yaw_rad, tilt=msg.mount_tilt_rad),
        full_scale=msg.full_scale,
    )


def _channel_error(array: AntennaArray) -> NDArray[np.float64]:
    """Gains, phases and shifts of all channels; empty for an ideal array, zeros for a kind that alone is left out."""
    if not (array.channel_gain or array.channel_phase or array.channel_shift):
        return np.empty(0)
    error = np.zeros((4, array.n_tx * array.n_rx))
    if array.channel_gain:
        error[0] = array.channel_gain
    if array.channel_phase:
        error[1] = array.channel_phase
    if array.channel_shift:
        error[2:] = np.transpose(array.channel_shift)
    return error.ravel()


def _pairs(first: Any, second: Any) -> tuple[tuple[float, float], ...]:
    if len(first) != len(second):
        raise DataError(
            f"radar/info gives {len(first)} y but {len(second)} z coordinates of elements; its driver is broken or of another version"
        )
    return tuple((float(y), float(z)) for y, z in zip(first, second, strict=True))


def frame_to_msg(frame: RadarFrame) -> RadarFrameMsg:
    """Put a raw frame into a message."""
    n_tx, n_chirp, n_rx, n_sample = frame.cube.shape
    return RadarFrameMsg(
        header=header(frame.stamp_ns, frame.frame_id),
        sequence=frame.sequence,
        n_tx=n_tx,
        n_chirp=n_chirp,
        n_rx=n_rx,
        n_sample=n_sample,
        data=array.array("f", np.ascontiguousarray(frame.cube).tobytes()),
        missing_chirps=array.array("I", frame.missing.astype(np.uint32).tobytes()),
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
    return RadarFrame(
        cube=samples.reshape(shape),
        stamp_ns=from_time(msg.header.stamp),
        sequence=msg.sequence,
        frame_id=msg.header.frame_id,
        missing=unpack(msg.missing_chirps, np.uint32),
    )


def cloud_to_msg(cloud: PointCloud) -> PointCloudMsg:
    """Put a point cloud into a message; a `CloudComposite` stays one."""
    arrays = {name: array.array("f", getattr(cloud, name).tobytes()) for name in ARRAY_FIELDS}
    head = header(cloud.stamp_ns, cloud.frame_id)
    msg = PointCloudMsg(header=head, sequence=cloud.sequence, every=cloud.every, quality=int(cloud.quality), **arrays)
    if isinstance(cloud, CloudComposite):
        msg.sensor = pack(cloud.sensor, "i")
        msg.sources = [_source_to_msg(source) for source in cloud.sources]
    return msg


def cloud_from_msg(msg: Any) -> PointCloud:
    """Take a point cloud out of a message: a `CloudComposite` where the message names the sensors that it was merged from.

    Raises
    ------
    DataError
        When its arrays differ in length, or points name a sensor that is not among the sources.
    ConfigError
        When a sensor's mount makes no sense.
    """
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


def _source_to_msg(source: CloudSource) -> CloudSourceMsg:
    m = source.mount
    return CloudSourceMsg(
        header=header(source.stamp_ns, source.frame_id),
        sequence=source.sequence,
        quality=int(source.quality),
        every=source.every,
        mount_x_m=m.x,
        mount_y_m=m.y,
        mount_z_m=m.z,
        mount_yaw_rad=m.yaw,
        mount_tilt_rad=m.tilt,
    )


def _source_from_msg(msg: Any) -> CloudSource:
    mount = Pose(x=msg.mount_x_m, y=msg.mount_y_m, z=msg.mount_z_m, yaw=msg.mount_yaw_rad, tilt=msg.mount_tilt_rad)
    return CloudSource(
        frame_id=msg.header.frame_id,
        mount=mount,
        stamp_ns=from_time(msg.header.stamp),
        sequence=msg.sequence,
        quality=Quality(msg.quality),
        every=stride(msg),
    )


def cloud_to_cloud2(cloud: PointCloud) -> PointCloud2:
    """Make a PointCloud2 for rviz and everything else that knows nothing of radar."""
    points = np.empty(len(cloud), [(name, "<f4") for name in CLOUD2_FIELDS])
    for name in CLOUD2_FIELDS:
        points[name] = getattr(cloud, name)
    return points_to_cloud2(cloud, points)


def points_to_cloud2(cloud: PointCloud, points: NDArray[Any]) -> PointCloud2:
    """Make a PointCloud2 of the cloud's points with any fields.

    Parameters
    ----------
    cloud : PointCloud
        For stamp and frame.
    points : structured ndarray, shape (n_points,)
        Fields of four bytes, one after the other: floats, and whole numbers with a sign. Unsigned ones are declared as floats, as PCL and
        rviz have the bytes of a colour.
    """
    kinds = {"f": PointField.FLOAT32, "i": PointField.INT32, "u": PointField.FLOAT32}
    fields = [(name, place[1], kinds[place[0].kind]) for name, place in (points.dtype.fields or {}).items()]
    return PointCloud2(
        header=header(cloud.stamp_ns, cloud.frame_id),
        height=1,
        width=len(points),
        fields=[PointField(name=name, offset=offset, datatype=kind, count=1) for name, offset, kind in fields],
        is_bigendian=False,
        point_step=points.dtype.itemsize,
        row_step=points.dtype.itemsize * len(points),
        data=array.array("B", points.tobytes()),
        is_dense=not bool(np.isnan(cloud.position).any()),
    )
