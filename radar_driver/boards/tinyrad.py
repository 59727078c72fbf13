"""EV-TINYRAD24G, 24 GHz, over USB."""

from __future__ import annotations

from typing import Any

from radar_core import DeviceError
from radar_driver.boards import Board, Found
from radar_driver.tinyrad.config import TinyRadConfig
from radar_driver.tinyrad.link import access_problem, port_of, usb_devices
from radar_driver.tinyrad.source import TinyRadSource


def find(backend: Any = None) -> list[Found]:
    """List the TinyRads that are plugged in; ``backend`` as for `TinyRadSource`.

    A machine without pyusb or libusb has none, as far as can be seen; opening one says what to install.
    """
    try:
        devices = usb_devices(backend)
    except DeviceError:
        return []
    return [Found("tinyrad", f"USB {port_of(d)}", {"port": port_of(d)}, access_problem(d)) for d in devices]


BOARD = Board("tinyrad", "EV-TINYRAD24G (24 GHz, 2 x 4 antennas, USB)", TinyRadConfig, TinyRadSource, find)
