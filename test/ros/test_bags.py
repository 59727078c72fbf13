"""Recordings: what is written is read, a cut-off bag is recovered, and what is wrong is said."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import radar_ros.bag_source  # noqa: F401  (registers the source)
from radar_app.watching.reports import StageReport, reports_from_msg
from radar_core import CloudSource, ConfigError, DataError, Pose, Quality
from radar_core.cloud import ARRAY_FIELDS
from radar_core.paths import share_dir
from radar_driver.boards import board
from radar_driver.health import probe
from radar_ros import bags
from radar_ros.bag_frames import BagFrames
from radar_ros.messages.convert import cloud_from_msg
from radar_ros.messages.gestures import gesture_from_msg
from radar_ros.messages.tracks import hand_from_msg, tracks_from_msg
from radar_ros.offline import open_recording, parse, simulate, simulators
from radar_sim import Simulator, load_scene
from radar_tracking.tracks import Deleted, Reason


@pytest.fixture(scope="module")
def raw_bag(tmp_path_factory):
    """Two seconds of raw frames of one point target."""
    folder = tmp_path_factory.mktemp("bags")
    scene = folder / "two_seconds.yaml"
    scene.write_text(
        "duration: 2.0\nseed: 3\npoints: [{position: [2.0, 0.5, 1.4], velocity: [0.5, 0, 0], rcs: 0.1}]\neffects: {noise: {}}\n"
    )
    assert len(list(simulate(simulators(scene), folder / "raw"))) == 100
    return folder / "raw"


def test_contents_and_file_names(raw_bag):
    """Counts per topic; the file is named as rosbag2 names its first."""
    assert bags.contents(raw_bag) == {"/radar/frame": 100, "/radar/info": 1, "/truth": 100}
    assert (raw_bag / "raw_0.mcap").exists()
    assert (raw_bag / "metadata.yaml").exists()


def test_frames_come_back_bit_for_bit(raw_bag):
    """The recording's frames are the simulator's; a source may go back and forth."""
    simulator = Simulator(load_scene(raw_bag.parent / "two_seconds.yaml"))
    source = BagFrames(raw_bag)
    assert source.info == simulator.info
    assert source.n_frames == 100
    for sequence in (0, 1, 5, 99, 0, 3):
        frame, _ = source.frame(sequence)
        assert frame.cube.tobytes() == simulator.process(sequence).frame.cube.tobytes()
    with pytest.raises(DataError, match="ends before frame 100"):
        source.frame(100)
    source.close()


def test_a_recording_is_a_source_as_any_board(raw_bag):
    """By name from the registry, in its own time, with a health."""
    bag = board("bag")
    found = probe(bag.source(bag.config(bag=str(raw_bag))), 0.5)
    checks = {check.name: check for check in found.checks}
    assert checks["link"].value > 5
    assert checks["noise floor"].value is not None
    assert found.report["state"] == "running"


def test_other_tools_can_read_it(raw_bag):
    """The mcap library, which knows nothing of us, finds schemas and messages."""
    from mcap.reader import make_reader

    with (raw_bag / "raw_0.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert {schema.name for schema in summary.schemas.values()} == {
        "handwave/msg/RadarFrame",
        "handwave/msg/RadarInfo",
        "handwave/msg/Truth",
    }
    assert summary.statistics.message_count == 201


def test_a_bag_without_the_needed_topics(raw_bag, tmp_path):
    """The message lists what it holds and what is needed."""
    with bags.BagWriter(tmp_path / "poor") as writer:
        for item in bags.read(raw_bag, ("truth",)):
            writer.write(item.topic, item.msgtype, item.stamp_ns, item.data)
    with pytest.raises(DataError, match=r"needs radar/info \+ radar/frame or radar/info \+ radar/points, but holds truth"):
        open_recording(tmp_path / "poor")
    with pytest.raises(DataError, match=r"has no radar/frame with radar/info \(topics: /truth\)"):
        BagFrames(tmp_path / "poor")
    with pytest.raises(DataError, match="nowhere"):
        open_recording(tmp_path / "nowhere")


def test_an_existing_folder_is_never_overwritten(raw_bag):
    """A second recording into the same folder is refused."""
    with pytest.raises(DataError, match="choose a folder that does not exist"):
        bags.BagWriter(raw_bag)


WRITER = """
import sys, time
from pathlib import Path
from radar_ros import bags
writer = bags.BagWriter(Path(sys.argv[2]))
for number, item in enumerate(bags.read(Path(sys.argv[1]))):
    writer.write(item.topic, item.msgtype, item.stamp_ns, item.data)
    if number == 120:
        writer.flush()
        print("flushed", flush=True)
        time.sleep(60)
