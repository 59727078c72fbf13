"""TI's radars (xWR14xx, 16xx, 18xx, 68xx, ...) with a demo that sends point clouds over a serial port."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from radar_driver.boards import Board, Found
from radar_driver.serial_ports import access_problem, ti_ports
from radar_driver.ti_demo.source import TiDemo, TiDemoConfig


def find() -> Sequence[Found]:
    """List what is plugged in."""
    lone = "only the command port is there: plug the board in again, or try another cable"
    found = []
    for board in ti_ports():
        parts = {"": board.data, "commands at ": board.command, "serial number ": board.number}
        address = ", ".join(word + part for word, part in parts.items() if part)
        found.append(Found("ti_demo", address, {"port": board.data}, access_problem(board.data) if board.data else lone))
    return found


_TITLE: Final = "TI mmWave radar with the out-of-the-box or a people-counting demo (point clouds over a serial port)"
BOARD = Board("ti_demo", _TITLE, TiDemoConfig, TiDemo, find, clouds=True)
