"""Acconeer's A121: 60 GHz pulses, one channel, over the network from its exploration server."""

from __future__ import annotations

from typing import Final

from radar_driver.a121.config import A121Config
from radar_driver.a121.source import A121
from radar_driver.boards import Board

_TITLE: Final = "Acconeer A121 (60 GHz, one channel without angle: presence, breathing, push, pull, wave; exploration server over TCP)"
BOARD = Board("a121", _TITLE, A121Config, A121)