"""


def test_kill_9_costs_only_what_was_not_flushed(raw_bag, tmp_path):
    """A writer killed with SIGKILL leaves a file without an end; all that was flushed comes back."""
    cut = tmp_path / "cut"
    process = subprocess.Popen([sys.executable, "-c", WRITER, str(raw_bag), str(cut)], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "flushed\n"
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    with pytest.raises(DataError, match=r"was cut off .*handwave repair"):
        open_recording(cut)
    counts = bags.repair(cut)
    assert sum(counts.values()) == 121
    assert sum(bags.contents(cut).values()) == 121
    original = list(bags.read(raw_bag))[:121]
    assert [(i.topic, i.data) for i in bags.read(cut)] == [(i.topic, i.data) for i in original]
    assert (cut / "cut_0.mcap.damaged").exists()


def test_repair_recovers_whole_messages_of_a_truncated_file(raw_bag, tmp_path):
    """A disk that filled up: the file ends in the middle of a message."""
    torn = tmp_path / "torn"
    torn.mkdir()
    data = (raw_bag / "raw_0.mcap").read_bytes()
    (torn / "torn_0.mcap").write_bytes(data[: len(data) * 2 // 3])
    counts = bags.repair(torn)
    assert 100 < sum(counts.values()) < 201
    assert open_recording(torn).topic == "radar/frame"


def test_repair_of_nothing(tmp_path):
    """A folder without recordings is said to be one, and so is one of which nothing is left."""
    with pytest.raises(DataError, match="nothing to recover"):
        bags.repair(tmp_path)
    for number, data in enumerate((b"", b"\x89", b"\x89MCAP0\r\n", 40 * b"noise")):
        (tmp_path / str(number)).mkdir()
        (tmp_path / str(number) / "bag_0.mcap").write_bytes(data)
        with pytest.raises(DataError, match="nothing can be recovered"):
            bags.repair(tmp_path / str(number))
        assert (tmp_path / str(number) / "bag_0.mcap").read_bytes() == data


@pytest.mark.parametrize("at", [0.02, 0.3, 0.6, 0.97])
def test_one_bit_of_a_recording(raw_bag, tmp_path, at):
    """Checksums of chunks: a message that changed is never given as if it were whole; repair gives all that did not change."""
    good = {(item.topic, item.stamp_ns): item.data for item in bags.read(raw_bag)}
    bag = tmp_path / "bag"
    bag.mkdir()
    data = bytearray((raw_bag / "raw_0.mcap").read_bytes())
    data[int(at * len(data))] ^= 8
    (bag / "raw_0.mcap").write_bytes(data)
    (bag / "metadata.yaml").write_text((raw_bag / "metadata.yaml").read_text())
    with pytest.raises(DataError, match="handwave repair"):
        list(bags.read(bag))
    assert sum(bags.repair(bag).values()) > 0.8 * len(good)
    assert all(good[item.topic, item.stamp_ns] == item.data for item in bags.read(bag))


@pytest.mark.long
def test_recorder_survives_sigint_with_a_complete_bag(tmp_path):
    """The recorder node, told to stop, finishes its bag: metadata is there."""
    from radar_app.graph import graph
    from radar_app.supervisor import Supervisor

    lines = []
    specs = graph(
        "demo",
        parameters={"driver": {"scene": "single_target", "at_end": "loop"}, "recorder": {"bag": str(tmp_path / "rec")}},
        without=("evaluation", "visualisation", "gestures", "hand", "zones", "baseband", "tracking"),
    )
    with Supervisor(specs, log=lambda name, line: lines.append(f"{name}: {line}")) as supervisor:
        end = time.monotonic() + 20
        while time.monotonic() < end and sum(file.stat().st_size for file in tmp_path.glob("rec/*.mcap")) < 5_000_000:
            time.sleep(0.1)
        assert supervisor.running == ["driver", "recorder"], lines
    counts = bags.contents(tmp_path / "rec")
    assert counts["/radar/frame"] > 15
    assert counts["/radar/info"] >= 1
    assert counts["/tf_static"] >= 1


def test_recorder_without_a_folder_is_a_configuration_error(ros):
    """The message names the parameter."""
    from radar_ros.nodes.recorder import make_node

    with pytest.raises(ConfigError, match="needs the parameter bag"):
        make_node()


def recorded_before(folder, kind, lines, topic="/hand", nested=None, **fields):
    """A bag of one message of ours as an older version defined it, in the real format, made without our writer."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in {**(nested or {}), kind: lines}.items():
        store.register(get_types_from_msg("\n".join(text), name))
    types = store.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](7, 5), "room")
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(topic, kind, typestore=store)
        given = {name: value(types, header) if callable(value) else value for name, value in fields.items()}
        writer.write(connection, 99, bytes(store.serialize_cdr(types[kind](header=header, **given), kind)))
    return folder


