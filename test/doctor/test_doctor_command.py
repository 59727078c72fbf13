"""`handwave doctor` on real bags, and on a graph that runs in another process."""

import json
import os
import shlex
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.doctor import DEVELOPED, diagnose
from benchmarks.doctor_bags import FAULTS, HEALTHY
from radar_app.cli import app
from radar_core import RadarFrame, RadarInfo
from radar_ros.bags import BagWriter
from radar_ros.messages.convert import frame_to_msg, info_to_msg

START = 1_700_000_000_000_000_000
WANTED = ("merged people", "lost when still")


def noise_bag(path, info=None, described=True, lost=()):
    """Two seconds of noise of a small radar."""
    info = info or RadarInfo()
    rng = np.random.default_rng(6)
    with BagWriter(path) as writer:
        if described:
            writer.put("/radar/info", START, info_to_msg(RadarInfo(), START))
        for k in range(40):
            stamp = START + k * 50_000_000
            cube = (rng.normal(size=(*info.cube_shape, 2)) @ [1, 1j]).astype(np.complex64)
            if k not in lost:
                writer.put("/radar/frame", stamp + 9_000_000 + k % 3 * 1000, frame_to_msg(RadarFrame(cube, stamp, k, "radar")))
    return path


def ask(*words):
    """Run the command; its status and its JSON."""
    done = CliRunner().invoke(app, ["doctor", *map(str, words), "--json"])
    return done.exit_code, json.loads(done.stdout) if done.stdout.startswith("{") else done


def test_a_quiet_recording_is_healthy(tmp_path):
    """Nothing wrong is found, in words and with the figures that were looked at; status 0."""
    bag = noise_bag(tmp_path / "quiet")
    status, found = ask(bag)
    assert (status, found["faults"]) == (0, [])
    assert {one["symptom"] for one in found["findings"] if one["fault"] is False} >= {"drops", "clock offset", "interference", "ghosts"}
    said = CliRunner().invoke(app, ["doctor", str(bag)])
    assert said.exit_code == 0
    assert said.stdout.startswith("nothing wrong found")
    assert "0 of 40 messages of radar/frame are lost" in said.stdout
    assert "looked at: 40 of radar/frame" in said.stdout


def test_faults_come_with_a_remedy(tmp_path):
    """Lost frames, a radar without description: status 1, the figure, and what to do."""
    status, found = ask(noise_bag(tmp_path / "lossy", lost=(3, 4, 9)))
    assert (status, found["faults"]) == (1, ["drops"])
    first = found["findings"][0]
    assert first["value"] == pytest.approx(3 / 40)
    assert "rmem_max" in first["remedy"]
    said = CliRunner().invoke(app, ["doctor", str(noise_bag(tmp_path / "nameless", described=False))])
    assert said.exit_code == 1
    assert said.stdout.startswith("1. radar info missing\n")
    assert "-> start the driver" in said.stdout


def test_frames_of_another_radar(tmp_path):
    """Frames that contradict their info are counted and named; none of them ends the doctor."""
    other = RadarInfo()
    other = RadarInfo(waveform=type(other.waveform)(n_sample=32))
    status, found = ask(noise_bag(tmp_path / "other", info=other))
    assert (status, found["faults"]) == (1, ["unusable data"])
    assert "40 messages could not be used" in found["findings"][0]["text"]


@pytest.mark.long
def test_what_cannot_be_read_is_status_two(tmp_path):
    """No bag, nothing of a radar in it, words and parameters that make no sense; by the command itself, in one line."""
    with BagWriter(tmp_path / "empty") as writer:
        writer.put("/radar/info", START, info_to_msg(RadarInfo(), START))
    good = noise_bag(tmp_path / "good")
    wrong = [[tmp_path / "none"], [tmp_path / "empty"], [good, "--walked", "up"], [good, "--param", "driver.scene=demo"]]
    wrong.append([good, "--param", "tracking.life.birth_pints=2"])
    code = "import sys; from radar_app.cli import app, main; sys.argv[0] = 'handwave'; main()"
    done = subprocess.run([sys.executable, "-c", code, "doctor", str(tmp_path / "empty")], capture_output=True, text=True, timeout=240)
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("handwave: ")
    assert len(done.stderr.strip().splitlines()) == 1
    for words in wrong:
        assert CliRunner().invoke(app, ["doctor", *map(str, words)]).exit_code != 0


@pytest.mark.long
@pytest.mark.parametrize("fault", WANTED)
def test_the_fault_of_a_simulated_room(fault, tmp_path):
    """A walker in a room, real bags of frames, clouds and tracks: the right fault is first, and its line, pasted, mends the tracking."""
    number, case = next((k, case) for k, case in enumerate(FAULTS) if case.fault == fault)
    case.make(tmp_path / "bag", DEVELOPED + number)
    assert diagnose(tmp_path / "bag", case)[0] == fault
    words = shlex.split(ask(tmp_path / "bag")[1]["findings"][0]["remedy"])
    pasted = [word for name, value in pairwise(words) if name == "--param" for word in (name, value)]
    assert pasted
    assert fault not in ask(tmp_path / "bag", *pasted)[1]["faults"]


@pytest.mark.long
def test_a_running_graph(tmp_path):
    """A replay in another process, heard over DDS: healthy, with its own clouds and tracks of what was sent."""
    HEALTHY[0].make(tmp_path / "bag", DEVELOPED)
    code = "import sys; from radar_app.cli import main; sys.argv[0] = 'handwave'; main()"
    words = ["replay", str(tmp_path / "bag"), "--no-graph", "--loop", "--topics", "radar/info,radar/points,tracks"]
    player = subprocess.Popen([sys.executable, "-c", code, *words], env=os.environ, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        status, found = ask("--seconds", "6")
    finally:
        player.terminate()
        player.wait(30)
    assert status in (0, 1), found
    known = {one["symptom"]: one for one in found["findings"]}
    assert known["clock offset"]["fault"] is None  # stamps are of the recording's time
    assert known["nobody found"]["fault"] is False
    assert "radar info missing" not in known
