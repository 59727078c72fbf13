"""Recordings: what is written is read, a cut-off bag is recovered, and what is wrong is said."""

import os
import signal
import subprocess
import sys
import time

import pytest

from radar_core import ConfigError, DataError
from radar_driver.messages import BagSource
from radar_ros import bags
from radar_ros.offline import open_recording, simulate, simulators
from radar_sim import Simulator, load_scene


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
    source = BagSource(raw_bag)
    assert source.info == simulator.info
    assert source.n_frames == 100
    for sequence in (0, 1, 5, 99, 0, 3):
        frame, _ = source.read(sequence)
        assert frame.cube.tobytes() == simulator.process(sequence).frame.cube.tobytes()
    with pytest.raises(DataError, match="ends before frame 100"):
        source.read(100)
    source.close()


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
        BagSource(tmp_path / "poor")
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
    """A folder without recordings is said to be one."""
    with pytest.raises(DataError, match="nothing to recover"):
        bags.repair(tmp_path)


def test_recorder_survives_sigint_with_a_complete_bag(tmp_path):
    """The recorder node, told to stop, finishes its bag: metadata is there."""
    from radar_ros.graph import graph
    from radar_ros.supervisor import Supervisor

    lines = []
    specs = graph(
        "demo",
        parameters={"driver": {"scene": "single_target", "at_end": "loop"}, "recorder": {"bag": str(tmp_path / "rec")}},
        without=("evaluation", "visualisation", "gestures", "hand", "baseband", "tracking"),
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
