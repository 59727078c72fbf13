"""The serial port on which a demo sends its packets."""

from __future__ import annotations

import errno
import termios
from contextlib import suppress
from typing import Final

import serial

from radar_core import DeviceError
from radar_driver.components import Device, Report

_CHUNK: Final = 1 << 16  # bytes: as much as the longest packet


class Uart(Device):
    """A serial port of which nobody else reads.

    Parameters
    ----------
    port : str
        Path, e.g. ``/dev/ttyACM1``.
    baud : int
        Bits per second.
    """

    name = "data port"

    def __init__(self, port: str, baud: int) -> None:
        self.port, self.baud = port, baud
        self._serial: serial.Serial | None = None

    def open(self) -> None:
        """Open the port for this program alone.

        Raises
        ------
        DeviceError
            When it is not there, may not be opened, or another program holds it; with what to do.
        """
        self.close()
        try:
            self._serial = serial.Serial(self.port, self.baud, timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            raise DeviceError(explain(self.port, error), gone=True) from None

    def close(self) -> None:
        """Close the port."""
        held, self._serial = self._serial, None
        if held is not None:
            with suppress(OSError, termios.error):  # the port has gone; its descriptor is closed all the same
                held.close()

    def read(self, timeout: float) -> bytes:
        """Read what is there; wait for the first byte so long [s].

        Returns
        -------
        bytes
            Empty: nothing came.

        Raises
        ------
        DeviceError
            ``gone``: the port has disappeared, or was never opened.
        """
        if self._serial is None:
            raise DeviceError(f"{self.port} is not open", gone=True)
        try:
            if self._serial.timeout != timeout:
                self._serial.timeout = timeout
            first: bytes = self._serial.read(1)
            return first + self._serial.read(min(self._serial.in_waiting, _CHUNK)) if first else first
        except (OSError, TypeError, termios.error) as error:  # TypeError: pyserial, when another thread closed it
            raise DeviceError(
                f"{self.port} has gone ({error}): plug the board in again, or, if it is still there, close the other program that reads it",
                gone=True,
            ) from None

    def flush(self) -> None:
        """Throw away what has come so far."""
        if self._serial is None:
            raise DeviceError(f"{self.port} is not open", gone=True)
        try:
            self._serial.reset_input_buffer()
        except (OSError, termios.error) as error:
            raise DeviceError(f"{self.port} has gone ({error}): plug the board in again", gone=True) from None

    def report(self) -> Report:
        """Name the port."""
        return {"port": self.port, "baud": self.baud}


def explain(port: str, error: Exception) -> str:
    """Say why a serial port cannot be opened, and what to do."""
    number = getattr(error, "errno", None)
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return f"there is no {port}: plug the board in; handwave devices lists the ports that there are"
    if number in (errno.EACCES, errno.EPERM):
        return f"{port} may not be opened by you: sudo usermod -aG dialout $USER, then log in again"
    if number in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK):
        return f"another program holds {port}: close it (fuser -v {port} names it)"
    return f"{port} cannot be used as a serial port: {error}"
