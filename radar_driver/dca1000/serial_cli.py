"""The sensor's command line on a serial port: a line in, words and a prompt out."""

from __future__ import annotations

import re
import time
from typing import Final

import serial

from radar_core import DeviceError
from radar_driver.components import Report
from radar_driver.serial_ports import GONE, close_port, only_port, open_port

BAUD: Final = 115200
_PROMPT: Final = re.compile(rb"(\w*):/>\s*$")
_FIRMWARE: Final = "mmwDemo"
_GREETINGS: Final = 3
_SLICE: Final = 0.02  # s
_LONGEST: Final = 1 << 14  # bytes of an answer
_REFUSED: Final = re.compile(r"^(error|.*not recognized)", re.IGNORECASE)


class SerialCli:
    """The command line of TI's mmWave demo.

    Parameters
    ----------
    port : str
        E.g. ``/dev/ttyACM0``; ``auto``: the only one that is plugged in.
    timeout : float
        How long the answer to one line may take [s].
    firmware : str
        What its prompt has to begin with; empty: any will do.
    """

    def __init__(self, port: str, timeout: float, firmware: str = _FIRMWARE) -> None:
        self._port, self._timeout, self._firmware = port, timeout, firmware
        self._link: serial.Serial | None = None
        self._used = port
        self._sent = 0

    def open(self) -> None:
        """Open the port and see whether the sensor's demo answers.

        A `DeviceError` says that the port is not there, not allowed or held, that nobody answers, or that another firmware does.
        """
        self._used = only_port("command", "serial_port") if self._port == "auto" else self._port
        self._link = open_port(self._used, BAUD, timeout=_SLICE, write_timeout=self._timeout)
        try:
            self._greet()
        except DeviceError:
            self.close()
            raise

    def close(self) -> None:
        """Let go of the port."""
        link, self._link = self._link, None
        close_port(link)

    def report(self) -> Report:
        """Give the lines sent."""
        return {"lines_sent": self._sent}

    def send(self, line: str, where: str = "", *, timeout: float = 0.0) -> None:
        """Send one line and wait until it is done.

        ``where`` is file and number of the line, for messages; ``timeout`` how long the answer may take [s], 0: as given at first.
        A `DeviceError` says that the sensor refuses the line (with its own words), does not answer in time, or is gone.
        """
        timeout = timeout or self._timeout
        said, firmware = self._exchange(line, timeout)
        self._sent += 1
        origin = f"{where}: " if where else ""
        if firmware is None:
            heard = f"; it said only: {' / '.join(said)}" if said else ""
            raise DeviceError(
                f"{origin}the sensor did not finish {line!r} within {timeout:g} s{heard}. It hangs: switch it off and on; this driver "
                "then sends its configuration again",
                gone=True,
            )
        refused = [text for text in said if _REFUSED.match(text)]
        if refused:
            raise DeviceError(
                f"{origin}the sensor refuses {line!r}: {' / '.join(refused)}. Correct the line: see the mmWave SDK's guide of the version "
                "that the sensor runs",
                gone=True,
            )

    def _greet(self) -> None:
        """See who is there."""
        heard: list[str] = []
        firmware = None
        for _ in range(_GREETINGS):  # the first one may end a line that somebody began
            said, firmware = self._exchange("", self._timeout / _GREETINGS)
            heard += said
            if firmware is not None:
                break
        if firmware is not None and firmware.startswith(self._firmware):
            return
        if firmware is not None:
            problem = f"runs another firmware (its prompt is {firmware}:/>)"
        elif heard:
            problem = f"says {' / '.join(dict.fromkeys(heard))[:100]!r} and gives no prompt"
        else:
            problem = "does not answer"
        raise DeviceError(
            f"the sensor on {self._used} {problem}. It needs the demo of the mmWave SDK in its flash, jumpers for functional mode "
            "(SOP 001), power, and the right port: that of the command line (Application/User UART, or Enhanced), not that of the data",
            gone=True,
        )

    def _exchange(self, line: str, timeout: float) -> tuple[list[str], str | None]:
        """Send a line; what was said before the prompt, echo left out, and the prompt's name, None where none came in time."""
        link = self._link
        if link is None:
            raise DeviceError("the sensor's serial port is not open", gone=True)
        heard = b""
        found = None
        try:
            link.reset_input_buffer()
            link.write(line.encode("ascii", "replace") + b"\n")
            end = time.monotonic() + timeout
            while found is None and time.monotonic() < end:
                heard = (heard + link.read(max(1, link.in_waiting)))[-_LONGEST:]
                found = _PROMPT.search(heard)
        except GONE as error:
            raise DeviceError(f"the sensor's serial port {self._used} is gone ({error}): plug its USB cable in again", gone=True) from None
        text = heard[: found.start()] if found else heard
        said = [word.strip() for word in text.decode("ascii", "replace").splitlines()]
        return [word for word in said if word and word != line], found.group(1).decode() if found else None
