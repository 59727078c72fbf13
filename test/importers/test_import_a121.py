"""Recordings of an A121: what the maker's recorder writes, made here by the layout that test/driver/test_a121_maker.py holds us to."""

import json

import numpy as np
import pytest

from radar_core import ConfigError, DataError
from radar_driver.a121.config import A121Config
from radar_lab.importers import open_original
from radar_ros.importing import import_recording

h5py = pytest.importorskip("h5py")
PAIR = np.dtype([("real", "<i2"), ("imag", "<i2")])


def subsweep(start=96, points=20, step=24):
    return {"start_point": start, "num_points": points, "step_length": step}


def record(path, values, *, subsweeps=None, rate=2000.0, ticks=None, fastest=5000.0, sessions=("sessions/session_0",), **more):
    """Write frames (frame, sweep, point) as the maker's recorder does; the second sensor of the group holds zeros."""
    settings = {"sweep_rate": rate, "sweeps_per_frame": values.shape[1], "subsweeps": subsweeps or [subsweep()]}
    pairs = np.zeros(values.shape, PAIR)
    pairs["real"], pairs["imag"] = values.real, values.imag
    with h5py.File(path, "w") as file:
        file["server_info"] = json.dumps({"ticks_per_second": 1000, "rss_version": "a121-v1.9.0"})
        for name in sessions:
            session = file.create_group(name)
            session["session_config"] = json.dumps({"groups": [{"1": settings, "3": settings}]})
            for k, sensor in enumerate((1, 3)):
                entry = session.create_group(f"group_0/entry_{k}")
                entry["sensor_id"] = sensor
                entry["metadata"] = json.dumps({"base_step_length_m": 0.00251, "max_sweep_rate": fastest})
                entry["result/frame"] = pairs if sensor == 1 else np.zeros_like(pairs)
                entry["result/tick"] = np.arange(len(values)) * 50 if ticks is None else np.array(ticks)
                for flag in ("data_saturated", "frame_delayed", "calibration_needed"):
                    entry[f"result/{flag}"] = np.zeros(len(values), bool) | more.get(flag, False)
    return path


@pytest.fixture
def values():
    return np.random.default_rng(3).integers(-2000, 2000, (5, 8, 20, 2)) @ [1, 1j]


def test_a_recording_comes_back(values, tmp_path):
    """Values, distances and times; the bag is made by the command's function."""
    path = record(tmp_path / "a.h5", values)
    recording = open_original("a121", path, height=0.8)
    frames = list(recording.items)
    grid = A121Config(num_points=20, sweeps_per_frame=8).grid()
    for frame, one in zip(frames, values, strict=True):
        np.testing.assert_allclose(grid.sweeps(frame.cube), one, rtol=1e-5, atol=0.02)
    np.testing.assert_array_equal(np.diff([frame.stamp_ns for frame in frames]), 50_000_000)
    info = recording.info
    assert (info.waveform.range_resolution, info.waveform.slow_interval) == pytest.approx((24 * 0.00251, 5e-4))
    assert (info.mount.z, info.waveform.frame_interval) == (0.8, 0.05)
    assert any("2 measurements; sensor 1 is read" in warning for warning in recording.tally.warnings)
    assert import_recording("a121", path, tmp_path / "bag").messages == {"/radar/info": 1, "/radar/frame": 5}


def test_options_and_older_files(values, tmp_path):
    """Another sensor, another session, one without number, a rate that the file leaves open, subsweeps in a row, flags."""
    path = record(tmp_path / "b.h5", values, sessions=("sessions/session_0", "sessions/session_1"), rate=None, data_saturated=True)
    silent = open_original("a121", path, sensor=3, session=1)
    assert not np.any([frame.cube for frame in silent.items])
    assert any("the fastest that the sensor could, 5000 Hz" in warning for warning in silent.tally.warnings)
    assert any("5 of 5 frames have the flag data_saturated" in warning for warning in silent.tally.warnings)
    assert open_original("a121", path, sweep_rate=1000.0).info.waveform.slow_interval == 1e-3
    row = [subsweep(96, 12), subsweep(96 + 12 * 24, 8)]
    old = record(tmp_path / "c.h5", values, sessions=("session",), subsweeps=row, ticks=[0, 50, 50, 100, 150])
    recording = open_original("a121", old)
    assert [frame.sequence for frame in recording.items] == [0, 1, 3, 4]
    assert recording.tally.dropped == {"frames whose time does not rise": 1}


@pytest.mark.parametrize(
    ("more", "options", "error", "message"),
    [
        ({}, {"session": 2}, DataError, "has no session 2"),
        ({}, {"sensor": 2}, DataError, "has no sensor 2; it has 1, 3"),
        ({"subsweeps": [subsweep(96, 19)]}, {}, DataError, "frames are .* expected 16-bit pairs"),
        ({"subsweeps": [subsweep(96, 10), subsweep(400, 10)]}, {}, DataError, "do not make one row of distances"),
        ({"subsweeps": [subsweep(100)]}, {}, DataError, "no multiple of their step"),
        ({"rate": None, "fastest": 0.0}, {}, ConfigError, "say it: -o sweep_rate=1000"),
        ({"ticks": [0, 50]}, {}, DataError, r"has \(2,\) times for 5 frames"),
        ({"subsweeps": "none"}, {}, DataError, "is no recording of an A121"),
    ],
)
def test_what_is_no_such_recording(values, tmp_path, more, options, error, message):
    """File and reason are named."""
    path = record(tmp_path / "d.h5", values, **more)
    with pytest.raises(error, match=message):
        open_original("a121", path, **options)


def test_no_hdf5_at_all(tmp_path):
    """One line."""
    path = tmp_path / "e.h5"
    path.write_bytes(b"nothing")
    with pytest.raises(DataError, match=r"e\.h5: cannot be read as \.h5"):
        open_original("a121", path)
    with h5py.File(path, "w") as file:
        file["other"] = 1
    with pytest.raises(DataError, match="has no session 0; is it a recording of an A121"):
        open_original("a121", path)
