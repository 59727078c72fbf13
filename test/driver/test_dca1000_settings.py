"""Settings that are refused before anything is opened, buffers and their bounds, and finding boards."""

from pathlib import Path

import numpy as np
import pytest
from dca1000_emulator import BOARD, HOST, cut, encode, free_ports
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from radar_core import ConfigError, DataError, DeviceError
from radar_driver.boards import board
from radar_driver.dca1000.receiver import Receiver, bind
from radar_driver.dca1000.serial_cli import SerialCli
from radar_driver.serial_ports import ti_ports

FRAMES = [encode(np.ones((2, 16, 4, 64), complex))]

WRONG = [
    ({"config": ""}, None, "name the sensor's .cfg"),
    ({"config": "/nowhere.cfg"}, None, "cannot be read as a configuration"),
    ({}, ("lvdsStreamCfg -1 0 1 0\n", ""), "add the line: lvdsStreamCfg -1 0 1 0"),
    ({}, ("lvdsStreamCfg -1 0 1 0", "lvdsStreamCfg -1 1 1 0"), "add the line: lvdsStreamCfg -1 0 1 0"),
    ({}, ("frameCfg 0 1 16 0", "frameCfg 0 1 16 8"), "ends after 8 frames; make its fourth number 0"),
    ({}, ("adcbufCfg -1 0 1", "adcbufCfg -1 0 0"), "gives samples in the order i_first, but dca1000.order is q_first"),
    ({"lanes": 4}, None, "xWR18xx, which has 2 lanes, but dca1000.lanes is 4"),
    (
        {"packet_delay": 500e-6},
        ("frameCfg 0 1 16 0 20", "frameCfg 0 1 16 0 10"),
        "23 packets a frame, 500 us apart, take longer than a frame",
    ),
]


@pytest.mark.parametrize(("given", "change", "message"), WRONG, ids=[m[:24] for _, _, m in WRONG])
def test_settings_that_could_only_fail(bench, given, change, message):
    """Refused before anything is opened."""
    one = bench(FRAMES)
    text = one.cfg.read_text()
    if change:
        assert change[0] in text
        one.cfg.write_text(text.replace(*change))
    with pytest.raises((ConfigError, DataError), match=message.replace("(", r"\(")):
        one.source(**given)
    assert one.log == []


def test_a_buffer_that_the_system_cuts(tidy):
    """Frames as large as the largest buffer: two of them cannot be held, and the advice names the setting."""
    largest = int(Path("/proc/sys/net/core/rmem_max").read_text())
    (port,) = free_ports(1)
    for size, warned in ((1 << 14, False), (largest, True)):
        receiver = Receiver(HOST, BOARD, port, size)
        receiver.open()
        assert ("sudo sysctl -w net.core.rmem_max=" in receiver.warning) == warned
        assert ("advice" in receiver.report()) == warned
        receiver.close()


def test_frames_that_nobody_reads_make_room(tidy):
    """Twenty frames wait: the last four are kept, the others counted; a stranger's packets count for nothing."""
    (port,) = free_ports(1)
    receiver = Receiver(HOST, BOARD, port, 4096)
    receiver.open()
    stranger, link = bind("127.0.0.3", 0, "test"), bind(BOARD, 0, "test")
    for one in cut(bytes(20 * 4096)):
        link.sendto(one, (HOST, port))
        stranger.sendto(one, (HOST, port))
    assert [receiver.read(1.0).number for _ in range(4)] == [16, 17, 18, 19]
    assert receiver.read(0.01) is None
    assert receiver.report()["frames_skipped"] == 16
    assert receiver.report()["packets_of_others"] == receiver.report()["packets"] == 57
    # What waits when a new recording begins is thrown away.
    for one in cut(bytes(4096)):
        link.sendto(one, (HOST, port))
    receiver.start_afresh()
    assert receiver.read(0.01) is None
    for end in (stranger, link, receiver):
        end.close()


def test_finding_boards_is_quick_and_touches_nothing():
    """No TI sensor is plugged in here, or those that are have a port each."""
    found = board("dca1000").find()
    assert all(one.board == "dca1000" and one.options["serial_port"].startswith("/dev/") for one in found)


def usb_port(device, vid, pid, location, interface=None):
    """Describe a port as the system lists it."""
    port = ListPortInfo(device)
    port.vid, port.pid, port.location, port.interface = vid, pid, location, interface
    return port


def test_the_port_of_the_command_line_is_chosen(monkeypatch):
    """One port for each board: by its name, else the first interface; other devices are none."""
    ports = [
        usb_port("/dev/ttyACM1", 0x0451, 0xBEF3, "1-2:1.3"),
        usb_port("/dev/ttyACM0", 0x0451, 0xBEF3, "1-2:1.0"),
        usb_port("/dev/ttyUSB0", 0x10C4, 0xEA70, "1-3:1.0", "Standard Com Port"),
        usb_port("/dev/ttyUSB1", 0x10C4, 0xEA70, "1-3:1.1", "Enhanced Com Port"),
        usb_port("/dev/ttyUSB2", 0x0403, 0x6011, "1-4:1.0"),
        usb_port("/dev/ttyS0", None, None, None),
    ]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    assert {board.command for board in ti_ports()} == {"/dev/ttyACM0", "/dev/ttyUSB1"}
    found = board("dca1000").find()
    assert {one.options["serial_port"] for one in found} == {"/dev/ttyACM0", "/dev/ttyUSB1"}
    with pytest.raises(DeviceError, match=r"there are several: .*set serial_port to one of them"):
        SerialCli("auto", 0.1).open()
    monkeypatch.setattr(list_ports, "comports", lambda: ports[-2:])
    with pytest.raises(DeviceError, match="plug the sensor's USB cable in"):
        SerialCli("auto", 0.1).open()
