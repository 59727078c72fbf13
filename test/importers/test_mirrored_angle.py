"""Mirrored angles are named when one says to which side somebody walked; otherwise they cannot be told, and are not."""

import dataclasses
import json

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from benchmarks.probe import RADARS
from radar_app.cli import app
from radar_core import AntennaArray, DataError
from radar_core.config import load
from radar_lab.cube_faults import name_fault
from radar_lab.mirrored_angle import name_mirrored
from radar_sim import Scene, Simulator


def crossing(radar, side, n=24):
    """Somebody who walks across the view, 2.5 m away, from one side to the other, among furniture."""
    waveform, places = RADARS[radar]
    array = AntennaArray() if places is None else AntennaArray.from_half_wavelengths(*places, waveform["carrier"])
    described = {"waveform": {**waveform, "frame_interval": 0.05}, "array": {"tx": array.tx, "rx": array.rx}, "mount": {"z": 1.2}}
    start = -1.0 if side == "left" else 1.0
    walker = {"id": 1, "position": [2.5, start], "script": [{"walk": {"to": [2.5, -start], "speed": 1.1}}]}
    still = [{"position": [4.0, 1.5, 1.0], "rcs": 0.2}, {"position": [3.2, -1.2, 0.6], "rcs": 0.1}]
    scene = {
        "duration": 2.0,
        "seed": 5,
        "radars": [described],
        "points": still,
        "people": [walker],
        "effects": {"noise": {"noise_figure": 15}},
    }
    simulator = Simulator(load(Scene, scene))
    return np.stack([simulator.process(k + 8).frame.cube for k in range(n)]), simulator.info


def mirrored(info):
    """The same radar, its array entered as seen from the front."""
    array = dataclasses.replace(info.array, tx=tuple((-y, z) for y, z in info.array.tx), rx=tuple((-y, z) for y, z in info.array.rx))
    return dataclasses.replace(info, array=array)


@pytest.mark.parametrize("radar", ["77 GHz, 2 x 4", "60 GHz, 1 x 3"])
@pytest.mark.parametrize("side", ["left", "right"])
def test_it_takes_the_side_to_tell(radar, side):
    """Right arrays agree, mirrored ones are named; without the side nothing speaks against either."""
    cubes, info = crossing(radar, side)
    assert name_mirrored(cubes, info, side) is None
    fault = name_mirrored(cubes, mirrored(info), side)
    assert fault.name == "mirrored angle"
    assert f"walked to the {side}, but by the angles" in fault.reason
    other = "right" if side == "left" else "left"
    assert name_mirrored(cubes, info, other).name == "mirrored angle"
    for one in (info, mirrored(info)):
        found = name_fault(cubes, one)
        assert found is None or found.name != "mirrored angle"


def test_what_cannot_be_told_is_refused():
    """Nobody who walks; an array without azimuth; a walk that goes nowhere."""
    cubes, info = crossing("77 GHz, 2 x 4", "left", n=10)
    with pytest.raises(DataError, match="in 0 of 10 frames somebody moves"):
        name_mirrored((np.random.default_rng(1).normal(size=(*cubes.shape, 2)) @ [1, 1j]).astype(np.complex64), info, "left")
    one = dataclasses.replace(info, array=AntennaArray(tx=((0.0, 0.0), (0.0, 0.0)), rx=((0.0, 0.0),) * 4))
    with pytest.raises(DataError, match="with an array that measures azimuth"):
        name_mirrored(cubes, one, "left")
    there_and_back = np.concatenate([cubes, cubes[::-1]])
    with pytest.raises(DataError, match="too little to tell the side"):
        name_mirrored(there_and_back, info, "left")


def test_the_command(tmp_path):
    """Status 0 or 1, and 2 for words that make no sense."""
    cubes, info = crossing("77 GHz, 2 x 4", "left")
    names = ("carrier", "bandwidth", "chirp_duration", "chirp_pause", "frame_interval", "n_tx", "n_chirp", "n_sample")
    (tmp_path / "w.yaml").write_text(yaml.safe_dump({name: getattr(info.waveform, name) for name in names}))
    (tmp_path / "a.yaml").write_text(yaml.safe_dump({"tx": [list(p) for p in info.array.tx], "rx": [list(p) for p in info.array.rx]}))
    np.save(tmp_path / "cube.npy", cubes)
    about = ["probe", str(tmp_path / "cube.npy"), "--waveform", str(tmp_path / "w.yaml"), "--array", str(tmp_path / "a.yaml"), "--json"]
    good, bad = (CliRunner().invoke(app, [*about, "--walked", side]) for side in ("left", "right"))
    assert (good.exit_code, json.loads(good.stdout)["fault"]) == (0, None)
    assert (bad.exit_code, json.loads(bad.stdout)["fault"]["name"]) == (1, "mirrored angle")
    for wrong in ([*about, "--walked", "up"], ["probe", "sim", "--walked", "left"]):
        assert CliRunner().invoke(app, wrong).exit_code != 0
