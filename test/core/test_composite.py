"""Clouds of several sensors are used like one."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from radar_core import ConfigError, DataError, PointCloud, Pose, Quality
from radar_core.cloud import ARRAY_FIELDS
from radar_core.composite import CloudComposite, CloudSource
from radar_core.geometry import cartesian_to_spherical, spherical_to_cartesian
from radar_core.merging import merge
from radar_ros.bags import typestore
from radar_ros.messages.convert import cloud_from_msg, cloud_to_msg
from radar_tracking import PeopleTracker
from radar_tracking.tracks import TrackStatus

LEFT, RIGHT = Pose(x=0.0, y=2.0, z=1.2, yaw=-0.4, tilt=-0.1), Pose(x=6.0, y=-1.0, z=1.8, yaw=2.8)
MS = 1_000_000


def random_cloud(rng, n, stamp_ns=0, sequence=0, frame_id="radar", quality=Quality.GOOD, every=1):
    arrays = {name: rng.normal(size=n).astype(np.float32) for name in ARRAY_FIELDS}
    return PointCloud(stamp_ns, sequence, frame_id, **arrays, quality=quality, every=every)


def seen(points, mount, stamp_ns=0, sequence=0, frame_id="radar", velocity=(0.0, 0.0, 0.0)):
    """What a perfect sensor at ``mount`` measures of points in the room, shape (n, 3)."""
    local = mount.from_room(np.asarray(points, float))
    distance, azimuth, elevation = cartesian_to_spherical(local)
    xyz = spherical_to_cartesian(distance, azimuth, elevation)
    speed = (local @ (np.asarray(velocity) @ mount.rotation)) / distance
    values = {"x": xyz[:, 0], "y": xyz[:, 1], "z": xyz[:, 2], "range": distance, "azimuth": azimuth, "elevation": elevation}
    values |= {"radial_speed": speed, "snr": np.full(len(distance), 20.0)}
    return PointCloud(stamp_ns, sequence, frame_id, **{name: value.astype(np.float32) for name, value in values.items()})


def same(a, b):
    for name in ARRAY_FIELDS:
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes(), name
    assert (a.stamp_ns, a.sequence, a.frame_id, a.quality, a.every) == (b.stamp_ns, b.sequence, b.frame_id, b.quality, b.every)


def test_a_point_seen_by_two_sensors_is_in_one_place():
    """Each sensor's mount is applied to its own points; what was measured stays relative to the sensor that measured it."""
    point = np.array([[3.0, 0.5, 1.0]])
    both = merge([seen(point, LEFT), seen(point, RIGHT)], [LEFT, RIGHT])
    assert both.frame_id == "room"
    # float32 positions of a few metres are rounded by 2e-7 m twice
    np.testing.assert_allclose(both.position, np.repeat(point, 2, 0), atol=2e-6)
    np.testing.assert_array_equal(both.sensor, [0, 1])
    distances = [np.linalg.norm(point - mount.origin) for mount in (LEFT, RIGHT)]
    np.testing.assert_allclose(both.range, distances, rtol=1e-6)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(0, 6), min_size=1, max_size=4), st.integers(0, 1 << 30))
def test_nothing_is_lost_or_mixed(sizes, seed):
    """The parts are the clouds that went in, levelled, bit for bit; the composite is their concatenation."""
    rng = np.random.default_rng(seed)
    strides = rng.integers(1, 5, len(sizes)).tolist()
    clouds = [random_cloud(rng, n, i * MS, 10 + i, f"s{i}", Quality(1 << i), strides[i]) for i, n in enumerate(sizes)]
    mounts = [Pose(x=float(rng.normal()), z=float(rng.uniform(0, 3)), yaw=float(rng.uniform(-3, 3))) for _ in sizes]
    merged = merge(clouds, mounts)
    levelled = [cloud.to_room(mount) for cloud, mount in zip(clouds, mounts, strict=True)]
    assert len(merged) == sum(sizes)
    for part, cloud in zip(merged.parts, levelled, strict=True):
        same(part, cloud)
    for name in ARRAY_FIELDS:
        np.testing.assert_array_equal(getattr(merged, name), np.concatenate([getattr(cloud, name) for cloud in levelled]))
    np.testing.assert_array_equal(merged.sensor, np.repeat(np.arange(len(sizes)), sizes))
    assert merged.stamp_ns == (len(sizes) - 1) * MS
    assert merged.sequence == 10
    assert merged.quality == Quality((1 << len(sizes)) - 1)
    assert merged.every == max(strides)
    assert merge([merged, clouds[0]], [LEFT, mounts[0]]).every == max(strides)
    last = clouds[-1]
    assert merged.sources[-1] == CloudSource(f"s{len(sizes) - 1}", mounts[-1], last.stamp_ns, last.sequence, last.quality, last.every)


