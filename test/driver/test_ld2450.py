"""An LD2450 on a real pseudo terminal: targets, what the line can do to them, commands, and nothing left behind."""

import time
from types import SimpleNamespace

import ld2450_emulator as ld
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from leftovers import held, left_since
from serial.tools import list_ports

from radar_core import DeviceError, Pose
from radar_driver.boards import boards, ld2450
from radar_driver.health import Verdict, probe
from radar_driver.ld2450 import wire
from radar_driver.ld2450.source import Ld2450, Ld2450Config
from radar_driver.live import Reader
from radar_driver.targets import place_covariance


def test_the_reports_that_the_maker_prints():
    """The two examples of the maker's papers: -782 mm, 1713 mm, -16 cm/s; 2750 mm, 3655 mm, -17 cm/s; cells of 0.36 m."""
    first = bytes.fromhex("AAFF0300 0E03B18610006801 0000000000000000 0000000000000000 55CC")
    second = bytes.fromhex("AAFF0300 BE8A478E11006801 0000000000000000 0000000000000000 55CC")
    one, two = wire.Parser().feed(first + second)
    np.testing.assert_allclose([one.targets[0].x, one.targets[0].y, one.targets[0].speed], [-0.782, 1.713, -0.16])
    np.testing.assert_allclose([two.targets[0].x, two.targets[0].y, two.targets[0].cell], [2.750, 3.655, 0.36])
    assert (one.end, two.end) == (30, 60)


def test_the_answers_that_the_maker_prints():
    """Begin of the configuration, firmware, and the command that asks for it."""
    assert wire.command(wire.ENABLE, b"\x01\x00") == bytes.fromhex("FDFCFBFA 0400 FF00 0100 04030201")
    heard = wire.Parser().feed(bytes.fromhex("FDFCFBFA 0C00 A001 0000 0000 0201 16240622 04030201"))
    assert (heard[0].word, heard[0].done, wire.firmware(heard[0].value)) == (wire.FIRMWARE, True, "V1.02.22062416")
    assert wire.firmware(b"\0") == ""


@given(st.lists(st.binary(max_size=80), max_size=6), st.integers(1, 40))
def test_whatever_is_on_the_line_reports_are_found(noise, size):
    """Bytes between reports, in pieces of any size: the parser never raises, holds less than one answer, and finds the last reports."""
    parser = wire.Parser()
    stream = b"".join(piece + ld.report((0.5, 2.0, 0.1)) for piece in noise) + b"\0" * 80 + ld.report((1.0, 3.0, 0.0)) * 2
    found = [one for start in range(0, len(stream), size) for one in parser.feed(stream[start : start + size])]
    assert [one.targets[0].y for one in found[-1:]] == [3.0]
    assert parser.held <= wire.LONGEST + 10
    assert parser.received == len(stream)
    assert 30 * parser.counts["reports"] + parser.counts["garbage_bytes"] <= len(stream)


@pytest.fixture
def board(tmp_path):
    emulated = ld.Board(tmp_path / "ttyUSB0")
    yield emulated
    emulated.close()


@pytest.fixture
def source(board):
    made = []

    def open_(**knobs):
        made.append(Ld2450(Ld2450Config(port=str(board.link), **knobs)))
        made[-1].power_up()
        made[-1].resume()
        return made[-1]

    yield open_
    for one in made:
        one.power_down()


def read(source, wanted=lambda found: len(found) >= 1, timeout=3.0):
    """Read until there are as many as wanted."""
    found, end = [], time.monotonic() + timeout
    while not wanted(found) and time.monotonic() < end:
        reading = source.read(0.05)
        if reading is not None and len(reading.data):
            found.append(reading.data)
    return found


def test_targets_come_through_the_line(board, source):
    """Forward, left, in the sensor's plane; speeds only once their sign is known; covariances as ranges and directions say."""
    device = source(mount=Pose(z=1.5), frame_id="left", speed_sign=1)
    board.send_all(ld.report((0.5, 2.0, 0.3), None, (-1.0, 3.0, -0.2)))
    (got,) = read(device)
    assert (got.slot.tolist(), got.frame_id) == ([0, 2], "left")
    np.testing.assert_allclose(got.position, [[2.0, -0.5, 0.0], [3.0, 1.0, 0.0]])
    np.testing.assert_allclose(got.radial_speed, [0.3, -0.2])
    assert np.isnan(got.velocity).all()
    np.testing.assert_allclose(got.covariance, place_covariance(got.position, 0.12, 0.06, 0.12))
    report = device.report()
    assert (report["module.firmware"], report["module.targets"], report["targets"]) == ("V1.02.22062416", "several", 2)
    assert board.said == [wire.ENABLE, wire.FIRMWARE, wire.SEVERAL, wire.DISABLE]


