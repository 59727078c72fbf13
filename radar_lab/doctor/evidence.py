"""What a recording or a running graph gives the doctor of one radar, gathered message by message, in bounded memory."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from radar_core import DataError, PointCloud, RadarFrame, RadarInfo
from radar_core.gaps import Gaps
from radar_driver.health import Health
from radar_lab.cube_faults import Cubes
from radar_lab.doctor.bursts import Bursts
from radar_tracking import Tracks

Stream = Literal["radar/frame", "radar/points", "tracks"]
STREAMS: Final[tuple[Stream, ...]] = ("radar/frame", "radar/points", "tracks")
CUBES: Final = 240  # whole frames that are kept at most: some seconds, in which somebody walks across; 60 MB of the default radar
_MEMORY: Final = 128 << 20  # bytes of them at most

_REFUSED: Final = 100


@dataclass
class Arrived:
    """Messages of one stream: how many came and were lost, and stamp and arrival of each [ns]."""

    came: int = 0
    lost: int = 0
    times: list[tuple[int, int]] = field(default_factory=list)
    gaps: Gaps = field(default_factory=Gaps)

    def add(self, stamp_ns: int, sequence: int, arrived_ns: int, every: int = 1) -> None:
        """Take in one message."""
        self.came += 1
        self.lost += self.gaps.lost(sequence, every)
        self.times.append((stamp_ns, arrived_ns))


class Evidence:
    """Everything about one radar that the checks look at.

    Parameters
    ----------
    info : RadarInfo
        The radar.
    name : str
        Namespace of the radar; empty: there is one.
    """

    def __init__(self, info: RadarInfo, name: str = "") -> None:
        self.info, self.name = info, name
        self.health, self.bursts = Health(info), Bursts()
        self.arrived: dict[Stream, Arrived] = {stream: Arrived() for stream in STREAMS}
        self.stages: dict[str, tuple[int, int]] = {}  # by stage: messages processed and dropped while it was listened to
        self.clouds: list[PointCloud] = []
        self.tracks: dict[int, Tracks] = {}  # by stamp
        self.refused: list[str] = []  # why messages could not be used, at most a hundred of them
        self.simulated_time = False  # stamps are of a clock that the arrivals are not of
        self.live = False  # messages that did not come here may have reached the graph all the same: its stages know what was lost
        self._first: dict[str, tuple[int, int]] = {}
        self._cubes: list[RadarFrame] = []

    def frame(self, frame: RadarFrame, arrived_ns: int) -> None:
        """Take in a raw frame and when it came [ns]; a `DataError` says that it contradicts the radar's description."""
        frame.check(self.info)
        self.arrived["radar/frame"].add(frame.stamp_ns, frame.sequence, arrived_ns)
        self.health.process(frame, arrived_ns)
        if not len(frame.missing):
            self.bursts.add(frame.cube)
            if len(self._cubes) < min(CUBES, max(_MEMORY // frame.cube.nbytes, 1)):
                self._cubes.append(frame)

    def cloud(self, cloud: PointCloud, arrived_ns: int | None) -> None:
        """Take in a cloud, in the sensor's frame; None: it was made here of a frame and did not travel."""
        if arrived_ns is not None:
            self.arrived["radar/points"].add(cloud.stamp_ns, cloud.sequence, arrived_ns, cloud.every)
        self.clouds.append(cloud)

    def track(self, tracks: Tracks, arrived_ns: int | None) -> None:
        """Take in the tracks of a cloud, likewise."""
        if arrived_ns is not None:
            self.arrived["tracks"].add(tracks.stamp_ns, tracks.sequence, arrived_ns, tracks.every)
        self.tracks[tracks.stamp_ns] = tracks

    def stage(self, name: str, processed: int, dropped: int) -> None:
        """Take in what a stage says it has processed and dropped since it began."""
        first = self._first.setdefault(name, (processed, dropped))
        self.stages[name] = processed - first[0], dropped - first[1]

    def refuse(self, reason: str) -> None:
        """Note that a message could not be used."""
        if len(self.refused) < _REFUSED:
            self.refused.append(reason)

    def cubes(self) -> Cubes:
        """Whole raw frames, shape (n_frames, n_tx, n_chirp, n_rx, n_sample); a `DataError` says that there are none."""
        if not self._cubes:
            raise DataError("no raw frames (radar/frame)")
        return np.stack([frame.cube for frame in self._cubes])

    @property
    def has_cubes(self) -> bool:
        """Whether there are raw frames without lost chirps."""
        return bool(self._cubes)

    def paired(self) -> list[tuple[PointCloud, Tracks]]:
        """Clouds levelled into ``room``, each with its tracks, in order; those without tracks are left out."""
        ordered = sorted(self.clouds, key=lambda cloud: cloud.stamp_ns)
        return [(c.to_room(self.info.mount), self.tracks[c.stamp_ns]) for c in ordered if c.stamp_ns in self.tracks]
