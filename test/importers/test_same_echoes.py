"""A simulated scene written in each format of raw frames comes back as the same echoes: all above 20 dB, within half a standard deviation.

Formats of clouds: test_same_clouds.py. The boards' own wires are in test/driver: test_same_echoes_wire.py, test_tinyrad_scene.py,
test_dca1000_stream.py, test_a121.py.
"""

import dataclasses
import json

import numpy as np
import pytest
import yaml
from originals import CFG, encode, packets, write_pcap
from test_import_a121 import record as write_a121
from test_import_npy import recorder, simulated
from test_import_studio import studio

from radar_core import Pose, RadarFrame
from radar_driver.a121.config import A121Config
from radar_driver.dca1000.ti_config import radar_info, read_ti_config
from radar_driver.tinyrad.convert import analytic
from radar_dsp import Baseband, BasebandConfig
from radar_lab.importers import open_original
from radar_sim import Effects, Scene, Simulator
from radar_sim.effects.config import NoiseConfig
from radar_sim.scene import SceneRadar
from radar_sim.things import Point

POINTS = ((1.6, 0.4, 1.2), (-0.7, 0, 0)), ((2.7, -0.6, 1.2), (0.9, 0, 0)), ((2.2, 0.9, 1.2), (0, 0, 0))
MEASURED = ("range", "radial_speed", "azimuth", "elevation")


NEAR = ((0.19, 0.02, 1.2), (-0.5, 0, 0)), ((0.2, -0.04, 1.2), (0.4, 0, 0))
"""Hands within the third of a metre that 8 range cells of 4 cm are."""


def cubes_of(info, rcs=1.0, n=3, noise=True, places=POINTS):
    """Frames of three echoes in noise, as counts of which the noise has some tens."""
    points = tuple(Point(position=place, velocity=speed, rcs=rcs) for place, speed in places)
    radar = SceneRadar.of(type(info)(waveform=info.waveform, array=info.array, mount=Pose(z=1.2)))
    simulator = Simulator(
        Scene(duration=1.0, seed=3, radars=(radar,), points=points, effects=Effects(noise=NoiseConfig() if noise else None))
    )
    cubes = np.stack([simulator.process(k).frame.cube for k in range(n)])
    return cubes * (20000 / np.abs(cubes).max())


def npy(folder):
    cubes, info = simulated(folder, 2, 48)
    names = ("carrier", "bandwidth", "chirp_duration", "chirp_pause", "frame_interval", "n_tx", "n_chirp", "n_sample")
    (folder / "w.yaml").write_text(yaml.safe_dump({name: getattr(info.waveform, name) for name in names}))
    (folder / "a.yaml").write_text(yaml.safe_dump({"tx": [list(p) for p in info.array.tx], "rx": [list(p) for p in info.array.rx]}))
    cubes = cubes_of(info)
    np.save(folder / "cube.npy", np.stack([cubes.real, cubes.imag], -1).round().astype(np.int16))
    about = {"waveform": str(folder / "w.yaml"), "array": str(folder / "a.yaml"), "axes": "frame tx chirp rx sample iq"}
    return cubes, info, open_original("npy", folder / "cube.npy", **about)


def ti(folder, swapped=None):
    (folder / "radar.cfg").write_text(CFG.format(n_sample=64, n_chirp=16))
    info = radar_info(read_ti_config(folder / "radar.cfg"))
    cubes = cubes_of(info)
    counts = np.round(cubes.real) + 1j * np.round(cubes.imag)
    words = counts.imag + 1j * counts.real if swapped == 0 else counts
    (folder / "adc_data.bin").write_bytes(b"".join(encode(one) for one in words))
    if swapped is not None:
        (folder / "radar.cfg").unlink()
        (folder / "x.mmwave.json").write_text(json.dumps(studio(swapped, numLoops=16)))
    return cubes, info, open_original("dca1000_bin", folder / "adc_data.bin")


def pcap(folder):
    (folder / "radar.cfg").write_text(CFG.format(n_sample=64, n_chirp=16))
    info = radar_info(read_ti_config(folder / "radar.cfg"))
    cubes = cubes_of(info)
    write_pcap(folder / "c.pcap", packets(b"".join(encode(np.round(one.real) + 1j * np.round(one.imag)) for one in cubes)))
    return cubes, info, open_original("dca1000", folder / "c.pcap")


def openradar(folder):
    """Signed counts stored as unsigned, channel = transmitter times receivers plus receiver."""
    np.save(folder / "a.npy", np.zeros((1, 64, 8, 64), complex))
    info = open_original("openradar", folder / "a.npy").info
    cubes = cubes_of(info)
    counts = cubes.swapaxes(1, 2).reshape(len(cubes), 64, 8, 64)
    parts = [np.round(part) % 65536 for part in (counts.real, counts.imag)]
    np.save(folder / "a.npy", parts[0] + 1j * parts[1])
    return cubes, info, open_original("openradar", folder / "a.npy")