def definition(name):
    return (share_dir() / "msg" / f"{name}.msg").read_text().splitlines()


HAND = {"sequence": 3, "parent_id": 2, "active": True, "n_points": 4, "unseen_s": 0.25, "position": np.arange(3.0)}
HAND |= {"velocity": np.arange(3.0) / 7, "covariance": np.arange(36.0), "value": 0.5}


def test_a_hand_track_recorded_before_its_velocity_was_judged(tmp_path):
    """What it held is read, what came later is not known; the recording itself stays as it is, also when it is repaired."""
    lines = [
        line for line in definition("HandTrack") if not any(new in line for new in ("velocity_rank", "velocity_condition", "outliers"))
    ]
    assert len(lines) == len(definition("HandTrack")) - 3
    bag = recorded_before(tmp_path / "old", "handwave/msg/HandTrack", lines, **HAND)
    (item,) = bags.read(bag, ("hand",))
    hand = hand_from_msg(parse(item.data, "hand"))
    assert (item.stamp_ns, hand.stamp_ns, hand.frame_id) == (99, 7 * 10**9 + 5, "room")
    assert (hand.sequence, hand.parent_id, hand.active, hand.n_points, hand.unseen, hand.value) == (3, 2, True, 4, 0.25, 0.5)
    np.testing.assert_array_equal(hand.velocity, HAND["velocity"])
    np.testing.assert_array_equal(hand.covariance.ravel(), HAND["covariance"])
    assert (hand.velocity_rank, hand.outliers) == (0, 0)
    assert np.isnan(hand.velocity_condition)
    assert bags.repair(bag) == {}
    (bag / "metadata.yaml").unlink()  # as if its writer had been killed
    assert bags.repair(bag) == {"/hand": 1}
    assert [(again.stamp_ns, again.data) for again in bags.read(bag)] == [(99, item.data)]


GESTURE = {"topic": "/gestures", "track_id": 3, "label": 4, "name": "swipe_down", "confidence": 0.5, "known": True, "latency_s": 0.25}
GESTURE |= {"probabilities": np.eye(10)[4], "features": np.arange(13.0), "start": lambda types, header: header.stamp}
GESTURE |= {"end": lambda types, header: header.stamp}


