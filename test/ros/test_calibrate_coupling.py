"""The command `calibrate-coupling`: a recording of a 24 GHz radar's own leakage becomes knobs that a graph takes."""

import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from radar_app.cli import app
from radar_core import AntennaArray, PointCloud, RadarInfo, Waveform
from radar_core.config import load
from radar_dsp import BasebandConfig
from radar_ros.bags import BagWriter
from radar_ros.messages.convert import cloud_to_msg, frame_to_msg, info_to_msg

sys.path.insert(0, str(Path(__file__).parents[1] / "dsp"))
from echoes import amplitude_for, echo, frame, noise

INFO = RadarInfo(
    waveform=Waveform(carrier=24.125e9, bandwidth=250e6, chirp_duration=64e-6, chirp_pause=36e-6, n_tx=1, n_chirp=64, n_sample=32),
    array=AntennaArray.from_half_wavelengths([(0, 0)], [(0, 0), (1, 0)], 24.125e9),
)


@pytest.fixture
def bag(tmp_path):
    def write(name, items):
        with BagWriter(tmp_path / name) as writer:
            writer.put("/radar/info", items[0].stamp_ns, info_to_msg(INFO, items[0].stamp_ns))
            for item in items:
                topic, make = ("/radar/points", cloud_to_msg) if isinstance(item, PointCloud) else ("/radar/frame", frame_to_msg)
                writer.put(topic, item.stamp_ns, make(item))
        return tmp_path / name

    return write


def test_knobs_of_a_recording(bag, tmp_path):
    """Level and reach are told; the file is a configuration of the baseband that suppresses more than before."""
    rng = np.random.default_rng(5)
    leak = echo(INFO, 0.02, 0.0, 0.0, 0.0, amplitude_for(80, INFO))
    one = [frame(INFO, noise(INFO, rng), leak, stamp_ns=1 + k * 20_000_000, sequence=k) for k in range(12)]
    source, out = bag("empty", one), tmp_path / "coupling.yaml"
    done = CliRunner().invoke(app, ["calibrate-coupling", str(source), "-o", str(out), "--seconds", "0.15", "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert told["frames"] == 8
    assert told["level_db"] > 60
    found = load(BasebandConfig, yaml.safe_load(out.read_text())).coupling
    assert 1.2 < found.range_extent == told["range_extent"] < 5.0
    said = CliRunner().invoke(app, ["calibrate-coupling", str(source), "-o", str(out)])
    assert "dB above the noise" in said.stdout


def test_recordings_without_frames(bag, tmp_path):
    """One line says what to record."""
    empty = np.zeros(0, np.float32)
    cloud = PointCloud(1, 0, "radar", empty, empty, empty)
    source = bag("clouds", [cloud, dataclasses.replace(cloud, stamp_ns=2)])
    done = CliRunner().invoke(app, ["calibrate-coupling", str(source), "-o", str(tmp_path / "c.yaml")])
    assert done.exit_code == 2 or done.exception is not None
    assert not (tmp_path / "c.yaml").exists()
