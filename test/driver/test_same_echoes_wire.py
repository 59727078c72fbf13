"""A simulated scene's clouds, sent as each board sends them through a real line, come back as the same echoes.

All above 20 dB are within half a standard deviation, or half of the format's own unit where that is more: packed points have angles in
steps of 0.01 rad. Raw frames of boards are in test_tinyrad_scene.py, test_dca1000_stream.py and test_a121.py.
"""

import struct

import ld2450_emulator as ld
import numpy as np
import pytest
import ti_demo_emulator as ti
from test_pointcloud2 import message
from test_ti_demo_packets import compressed

from radar_core import AntennaArray, RadarInfo, Waveform
from radar_driver.foreign import ForeignConfig, foreign_cloud
from radar_driver.ld2450.source import Ld2450, Ld2450Config
from radar_driver.ti_demo.source import TiDemo, TiDemoConfig
from radar_dsp import Baseband, BasebandConfig
from radar_ros.messages.pointcloud2 import read_fields
from radar_sim import Effects, Scene, Simulator
from radar_sim.effects.config import NoiseConfig
from radar_sim.scene import SceneRadar
from radar_sim.things import Point

PLACES = ((1.6, 0.4, 0.1), (-0.7, 0, 0)), ((2.7, -0.6, -0.2), (0.9, 0, 0)), ((2.2, 0.9, 0.0), (0.2, 0, 0))


@pytest.fixture(scope="module")
def clouds():
    """Three clouds of three echoes, of a radar that sees azimuth and elevation."""
    waveform = Waveform(
        carrier=60.5e9, bandwidth=2e9, chirp_duration=64e-6, chirp_pause=36e-6, frame_interval=0.1, n_tx=2, n_chirp=32, n_sample=64
    )
    array = AntennaArray.from_half_wavelengths([(0.0, 0.0), (0.0, 1.0)], [(float(k), 0.0) for k in range(4)], waveform.carrier)
    points = tuple(Point(position=place, velocity=speed, rcs=1e-4) for place, speed in PLACES)
    radar = SceneRadar.of(RadarInfo(waveform=waveform, array=array))
    simulator = Simulator(Scene(duration=0.5, seed=3, radars=(radar,), points=points, effects=Effects(noise=NoiseConfig())))
    baseband = Baseband(BasebandConfig(), simulator.info)
    made = [baseband.process(simulator.process(k).frame) for k in range(3)]
    assert all(np.sum(cloud.snr > 20) >= 3 for cloud in made)
    return [cloud.select(np.isfinite(cloud.elevation)) for cloud in made]


def spherical(cloud):
    """TI's angles: to the right, and up."""
    return cloud.range, -cloud.azimuth, cloud.elevation


def ratio(cloud):
    return 10 ** (cloud.snr / 10)


def demo(number, cloud, kind, value, make=ti.demo_packet):
    """A packet of the newer demos with one item of points and their SNR."""
    side = ti.item(7, ti.side(cloud.snr, np.full(len(cloud), 40.0)))
    return make(number, [ti.item(kind, value), side], len(cloud))


