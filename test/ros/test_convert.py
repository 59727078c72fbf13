"""Every message carries its dataclass there and back without loss, bit for bit, through real serialisation."""

import dataclasses
import sys

import numpy as np
import pytest
from handwave.msg import Track as TrackMsg
from handwave.msg import TrackArray as TrackArrayMsg
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from radar_core import GESTURES, AntennaArray, DataError, PointCloud, Pose, Quality, RadarFrame, RadarInfo, Waveform, merge
from radar_core.cloud import ARRAY_FIELDS
from radar_driver.clouds import cloud_from_ti
from radar_driver.foreign import ForeignConfig, foreign_cloud
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.gesture import Gesture
from radar_ros.bags import typestore
from radar_ros.messages import convert
from radar_ros.messages.gestures import gesture_from_msg, gesture_to_msg
from radar_ros.messages.tracks import hand_from_msg, hand_to_msg, tracks_from_msg, tracks_to_msg
from radar_ros.messages.truth import truth_from_msg, truth_to_msg
from radar_sim import Simulator, Truth, load_scene
from radar_tracking import HandTrack, Track, Tracks
from radar_tracking.tracks import Deleted, Reason, TrackStatus

stamps = st.integers(0, (1 << 31) * 10**9 - 1)
sizes = st.integers(0, 40)
seeds = st.integers(0, 1 << 30)


def same(a, b):
    """Equal types and equal bits, NaN and signs of zero included, field by field."""
    assert type(a) is type(b)
    if dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            same(getattr(a, field.name), getattr(b, field.name))
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype
        assert a.shape == b.shape
        assert a.tobytes() == b.tobytes()
    elif isinstance(a, tuple):
        assert len(a) == len(b)
        for x, y in zip(a, b, strict=True):
            same(x, y)
    else:
        assert a == b or a != a


def through(msg):
    """What arrives when a message is sent."""
    return deserialize_message(serialize_message(msg), type(msg))


def numbers(rng, *shape, dtype=np.float64):
    """Floats of any bit pattern: NaN, infinities, subnormals."""
    return np.frombuffer(rng.bytes(int(np.prod(shape)) * np.dtype(dtype).itemsize), dtype).reshape(shape).copy()


@settings(max_examples=30, deadline=None)
@given(stamps, sizes, seeds)
def test_point_cloud(stamp, n, seed):
    """Clouds of any size, also empty, with any bits."""
    rng = np.random.default_rng(seed)
    cloud = PointCloud(
        stamp,
        7,
        "left/radar",
        **{name: numbers(rng, n, dtype=np.float32) for name in ARRAY_FIELDS},
        quality=Quality(seed % 32),
        every=1 + seed * 3,
    )
    same(convert.cloud_from_msg(through(convert.cloud_to_msg(cloud))), cloud)


@settings(max_examples=20, deadline=None)
@given(stamps, seeds, st.tuples(*[st.integers(1, 5)] * 4))
def test_radar_frame(stamp, seed, shape):
    """Frames of any shape and any bits."""
    cube = numbers(np.random.default_rng(seed), *shape, 2, dtype=np.float32).view(np.complex64)[..., 0]
    frame = RadarFrame(
        cube=np.ascontiguousarray(cube),
        stamp_ns=stamp,
        sequence=3,
        frame_id="radar",
        missing=np.arange(seed % (shape[0] * shape[1] + 1), dtype=np.uint32),
    )
    same(convert.frame_from_msg(through(convert.frame_to_msg(frame))), frame)


def test_radar_info():
    """A radar unlike the default in every respect."""
    info = RadarInfo(
        frame_id="right/radar",
        waveform=Waveform(
            modulation="ofdm",
            code_seed=7,
            carrier=24.1e9,
            bandwidth=77 / 64e-6,
            chirp_duration=64e-6,
            chirp_pause=1e-7,
            frame_interval=0.05,
            n_tx=1,
            n_chirp=33,
            n_sample=77,
        ),
        array=AntennaArray(
            tx=((0.1, -0.2),),
            rx=((0.0, 1e-9), (0.3, 0.4), (1 / 3, 2 / 3)),
            gain=3.3,
            tx_power=-1.5,
            fov_azimuth=1.1,
            fov_elevation=0.3,
            channel_gain=(0.1, -0.2, 1 / 3),
            channel_phase=(0.1, 2.0, -3.0),
            channel_shift=((1e-4, 0.0), (0.0, 2e-4), (1e-5, 1 / 7)),
        ),
        mount=Pose(x=1.5, y=-2.5, z=0.7, yaw=-1.2, tilt=0.3),
        full_scale=1.25,
    )
    same(convert.info_from_msg(through(convert.info_to_msg(info, 5))), info)


