"""The serial port on which a demo sends its packets."""

from __future__ import annotations

from contextlib import suppress
from typing import Final

import serial

from radar_core import DeviceError
from radar_driver.components import Component, Report
from radar_driver.serial_ports import GONE, open_port, ti_ports

_CHUNK: Final = 1 << 16  # bytes: as much as the longest packet


class Uart(Component):
    """A serial port of which nobody else reads.

    Parameters
    ----------
    port : str
        Path, e.g. ``/dev/ttyACM1``; empty: the only data port of a TI board that is plugged in.
    baud : int
        Bits per second.
    """

    name = "data port"

    def __init__(self, port: str, baud: int) -> None:
        self._wanted, self.port, self.baud = port, port, baud
        self._serial: serial.Serial | None = None

    def power_up(self) -> None:
        """Open the port for this program alone; a `DeviceError` says that it is not there or may not be opened, and what to do."""
        self.power_down()
        self.port = self._wanted or _only_port()
        self._serial = open_port(self.port, self.baud, timeout=0)

    def power_down(self) -> None:
        """Close the port."""
        held, self._serial = self._serial, None
        if held is not None:
            with suppress(*GONE):  # the port has gone; its descriptor is closed all the same
                held.close()

    def read(self, timeout: float) -> bytes:
        """Read what is there, waiting ``timeout`` seconds at most for the first byte; empty: nothing came.

        A `DeviceError` says that the port has disappeared, or was never opened.
        """
        if self._serial is None:
            raise DeviceError(f"{self.port} is not open", gone=True)
        try:
            if self._serial.timeout != timeout:
                self._serial.timeout = timeout
            first: bytes = self._serial.read(1)
            return first + self._serial.read(min(self._serial.in_waiting, _CHUNK)) if first else first
        except (*GONE, TypeError) as error:  # TypeError: pyserial, when another thread closed it
            raise DeviceError(
                f"{self.port} has gone ({error}): plug the board in again, or, if it is still there, close the other program that reads it",
                gone=True,
            ) from None

    def resume(self) -> None:
        """Throw away what has come so far."""
        if self._serial is None:
            raise DeviceError(f"{self.port} is not open", gone=True)
        try:
            self._serial.reset_input_buffer()
        except GONE as error:
            raise DeviceError(f"{self.port} has gone ({error}): plug the board in again", gone=True) from None

    def report(self) -> Report:
        """Name the port."""
        return {"port": self.port, "baud": self.baud}


def _only_port() -> str:
    """Path of the only data port that is plugged in."""
    ports = [board.data for board in ti_ports() if board.data]
    if len(ports) == 1:
        return ports[0]
    if not ports:
        raise DeviceError(
            "no TI board is plugged in: connect its USB socket and let it run its demo; or name the serial port (knob port)",
            gone=True,
        )
    raise DeviceError(f"several TI boards are plugged in; choose one with the knob port: {', '.join(ports)}", gone=True)
