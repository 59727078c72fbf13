"""Anybody's array and Infineon's folders: a simulated scene written in each way comes back as the same frames, or the same echoes."""

import json

import numpy as np
import pytest
import yaml

from radar_core import AntennaArray, ConfigError, DataError
from radar_core.waveform import SPEED_OF_LIGHT
from radar_dsp import Baseband, BasebandConfig
from radar_lab.importers import open_original
from radar_lab.importers.npy import to_frames
from radar_ros.importing import import_recording
from radar_sim import Simulator, load_scene

SCENE = """
duration: 0.2
seed: 2
radars: [{{waveform: {waveform}, array: {array}}}]
points: [{{position: [2.0, 0.5, 1.2], velocity: [0.6, 0, 0], rcs: 1.0}}]
effects: {{noise: {{}}}}
"""
WAVEFORM = {"carrier": 60.5e9, "bandwidth": 1e9, "chirp_duration": 64e-6, "chirp_pause": 36e-6, "frame_interval": 0.05, "n_chirp": 32}


def plain(array):
    return {"tx": [list(map(float, p)) for p in array.tx], "rx": [list(map(float, p)) for p in array.rx]}


def simulated(tmp_path, n_tx, n_sample):
    """Cubes (frame, tx, chirp, rx, sample) of a receding echo on the left, and the radar."""
    tx = [(0.0, 0.0), (4.0, 0.0)][:n_tx]
    rx = [(-1.0, 0.0), (0.0, 1.0), (0.0, 0.0)] if n_tx == 1 else [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (3.0, 0.0)]
    array = AntennaArray.from_half_wavelengths(tx, rx, 60.5e9)
    path = tmp_path / "scene.yaml"
    waveform = {**WAVEFORM, "n_tx": n_tx, "n_sample": n_sample}
    path.write_text(SCENE.format(waveform=json.dumps(waveform), array=json.dumps(plain(array))))
    simulator = Simulator(load_scene(path))
    return np.stack([simulator.process(k).frame.cube for k in range(4)]), simulator.info


@pytest.fixture
def scene(tmp_path):
    cubes, info = simulated(tmp_path, 2, 48)
    (tmp_path / "w.yaml").write_text(yaml.safe_dump({**WAVEFORM, "n_tx": 2, "n_sample": 48}))
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(plain(info.array)))
    return cubes, info, {"waveform": str(tmp_path / "w.yaml"), "array": str(tmp_path / "a.yaml")}


def pair(cubes):
    return np.stack([cubes.real, cubes.imag], -1)


@pytest.mark.parametrize(
    ("write", "options"),
    [
        (lambda c: c, {}),
        (lambda c: c.transpose(0, 2, 1, 3, 4).reshape(4, 64, 4, 48), {"axes": "frame pulse rx sample"}),
        (lambda c: c.transpose(0, 2, 4, 1, 3).reshape(4, 32, 48, 8), {"axes": "frame chirp sample channel"}),
        (lambda c: pair(c)[..., ::-1].transpose(5, 0, 1, 2, 3, 4), {"axes": "iq frame tx chirp rx sample", "quadrature": "q_first"}),
        (lambda c: pair(c).transpose(4, 3, 2, 1, 0, 5), {"axes": "sample rx chirp tx frame iq"}),
        (np.conj, {"conjugate": True}),
        (lambda c: c.imag + 1j * c.real, {"quadrature": "q_first"}),
    ],
    ids=["ours", "pulses", "channels", "q first", "iq last", "conjugated", "q as real part"],
)
def test_every_order_of_axes_gives_the_same_cubes(scene, tmp_path, write, options):
    """To the bit."""
    cubes, _, about = scene
    path = tmp_path / "cube.npy"
    np.save(path, write(cubes))
    for frame, cube in zip(open_original("npy", path, **about, **options).items, cubes, strict=True):
        np.testing.assert_array_equal(frame.cube, cube)