def test_one_sensor_is_that_cloud_in_the_room():
    """Whoever uses a composite cannot tell it from a single sensor's cloud."""
    cloud = random_cloud(np.random.default_rng(1), 5, 7, 3, "left/radar", Quality.CAPPED)
    merged = merge([cloud], [LEFT])
    assert isinstance(merged, PointCloud)
    same(merged, cloud.to_room(LEFT))
    assert merged.to_room(RIGHT) is merged
    same(cloud_from_msg(cloud_to_msg(merged)), cloud.to_room(LEFT))


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(0, 6), min_size=1, max_size=4), st.integers(0, 1 << 30))
def test_a_composite_survives_its_message(sizes, seed):
    """Through real serialisation: points, which sensor saw them, where the sensors stand; also without any point."""
    rng = np.random.default_rng(seed)
    stamp = int(rng.integers(0, 1 << 60))
    clouds = [random_cloud(rng, n, stamp + i * MS, i + (1 << 40), f"s{i}/radar", Quality(1 << i), 1 + i) for i, n in enumerate(sizes)]
    merged = merge(clouds, [Pose(x=float(rng.normal()), y=1 / 3, yaw=float(rng.uniform(-3, 3)), tilt=-0.1) for _ in sizes])
    msg = cloud_to_msg(merged)
    got = cloud_from_msg(deserialize_message(serialize_message(msg), type(msg)))
    assert isinstance(got, CloudComposite)
    same(got, merged)
    assert got.sources == merged.sources
    assert got.sensor.tobytes() == merged.sensor.tobytes()
    assert got.sensor.flags.writeable


@pytest.mark.parametrize("n", [0, 1, 2, 5])
@pytest.mark.parametrize("sensors", [0, 1, 2, 3])
@pytest.mark.parametrize("frame_id", ["room", "left/radar", "x"])
def test_readers_of_recordings_agree(n, sensors, frame_id):
    """Both kinds of cloud are the same bytes to rclpy and to rosbags, however the names before the numbers are aligned."""
    rng = np.random.default_rng(n + 10 * sensors)
    cloud = random_cloud(rng, n, 5 * MS, 3, frame_id)
    if sensors:
        cloud = merge([random_cloud(rng, n, 5 * MS, 3, frame_id + "a" * i) for i in range(sensors)], [LEFT, RIGHT, LEFT][:sensors])
    data = serialize_message(cloud_to_msg(cloud))
    theirs = typestore().deserialize_cdr(data, "handwave/msg/PointCloud")
    assert theirs.snr.tobytes() == cloud.snr.tobytes()
    assert len(theirs.sources) == sensors
    if sensors:
        assert theirs.sensor.tobytes() == cloud.sensor.tobytes()
        found = [(s.header.frame_id, s.sequence, s.mount_x_m, s.mount_yaw_rad, s.mount_tilt_rad) for s in theirs.sources]
        assert found == [(s.frame_id, s.sequence, s.mount.x, s.mount.yaw, s.mount.tilt) for s in cloud.sources]
    back = bytes(typestore().serialize_cdr(theirs, "handwave/msg/PointCloud"))
    got = cloud_from_msg(deserialize_message(back, type(cloud_to_msg(cloud))))
    assert type(got) is type(cloud)
    same(got, cloud)


def test_a_message_that_contradicts_itself():
    """Sensors that are not named, and points that name one too many."""
    merged = merge([random_cloud(np.random.default_rng(11), 2)], [LEFT])
    msg = cloud_to_msg(merged)
    msg.sources = []
    with pytest.raises(DataError, match=r"cloud 0 says for 2 points which sensor saw them, but names no sensors"):
        cloud_from_msg(msg)
    msg = cloud_to_msg(merged)
    msg.sensor = [0, 1]
    with pytest.raises(DataError, match=r"CloudComposite\.sensor has entries outside 0\.\.0"):
        cloud_from_msg(msg)
    msg.sensor = [0]
    with pytest.raises(DataError, match=r"CloudComposite\.sensor has shape \(1,\), expected \(2,\)"):
        cloud_from_msg(msg)


def test_a_cloud_that_is_in_the_room_stays():
    """Its mount is not applied a second time."""
    room = random_cloud(np.random.default_rng(2), 3, frame_id="room")
    same(merge([room], [LEFT]), room)


def test_select_keeps_points_and_sensors_in_step():
    """A mask or an index array, in its order; sources stay even when none of their points does."""
    rng = np.random.default_rng(3)
    merged = merge([random_cloud(rng, 3), random_cloud(rng, 2)], [LEFT, RIGHT])
    picked = merged.select(np.array([4, 0, 1]))
    assert isinstance(picked, CloudComposite)
    np.testing.assert_array_equal(picked.sensor, [1, 0, 0])
    np.testing.assert_array_equal(picked.snr, merged.snr[[4, 0, 1]])
    only = merged.select(merged.sensor == 1)
    assert [len(part) for part in only.parts] == [0, 2]


