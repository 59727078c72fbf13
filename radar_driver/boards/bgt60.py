"""Infineon's BGT60TR13C: 60 GHz, one transmitter, three receivers, through the maker's library."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from radar_core import DeviceError
from radar_driver.bgt60.config import Bgt60Config
from radar_driver.bgt60.source import Bgt60, load_sdk
from radar_driver.boards import Board, Found


def find() -> Sequence[Found]:
    """List the boards that the maker's library sees; none where it is not installed."""
    try:
        fmcw, _ = load_sdk()
    except DeviceError:
        return ()
    return [Found("bgt60", f"BGT60TR13C {uuid}", {"uuid": str(uuid)}) for uuid in fmcw.DeviceFmcw.get_list()]


_TITLE: Final = "Infineon BGT60TR13C (60 GHz, three receivers; raw frames through Infineon's ifxradarsdk, which has to be installed)"
BOARD = Board("bgt60", _TITLE, Bgt60Config, Bgt60, find)
