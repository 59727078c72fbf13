"""What every importer makes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from radar_core import PointCloud, Pose, RadarFrame, RadarInfo
from radar_core.config import config, knob
from radar_sim.truth import Truth

Item = PointCloud | RadarFrame | Truth


@config
class SourceOptions:
    """Where the radar stood; every kind of recording has these options."""

    height: float = knob(1.2, unit="m", low=-100.0, high=100.0, doc="of the radar above the floor")
    yaw: float = knob(0.0, unit="rad", low=-6.3, high=6.3, doc="boresight from the room's x towards its y, left positive")
    tilt: float = knob(0.0, unit="rad", low=-1.57, high=1.57, doc="boresight above the horizon, up positive")

    @property
    def mount(self) -> Pose:
        """Pose of the radar in the room."""
        return Pose(z=self.height, yaw=self.yaw, tilt=self.tilt)


START_NS: Final[int] = 1_000_000_000
"""Stamp of the first frame of recordings that carry no time; not 0, which ROS reads as "no time"."""


@dataclass(frozen=True)
class Segment:
    """A labelled part of a recording.

    Attributes
    ----------
    label : str
        As the original says.
    subject : int
        Who.
    distance : float
        From the radar [m]; NaN: unknown.
    start_ns, end_ns : int
        Stamps of its first and last cloud [ns].
    """

    label: str
    subject: int
    distance: float
    start_ns: int
    end_ns: int


@dataclass
class Tally:
    """What an importer counts while its items are taken: rows it dropped, by reason, segments, and sentences for the user."""

    dropped: Counter[str] = field(default_factory=Counter)
    segments: list[Segment] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Recording:
    """A recording being read.

    Attributes
    ----------
    info : RadarInfo
        The radar.
    items : iterator of PointCloud, RadarFrame or Truth
        In the order of time; read once.
    tally : Tally
        Complete when ``items`` is exhausted.
    """

    info: RadarInfo
    items: Iterator[Item]
    tally: Tally