@settings(max_examples=20, deadline=None)
@given(stamps, st.integers(0, 5), st.integers(0, 6), sizes, seeds)
def test_tracks(stamp, n_tracks, n_deleted, n_points, seed):
    """Any number of tracks and points, and of tracks that ended for any reason."""
    rng = np.random.default_rng(seed)
    tracks = tuple(
        Track(
            i + 1,
            TrackStatus(i % 3),
            float(rng.random()),
            float(rng.random()),
            i,
            *(numbers(rng, 3) for _ in range(3)),
            numbers(rng, 6, 6),
            nis=float("nan") if i % 2 else float(rng.random()),
            dof=0 if i % 2 else 3,
        )
        for i in range(n_tracks)
    )
    deleted = tuple(Deleted(100 + i, Reason(i % len(Reason)), bool(rng.integers(2))) for i in range(n_deleted))
    result = Tracks(stamp, 1, "room", tracks, rng.integers(-1, 5, n_points).astype(np.int32), deleted, every=1 + seed * 3)
    same(tracks_from_msg(through(tracks_to_msg(result))), result)


def test_whoever_knows_no_strides_leaves_nothing_out():
    """0 in a message is 1 for clouds, their sources and tracks."""
    cloud = merge([PointCloud(0, 0, "radar", *np.zeros((3, 2), np.float32), every=4)] * 2, [Pose(), Pose()])
    msg = convert.cloud_to_msg(cloud)
    msg.every = msg.sources[1].every = 0
    got = convert.cloud_from_msg(through(msg))
    assert (got.every, [source.every for source in got.sources]) == (1, [4, 1])
    assert tracks_from_msg(through(TrackArrayMsg())).every == 1


@pytest.mark.parametrize("n_tracks", [0, 1, 2])
@pytest.mark.parametrize("frame_id", ["room", "x", ""])
def test_readers_of_recordings_agree_on_tracks(n_tracks, frame_id):
    """Tracks are the same bytes to rclpy and to rosbags, whatever stands before their numbers; also none."""
    own = tuple(
        Track(i, TrackStatus.CONFIRMED, 1.0, 0.5, 3, np.arange(3.0), np.zeros(3), np.ones(3), np.arange(36.0).reshape(6, 6))
        for i in range(n_tracks)
    )
    tracks = Tracks(5, 3, frame_id, own, np.arange(4, dtype=np.int32), (Deleted(7, Reason.LEFT, True),), every=3)
    data, kind = serialize_message(tracks_to_msg(tracks)), "handwave/msg/TrackArray"
    theirs = typestore().deserialize_cdr(data, kind)
    assert (theirs.every, len(theirs.tracks), theirs.deleted_id.tolist()) == (3, n_tracks, [7])
    same(tracks_from_msg(deserialize_message(bytes(typestore().serialize_cdr(theirs, kind)), TrackArrayMsg)), tracks)


@pytest.mark.parametrize("name", [reason.name for reason in Reason])
def test_reasons_are_those_of_the_message(name):
    """The library's numbers are the message's constants."""
    assert getattr(TrackArrayMsg, name) == Reason[name]


@pytest.mark.parametrize("name", [status.name for status in TrackStatus])
def test_statuses_are_those_of_the_message(name):
    """The library's numbers are the message's constants."""
    assert getattr(TrackMsg, name) == TrackStatus[name]


@settings(max_examples=20, deadline=None)
@given(stamps, seeds)
def test_hand(stamp, seed):
    """A hand track."""
    rng = np.random.default_rng(seed)
    told = (seed % 4, float(numbers(rng, 1)[0]), seed % 7)
    hand = HandTrack(stamp, 9, "room", 4, bool(seed % 2), 6, 0.25, numbers(rng, 3), numbers(rng, 3), numbers(rng, 6, 6), 0.75, *told)
    same(hand_from_msg(through(hand_to_msg(hand))), hand)


@settings(max_examples=20, deadline=None)
@given(stamps, stamps, seeds)
def test_gesture(stamp, start, seed):
    """A gesture with all its probabilities and features."""
    rng = np.random.default_rng(seed)
    gesture = Gesture(stamp, "room", 3, 4, "swipe_down", 0.5, numbers(rng, 10), start, stamp, numbers(rng, 13))
    gesture = dataclasses.replace(gesture, position=numbers(rng, 3), zones=("sofa", "by the door")[: seed % 3])
    same(gesture_from_msg(through(gesture_to_msg(gesture))), gesture)
    own = dataclasses.replace(gesture, label=10, name="clap", probabilities=numbers(rng, 11), labels=(*GESTURES, "clap"))
    same(gesture_from_msg(through(gesture_to_msg(own))), own)