def cubelearn(folder):
    about = {"slope": 60e12, "sample_rate": 6e6, "chirp_interval": 70e-6}
    np.save(folder / "0_1_2.npy", np.zeros((2, 1, 128, 12, 256)))
    info = open_original("cubelearn", folder / "0_1_2.npy", **about).info
    cubes = cubes_of(info)
    counts = cubes.swapaxes(1, 2).reshape(len(cubes), 128, 12, 256)
    np.save(folder / "0_1_2.npy", np.stack([counts.real, counts.imag]).round())
    return cubes, info, open_original("cubelearn", folder / "0_1_2.npy", **about)


def as_real(fine, coarse, width=400):
    """Real samples of what was simulated at twice the rate, and what they should become; the same noise goes onto both."""
    noise = np.random.default_rng(4).normal(size=fine.shape).astype(np.float32) * width
    made = analytic((fine.real - fine.real.mean(axis=-1, keepdims=True)).astype(np.float32))
    gain = np.vdot(coarse, made) / np.vdot(coarse, coarse)
    return fine.real + noise, gain * coarse + analytic(noise - noise.mean(axis=-1, keepdims=True))


def bgt60_eth(folder):
    """Eight range cells, of which a hand's echo fills two: echoes of 22 to 26 dB in the cells 3 and 4.

    Nearer, an echo overlaps with its own mirror image; and at 60 dB the deviations are so small that the making of complex samples out of
    16 real ones shows, by up to three of them.
    """
    np.save(folder / "a.npy", np.zeros((1, 16, 96, 16, 3)))
    info = open_original("bgt60_eth", folder / "a.npy").info
    fine = type(info)(waveform=dataclasses.replace(info.waveform, n_sample=16), array=info.array)
    real, cubes = as_real(*(cubes_of(one, rcs=0.01, noise=False, places=NEAR, n=2) for one in (fine, info)), width=8000)
    np.save(folder / "a.npy", real[:, 0].transpose(0, 1, 3, 2)[None].round().astype(np.int32) + 2048)
    return cubes, info, open_original("bgt60_eth", folder / "a.npy")


def bgt60(folder):
    """Real samples around a half."""
    _, whole = simulated(folder, 1, 128)
    half = dataclasses.replace(whole, waveform=dataclasses.replace(whole.waveform, n_sample=64))
    real, cubes = as_real(*(cubes_of(info, noise=False) for info in (whole, half)))
    recording = open_original("bgt60", recorder(folder / "BGT60TR13C_record", real + 0j))
    return cubes, recording.info, recording


def a121(folder):
    pytest.importorskip("h5py")
    config = A121Config(start_point=0, num_points=60)
    info, grid = config.info(0.00251), config.grid()
    cubes = cubes_of(info, rcs=300.0)
    values = np.stack([grid.sweeps(one / 8) for one in cubes])  # an inverse transform of 64 cells: a tone has eight times its samples
    subsweeps = [{"start_point": 0, "num_points": 60, "step_length": 24}]
    path = write_a121(folder / "a.h5", np.round(values.real) + 1j * np.round(values.imag), subsweeps=subsweeps)
    return np.stack([grid.cube(one.astype(np.complex64)) for one in values]), info, open_original("a121", path)


@pytest.mark.long
@pytest.mark.parametrize(
    "write",
    [npy, ti, lambda f: ti(f, 0), lambda f: ti(f, 1), pcap, openradar, cubelearn, bgt60, bgt60_eth, a121],
    ids=["npy", "dca1000_bin", "studio", "swapped", "dca1000", "openradar", "cubelearn", "bgt60", "bgt60_eth", "a121"],
)
def test_the_same_echoes_come_back(tmp_path, write):
    """Range, range rate and what the array measures of the direction."""
    cubes, info, recording = write(tmp_path)
    ours, theirs = Baseband(BasebandConfig(), info), Baseband(BasebandConfig(), recording.info)
    compared = 0
    for k, frame in enumerate(recording.items):
        sure, found = ours.process(RadarFrame(cubes[k].astype(np.complex64), 0, k, "radar")), theirs.process(frame)
        assert sum(sure.snr > 20) > 1
        for i in np.flatnonzero(sure.snr > 20):
            errors = [
                np.abs(getattr(found, name) - getattr(sure, name)[i]) / max(getattr(sure, f"{name}_std")[i], 1e-4)
                for name in MEASURED
                if np.isfinite(getattr(sure, name)[i])
            ]
            assert np.min(np.max(errors, axis=0)) < 0.5, (k, sure.range[i], sure.radial_speed[i])
            compared += 1
    assert compared >= 4
