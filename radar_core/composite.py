"""The clouds of several sensors as one (thesis, figure A.16, TargetsComposite)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from radar_core.checks import require_shape
from radar_core.cloud import ARRAY_FIELDS, PointCloud, Quality
from radar_core.errors import DataError
from radar_core.geometry import Pose


@dataclass(frozen=True)
class CloudSource:
    """Where the points of one sensor came from: the sensor, its mount, and the cloud that was merged."""

    frame_id: str
    mount: Pose
    stamp_ns: int
    sequence: int
    quality: Quality
    every: int = 1


@dataclass(frozen=True, eq=False)
class CloudComposite(PointCloud):
    """Clouds of several sensors that are used like one `PointCloud` in ``room``; made by `radar_core.merge`.

    Positions are in ``room``. What a sensor measured (range, azimuth, elevation, radial_speed and their standard deviations) stays
    relative to that sensor; `sensor` says to which.

    Attributes
    ----------
    stamp_ns : int
        The latest of the sources' stamps [ns], so that the stamps of a stream of composites never go back.
    sequence : int
        Of the first source; another count: ``dataclasses.replace(composite, sequence=...)``.
    quality : Quality
        What is wrong with any of the sources.
    every : int
        The largest of the merged clouds; whoever counts composites anew replaces it along with the sequence.
    sensor : ndarray of int32, shape (n_points,)
        Index into `sources` of the sensor that saw the point.
    sources : tuple of CloudSource
        The sensors, in the order of the merged clouds.
    """

    sensor: NDArray[np.int32] = field(default_factory=lambda: np.empty(0, np.int32))
    sources: tuple[CloudSource, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        require_shape("CloudComposite.sensor", self.sensor, (len(self.x),))
        if self.sensor.dtype != np.int32:
            raise DataError(f"CloudComposite.sensor is {self.sensor.dtype}, expected int32")
        if len(self.sensor) and not (self.sensor.min() >= 0 and self.sensor.max() < len(self.sources)):
            raise DataError(f"CloudComposite.sensor has entries outside 0..{len(self.sources) - 1}, the indices of its sources")

    def select(self, index: NDArray[np.generic]) -> CloudComposite:
        """Keep the points that a mask or an index array picks, in its order; the sources stay."""
        return replace(self, sensor=self.sensor[index], **{name: getattr(self, name)[index] for name in ARRAY_FIELDS})

    @property
    def parts(self) -> tuple[PointCloud, ...]:
        """The points of each source as a cloud of its own in ``room``, with that source's stamp, sequence, quality and stride."""
        found = []
        for number, s in enumerate(self.sources):
            arrays = {name: getattr(self, name)[self.sensor == number] for name in ARRAY_FIELDS}
            found.append(PointCloud(s.stamp_ns, s.sequence, self.frame_id, **arrays, quality=s.quality, every=s.every))
        return tuple(found)
