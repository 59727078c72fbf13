"""Faults of raw frames are named from the data alone; healthy ones are not accused. Scenes are those that the checks were made with."""

import json

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from benchmarks.probe import DEVELOPED, FAULTS, RADARS, record
from radar_app.cli import app
from radar_core import DataError
from radar_lab.cube_faults import name_fault


@pytest.mark.long
@pytest.mark.parametrize("number", range(len(FAULTS)))
def test_a_fault_is_named(number):
    """Two cubes with each of six faults."""
    name, radar, spoil = FAULTS[number]
    cubes, info = record(radar, DEVELOPED + number)
    fault = name_fault(spoil(cubes), info)
    assert fault is not None
    assert fault.name == name


@pytest.mark.parametrize("radar", RADARS)
def test_healthy_frames_are_not_accused(radar):
    """Nor are they without anybody, in noise alone, or where a frame is too little to tell."""
    cubes, info = record(radar, DEVELOPED + 50)
    assert name_fault(cubes, info) is None
    assert name_fault(cubes[:1], info) is None
    rng = np.random.default_rng(0)
    noise = (rng.normal(size=cubes.shape) + 1j * rng.normal(size=cubes.shape)).astype(np.complex64)
    assert name_fault(noise, info) is None


def test_what_is_no_frame_of_this_radar():
    """Sizes in another order are a fault; other sizes are another radar; nothing but zeros, and no numbers, are a wrong format."""
    cubes, info = record("24 GHz, 2 x 4", DEVELOPED)
    assert name_fault(cubes.transpose(0, 2, 1, 3, 4), info).name == "axis order"
    with pytest.raises(DataError, match="it is another radar's; check waveform and array"):
        name_fault(cubes[:, :, :-1], info)
    assert name_fault(np.zeros_like(cubes), info).name == "sample format"
    assert name_fault(cubes * np.float32(np.nan), info).name == "sample format"


def test_the_command(tmp_path):
    """Status 0 and nothing to say, or 1, the fault and what to do; as text and as JSON; of a bag too."""
    from radar_ros.importing import import_recording

    cubes, info = record("24 GHz, 2 x 4", DEVELOPED)
    names = ("carrier", "bandwidth", "chirp_duration", "chirp_pause", "frame_interval", "n_tx", "n_chirp", "n_sample")
    (tmp_path / "w.yaml").write_text(yaml.safe_dump({name: getattr(info.waveform, name) for name in names}))
    (tmp_path / "a.yaml").write_text(yaml.safe_dump({"tx": [list(p) for p in info.array.tx], "rx": [list(p) for p in info.array.rx]}))
    about = ["--waveform", str(tmp_path / "w.yaml"), "--array", str(tmp_path / "a.yaml")]
    for name, array in (("good", cubes), ("bad", cubes.conj()), ("order", cubes.transpose(0, 2, 1, 3, 4))):
        np.save(tmp_path / f"{name}.npy", array)
    done = CliRunner().invoke(app, ["probe", str(tmp_path / "good.npy"), *about])
    assert done.exit_code == 0, done.output
    assert "20 frames: nothing speaks against these frames" in done.output
    done = CliRunner().invoke(app, ["probe", str(tmp_path / "bad.npy"), *about, "--json"])
    assert done.exit_code == 1
    assert json.loads(done.stdout)["fault"]["name"] == "swapped I/Q"
    assert "axis order" in CliRunner().invoke(app, ["probe", str(tmp_path / "order.npy"), *about]).output
    import_recording("npy", tmp_path / "bad.npy", tmp_path / "bag", waveform=about[1], array=about[3])
    done = CliRunner().invoke(app, ["probe", str(tmp_path / "bag")])
    assert (done.exit_code, "swapped I/Q" in done.output) == (1, True)
