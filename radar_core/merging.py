"""Putting the clouds of several sensors into one (thesis, figure A.16)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from operator import or_

import numpy as np
from numpy.typing import NDArray

from radar_core.cloud import ARRAY_FIELDS, PointCloud
from radar_core.composite import CloudComposite, CloudSource
from radar_core.errors import ConfigError, DataError
from radar_core.geometry import Pose

_SECOND = 1_000_000_000  # ns


def merge(clouds: Sequence[PointCloud], mounts: Sequence[Pose], tolerance: float = 0.02) -> CloudComposite:
    """Put the clouds that several sensors made at about the same time into one, in ``room``.

    Parameters
    ----------
    clouds : sequence of PointCloud
        At least one, in sensor frames, or in ``room`` already. Composites may be merged again.
    mounts : sequence of Pose
        Where each sensor stands; not used for a cloud that is in ``room`` already.
    tolerance : float
        How far apart the stamps may lie [s]. Nothing is moved in time: at 4 m/s the default of 20 ms is a step of 80 mm at most.

    Returns
    -------
    CloudComposite
        The points of the first cloud, then those of the second, and so on. With one cloud: the points of ``cloud.to_room(mount)``.

    Raises
    ------
    DataError
        When there is no cloud, not one mount for each, or stamps lie further apart than ``tolerance``.
    ConfigError
        When ``tolerance`` is negative or not finite.
    """
    if not (math.isfinite(tolerance) and tolerance >= 0):
        raise ConfigError(f"tolerance is {tolerance}; it must be a finite number of seconds, 0 or more")
    if not clouds or len(clouds) != len(mounts):
        raise DataError(f"{len(clouds)} clouds with {len(mounts)} mounts cannot be merged; give at least one cloud, and one mount for each")
    sources = [_sources(cloud, mount) for cloud, mount in zip(clouds, mounts, strict=True)]
    together = [source for group in sources for source in group]
    _refuse_apart(together, tolerance)
    levelled = [cloud.to_room(mount) for cloud, mount in zip(clouds, mounts, strict=True)]
    first = np.cumsum([0, *map(len, sources)])  # number of each cloud's first source
    return CloudComposite(
        stamp_ns=max(source.stamp_ns for source in together),
        sequence=together[0].sequence,
        frame_id="room",
        **{name: np.concatenate([getattr(cloud, name) for cloud in levelled]) for name in ARRAY_FIELDS},
        quality=reduce(or_, (source.quality for source in together)),
        every=max(cloud.every for cloud in clouds),
        sensor=np.concatenate([start + _sensor(cloud) for start, cloud in zip(first, clouds, strict=False)]).astype(np.int32),
        sources=tuple(together),
    )


def _sources(cloud: PointCloud, mount: Pose) -> tuple[CloudSource, ...]:
    if isinstance(cloud, CloudComposite):
        return cloud.sources
    return (CloudSource(cloud.frame_id, mount, cloud.stamp_ns, cloud.sequence, cloud.quality, cloud.every),)


def _sensor(cloud: PointCloud) -> NDArray[np.int32]:
    return cloud.sensor if isinstance(cloud, CloudComposite) else np.zeros(len(cloud), np.int32)


def _refuse_apart(sources: Sequence[CloudSource], tolerance: float) -> None:
    """Raise `DataError` naming the earliest and the latest when they lie too far apart."""
    early, late = min(sources, key=lambda s: s.stamp_ns), max(sources, key=lambda s: s.stamp_ns)
    apart = late.stamp_ns - early.stamp_ns
    if apart > round(tolerance * _SECOND):
        raise DataError(
            f"cloud {late.sequence} of {late.frame_id!r} is {apart / _SECOND:.6g} s younger than cloud {early.sequence} of "
            f"{early.frame_id!r}, more than the tolerance of {tolerance:g} s; pair clouds by their stamps, or synchronise the clocks"
        )
