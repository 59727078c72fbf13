"""TI sensors with a DCA1000EVM: raw samples over the network."""

from __future__ import annotations

from collections.abc import Sequence

from radar_driver.boards import Board, Found
from radar_driver.dca1000.board import open_dca1000
from radar_driver.dca1000.serial_cli import access_problem, cli_ports
from radar_driver.dca1000.settings import Dca1000Config


def find() -> Sequence[Found]:
    """List the command lines of TI sensors on serial ports; whether a capture board is behind one shows only when it is powered up."""
    return [
        Found("dca1000", f"{port.device} ({port.description})", {"serial_port": port.device}, access_problem(port.device))
        for port in cli_ports()
    ]


BOARD = Board("dca1000", "TI xWR sensor with a DCA1000EVM (raw samples over UDP)", Dca1000Config, open_dca1000, find)