def area_scanner(number, items, n_points):
    """A header with one more number at its end."""
    plain = ti.demo_packet(number, items, n_points)
    body = b"".join(items)
    length = -(-(44 + len(body)) // 32) * 32
    return (plain[:12] + struct.pack("<I", length) + plain[16:40] + bytes(4) + body).ljust(length, b"\x0f")


def cartesian(number, cloud):
    return ti.cloud_packet(number, cloud)


def ranges_and_angles(number, cloud):
    return demo(number, cloud, 1000, ti.floats(*spherical(cloud), cloud.radial_speed))


def scanner(number, cloud):
    return demo(number, cloud, 1, ti.floats(*spherical(cloud), cloud.radial_speed), area_scanner)


def xwrl6432(number, cloud):
    places = np.stack([-cloud.y, cloud.x, cloud.z], axis=-1)
    return ti.demo_packet(number, [ti.item(301, compressed(places, cloud.radial_speed, cloud.snr, np.full(len(cloud), 40.0)))], len(cloud))


def people_3d(number, cloud):
    return ti.demo_packet(number, [ti.item(1020, ti.packed(*spherical(cloud), cloud.radial_speed, ratio(cloud)))], len(cloud))


def old_people_3d(number, cloud):
    return ti.people_3d_packet(number, [ti.item(6, ti.packed(*spherical(cloud), cloud.radial_speed, ratio(cloud)), True)])


def old_people_2d(number, cloud):
    return ti.people_2d_packet(number, [ti.item(6, ti.floats(cloud.range, -cloud.azimuth, cloud.radial_speed, ratio(cloud)), True)])


EXACT = {"range": 1e-5, "radial_speed": 1e-5, "azimuth": 1e-5, "elevation": 1e-5}
PACKED = {"range": ti.UNITS[3] / 2, "radial_speed": ti.UNITS[2] / 2, "azimuth": ti.UNITS[1] / 2, "elevation": ti.UNITS[0] / 2}
FORMATS = [
    (cartesian, EXACT),
    (ranges_and_angles, EXACT),
    (scanner, EXACT),
    (xwrl6432, {"range": 9e-4, "radial_speed": 5e-3, "azimuth": 5e-4, "elevation": 5e-4}),
    (people_3d, PACKED),
    (old_people_3d, PACKED),
    (old_people_2d, {name: EXACT[name] for name in ("range", "radial_speed", "azimuth")}),
]


def check(clouds, back, least):
    """Compare all strong echoes; gives how many."""
    assert [len(cloud) for cloud in back] == [len(cloud) for cloud in clouds]
    compared = 0
    for sure, found in zip(clouds, back, strict=True):
        strong = np.flatnonzero(sure.snr > 20)
        for name, unit in least.items():
            error = np.abs(getattr(found, name)[strong] - getattr(sure, name)[strong])
            assert (error <= np.maximum(0.5 * getattr(sure, f"{name}_std")[strong], 1.01 * unit)).all(), name
        compared += len(strong)
    return compared


def listened(source, n):
    """Read so many readings of a source."""
    found = []
    for _ in range(600):
        reading = source.read(0.05)
        if reading is not None and len(reading.data):
            found.append(reading.data)
        if len(found) == n:
            break
    return found


@pytest.mark.parametrize(("write", "least"), FORMATS, ids=[write.__name__ for write, _ in FORMATS])
def test_points_of_every_demo(tmp_path, clouds, write, least):
    """Through a pseudo terminal and the whole source."""
    board = ti.Board(tmp_path / "ttyACM1")
    source = TiDemo(TiDemoConfig(port=str(board.link), silence=30.0))
    source.power_up()
    source.resume()
    try:
        board.send_all(b"".join(write(k, cloud) for k, cloud in enumerate(clouds)))
        assert check(clouds, listened(source, 3), least) >= 9
        assert source.report()["refused"] == 0
    finally:
        source.power_down()
        board.unplug()


def test_targets_of_an_ld2450(tmp_path, clouds):
    """The three echoes as the board's three targets: within half of what the driver says of its places; speeds to half of 1 cm/s."""
    board = ld.Board(tmp_path / "ttyUSB0")
    source = Ld2450(Ld2450Config(port=str(board.link), speed_sign=1, silence=30.0))
    source.power_up()
    source.resume()
    try:
        for cloud in clouds:
            strong = [int(np.abs(cloud.position - place).sum(axis=1).argmin()) for place, _ in PLACES]
            board.send_all(ld.report(*((-cloud.y[i], cloud.x[i], cloud.radial_speed[i]) for i in strong)))
            (found,) = listened(source, 1)
            std = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
            error = np.abs(found.position[:, :2] - cloud.position[strong, :2])
            assert (error < 0.5 * std[:, :2]).all()
            assert (error < 1e-3).all()
            np.testing.assert_allclose(found.radial_speed, cloud.radial_speed[strong], atol=0.0051)
    finally:
        source.power_down()
        board.close()


def test_fields_of_a_point_cloud_message(clouds):
    """Single precision, in TI's axes with approaching positive and amplitudes, as one driver may send them."""
    settings = ForeignConfig(axes="ti", doppler_sign=-1, intensity_unit="amplitude")
    back = []
    for cloud in clouds:
        values = {"x": -cloud.y, "y": cloud.x, "z": cloud.z, "velocity": -cloud.radial_speed, "intensity": 10 ** (cloud.snr / 20)}
        fields = read_fields(message(values), settings.names, "points")
        back.append(foreign_cloud(fields, settings, cloud.stamp_ns, cloud.sequence, "radar")[0])
    assert check(clouds, back, EXACT) >= 9
