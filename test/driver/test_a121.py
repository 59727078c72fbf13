"""An A121 behind a real TCP connection: frames as they were, and every fault that a cable, a board or a stranger can make."""

import json
import time

import a121_emulator as emulated
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from leftovers import held, left_since

from radar_core import ConfigError, DeviceError
from radar_driver.a121 import wire
from radar_driver.a121.config import A121Config, Grid
from radar_driver.a121.source import A121
from radar_driver.boards import board
from radar_driver.health import Verdict, probe
from radar_driver.live import Reader
from radar_dsp import Baseband, BasebandConfig
from radar_sim import Simulator, load_scene

SMALL = {"sweeps_per_frame": 8, "num_points": 20, "start_point": 96, "frame_interval": 0.01, "sweep_rate": 2000.0}
SCENE = """
duration: 0.3
seed: 4
radars: [{{waveform: {waveform}, array: {{tx: [[0, 0]], rx: [[0, 0]]}}}}]
points: [{{position: [1.5, 0.0, 1.2], velocity: [-0.6, 0, 0], rcs: 20.0}}, {{position: [2.6, 0.0, 1.2], velocity: [0.9, 0, 0], rcs: 200.0}}]
effects: {{noise: {{}}}}
"""


def noise(n=4, **knobs):
    """Bytes of frames of noise."""
    config = A121Config(**{**SMALL, **knobs})
    values = np.random.default_rng(1).normal(size=(n, config.sweeps_per_frame, config.num_points, 2)) * 100
    return [emulated.pack(one[..., 0] + 1j * one[..., 1]) for one in values]


