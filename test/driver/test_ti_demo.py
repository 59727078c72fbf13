"""A TI board on a real pseudo terminal: clouds, every fault a serial line knows, and nothing left behind."""

import math
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
import ti_demo_emulator as ti
from leftovers import held, left_since

from radar_core import ConfigError, DataError, DeviceError, PointCloud, Pose, Quality
from radar_core.geometry import cartesian_to_spherical, spherical_to_cartesian
from radar_driver.boards import boards
from radar_driver.live import Reader
from radar_driver.ti_demo.source import TiDemo, TiDemoConfig, Uart

CFG = """% Platform:xWR18xx
sensorStop
flushCfg
channelCfg 15 5 0
adcCfg 2 1
profileCfg 0 77 7 7 58 0 0 68 1 256 5500 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
frameCfg 0 1 32 0 50 1 0
clutterRemoval -1 1

sensorStart
"""


def cloud(number=0, n=6):
    """Points of a body in front of the radar, as our baseband would give them."""
    rng = np.random.default_rng(number)
    distance, azimuth, elevation = rng.uniform(1, 4, n), rng.uniform(-0.8, 0.8, n), rng.uniform(-0.4, 0.4, n)
    xyz = spherical_to_cartesian(distance, azimuth, elevation)
    columns = (*xyz.T, distance, azimuth, elevation, rng.uniform(-2, 2, n), rng.uniform(8, 30, n))
    names = ("x", "y", "z", "range", "azimuth", "elevation", "radial_speed", "snr")
    return PointCloud(0, number, "radar", **{k: np.asarray(v, np.float32) for k, v in zip(names, columns, strict=True)})


def packet(number, n=6):
    return ti.cloud_packet(number, cloud(number, n))


@pytest.fixture
def board(tmp_path):
    """An emulated board; unplugged at the end."""
    emulated = ti.Board(tmp_path / "ttyACM1")
    yield emulated
    emulated.unplug()


@pytest.fixture
def source(board):
    """A source on the board's port; closed at the end."""
    made = []

    def open_(send=None, **knobs):
        settings = TiDemoConfig(port=str(board.link), **knobs)
        made.append(TiDemo(settings, **({"send": send} if send else {})))
        made[-1].power_up()
        made[-1].resume()
        return made[-1]

    yield open_
    for one in made:
        one.power_down()


def read(source, count=1, timeout=3.0):
    """Read so many clouds, or as many as come."""
    found, end = [], time.monotonic() + timeout
    while len(found) < count and time.monotonic() < end:
        reading = source.read(0.05)
        if reading is not None:
            found.append(reading.data)
    return found


def test_clouds_come_through_the_line(board, source):
    """Our axes, ranges and angles that fit the positions, dB to a tenth, the board's own count, and stamps that rise."""
    device = source(mount=Pose(z=1.5), frame_id="left")
    board.send_all(b"".join(packet(k, k) for k in range(8)))
    clouds = read(device, 8)
    assert [c.sequence for c in clouds] == list(range(8))
    assert [len(c) for c in clouds] == list(range(8))
    for sent, got in ((cloud(k, k), c) for k, c in enumerate(clouds)):
        assert got.frame_id == "left"
        for name in ("x", "y", "z", "radial_speed"):
            np.testing.assert_array_equal(getattr(got, name), getattr(sent, name))
        np.testing.assert_allclose(got.snr, sent.snr, atol=0.051)  # sent in 0.1 dB
        np.testing.assert_allclose(got.noise, 40.0)
        for name, value in zip(("range", "azimuth", "elevation"), cartesian_to_spherical(sent.position), strict=True):
            np.testing.assert_allclose(getattr(got, name), value, atol=1e-6)
        assert np.isnan(got.range_std).all()
    assert (np.diff([c.stamp_ns for c in clouds]) > 0).all()
    assert device.info.waveform.n_sample == 0
    assert device.info.mount.z == 1.5
    report = device.report()
    assert (report["demo"], report["platform"], report["sdk"], report["packets"]) == ("demo", "A6843", "3.6.2.0", 8)


