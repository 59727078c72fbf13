"""TI sensors with a DCA1000EVM: raw samples over the network."""

from __future__ import annotations

from collections.abc import Sequence

from radar_driver.boards import Board, Found
from radar_driver.dca1000.board import Dca1000Config, Dca1000Source
from radar_driver.serial_ports import access_problem, ti_ports


def find() -> Sequence[Found]:
    """List the command lines of TI sensors on serial ports; whether a capture board is behind one shows only when it is powered up."""
    return [
        Found("dca1000", f"{board.command} ({board.description})", {"serial_port": board.command}, access_problem(board.command))
        for board in ti_ports()
        if board.command
    ]


BOARD = Board("dca1000", "TI xWR sensor with a DCA1000EVM (raw samples over UDP)", Dca1000Config, Dca1000Source, find)
