"""Hi-Link's LD2450: 24 GHz, up to three people over a serial port, behind any USB serial adapter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from radar_driver.boards import Board, Found
from radar_driver.ld2450.source import Ld2450, Ld2450Config
from radar_driver.serial_ports import access_problem, adapters


def find() -> Sequence[Found]:
    """List USB serial adapters: what is behind one is not known before it is listened to."""
    found = []
    for port in adapters():
        address = f"{port.device}, a USB serial adapter; whether an LD2450 is behind it, handwave probe tells"
        found.append(Found("ld2450", address, {"port": port.device}, access_problem(port.device)))
    return found


_TITLE: Final = "Hi-Link HLK-LD2450 (24 GHz, follows up to three people itself; targets over a serial port)"
BOARD = Board("ld2450", _TITLE, Ld2450Config, Ld2450, find, targets=True)