def test_a_flat_radar_has_no_elevation(board, source):
    """People counting in 2D: positions at the radar's height, elevations NaN, azimuths to the left positive."""
    device = source()
    board.send_all(ti.people_2d_packet(5, [ti.item(6, ti.floats([2.0], [0.5], [-1.0], [100.0]), True)]))
    (got,) = read(device)
    np.testing.assert_allclose(got.position, [[2 * math.cos(0.5), -2 * math.sin(0.5), 0.0]], rtol=1e-6)
    np.testing.assert_allclose([got.azimuth[0], got.snr[0], got.radial_speed[0]], [-0.5, 20.0, -1.0], rtol=1e-6)
    assert np.isnan(got.elevation[0])


def test_stamps_are_the_middle_of_the_acquisition(board, source, tmp_path):
    """Back from the arrival by what was on the line, by what the demo says it computed, and by half of the chirps."""
    path = tmp_path / "demo.cfg"
    path.write_text(CFG)
    device = source(config=str(path))
    stats = ti.struct.pack("<6I", 30_000, 0, 0, 0, 0, 0)
    data = ti.demo_packet(1, [ti.item(6, stats)])
    before = time.monotonic_ns()
    board.send_all(data)
    (got,) = read(device)
    after = time.monotonic_ns()
    half = 2 * 32 * 65e-6 / 2  # two transmitters, 32 loops, 7 us idle and 58 us ramp
    delay = round((30e-3 + half + len(data) * 10 / 921_600) * 1e9)
    assert before - delay - 1000 <= got.stamp_ns <= after - delay + 1000
    assert got.quality is Quality.STATIC_REMOVED
    waveform = device.info.waveform
    assert (waveform.n_tx, waveform.n_chirp, waveform.n_sample, waveform.frame_interval) == (2, 32, 0, 0.05)
    np.testing.assert_allclose(waveform.bandwidth, 68e12 * 256 / 5.5e6)


def test_a_cfg_that_makes_no_sense_is_refused(tmp_path):
    """File and line are named; nothing is opened."""
    path = tmp_path / "bad.cfg"
    path.write_text(CFG.replace("adcCfg 2 1", "adcCfg 2 0"))
    with pytest.raises(DataError, match=r"bad\.cfg:5: adcCfg asks for real samples"):
        TiDemo(TiDemoConfig(port="/nowhere", config=str(path)))
    with pytest.raises(ConfigError, match="cli_port is given but no config"):
        TiDemoConfig(cli_port="/dev/ttyACM0")


def test_partial_transfers_garbage_and_lost_bytes(board, source):
    """Packets in pieces, noise between them, a wrong magic word, a gap in the middle: all that is whole arrives, the rest is counted."""
    device = source()
    whole = packet(1)
    board.send_all(whole[:50])
    assert read(device, 1, 0.2) == []
    board.send_all(whole[50:])
    assert [c.sequence for c in read(device)] == [1]
    wrong = bytes([3]) + packet(2)[1:]
    cut = packet(3)
    board.send_all(b"mmwDemo:/>" + wrong + cut[:60] + cut[61:] + packet(4))
    assert [c.sequence for c in read(device)] == [4]
    report = device.report()
    assert report["refused"] == 1
    assert report["lost"] == 2
    assert report["garbage_bytes"] == 10 + len(wrong) + len(cut) - 1
    impossible = whole[:12] + b"\xff\xff\xff\x7f" + whole[16:]
    board.send_all(impossible + packet(5))
    assert [c.sequence for c in read(device)] == [5]


def test_what_was_there_before_is_thrown_away(board, source):
    """A port that nobody read holds old packets; after resume only new ones come."""
    device = source()
    device.suspend()
    board.send_all(packet(1))
    device.resume()
    board.send_all(packet(2))
    assert [c.sequence for c in read(device, 2, 0.3)] == [2]


