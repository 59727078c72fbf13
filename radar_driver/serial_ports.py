"""Serial ports of TI's boards: which there are, what each is for, and why one cannot be used."""

from __future__ import annotations

import errno
import os
import termios
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final, Literal

import serial
from serial.tools import list_ports

from radar_core import DeviceError

GONE: Final = (OSError, termios.error)  # what pyserial raises, its own errors among them, when a port has gone
_BRIDGES: Final = {
    (0x0451, 0xBEF3): ("auxiliary", "application"),
    (0x0451, 0xBEF4): ("auxiliary", "application"),
    (0x10C4, 0xEA70): ("standard", "enhanced"),
}
"""USB ids of the bridges on TI's boards (XDS110, CP2105): words in the descriptions of the data port and of the command port."""

_ADAPTERS: Final = {(0x1A86, 0x7523), (0x1A86, 0x55D4), (0x10C4, 0xEA60), (0x0403, 0x6001), (0x0403, 0x6015), (0x067B, 0x2303)}
"""USB ids of adapters behind which a radar module may be: CH340, CH9102, CP2102, FT232R, FT230X, PL2303."""

_FORBIDDEN: Final = "{} may not be opened by you: sudo usermod -aG dialout $USER, then log in again"


@dataclass(frozen=True)
class TiPorts:
    """The ports of one board.

    Attributes
    ----------
    number : str
        Serial number; empty: it has none.
    data, command, description : str
        Paths, empty: not there; of the command port, as the system has it.
    """

    number: str
    data: str
    command: str
    description: str


def ti_ports(ports: Iterable[Any] | None = None) -> list[TiPorts]:
    """List the TI boards among the serial ports of this machine, or among others as `serial.tools.list_ports` gives them."""
    boards: dict[tuple[int, str], list[Any]] = {}
    for port in list_ports.comports() if ports is None else ports:
        if (port.vid, port.pid) in _BRIDGES:
            place = port.serial_number or (port.location or port.device).partition(":")[0]
            boards.setdefault((port.vid, place), []).append(port)
    return [_of_board(held) for _, held in sorted(boards.items())]


def _of_board(ports: list[Any]) -> TiPorts:
    """Tell which port is which: by its description, else by its place, in which the command port comes first."""
    ports = sorted(ports, key=lambda port: (port.location or "", port.device))
    words = _BRIDGES[ports[0].vid, ports[0].pid]
    data, command = (next((p for p in ports if word in f"{p.interface or ''} {p.description or ''}".lower()), None) for word in words)
    if data is None:
        data = next((p for p in reversed(ports) if len(ports) > 1 and p is not command), None)
    if command is None:
        command = next((p for p in ports if p is not data), None)
    about = (command.description or "") if command else ""
    return TiPorts(ports[0].serial_number or "", data.device if data else "", command.device if command else "", about)


def adapters() -> list[Any]:
    """List plain USB serial adapters as `serial.tools.list_ports` gives them."""
    return sorted((port for port in list_ports.comports() if (port.vid, port.pid) in _ADAPTERS), key=lambda port: str(port.device))


def only_adapter() -> str:
    """Path of the only plain USB serial adapter; a `DeviceError` says that there is none, or another one."""
    return _only([port.device for port in adapters()], "USB serial adapter can be chosen", "port")


def access_problem(port: str) -> str:
    """Say why this user may not open a port, and what to do; empty: the user may."""
    return "" if os.access(port, os.R_OK | os.W_OK) else _FORBIDDEN.format(port)


def open_port(port: str, baud: int, **options: Any) -> serial.Serial:
    """Open a serial port for this program alone; ``options`` go to pyserial.

    A `DeviceError` says that it is not there, may not be opened, or is held by another program, and what to do.
    """
    try:
        return serial.Serial(port, baud, exclusive=True, **options)
    except (*GONE, ValueError) as error:
        raise DeviceError(_explain(port, error), gone=True) from None


def _explain(port: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return f"there is no serial port {port}: plug the board in; handwave devices lists the ports that there are"
    if number in (errno.EACCES, errno.EPERM):
        return _FORBIDDEN.format(port)
    if number in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK) or "exclusively lock" in str(error):
        return f"another program holds {port}: close it (fuser -v {port} names it)"
    return f"{port} cannot be used as a serial port: {error}"


def only_port(kind: Literal["data", "command"], knob: str) -> str:
    """Path of the only data or command port of TI boards that is plugged in; a `DeviceError` says that there is none, or another one."""
    ports = [path for board in ti_ports() if (path := board.data if kind == "data" else board.command)]
    return _only(ports, f"{kind} port of a TI board can be chosen", knob)


def _only(ports: list[str], what: str, knob: str) -> str:
    if len(ports) == 1:
        return ports[0]
    found = (
        f"there are several: {', '.join(ports)}; set {knob} to one of them" if ports else f"plug the sensor's USB cable in, or set {knob}"
    )
    raise DeviceError(f"no {what}: {found}", gone=True)


def close_port(link: serial.Serial | None) -> None:
    """Close a serial port, if it is open."""
    if link is not None:
        with suppress(*GONE):  # it was unplugged; its descriptor is closed all the same
            link.close()