def test_composites_can_be_merged_again():
    """A tree of sensors is a flat list of sensors."""
    rng = np.random.default_rng(4)
    clouds = [random_cloud(rng, n, frame_id=f"s{n}") for n in (2, 1, 3)]
    third = Pose(x=1.0)
    tree = merge([merge(clouds[:2], [LEFT, RIGHT]), clouds[2]], [Pose(), third])
    flat = merge(clouds, [LEFT, RIGHT, third])
    same(tree, flat)
    assert tree.sources == flat.sources
    np.testing.assert_array_equal(tree.sensor, flat.sensor)


def test_clouds_too_far_apart_in_time_are_refused():
    """At the tolerance they pass; beyond it the message names both."""
    rng = np.random.default_rng(5)
    early, late = random_cloud(rng, 2, 100 * MS, 8, "left/radar"), random_cloud(rng, 2, 130 * MS, 9, "right/radar")
    assert merge([early, late], [LEFT, RIGHT], tolerance=0.03).stamp_ns == 130 * MS
    with pytest.raises(
        DataError, match=r"cloud 9 of 'right/radar' is 0\.03 s younger than cloud 8 of 'left/radar', more than the tolerance of 0\.02 s"
    ):
        merge([late, early], [RIGHT, LEFT])


@pytest.mark.parametrize("tolerance", [-0.01, math.nan, math.inf])
def test_a_tolerance_that_makes_no_sense(tolerance):
    """It has to be a number of seconds."""
    with pytest.raises(ConfigError, match=r"tolerance is .* finite number of seconds"):
        merge([random_cloud(np.random.default_rng(6), 1)], [LEFT], tolerance)


def test_no_clouds_and_missing_mounts():
    """Without a cloud there is no time to give to the result; each cloud needs its own mount."""
    with pytest.raises(DataError, match="0 clouds with 0 mounts"):
        merge([], [])
    with pytest.raises(DataError, match="1 clouds with 2 mounts"):
        merge([random_cloud(np.random.default_rng(7), 1)], [LEFT, RIGHT])


def test_sensors_that_see_nothing():
    """An empty cloud among others, and only empty clouds."""
    rng = np.random.default_rng(8)
    assert list(merge([random_cloud(rng, 0), random_cloud(rng, 2)], [LEFT, RIGHT]).sensor) == [1, 1]
    nothing = merge([random_cloud(rng, 0), random_cloud(rng, 0, quality=Quality.NO_SIGNAL)], [LEFT, RIGHT])
    assert (len(nothing), nothing.position.shape, nothing.quality) == (0, (0, 3), Quality.NO_SIGNAL)


def test_a_composite_refuses_what_contradicts_itself():
    """Frozen, and sensors are indices of sources."""
    merged = merge([random_cloud(np.random.default_rng(9), 2)], [LEFT])
    with pytest.raises(dataclasses.FrozenInstanceError):
        merged.stamp_ns = 1
    with pytest.raises(DataError, match=r"CloudComposite\.sensor has entries outside 0\.\.0"):
        dataclasses.replace(merged, sensor=np.array([0, 1], np.int32))
    with pytest.raises(DataError, match=r"CloudComposite\.sensor has shape \(1,\), expected \(2,\)"):
        dataclasses.replace(merged, sensor=np.zeros(1, np.int32))
    with pytest.raises(DataError, match=r"CloudComposite\.sensor is int64, expected int32"):
        dataclasses.replace(merged, sensor=np.zeros(2, np.int64))


def test_tracking_takes_a_composite_unchanged():
    """A walker seen by two sensors that face each other, 4 ms apart in time, is one person at the true place."""
    rng, tracker = np.random.default_rng(10), PeopleTracker()
    velocity = np.array([0.6, 0.3, 0.0])
    for k in range(100):
        clouds = []
        for number, (mount, late) in enumerate(((LEFT, 0), (RIGHT, 4 * MS))):
            stamp = 20 * MS * k + late
            body = np.array([2.0, -0.5, 1.0]) + velocity * stamp * 1e-9
            points = body + rng.normal(0, (0.1, 0.1, 0.3), (6, 3))
            clouds.append(seen(points, mount, stamp, k, f"s{number}", velocity))
        tracks = tracker.process(merge(clouds, [LEFT, RIGHT]))
    assert len(tracks.point_track_id) == 12
    (track,) = tracks.tracks
    assert track.status is TrackStatus.CONFIRMED
    # 12 points of 0.1 m give centroids of 0.03 m, smoothed further; the tracker weighs points by range, so in the worst case only 6 count
    np.testing.assert_allclose(track.position[:2], body[:2], atol=0.12)
    np.testing.assert_allclose(track.velocity[:2], velocity[:2], atol=0.3)