@pytest.mark.parametrize(
    ("say", "message"),
    [
        (b"", "silent for 0.3 s; the sensor does not run, or hangs: start it with its .cfg"),
        (b"mmwDemo:/>help" * 5, "70 bytes in 0.3 s but no packet in them: is it the data port"),
        (ti.demo_packet(1, [ti.item(1, b"\0" * 28)], 2), "none of which makes sense: item 1 has 28 bytes for 2 points"),
    ],
    ids=["hang", "command port", "old demo"],
)
def test_nothing_useful_is_an_error_that_says_what_came(board, source, say, message):
    """Reading may go on: the board may be started by hand any time."""
    device = source(silence=0.3)
    board.send_all(say)
    with pytest.raises(DeviceError, match=message) as caught:
        read(device, 1, 2.0)
    assert not caught.value.gone
    board.send_all(packet(3))
    assert [c.sequence for c in read(device)] == [3]


@pytest.mark.parametrize(
    ("port", "message"),
    [
        ("{}/ttyACM9", "there is no serial port .*ttyACM9: plug the board in; handwave devices"),
        ("/dev/null", "/dev/null cannot be used as a serial port"),
    ],
)
def test_a_port_that_is_none(tmp_path, port, message):
    """What to do is said."""
    device = TiDemo(TiDemoConfig(port=port.format(tmp_path)))
    with pytest.raises(DeviceError, match=message):
        device.power_up()


def test_a_second_opener_is_told(board, source):
    """Two programs on one line would get half of the bytes each; the first one is not disturbed."""
    first = source()
    second = TiDemo(TiDemoConfig(port=str(board.link)))
    with pytest.raises(DeviceError, match=r"another program holds .*: close it \(fuser -v"):
        second.power_up()
    board.send_all(packet(1))
    assert len(read(first)) == 1


def test_a_killed_program_leaves_the_port_free(board):
    """kill -9 while it reads: the next one opens the port at once, and what the dead one left unread is thrown away."""
    code = """
import sys
from radar_driver.ti_demo.source import Uart
uart = Uart(sys.argv[1], 921600)
uart.power_up()
print("open", flush=True)
uart.read(60)
"""
    victim = subprocess.Popen([sys.executable, "-c", code, str(board.link)], stdout=subprocess.PIPE, text=True)
    assert victim.stdout.readline() == "open\n"
    victim.kill()
    victim.communicate()
    board.send(packet(1))
    device = TiDemo(TiDemoConfig(port=str(board.link)))
    device.power_up()
    device.resume()
    board.send_all(packet(2))
    assert [c.sequence for c in read(device, 2, 0.3)] == [2]
    device.power_down()


def test_a_port_without_permission(monkeypatch):
    """Root may open everything, so the error is the system's own, made by hand."""
    refused = PermissionError(13, "Permission denied", "/dev/ttyACM1")
    monkeypatch.setattr("serial.Serial", lambda *_, **__: (_ for _ in ()).throw(refused))
    with pytest.raises(DeviceError, match=r"sudo usermod -aG dialout \$USER, then log in again"):
        Uart("/dev/ttyACM1", 921600).power_up()


@pytest.fixture
def reader(source):
    """A reader on a source, with all that it gave."""
    made = []

    def start(**knobs):
        device = source(**knobs)
        got, told = [], []

        def notify():
            taken = one.take()
            if taken is not None:
                got.append(taken.data.sequence)
            told.append(one.problem)

        one = Reader(device, notify)
        one.start()
        made.append(one)
        return SimpleNamespace(reader=one, device=device, got=got, told=told)

    yield start
    for one in made:
        one.stop()


def until(wanted, timeout=5.0):
    end = time.monotonic() + timeout
    while not wanted() and time.monotonic() < end:
        time.sleep(0.01)
    return wanted()


