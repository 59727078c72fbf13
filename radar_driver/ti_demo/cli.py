"""Starts a demo: sends the lines of a .cfg to the command port."""

from __future__ import annotations

import re
import termios
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import serial

from radar_core import DeviceError
from radar_driver.ti_demo.uart import explain

SendConfig = Callable[[str, Path], None]
"""Sends a .cfg to the command port of that path; a `DeviceError` says which line the radar refused."""

_BAUD: Final = 115200
_ANSWER: Final = 3.0  # s: sensorStart calibrates the front end, which takes about a second
_BAD: Final = re.compile(r"error|not recognized|exception", re.IGNORECASE)


def send_config(port: str, path: Path) -> None:
    """Send every command of a .cfg, each after the answer to the one before.

    Parameters
    ----------
    port : str
        The command port, e.g. ``/dev/ttyACM0``.
    path : Path
        The .cfg.

    Raises
    ------
    DeviceError
        When the port cannot be opened, the file not be read, or a line is refused or not answered.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DeviceError(f"{path}: cannot be read as a configuration ({error})") from None
    commands = [(number, line.strip()) for number, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("%")]
    try:
        with serial.Serial(port, _BAUD, timeout=0.1, write_timeout=_ANSWER, exclusive=True) as line:
            line.reset_input_buffer()
            for number, command in commands:
                line.write(command.encode() + b"\n")
                answer = _answer(line)
                if _BAD.search(answer) or "Done" not in answer:
                    raise DeviceError(f"{path}:{number}: {port} answers {command!r} with {answer.strip()[-200:]!r}; {_advice(answer)}")
    except (OSError, termios.error) as error:
        raise DeviceError(explain(port, error), gone=True) from None


def _answer(line: serial.Serial) -> str:
    """Read until the radar says that it is done, or too long."""
    text, end = "", time.monotonic() + _ANSWER
    while time.monotonic() < end and len(text) < 65536:
        text += line.read(max(1, line.in_waiting)).decode("utf-8", "replace")
        done = text.find("Done")
        if (done >= 0 and ">" in text[done:]) or _BAD.search(text):
            break
    return text


def _advice(answer: str) -> str:
    if not answer:
        return "is this the command port (Application/User UART), and is the demo running (not in flashing mode)? Press reset and try again"
    return "the .cfg is for another demo or chip; use one of those that came with the demo that is flashed"
