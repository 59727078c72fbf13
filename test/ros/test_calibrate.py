"""The command's logic: recordings of turntables to array files."""

import dataclasses
import shutil

import numpy as np
import pytest

from radar_core import ConfigError, DataError
from radar_dsp.array_file import load_array
from radar_lab.arrays.calibration import Calibration
from radar_lab.arrays.turntable import SWEEPS_FILE, parse_sweep
from radar_ros.turntables import calibrate, record_turntable
from radar_sim.turntable import ChannelErrors, Sweep, Turntable, TurntableSimulator

SWEEPS = (Sweep(step=4.0), Sweep(axis="elevation", start=-30.0, stop=30.0, step=4.0))
TURNTABLE = Turntable(sweeps=SWEEPS, errors=ChannelErrors(seed=11), frames=2)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """One bag with both sweeps, and one for each."""
    folder = tmp_path_factory.mktemp("turntable")
    for name, sweeps in (("both", SWEEPS), ("azimuth", SWEEPS[:1]), ("elevation", SWEEPS[1:])):
        for _ in record_turntable(dataclasses.replace(TURNTABLE, sweeps=sweeps), folder / name):
            pass
    return folder


def shifts_found(report) -> np.ndarray:
    """Errors of the shifts, their mean taken out [m]."""
    errors = np.array(report.result.array.channel_shift) - np.array(TurntableSimulator(TURNTABLE).array.channel_shift)
    return errors - errors.mean(axis=0)


@pytest.mark.long
def test_one_recording_two_recordings_and_options_agree(recordings, tmp_path):
    """Both sweeps in one bag, one bag each, and angles given by options instead of files find the same array."""
    one = calibrate([recordings / "both"], tmp_path / "one.npz")
    two = calibrate([recordings / "azimuth", recordings / "elevation"], tmp_path / "two.npz")
    options = [parse_sweep("azimuth", "-60:60:4", 1.0), parse_sweep("elevation", "-30:30:4", 1.0)]
    given = calibrate([recordings / "both"], tmp_path / "given.npz", options)
    assert given.result.array == one.result.array
    for report in (one, two):
        # 30 dB less 3 dB of the range window, 94 frames: the table in docs/how-to/calibration.md has 5 and 12 um for twice as many.
        assert np.abs(shifts_found(report)).max() < 6e-5
        assert report.result.notes() == []
        assert report.result.n_snapshot == 94
    assert load_array(tmp_path / "one.npz").array == one.result.array
    assert (tmp_path / "one.png").exists()
    assert len(one.lines()) == 2 + 8 + 2


def test_settling_frames_are_left_out(recordings, tmp_path):
    """Frames at the change of an angle are dropped: of two a dwell the first; too much settling leaves angles without a frame."""
    options = [parse_sweep("azimuth", "-60:60:4", 1.0, 0.3)]
    report = calibrate([recordings / "azimuth"], tmp_path / "a.npz", options)
    assert report.result.n_snapshot == 31
    assert any("not observable" in line for line in report.lines())
    with pytest.raises(DataError, match="frames meet only 0"):
        calibrate([recordings / "azimuth"], tmp_path / "a.npz", [parse_sweep("azimuth", "-60:60:4", 1.0, 0.495)])


def test_wrong_angles_are_refused_with_advice(recordings, tmp_path):
    """A dwell that does not match, the wrong sense, a bad option, no file and too many sweeps."""
    out = tmp_path / "a.npz"
    with pytest.raises(DataError, match="check begin, dwell"):
        calibrate([recordings / "azimuth"], out, [parse_sweep("azimuth", "-60:60:4", 1.2)])
    with pytest.raises(DataError, match="counts the other way"):
        calibrate([recordings / "azimuth"], out, [parse_sweep("azimuth", "60:-60:-4", 1.0)])
    with pytest.raises(ConfigError, match="write start:stop:step"):
        parse_sweep("azimuth", "-60..60", 1.0)
    with pytest.raises(ConfigError, match="one sweep each"):
        calibrate([recordings / "azimuth", recordings / "elevation"], out, [parse_sweep("azimuth", "-60:60:4", 1.0)] * 3)
    with pytest.raises(ConfigError, match="at least one recording"):
        calibrate([], out)
    bare = tmp_path / "bare"
    shutil.copytree(recordings / "azimuth", bare)
    (bare / SWEEPS_FILE).unlink()
    with pytest.raises(ConfigError, match=r"docs/how-to/calibration\.md"):
        calibrate([bare], out)
    (bare / SWEEPS_FILE).write_text("sweeps:\n  - {axis: roll}\n")
    with pytest.raises(ConfigError, match=r"turntable.yaml:2: .*'azimuth', 'elevation'"):
        calibrate([bare], out)
    assert not out.exists()


def test_recordings_of_different_radars_are_refused(recordings, tmp_path):
    """Two bags must be of one radar."""
    other = dataclasses.replace(TURNTABLE.radar, array=dataclasses.replace(TURNTABLE.radar.array, gain=3.0))
    for _ in record_turntable(Turntable(radar=other, sweeps=(Sweep(step=60.0),)), tmp_path / "other"):
        pass
    with pytest.raises(DataError, match="another radar"):
        calibrate([recordings / "azimuth", tmp_path / "other"], tmp_path / "a.npz", config=Calibration())