@pytest.fixture
def server():
    made, before = [], held()

    def make(frames=None, **options):
        made.append(emulated.Server(noise() if frames is None else frames, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()
    assert not left_since(before)


@pytest.fixture
def source():
    made = []

    def make(server, **knobs):
        made.append(A121(A121Config(address=server.address, **{**SMALL, "timeout": 0.5, **knobs})))
        made[-1].power_up()
        made[-1].resume()
        return made[-1]

    yield make
    for one in made:
        one.power_down()


def read(device, wanted=1, timeout=5.0):
    found, end = [], time.monotonic() + timeout
    while len(found) < wanted and time.monotonic() < end:
        reading = device.read(0.05)
        if reading is not None:
            found.append(reading.data)
    return found


@pytest.mark.long
def test_an_emulated_scene_comes_back_as_the_same_echoes(server, source, tmp_path):
    """Range and range rate of every echo above 20 dB within half a standard deviation of those of the scene's own frames."""
    config = A121Config(start_point=0, num_points=60)
    info = config.info()
    w = info.waveform
    names = ("carrier", "bandwidth", "chirp_duration", "chirp_pause", "frame_interval", "n_tx", "n_chirp", "n_sample")
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE.format(waveform=json.dumps({name: getattr(w, name) for name in names})))
    simulator = Simulator(load_scene(path))
    cubes = emulated.frames_of(np.stack([simulator.process(k).frame.cube for k in range(4)]))
    grid = config.grid()
    near = [grid.cube(grid.sweeps(cube)) for cube in cubes]  # what lies in the cells that are measured
    device = source(server([emulated.pack(grid.sweeps(cube)) for cube in cubes], interval=0.05), **{k: getattr(config, k) for k in SMALL})
    chain, compared = Baseband(BasebandConfig(), device.info), 0
    for frame, cube in zip(read(device, 4), near, strict=True):
        theirs = chain.process(frame)
        ours = chain.process(type(frame)(cube, frame.stamp_ns, frame.sequence, frame.frame_id))
        for k in np.flatnonzero(ours.snr > 20):
            other = int(np.hypot(theirs.range - ours.range[k], theirs.radial_speed - ours.radial_speed[k]).argmin())
            assert abs(theirs.range[other] - ours.range[k]) < 0.5 * max(ours.range_std[k], 1e-4)
            assert abs(theirs.radial_speed[other] - ours.radial_speed[k]) < 0.5 * max(ours.radial_speed_std[k], 1e-4)
            compared += 1
        strong = [int(np.where(np.abs(theirs.range - place) < 0.3, theirs.snr, -99.0).argmax()) for place in (1.5, 2.6)]
        np.testing.assert_allclose(theirs.range[strong], [1.5, 2.6], atol=0.3)
        np.testing.assert_allclose(theirs.radial_speed[strong], [-0.6, 0.9], atol=0.1)
        assert np.isnan(theirs.azimuth).all()
    assert compared >= 8
    assert device.report()["broken"] == 0


def test_sweeps_become_samples_and_back():
    """Values stay in their range cells; noise keeps its power; what recedes turns forward."""
    grid = Grid(96, 20, 24)
    values = (np.random.default_rng(2).normal(size=(8, 20, 2)) @ [1, 1j]).astype(np.complex64)
    cube = grid.cube(values)
    assert cube.shape == (1, 8, 1, 28)
    np.testing.assert_allclose(grid.sweeps(cube), values, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose((np.abs(cube) ** 2).sum(), (np.abs(values) ** 2).sum(), rtol=1e-5)
    cell = int(np.abs(np.fft.fft(grid.cube(np.eye(1, 20, 3, dtype=np.complex64))[0, 0, 0])).argmax())
    assert cell * grid.info(8, 5e-4, 0.05, 2.5e-3, A121Config().mount).waveform.range_resolution == pytest.approx((96 + 3 * 24) * 2.5e-3)


def test_stamps_and_losses_follow_the_boards_clock(server, source):
    """Frames that never came are seen in its ticks; stamps rise."""
    host = server()
    host.faults = {3: b"", 4: b""}
    found = read(source(host), 8)
    assert [one.sequence for one in found] == [0, 1, 2, 5, 6, 7, 8, 9]
    assert (np.diff([one.stamp_ns for one in found]) > 0).all()
    assert all(one.cube.shape == (1, 8, 1, 28) for one in found)


def test_the_frame_that_came_fastest_sets_the_clock():
    """However late frames arrive, their stamps are as far apart as the board's ticks once one has come without delay."""
    device = A121(A121Config(**SMALL))
    tick = round(0.01 / device._server.tick)
    delays = np.array([9, 3, 0, 7, 20, 1, 5]) * 1_000_000
    stamps = [device._stamped(0 if k == 0 else tick, 10**9 + k * 10_000_000 + int(late)) for k, late in enumerate(delays)]
    np.testing.assert_array_equal(np.diff(stamps[2:]), 10_000_000)
    assert stamps[2] == 10**9 + 20_000_000 - device.info.waveform.acquisition_ns


def test_flags_of_a_frame(server, source):
    """Saturation is told with what to do; a sensor that wants to be calibrated is set up again, and goes on."""
    host = server()
    host.flags = {1: {"data_saturated": True}, 2: {"calibration_needed": True}, 3: {"frame_delayed": True}}
    device = source(host)
    assert len(read(device, 8)) == 8
    told = device.report()
    assert (told["data_saturated"], told["frame_delayed"], told["calibration_needed"], told["temperature"]) == (1, 1, 1, 31)
    assert "lower receiver_gain" in told["saturation_advice"]
    assert len(host.setups) == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sensor": "a111"}, "has a sensor 'a111', not an A121"),
        ({"connected": (2, 3)}, r"sensor 1 is not connected; there is \[2, 3\]"),
    ],
)
def test_the_wrong_board_is_refused(server, source, options, message):
    """With what it is."""
    with pytest.raises(DeviceError, match=message):
        source(server(**options))


def test_another_version_is_named(server, source):
    """With those that are known."""
    assert "software a121-v3.0.0 is not known here" in source(server(version="a121-v3.0.0")).report()["server.advice"]


def test_nobody_there_and_nobody_answers(server, source):
    """What to check."""
    host = server()
    host.mute = {"get_system_info"}
    with pytest.raises(DeviceError, match=r"no answer .*is it an exploration server"):
        source(host)
    host.unplug()
    with pytest.raises(DeviceError, match=r"nobody answers at 127\.0\.0\.1"):
        source(host)
    host.plug()
    for address, text in (("", "say where"), (":6110", "is no address"), ("host:port", "is no address")):
        with pytest.raises(DeviceError, match=text):
            A121(A121Config(address=address)).power_up()


def test_silence_is_an_error(server, source):
    """So that it is opened anew."""
    device = source(server([]))
    with pytest.raises(DeviceError, match=r"no frame for 0\.5 s") as error:
        read(device)
    assert error.value.gone


