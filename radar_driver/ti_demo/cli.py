"""Starts a demo: sends the lines of a .cfg to the command port."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from radar_core import DeviceError
from radar_driver.dca1000.serial_cli import SerialCli

SendConfig = Callable[[str, Path], None]
"""Sends a .cfg to the command port of that path; a `DeviceError` says which line the radar refused."""

_ANSWER: Final = 3.0  # s: sensorStart calibrates the front end, which takes about a second


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
    line = SerialCli(port, _ANSWER, firmware="")  # every demo has a prompt of its own
    line.open()
    try:
        for number, command in commands:
            line.send(command, f"{path}:{number}")
    finally:
        line.close()
