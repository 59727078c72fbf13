"""Recorded raw frames as a source: reads the messages of a rosbag2 recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from radar_core.config import config, knob
from radar_driver.boards import Board, register
from radar_driver.sources import Context

if TYPE_CHECKING:
    from radar_driver.paced import Paced


@config
class BagConfig:
    """Which recording."""

    bag: str = knob("", doc="source bag: folder of the recording")


def open_bag(config: BagConfig, context: Context) -> Paced:
    """Make the source of a recording."""
    from radar_driver.paced import Paced
    from radar_ros.bag_frames import BagFrames  # nodes of other sources start without what reads bags

    return Paced(BagFrames(Path(config.bag), context.namespace), context)


BOARD = register(Board("bag", "recording of raw frames (rosbag2)", BagConfig, open_bag, prefix="", paced=True))
