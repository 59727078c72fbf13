"""Which serial ports are a TI board, told by its USB bridge."""

from types import SimpleNamespace

from serial.tools import list_ports

from radar_driver.boards import ti_demo


def ports(*rows):
    """Serial ports as pyserial lists them."""
    names = ("device", "vid", "pid", "serial_number", "location", "interface", "description")
    return [SimpleNamespace(**dict(zip(names, (*row, row[-1]), strict=True))) for row in rows]


def test_boards_are_told_by_their_usb_bridge(monkeypatch):
    """Data and command port by name, else by place; foreign ports are not ours; a port that may not be opened is told."""
    xds = [
        ("/dev/ttyACM1", 0x0451, 0xBEF3, "R1", "1-2:1.3", "XDS110 Class Auxiliary Data Port"),
        ("/dev/ttyACM0", 0x0451, 0xBEF3, "R1", "1-2:1.0", "XDS110 Class Application/User UART"),
    ]
    cp = [
        ("/dev/ttyUSB0", 0x10C4, 0xEA70, "00A", "1-3:1.0", "Enhanced Com Port"),
        ("/dev/ttyUSB1", 0x10C4, 0xEA70, "00A", "1-3:1.1", "Standard Com Port"),
    ]
    other = [("/dev/ttyS0", None, None, None, None, None), ("/dev/ttyUSB7", 0x0403, 0x6001, "X", "1-4", "FT232")]

    def find_ports(found):
        monkeypatch.setattr(list_ports, "comports", lambda: found)
        return ti_demo.find()

    found = find_ports(ports(*xds, *other, *cp))
    assert [f.options["port"] for f in found] == ["/dev/ttyACM1", "/dev/ttyUSB1"]
    assert "commands at /dev/ttyACM0" in found[0].address
    unnamed = [(*row[:5], None) for row in xds]
    assert find_ports(ports(*unnamed))[0].options["port"] == "/dev/ttyACM1"
    (lone,) = find_ports(ports(xds[1]))
    assert "only the command port is there" in lone.problem
