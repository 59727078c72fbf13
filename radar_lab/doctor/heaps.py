"""Heaps of moving points: where something moves, told from the clouds alone, without any tracker."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from radar_core import PointCloud
from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.clustering import Clustering, ClusteringConfig, ClusterPoints

MOVES: Final = 0.2  # m/s: `radar_lab.mirrored_angle` takes the same; what stands still leaks up to one Doppler cell, 0.13 m/s by default
WINDOW: Final = 0.5  # s: one step; both legs and the trunk have been seen
NEAR: Final = 0.5  # m: a body is that wide
_STEADY: Final = 0.5  # of the clouds of a window have a point of a heap; a false alarm has one


@dataclass(frozen=True, eq=False)
class Heap:
    """Points that move together for half a second.

    Attributes
    ----------
    place : ndarray of float64, shape (2,)
        On the floor of ``room`` [m].
    time, range, speed, snr : ndarray of float64, shape (n_points,)
        Of its points [s, m, m/s, dB].
    position : ndarray of float64, shape (n_points, 2)
        Of its points [m].
    """

    place: Float64Array
    position: Float64Array
    time: Float64Array
    range: Float64Array
    speed: Float64Array
    snr: Float64Array


@dataclass(frozen=True, eq=False)
class Window:
    """Half a second: its clouds by number, its middle [s], and what moved in it, the strongest first."""

    clouds: range
    time: float
    heaps: tuple[Heap, ...]


def windows(clouds: Sequence[PointCloud], *, along_range: bool = False) -> list[Window]:
    """Cut a recording into windows and find the heaps of each.

    Parameters
    ----------
    clouds : sequence of PointCloud
        In ``room``, in order.
    along_range : bool
        Heap points by range alone: for radars without azimuth, and where azimuths may be what is wrong.
    """
    times = np.array([cloud.stamp_ns - clouds[0].stamp_ns for cloud in clouds]) * 1e-9 if clouds else np.empty(0)
    number = (times // WINDOW).astype(int)
    first = np.searchsorted(number, np.arange(number[-1] + 2 if len(number) else 0))
    cut = [range(a, b) for a, b in zip(first[:-1].tolist(), first[1:].tolist(), strict=True) if b > a]
    return [Window(part, float(times[part].mean()), _heaps(clouds, times, part, along_range)) for part in cut]


def _heaps(clouds: Sequence[PointCloud], times: Float64Array, part: range, along_range: bool) -> tuple[Heap, ...]:
    moving = [_moving(clouds[k], along_range) for k in part]
    cloud = np.concatenate([np.full(int(mask.sum()), k) for k, mask in zip(part, moving, strict=True)])
    if len(cloud) == 0:
        return ()
    names = ("x", "y", "range", "radial_speed", "snr")
    x, y, away, speed, snr = (
        np.concatenate([getattr(clouds[k], name)[mask] for k, mask in zip(part, moving, strict=True)]).astype(float) for name in names
    )
    place = np.column_stack([away, np.zeros_like(away)] if along_range else [x, y])
    labels: IndexArray = Clustering(ClusteringConfig(eps=NEAR, min_points=2)).labels(ClusterPoints(place))
    found = []
    for label in range(labels.max(initial=-1) + 1):
        own = labels == label
        if len(np.unique(cloud[own])) >= max(_STEADY * len(part), 2):
            weight = 10 ** (np.nan_to_num(snr[own]) / 20)
            centre = np.average(np.column_stack([x, y])[own], axis=0, weights=weight)
            found.append(Heap(centre, np.column_stack([x, y])[own], times[cloud[own]], away[own], speed[own], snr[own]))
    return tuple(sorted(found, key=lambda heap: -float(np.nanmax(heap.snr, initial=-100.0))))


def _moving(cloud: PointCloud, along_range: bool) -> BoolArray:
    moves: BoolArray = np.abs(cloud.radial_speed) > MOVES
    known = np.isfinite(cloud.range) if along_range else np.isfinite(cloud.x) & np.isfinite(cloud.y)
    return np.asarray(moves & known)
