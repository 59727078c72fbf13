"""The maker's own client against our emulated server: it takes it for a real one, and asks for the same measurement as our driver.

It needs older libraries than we do, so it lives in an environment of its own, whose Python the variable HANDWAVE_EXPTOOL names:
python -m venv exptool && exptool/bin/pip install acconeer-exptool && export HANDWAVE_EXPTOOL=$PWD/exptool/bin/python
"""

import json
import os
import subprocess
from pathlib import Path

import a121_emulator as emulated
import numpy as np
import pytest

from radar_driver.a121.config import A121Config
from radar_lab.importers import open_original

KNOBS = {"start_point": 96, "num_points": 20, "step_length": 24, "hwaas": 16, "sweeps_per_frame": 8, "receiver_gain": 16}


@pytest.fixture
def measured(tmp_path):
    """What the maker's client saw of six frames, what was sent, the commands it sent, and its recording."""
    python = os.environ.get("HANDWAVE_EXPTOOL", "")
    if not python:
        pytest.skip("HANDWAVE_EXPTOOL names no Python with acconeer-exptool")
    sent = [np.random.default_rng(k).integers(-900, 900, (8, 20, 2)) @ [1, 1j] for k in range(4)]
    server = emulated.Server([emulated.pack(one) for one in sent], interval=0.05)
    try:
        knobs = json.dumps({**KNOBS, "sweep_rate": 2000.0, "frame_rate": 20.0})
        script = str(Path(__file__).with_name("a121_maker.py"))
        done = subprocess.run(
            [python, script, str(server.port), str(tmp_path / "a.h5"), "6", knobs], capture_output=True, text=True, timeout=60
        )
    finally:
        server.close()
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), sent, server, tmp_path / "a.h5"


def test_the_makers_client_takes_our_server_for_a_real_one(measured):
    """It reads the values that were sent, and its command is ours, word for word."""
    seen, sent, server, _ = measured
    assert (seen["version"], seen["temperature"], seen["ticks"][:3]) == ("a121-v1.13.0", 31, [0, 50_000, 100_000])
    for k, (real, imag) in enumerate(seen["frames"]):
        np.testing.assert_array_equal(np.array(real) + 1j * np.array(imag), sent[k % 4])
    assert server.said == ["get_system_info", "get_sensor_info", "setup", "start_streaming", "stop_streaming"]
    assert server.setups[0]["groups"] == A121Config(**KNOBS).setup()["groups"]


def test_the_makers_recording_is_read(measured):
    """The same values and times come out of its file."""
    _, sent, _, path = measured
    pytest.importorskip("h5py")
    recording = open_original("a121", path)
    grid = A121Config(**KNOBS).grid()
    frames = list(recording.items)
    assert len(frames) == 6
    for k, frame in enumerate(frames):
        np.testing.assert_allclose(grid.sweeps(frame.cube), sent[k % 4], rtol=1e-5, atol=0.01)
    np.testing.assert_array_equal(np.diff([frame.stamp_ns for frame in frames]), 50_000_000)