def test_it_becomes_a_bag(scene, tmp_path):
    """Through the command's function; five lines of Python do the same without."""
    cubes, info, about = scene
    np.save(tmp_path / "cube.npy", cubes)
    report = import_recording("npy", tmp_path / "cube.npy", tmp_path / "bag", **about)
    assert report.messages == {"/radar/info": 1, "/radar/frame": 4}
    assert len(list(to_frames(cubes[0], "tx chirp rx sample", info))) == 1


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"waveform": ""}, ConfigError, "say what the radar is: --waveform w.yaml --array a.yaml"),
        ({"axes": "frame tx chirp rx simple"}, DataError, "make no sense; name each once: frame, tx, chirp"),
        ({"axes": "frame tx chirp sample"}, DataError, "4 axes are named"),
        ({"axes": "frame pulse rx channel sample"}, DataError, "make no sense"),
        ({"axes": "frame tx rx chirp sample"}, DataError, r"cube.npy: .*has shape \(2, 4, 32, 48\)"),
    ],
)
def test_what_does_not_fit_is_named(scene, tmp_path, options, error, message):
    """Before anything is written."""
    cubes, _, about = scene
    np.save(tmp_path / "cube.npy", cubes)
    with pytest.raises(error, match=message):
        list(open_original("npy", tmp_path / "cube.npy", **{**about, **options}).items)


def recorder(folder, cubes):
    """A folder of Infineon's recorder: real samples (frame, rx, chirp, sample) around a half."""
    inner = folder / "RadarIfxAvian_00"
    inner.mkdir(parents=True)
    real = cubes[:, 0].transpose(0, 2, 1, 3).real
    np.save(inner / "radar.npy", (0.5 + real / (4 * np.abs(real).max())).astype(np.float32))
    shape = {"rx_antennas": [1, 2, 3], "lower_frequency_Hz": 60e9, "upper_frequency_Hz": 61e9, "num_chirps_per_frame": 32}
    shape |= {"num_samples_per_chirp": 128, "sample_rate_Hz": 2e6, "chirp_repetition_time_s": 1e-4, "frame_repetition_time_s": 0.05}
    (inner / "config.json").write_text(json.dumps({"device_config": {"fmcw_single_shape": shape}}))
    (inner / "meta.json").write_text("{}")
    return folder


def test_a_folder_of_the_recorder_gives_the_same_echo(tmp_path):
    """Real samples of three receivers in an L: range, range rate and both angles within half a standard deviation of the complex ones."""
    cubes, info = simulated(tmp_path, 1, 128)
    path = recorder(tmp_path / "BGT60TR13C_record", cubes)
    recording = open_original("bgt60", path)
    np.testing.assert_allclose(recording.info.array.virtual, info.array.virtual)
    assert recording.info.waveform.n_sample == 64
    ours = Baseband(BasebandConfig(), recording.info)
    theirs = Baseband(BasebandConfig(), info)
    for frame, other in zip(recording.items, to_frames(cubes, "frame tx chirp rx sample", info), strict=True):
        a, b = ours.process(frame), theirs.process(other)
        one, two = int(a.snr.argmax()), int(b.snr.argmax())
        for name in ("range", "radial_speed", "azimuth", "elevation"):
            std = max(getattr(b, f"{name}_std")[two], 1e-3)
            assert abs(getattr(a, name)[one] - getattr(b, name)[two]) < 0.5 * std, name
        assert a.azimuth[one] > 0.1
        assert a.radial_speed[one] > 0.3


def test_folders_that_are_no_recordings(tmp_path):
    """File and reason are named."""
    cubes, _ = simulated(tmp_path, 1, 128)
    folder = recorder(tmp_path / "record", cubes) / "RadarIfxAvian_00"
    (folder / "config.json").write_text('{"device_config": {}}')
    with pytest.raises(DataError, match=r"config\.json: does not describe a recording of a BGT60TR13C \(KeyError"):
        open_original("bgt60", folder)
    broken = recorder(tmp_path / "other", cubes)
    (broken / "RadarIfxAvian_00" / "radar.npy").write_bytes(b"nothing")
    with pytest.raises(DataError, match=r"cannot be read as \.npy"):
        open_original("bgt60", broken)


def test_places_in_half_wavelengths():
    """(y, z) to the left and up: an echo on the left reaches the left element first, so its phase is behind (see conventions)."""
    array = AntennaArray.from_half_wavelengths([(0, 0)], [(0, 0), (1, 0), (0, 1)], 60e9, tx_power=5.0)
    wavelength = SPEED_OF_LIGHT / 60e9
    np.testing.assert_allclose(array.virtual, [[0, 0], [wavelength / 2, 0], [0, wavelength / 2]])
    left = array.steering(np.radians(30.0), 0.0, wavelength)
    np.testing.assert_allclose(np.angle(left[1] / left[0]), -np.pi / 2)
    above = array.steering(0.0, np.radians(30.0), wavelength)
    np.testing.assert_allclose(np.angle(above[2] / above[0]), -np.pi / 2)
    assert array.tx_power == 5.0
