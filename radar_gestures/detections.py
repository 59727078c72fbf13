"""The detections of one track: whose points they are, and the strongest of every Doppler gate (thesis, section 7.2)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from radar_core import PointCloud
from radar_core.types import Float32Array


class Detections(Protocol):
    """What features and maps need of a cloud, or of one track's share of it; every array float32, shape (n_points,)."""

    @property
    def stamp_ns(self) -> int:
        """Of the cloud [ns]."""

    @property
    def radial_speed(self) -> Float32Array:
        """Range rate, positive = receding [m/s]."""

    @property
    def snr(self) -> Float32Array:
        """Signal over noise floor [dB]."""

    @property
    def range(self) -> Float32Array:
        """Distance from the sensor [m]."""

    @property
    def azimuth(self) -> Float32Array:
        """Seen from the sensor, left positive [rad]."""

    @property
    def elevation(self) -> Float32Array:
        """Seen from the sensor, up positive [rad]."""


@dataclass(frozen=True, eq=False)
class Share:
    """The detections of a cloud that belong to one track; as `Detections`."""

    stamp_ns: int
    radial_speed: Float32Array
    snr: Float32Array
    range: Float32Array
    azimuth: Float32Array
    elevation: Float32Array


def shares(cloud: PointCloud, owner: NDArray[np.integer], track_ids: Iterable[int]) -> Iterator[Share]:
    """Give each track its share of a cloud.

    Parameters
    ----------
    cloud : PointCloud
        All detections.
    owner : ndarray of int, shape (n_points,)
        Track of each detection.
    track_ids : iterable of int
        Whose shares, in this order.
    """
    values = np.array((cloud.radial_speed, cloud.snr, cloud.range, cloud.azimuth, cloud.elevation))
    for track_id in track_ids:
        yield Share(cloud.stamp_ns, *values[:, owner == track_id])


def doppler_gates(radial_speed: Float32Array, snr: Float32Array, gate: float) -> NDArray[np.intp]:
    """Pick the strongest detection of every Doppler gate (section 7.2).

    Parameters
    ----------
    radial_speed, snr : ndarray, shape (n_points,)
        Range rate [m/s] and SNR [dB]; a detection without a range rate is never picked, one without an SNR only when alone.
    gate : float
        Width of a gate [m/s].

    Returns
    -------
    ndarray of int, shape (n_gates,)
        Indices into the arrays, ordered by range rate.
    """
    known = np.flatnonzero(np.isfinite(radial_speed))
    number = np.rint(radial_speed[known].astype(np.float64) / gate)
    strength = snr[known]
    order = np.lexsort((np.where(np.isnan(strength), -np.inf, strength), number))
    number = number[order]
    last = np.append(number[1:] != number[:-1], True) if len(number) else np.zeros(0, bool)
    return np.asarray(known[order[last]])