@settings(max_examples=20, deadline=None)
@given(stamps, st.integers(0, 6), seeds)
def test_truth(stamp, n, seed):
    """Any number of people, also nobody."""
    rng = np.random.default_rng(seed)
    truth = Truth(
        stamp_ns=stamp,
        sequence=2,
        frame_id="room",
        person_id=np.arange(n, dtype=np.uint32),
        position=numbers(rng, n, 3),
        velocity=numbers(rng, n, 3),
        hand_position=numbers(rng, n, 3),
        hand_velocity=numbers(rng, n, 3),
        gesture=rng.integers(0, 256, n).astype(np.uint8),
        gesture_index=rng.integers(0, 9, n).astype(np.uint32),
        walking=rng.random(n) > 0.5,
        drawing=rng.random(n) > 0.5,
        gesture_start_ns=rng.integers(0, 10**18, n),
        gesture_end_ns=rng.integers(0, 10**18, n),
        other_hand_position=numbers(rng, n, 3),
        other_hand_velocity=numbers(rng, n, 3),
        scatterer_position=rng.standard_normal((5 * n, 3)).astype(np.float32),
        scatterer_owner=rng.integers(-9, 9, 5 * n).astype(np.int32),
        scatterer_rcs=rng.random(5 * n).astype(np.float32),
    )
    same(truth_from_msg(through(truth_to_msg(truth))), truth)
    own = dataclasses.replace(truth, labels=(*GESTURES, "clap"))
    same(truth_from_msg(through(truth_to_msg(own))), own)


def test_frame_whose_size_contradicts_itself():
    """A broken driver is named, with both numbers."""
    msg = convert.frame_to_msg(RadarFrame(cube=np.zeros((1, 2, 3, 4), np.complex64), stamp_ns=0, sequence=8, frame_id="radar"))
    msg.n_chirp = 3
    with pytest.raises(DataError, match=r"frame 8 of 'radar' says \(1, 3, 3, 4\).*carries 48 floats, not 72"):
        convert.frame_from_msg(msg)


def test_point_cloud2_fields_in_order():
    """Other tools read x, y, z at the offsets that the message states."""
    values = {name: np.float32([i, i + 0.5]) for i, name in enumerate(ARRAY_FIELDS)}
    cloud = PointCloud(0, 0, "radar", **values)
    msg = convert.cloud_to_cloud2(cloud)
    table = np.frombuffer(bytes(msg.data), np.float32).reshape(msg.width, -1)
    for field in msg.fields:
        np.testing.assert_array_equal(table[:, field.offset // 4], values[field.name])
    assert len(msg.data) == msg.row_step == msg.point_step * msg.width


def clouds_of_every_maker(rng):
    """One cloud of everything that makes clouds of arrays: the baseband, a TI demo, a foreign driver, a selection and a fusion."""
    frame = Simulator(load_scene("single_target")).process(0).frame
    yield Baseband(BasebandConfig(), RadarInfo()).process(frame)
    yield Baseband(BasebandConfig(backend="numpy"), RadarInfo()).process(frame)
    ti = cloud_from_ti(0, 0, rng.uniform(1, 3, (5, 3)), rng.normal(size=5), rng.uniform(5, 9, 5), noise=2.0)
    values = {name: rng.uniform(1, 3, 5) for name in ("x", "y", "z", "doppler", "intensity")}
    yield from (ti, foreign_cloud(values, ForeignConfig(), 0, 0, "radar")[0], ti.select(np.array([2, 0])))
    fused = merge([ti, ti], [Pose(y=1.0), Pose(y=-1.0)])
    yield from (fused, *fused.parts)


def test_the_order_of_fields_means_nothing(monkeypatch):
    """With the list of fields reversed everywhere, every array still lands under its own name, in clouds and in messages."""
    before = list(clouds_of_every_maker(np.random.default_rng(5)))
    for module in [m for name, m in sys.modules.items() if name.startswith("radar_") and hasattr(m, "ARRAY_FIELDS")]:
        monkeypatch.setattr(module, "ARRAY_FIELDS", ARRAY_FIELDS[::-1])
    after = list(clouds_of_every_maker(np.random.default_rng(5)))
    assert len(before) == len(after) == 8
    for expected, found in zip(before, after, strict=True):
        assert len(expected) > 0
        for cloud in (found, convert.cloud_from_msg(convert.cloud_to_msg(found))):
            for name in ARRAY_FIELDS:
                np.testing.assert_array_equal(getattr(cloud, name), getattr(expected, name), err_msg=name)
        table = np.frombuffer(bytes(convert.cloud_to_cloud2(found).data), np.float32).reshape(len(found), -1)
        np.testing.assert_array_equal(table[:, convert.CLOUD2_FIELDS.index("snr")], expected.snr)


def test_measured_arrays_of_a_cloud_are_given_by_name():
    """By position they could be swapped in silence; only x, y, z may be given so."""
    assert len(PointCloud(0, 0, "radar", *np.zeros((3, 2), np.float32))) == 2
    with pytest.raises(TypeError, match="positional"):
        PointCloud(0, 0, "radar", *np.zeros((4, 2), np.float32))