def test_garbage_between_frames(server, source):
    """Counted; the frames around it come."""
    host = server()
    bad = b'\xff\x00noise\n{"status": "ok", "payload_size": 99999999999}\n[1, 2]\n{"result_info": 3}\n{"result_info": [[{"tick": "x"}]]}\n'
    host.faults = {1: bad, 2: emulated.line(result_info=[[{"tick": 20000}]], payload_size=5) + b"short"}
    device = source(host)
    assert len(read(device, 4)) == 4
    told = device.report()
    assert told["broken"] == 2
    assert told["link.refused"] == 3


def until(wanted, timeout=5.0):
    end = time.monotonic() + timeout
    while not wanted() and time.monotonic() < end:
        time.sleep(0.01)
    return wanted()


@pytest.mark.parametrize("half", [True, False])
def test_unplugged_and_plugged_in_again(server, half):
    """In the middle of a frame, or between two: the error says what to do, frames come again by themselves, nothing half is made up."""
    host, got = server(), []
    device = A121(A121Config(address=host.address, **SMALL, timeout=0.5))
    device.power_up()
    reader = Reader(device, lambda: got.append(reader.take()), again=0.1)
    reader.start()
    try:
        assert until(lambda: any(got))
        if half:
            host.faults = {host.sent + 1: None}
            assert until(lambda: reader.counts["reopened"] == 1)
        else:
            host.unplug()
            assert until(lambda: "check cable, power and network" in reader.problem or "nobody answers" in reader.problem)
            host.plug()
        got.clear()
        assert until(lambda: sum(one is not None for one in got) > 2)
        assert reader.counts["reopened"] >= 1
        assert not reader.problem
    finally:
        reader.stop()
        device.power_down()
    assert all(np.isfinite(one.data.cube).all() for one in got if one is not None)


@given(st.lists(st.binary(max_size=300), max_size=20), st.integers(1, 97))
@settings(max_examples=150, deadline=None)
def test_any_bytes(noise_pieces, size):
    """The parser survives, holds no more than a message, and finds the last whole one behind an end of line."""
    parser = wire.Parser()
    whole = emulated.line(status="ok", payload_size=8) + b"12345678"
    stream = b"".join(noise_pieces).replace(b"payload_size", b"") + b"\n" + whole * 2
    found = [one for start in range(0, len(stream), size) for one in parser.feed(stream[start : start + size])]
    assert [one.data for one in found[-2:]] == [b"12345678"] * 2
    assert parser.held == 0
    assert parser.received == len(stream)


def test_a_line_without_an_end_is_not_kept():
    """Nor are deep ones read."""
    parser = wire.Parser()
    for _ in range(100):
        parser.feed(b"x" * 10_000)
        assert parser.held <= wire.LONGEST + 10_000
    assert not parser.feed(b"\n" + b"[" * 60_000 + b"\n" + b'{"a":' * 10_000 + b"\n" + b'{"a": ' + b"9" * 6000 + b"}\n")
    assert parser.feed(b'{"status":"ok"}\n')[0].status == "ok"


@pytest.mark.parametrize(
    ("knobs", "message"),
    [
        ({"step_length": 5}, "choose one of 1, 2, 3"),
        ({"start_point": 100}, "must be a multiple of step_length"),
        ({"num_points": 200}, "more than the sensor's 4095 values"),
        ({"frame_interval": 0.01}, "the sweeps take longer than frame_interval"),
    ],
)
def test_what_the_board_cannot_do_is_refused(knobs, message):
    """With the rule that is broken."""
    with pytest.raises(ConfigError, match=message):
        A121Config(**knobs)


def test_health_and_registry(server):
    """The registry knows it, `probe` finds it healthy, and says what is wrong where nobody answers."""
    host = server()
    assert board("a121").variant == "live"
    found = {check.name: check for check in probe(board("a121").source(A121Config(address=host.address, **SMALL)), 0.5).checks}
    assert found["temperature"].value == 31
    assert found["link"].verdict is Verdict.OK
    assert not [name for name, check in found.items() if check.verdict is Verdict.FAIL and name not in ("jitter", "frame rate")]  # load
    host.unplug()
    gone = probe(board("a121").source(A121Config(address=host.address, **SMALL)), 0.5).checks[0]
    host.plug()
    assert (gone.verdict, "nobody answers" in gone.advice) == (Verdict.FAIL, True)