def test_upside_down_and_without_speeds(board, source):
    """The knob turns x; speeds are NaN as long as nobody has said what their sign means."""
    device = source(x_to="left", targets="one")
    board.send_all(ld.report((0.5, 2.0, 0.3)))
    (got,) = read(device)
    np.testing.assert_allclose(got.position, [[2.0, 0.5, 0.0]])
    assert np.isnan(got.radial_speed).all()
    assert board.said[2] == wire.ONE


def test_covariance_is_that_of_range_and_direction():
    """Along the line of sight the range's, across it the direction's; anywhere."""
    place = np.array([[3.0, 4.0, 0.0]])
    (found,) = place_covariance(place, 0.1, 0.02, 0.3)
    along, across = np.array([0.6, 0.8, 0.0]), np.array([-0.8, 0.6, 0.0])
    np.testing.assert_allclose([along @ found @ along, across @ found @ across, found[2, 2]], [0.01, 0.01, 0.09])


def test_half_reports_garbage_and_absurd_targets(board, source):
    """What is whole arrives, what is not is counted; a target 30 m away is no target."""
    device = source()
    whole = ld.report((0.5, 2.0, 0.0))
    board.send_all(whole[:11])
    assert read(device, timeout=0.2) == []
    board.send_all(whole[11:] + b"noise" + whole[:17] + ld.report((0.0, 30.0, 0.0), (0.1, 1.0, 0.0)))
    found = read(device, lambda found: len(found) >= 2)
    assert [len(one) for one in found] == [1, 1]
    report = device.report()
    assert (report["targets_refused"], report["refused"]) == (1, 1)
    assert report["garbage_bytes"] >= 5 + 17


def test_a_board_that_does_not_answer_is_listened_to(board, source):
    """Only its TX is connected: targets come, and the advice says what to connect."""
    board.mute = True
    device = source()
    board.send_all(ld.report((0.5, 2.0, 0.0)))
    assert len(read(device)) == 1
    assert "connect its RX too" in device.report()["module.advice"]


def test_another_firmware_is_named(board, source):
    """With the versions that are known."""
    board.version = bytes.fromhex("0000 0107 01020304")
    assert "firmware V7.01.04030201 is not known here (V1 and V2 are)" in source().report()["module.advice"]


@pytest.mark.parametrize(("say", "message"), [(b"", "silent: power the board with 5 V"), (b"x" * 40, "40 bytes but no report in them")])
def test_nothing_useful_is_an_error_that_says_what_came(board, source, say, message):
    """What to look at: the power, the wires, the baud rate."""
    device = source(silence=0.3, configure=False)
    board.send_all(say)
    with pytest.raises(DeviceError, match=message):
        read(device)


def until(wanted, timeout=5.0):
    end = time.monotonic() + timeout
    while not wanted() and time.monotonic() < end:
        time.sleep(0.01)
    return wanted()


def test_unplugged_in_the_middle_of_a_report_and_plugged_in_again(board, source):
    """The error says what to do; targets come again by themselves; nothing of the half report is made up; nothing is left behind."""
    before = held()
    device, got = source(), []
    reader = Reader(device, lambda: got.append(reader.take()), again=0.1)
    reader.start()
    board.send_all(ld.report((0.5, 2.0, 0.0)) + ld.report((0.5, 4.0, 0.0))[:20])
    assert until(lambda: any(one is not None and len(one.data) for one in got))
    board.unplug()
    assert until(lambda: "plug the board in" in reader.problem)
    board.plug()

    def again():
        board.send(ld.report((0.5, 3.0, 0.0)))
        return any(one is not None and len(one.data) and one.data.position[0, 0] == 3.0 for one in got)

    assert until(again)
    reader.stop()
    device.power_down()
    assert not any(one is not None and 4.0 in one.data.position for one in got)
    assert reader.counts["reopened"] == 1
    assert not left_since(before)


def test_health_of_a_board_of_targets(board):
    """Rate and number of targets; a board that is not there fails with what to do."""
    board.link = board.link.with_name("gone")
    found = probe(Ld2450(Ld2450Config(port=str(board.link))), 0.5)
    assert (found.checks[0].verdict, "there is no serial port" in found.checks[0].advice) == (Verdict.FAIL, True)


def test_adapters_are_listed(monkeypatch):
    """Plain USB serial adapters may have the board behind them; a TI board is none."""
    ports = [
        SimpleNamespace(device="/dev/ttyUSB0", vid=0x1A86, pid=0x7523),
        SimpleNamespace(device="/dev/ttyACM0", vid=0x0451, pid=0xBEF3),
    ]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    monkeypatch.setattr("radar_driver.boards.ld2450.access_problem", lambda port: "")
    (found,) = ld2450.find()
    assert found.options == {"port": "/dev/ttyUSB0"}
    assert boards()["ld2450"].variant == "targets"
    ports.append(SimpleNamespace(device="/dev/ttyUSB1", vid=0x10C4, pid=0xEA60))
    with pytest.raises(DeviceError, match="there are several: /dev/ttyUSB0, /dev/ttyUSB1; set port to one of them"):
        Ld2450(Ld2450Config()).power_up()