def test_a_gesture_recorded_before_it_said_where(tmp_path):
    """What it held is read; where it was is not known."""
    lines = [line for line in definition("Gesture") if not line.startswith(("float64[3] position", "string[] zones", "string[] labels"))]
    assert len(lines) == len(definition("Gesture")) - 3
    bag = recorded_before(tmp_path / "old", "handwave/msg/Gesture", lines, **GESTURE)
    (item,) = bags.read(bag, ("gestures",))
    gesture = gesture_from_msg(parse(item.data, "gestures"))
    assert (gesture.track_id, gesture.label, gesture.name, gesture.start_ns, gesture.zones) == (3, 4, "swipe_down", 7 * 10**9 + 5, ())
    np.testing.assert_array_equal(gesture.features, GESTURE["features"])
    assert np.isnan(gesture.position).all()


LISTS = tuple(f"{kind}[] earlier_" for kind in ("int64", "uint64", "float64"))


@pytest.mark.parametrize("lacks", [LISTS, (*LISTS, "bool stale")])
def test_a_status_recorded_before_several_went_together(tmp_path, lacks):
    """It is of one message; a stage that said nothing of being stale was not."""
    lines = [line for line in definition("StageStatus") if not line.startswith(lacks)]
    assert len(lines) == len(definition("StageStatus")) - 3 - len(lacks)
    counts = {"sequence": 3, "processed": 4, "dropped": 1, "compute_s": 0.5, "monotonic_ns": 9}
    counts |= {} if "bool stale" in lacks else {"stale": False}
    bag = recorded_before(tmp_path / "old", "handwave/msg/StageStatus", lines, topic="/stage_status", stage="tracking", **counts)
    (item,) = bags.read(bag, ("stage_status",))
    assert [*reports_from_msg(parse(item.data, "stage_status"), "left")] == [
        StageReport("left/tracking", 3, 4, 1, 0.5, 9, False, 7 * 10**9 + 5)
    ]


def before_strides(name):
    """A definition as it was before messages said that frames are left out on purpose."""
    lines = [line for line in definition(name) if not line.startswith("uint32 every ")]
    assert len(lines) == len(definition(name)) - 1
    return lines


POINTS = {name: np.arange(4, dtype=np.float32) + i for i, name in enumerate(ARRAY_FIELDS)}
MOUNT = {"mount_x_m": 1.0, "mount_y_m": 2.0, "mount_z_m": 1.5, "mount_yaw_rad": 0.5, "mount_tilt_rad": -0.25}


@pytest.mark.parametrize("n_sources", [0, 1, 2])
def test_clouds_recorded_before_frames_were_left_out(tmp_path, n_sources):
    """Of one radar or of several: all that was recorded is read, and every frame was used."""

    def sources(types, header):
        return [types["handwave/msg/CloudSource"](header=header, sequence=20 + i, quality=i, **MOUNT) for i in range(n_sources)]

    nested = {"handwave/msg/CloudSource": before_strides("CloudSource")}
    told = {"sensor": np.arange(4, dtype=np.int32) % max(n_sources, 1) if n_sources else np.empty(0, np.int32), "sources": sources}
    values = {"topic": "/left/radar/points", "sequence": 9, "quality": 4, **POINTS, **told}
    bag = recorded_before(tmp_path / "old", "handwave/msg/PointCloud", before_strides("PointCloud"), nested=nested, **values)
    (item,) = bags.read(bag, ("radar/points",))
    cloud = cloud_from_msg(parse(item.data, "radar/points"))
    assert (cloud.stamp_ns, cloud.sequence, cloud.frame_id, cloud.quality, cloud.every) == (7 * 10**9 + 5, 9, "room", 4, 1)
    for name, expected in POINTS.items():
        assert getattr(cloud, name).tobytes() == expected.tobytes()
    mount = Pose(x=1.0, y=2.0, z=1.5, yaw=0.5, tilt=-0.25)
    expected = tuple(CloudSource("room", mount, 7 * 10**9 + 5, 20 + i, Quality(i), 1) for i in range(n_sources))
    assert getattr(cloud, "sources", ()) == expected


