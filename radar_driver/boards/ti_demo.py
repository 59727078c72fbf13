"""TI's radars (xWR14xx, 16xx, 18xx, 68xx, ...) with a demo that sends point clouds over a serial port."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import Any, Final

from serial.tools import list_ports

from radar_core import DeviceError
from radar_driver.boards import Board, Found
from radar_driver.ti_demo.source import TiDemo, TiDemoConfig

_NAME: Final = "ti_demo"
_PORTS: Final = {(0x0451, 0xBEF3): ("Auxiliary", "User"), (0x10C4, 0xEA70): ("Standard", "Enhanced")}
"""USB ids of the bridges on TI's boards (XDS110, CP2105): words in the names of their data port and of their command port."""


def find_ports(ports: Iterable[Any] | None = None) -> tuple[Found, ...]:
    """List the boards among the serial ports of this machine, or among others as `serial.tools.list_ports` gives them."""
    boards: dict[tuple[int, int, str], list[Any]] = {}
    for port in list_ports.comports() if ports is None else ports:
        if (port.vid, port.pid) in _PORTS:
            boards.setdefault((port.vid, port.pid, port.serial_number or ""), []).append(port)
    return tuple(_found(_PORTS[key[:2]], key[2], held) for key, held in sorted(boards.items()))


def _found(words: tuple[str, str], number: str, ports: list[Any]) -> Found:
    """Tell which port is which: by its name, else by its place, in which the command port comes first."""
    ports = sorted(ports, key=lambda port: (port.location or "", port.device))
    named = [next((p for p in ports if word in (p.interface or p.description or "")), None) for word in words]
    data = named[0] or (ports[-1] if len(ports) > 1 else None)
    command = named[1] or next((p for p in ports if p is not data), None)
    options = {"port": data.device if data else "", "cli_port": command.device if command else ""}
    parts = {"": options["port"], "commands at ": options["cli_port"], "serial number ": number}
    address = ", ".join(word + part for word, part in parts.items() if part)
    return Found(_NAME, address, {"port": options["port"]}, _problem(options))


def _problem(options: dict[str, str]) -> str:
    port = options["port"]
    if not port:
        return "only the command port is there: plug the board in again, or try another cable"
    if not os.access(port, os.R_OK | os.W_OK):
        return f"{port} may not be opened by you: sudo usermod -aG dialout $USER, then log in again"
    return ""


def only_port() -> str:
    """Path of the only data port that is plugged in.

    Raises
    ------
    DeviceError
        When there is none, or there are several.
    """
    ports = [str(found.options["port"]) for found in find_ports() if found.options["port"]]
    if len(ports) == 1:
        return ports[0]
    if not ports:
        raise DeviceError(
            "no TI board is plugged in: connect its USB socket and let it run its demo; or name the serial port (knob port)",
            gone=True,
        )
    raise DeviceError(f"several TI boards are plugged in; choose one with the knob port: {', '.join(ports)}", gone=True)


def open_board(settings: TiDemoConfig) -> TiDemo:
    """Make the source of a configuration."""
    return TiDemo(settings, only_port)


def find() -> Sequence[Found]:
    """List what is plugged in."""
    return find_ports()


BOARD: Final = Board(
    name=_NAME,
    title="TI mmWave radar with the out-of-the-box or a people-counting demo (point clouds over a serial port)",
    config=TiDemoConfig,
    open=open_board,
    find=find,
    clouds=True,
)
