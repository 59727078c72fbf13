"""`handwave simulate` and `handwave explain`: several radars, what is written beside a bag, runs that are stopped."""

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from radar_driver.boards.sim import SimFrames
from radar_ros.bags import contents, read, repair
from radar_ros.messages.truth import truth_from_msg
from radar_ros.offline import parse, process_recording, simulate, simulators
from radar_sim import load_scene

SMALL = "waveform: {n_chirp: 8, n_sample: 32, frame_interval: 0.02}"
SCENE = f"""
duration: 0.4
seed: 5
radars:
  - {{frame_id: left/radar, mount: {{y: 0.5}}, {SMALL}}}
  - {{frame_id: right/radar, mount: {{y: -0.5}}, trigger_offset: 0.005, clock_drift: 0.001, {SMALL}}}
people:
  - {{position: [2.0, 0.0]}}
effects: auto
tolerance: 0.1
"""


def command(*arguments):
    return [sys.executable, "-m", "radar_app", *map(str, arguments)]


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(SCENE)
    return path


@pytest.mark.long
def test_every_radar_has_its_own_topics(tmp_path, scene):
    """Frames of both, in the order of their stamps, each with the truth of its own middle; the scene lies beside the bag as simulated."""
    radars = simulators(scene)
    assert len(list(simulate(radars, tmp_path / "bag"))) == 20 + 19
    held = contents(tmp_path / "bag")
    assert {f"/{side}/{topic}" for side in ("left", "right") for topic in ("radar/info", "radar/frame", "truth")} == set(held)
    assert (held["/left/radar/frame"], held["/right/radar/frame"]) == (20, 19)
    frames = list(read(tmp_path / "bag", ("radar/frame",)))
    stamps = [item.stamp_ns for item in frames]
    assert stamps == sorted(stamps)
    right = [item.stamp_ns for item in frames if item.topic == "/right/radar/frame"]
    np.testing.assert_allclose(np.diff(right), 20_020_000, atol=1)
    assert right[0] == 5_000_000
    truths = [truth_from_msg(parse(item.data, "truth")) for item in read(tmp_path / "bag", ("truth",))]
    assert all(len(truth.scatterer_rcs) > 50 and truth.person_id.tolist() == [1] for truth in truths)
    again = load_scene(tmp_path / "bag" / "scene.yaml")
    assert again == radars[0].scene
    assert not again.effects.auto
    assert again.effects.coupling is not None


def test_a_driver_takes_the_radar_of_its_namespace(scene):
    """By namespace, with its own clock; the only radar of a scene is taken whatever the namespace."""
    source = SimFrames(scene, "/right")
    assert source.info.frame_id == "right/radar"
    assert source.interval == pytest.approx(0.02002)
    assert source.delay == 0.005
    assert SimFrames("short", "/right").info.frame_id == "radar"


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_run_that_is_stopped_leaves_a_bag_that_can_be_read(tmp_path, number):
    """Told to stop, it closes the bag; killed, `repair` gets back what had been brought to the file, 50 frames at a time."""
    bag = tmp_path / "bag"
    with subprocess.Popen(command("simulate", "demo", "--out", bag), stdout=subprocess.PIPE, text=True) as process:
        file = bag / "bag_0.mcap"
        end = time.monotonic() + 60.0
        while not (file.exists() and file.stat().st_size > 30_000_000):  # more than a hundred frames
            assert time.monotonic() < end
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(number)
        output, _ = process.communicate(timeout=30.0)
    if number == signal.SIGKILL:
        repair(bag)
    else:
        assert process.returncode == 128 + number
        assert "stopped: " in output
    frames = contents(bag)["/radar/frame"]
    assert 100 <= frames < 1499
    assert sum(1 for _ in process_recording(bag)) == frames


@pytest.mark.long
def test_explain_prints_all_effects(tmp_path):
    """As a table with warnings, and as JSON that says the same."""
    text = subprocess.run(command("explain", "single_target"), capture_output=True, text=True, check=True).stdout
    assert "range_migration" in text
    assert "missing" in text
    done = subprocess.run(command("explain", "single_target", "--json"), capture_output=True, text=True, check=True)
    result = json.loads(done.stdout)
    assert {"effects", "reasons", "tolerance"} == set(result)
    assert {row["name"]: row["on"] for row in result["effects"]}["noise"]
