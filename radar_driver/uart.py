"""A serial port that sends bytes all the time, as a part of a radar."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import serial

from radar_core import DeviceError
from radar_driver.components import Component, Report
from radar_driver.serial_ports import GONE, close_port, only_port, open_port

BITS: Final = 10  # on the line for a byte: start, 8, stop
_CHUNK: Final = 1 << 16  # bytes: as much as the longest packet
_WRITE: Final = 1.0  # s: how long a few bytes may take to be sent


class Uart(Component):
    """A serial port of which nobody else reads; without a path, what ``choose`` finds: the only data port of a TI board."""

    name = "data port"

    def __init__(self, port: str, baud: int, choose: Callable[[], str] = lambda: only_port("data", "port")) -> None:
        self._wanted, self.port, self.baud, self._choose = port, port, baud, choose
        self._serial: serial.Serial | None = None

    def power_up(self) -> None:
        """Open the port for this program alone; a `DeviceError` says that it is not there or may not be opened, and what to do."""
        self.power_down()
        self.port = self._wanted or self._choose()
        self._serial = open_port(self.port, self.baud, timeout=0, write_timeout=_WRITE)

    def power_down(self) -> None:
        """Close the port."""
        held, self._serial = self._serial, None
        close_port(held)

    def read(self, timeout: float) -> bytes:
        """Read what is there, waiting ``timeout`` seconds at most for the first byte; empty: nothing came.

        A `DeviceError` says that the port has disappeared, or was never opened.
        """
        link = self._open()
        try:
            if link.timeout != timeout:
                link.timeout = timeout
            first: bytes = link.read(1)
            return first + link.read(min(link.in_waiting, _CHUNK)) if first else first
        except (*GONE, TypeError) as error:  # TypeError: pyserial, when another thread closed it
            raise DeviceError(
                f"{self.port} has gone ({error}): plug the board in again, or, if it is still there, close the other program that reads it",
                gone=True,
            ) from None

    def write(self, data: bytes) -> None:
        """Send bytes; a `DeviceError` says that the port has disappeared, or takes none."""
        try:
            self._open().write(data)
        except (*GONE, TypeError) as error:
            raise DeviceError(f"{self.port} takes no bytes ({error}): plug the board in again", gone=True) from None

    def resume(self) -> None:
        """Throw away what has come so far."""
        try:
            self._open().reset_input_buffer()
        except GONE as error:
            raise DeviceError(f"{self.port} has gone ({error}): plug the board in again", gone=True) from None

    def _open(self) -> serial.Serial:
        if self._serial is None:
            raise DeviceError(f"{self.port} is not open", gone=True)
        return self._serial

    def report(self) -> Report:
        """Name the port."""
        return {"port": self.port, "baud": self.baud}