TRACK = {"id": 5, "status": 1, "age_s": 2.0, "unseen_s": 0.25, "n_points": 3, "position": np.arange(3.0), "velocity": np.ones(3)}
TRACK |= {"extent": np.zeros(3), "covariance": np.arange(36.0), "nis": 0.5, "dof": 2}
TRACKS = {"topic": "/tracks", "sequence": 4, "point_track_id": np.int32([5, -1]), "deleted_id": np.uint32([3])}
TRACKS |= {"deleted_reason": np.uint8([2]), "deleted_confirmed": np.array([True])}


@pytest.mark.parametrize("n_tracks", [0, 2])
def test_tracks_recorded_before_frames_were_left_out(tmp_path, n_tracks):
    """All that was recorded is read."""
    values = {**TRACKS, "tracks": lambda types, _: [types["handwave/msg/Track"](**TRACK)] * n_tracks}
    nested = {"handwave/msg/Track": definition("Track")}
    bag = recorded_before(tmp_path / "old", "handwave/msg/TrackArray", before_strides("TrackArray"), nested=nested, **values)
    (item,) = bags.read(bag)
    found = tracks_from_msg(parse(item.data, "tracks"))
    assert (found.sequence, found.every, found.point_track_id.tolist(), len(found.tracks)) == (4, 1, [5, -1], n_tracks)
    assert found.deleted == (Deleted(3, Reason.LEFT, True),)
    for track in found.tracks:
        assert (track.id, track.age, track.nis, track.dof) == (5, 2.0, 0.5, 2)
        np.testing.assert_array_equal(track.covariance.ravel(), TRACK["covariance"])


def test_messages_within_messages_are_held_to_the_same(tmp_path):
    """Tracks that another version defined otherwise are refused, though their array lacks only what came later."""
    given = {name: value for name, value in TRACK.items() if name != "dof"}
    values = {**TRACKS, "tracks": lambda types, _: [types["handwave/msg/Track"](**given)]}
    nested = {"handwave/msg/Track": [line for line in definition("Track") if " dof " not in line]}
    bag = recorded_before(tmp_path / "old", "handwave/msg/TrackArray", before_strides("TrackArray"), nested=nested, **values)
    with pytest.raises(DataError, match=r"/tracks: handwave/msg/TrackArray was recorded by another version"):
        list(bags.read(bag))


def test_what_another_version_defined_otherwise_is_refused(tmp_path):
    """Fields that are gone, or of another type, would be garbage: the message says which topic and what to do; other topics can be read."""
    narrow, without = (lambda line: line.replace("float64 value", "float32 value")), (lambda line: "" if " n_points" in line else line)
    for number, change in enumerate((narrow, without)):
        fields = {name: value for name, value in HAND.items() if change is narrow or name != "n_points"}
        fields |= {"velocity_rank": 1, "velocity_condition": 2.0, "outliers": 0}
        lines = [change(line) for line in definition("HandTrack")]
        bag = recorded_before(tmp_path / str(number), "handwave/msg/HandTrack", lines, **fields)
        with pytest.raises(DataError, match=r"/hand: handwave/msg/HandTrack was recorded by another version .* record again"):
            list(bags.read(bag, ("hand",)))
        assert list(bags.read(bag, ("tracks",))) == []
        assert bags.contents(bag) == {"/hand": 1}


def test_a_message_of_this_version_is_read_as_it_is(tmp_path):
    """Not a byte changes."""
    told = {"velocity_rank": 2, "velocity_condition": np.inf, "outliers": 1}
    bag = recorded_before(tmp_path / "new", "handwave/msg/HandTrack", definition("HandTrack"), **HAND, **told)
    (item,) = bags.read(bag)
    with bags.open_bag(bag) as reader:
        ((_, _, raw),) = reader.messages()
    assert item.data == bytes(raw)
    hand = hand_from_msg(parse(item.data, "hand"))
    assert (hand.velocity_rank, hand.velocity_condition, hand.outliers) == (2, np.inf, 1)