def test_unplugged_in_the_middle_of_a_packet_and_plugged_in_again(board, reader):
    """The error says what to do; three seconds after the board is back, clouds come; nothing of the half packet is made up."""
    r = reader()
    board.send_all(packet(1) + packet(2)[:70])
    assert until(lambda: r.got == [1])
    board.unplug()
    assert until(lambda: "plug the board in" in r.reader.problem)
    board.plug()
    back = time.monotonic()
    number = 10
    while time.monotonic() < back + 3.0 and r.got[-1] < 10:
        board.send(packet(number))
        number += 1
        time.sleep(0.05)
    assert r.got[-1] >= 10  # the accepted limit is 3 s
    assert r.reader.counts["reopened"] == 1
    assert r.reader.problem == ""


def test_nothing_survives(board, source, tmp_path):
    """Twenty lives, some of which end with an unplugged board: as many threads and descriptors as before."""
    source().power_down()
    before = held()
    for life in range(20):
        device = TiDemo(TiDemoConfig(port=str(board.link)))
        device.power_up()
        one = Reader(device, lambda: None)
        one.start()
        board.send(packet(life))
        if life % 4 == 3:
            board.unplug()
            assert until(lambda o=one: o.problem)
            board.plug()
        one.stop()
        device.power_down()
        device.power_down()
    assert not left_since(before)


def test_a_hanging_sensor_is_started_anew(board, reader, tmp_path):
    """With a command port: the .cfg is sent at the start, and again when nothing comes any more."""
    path = tmp_path / "demo.cfg"
    path.write_text(CFG)
    sent = []
    r = reader(send=lambda port, file: sent.append((port, file)), cli_port="/dev/cli", config=str(path), silence=0.4)
    assert sent == [("/dev/cli", path)]
    board.send_all(packet(1))
    assert until(lambda: len(sent) == 2)
    assert "it is started anew" in "".join(r.told)
    board.send_all(packet(1))
    assert until(lambda: r.got == [1, 1])


def test_the_cfg_goes_to_the_command_port(board, source, tmp_path):
    """Line after line, without comments, each after its answer."""
    path = tmp_path / "demo.cfg"
    path.write_text(CFG)
    cli = ti.CommandLine(tmp_path / "ttyACM0")
    try:
        source(cli_port=str(cli.link), config=str(path))
        assert cli.said == [line for line in CFG.splitlines() if line and not line.startswith("%")]
    finally:
        cli.close()


@pytest.mark.parametrize(
    ("behaviour", "message"),
    [
        ({"refuse": ["profileCfg"]}, r"demo\.cfg:6: the sensor refuses 'profileCfg .*Error -1.* Correct the line"),
        ({"silent": True}, r"the sensor on .* does not answer\. .* the right port: that of the command line"),
    ],
    ids=["refused", "silent"],
)
def test_a_line_that_is_refused_is_named(board, tmp_path, behaviour, message, monkeypatch):
    """File, line, answer and advice; the data port is closed again."""
    monkeypatch.setattr("radar_driver.ti_demo.source._ANSWER", 0.3)
    path = tmp_path / "demo.cfg"
    path.write_text(CFG)
    cli = ti.CommandLine(tmp_path / "ttyACM0", **behaviour)
    device = TiDemo(TiDemoConfig(port=str(board.link), cli_port=str(cli.link), config=str(path)))
    try:
        before = held()
        device.power_up()
        with pytest.raises(DeviceError, match=f"sensor did not resume: .*{message}"):
            device.resume()
        assert not left_since(before)
    finally:
        cli.close()


def test_the_board_is_known(board, tmp_path):
    """The registry has it, its knobs are a configuration, and it makes sources of it."""
    known = boards()["ti_demo"]
    assert known.clouds
    device = known.open(known.config(port=str(board.link)))
    device.power_up()
    assert device.report()["data port.state"] == "suspended"
    device.power_down()
    assert device.report()["data port.state"] == "off"
