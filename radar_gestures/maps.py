"""The detections of one track, and their feature maps: micro-Doppler, directions and distance over time (thesis, 4.2 and 7.2)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import PointCloud
from radar_core.config import config, knob
from radar_core.types import Float32Array, IndexArray

_ROWS: Final[int] = 128  # of a new ring: two seconds at 50 Hz and some more
_EMPTY: Final[tuple[float, float, float, float]] = (0.0, math.nan, math.nan, math.nan)


@dataclass(frozen=True, eq=False)
class Share:
    """The detections of a cloud that belong to one track, in the columns of `PointCloud`, shape (n_points,) each."""

    stamp_ns: int
    radial_speed: Float32Array
    snr: Float32Array
    range: Float32Array
    azimuth: Float32Array
    elevation: Float32Array


Detections = PointCloud | Share
"""What features and maps are made of."""


def shares(cloud: PointCloud, owner: NDArray[np.integer], track_ids: Iterable[int]) -> Iterator[Share]:
    """Give each track in turn its share of a cloud; ``owner``, shape (n_points,), is the track of each detection."""
    values = np.array((cloud.radial_speed, cloud.snr, cloud.range, cloud.azimuth, cloud.elevation))
    for track_id in track_ids:
        yield Share(cloud.stamp_ns, *values[:, owner == track_id])


def doppler_gates(radial_speed: Float32Array, snr: Float32Array, gate: float) -> NDArray[np.intp]:
    """Pick the strongest detection of every Doppler gate (section 7.2): indices, shape (n_gates,), ordered by range rate.

    Range rates [m/s] and SNRs [dB] have shape (n_points,), a gate is ``gate`` wide [m/s]. A detection without a range rate is never picked,
    one without an SNR only when alone.
    """
    known = np.flatnonzero(np.isfinite(radial_speed))
    number = np.rint(radial_speed[known].astype(np.float64) / gate)
    strength = snr[known]
    order = np.lexsort((np.where(np.isnan(strength), -np.inf, strength), number))
    number = number[order]
    last = np.append(number[1:] != number[:-1], True) if len(number) else np.zeros(0, bool)
    return np.asarray(known[order[last]])


@config
class MapConfig:
    """Size of the maps of an event; their gates are those of the features."""

    max_speed: float = knob(4.2, unit="m/s", low=0.1, high=100.0, doc="maps reach from minus to plus this; outer gates hold what is faster")
    length: float = knob(0.0, unit="s", low=0.0, high=20.0, doc="length of an event's maps, empty after its end; 0: as long as it")


@dataclass(frozen=True, eq=False)
class FeatureMaps:
    """The strongest detection of every Doppler gate, cloud by cloud.

    Attributes
    ----------
    stamp_ns : ndarray of int64, shape (n_frames,)
        Of the clouds [ns].
    speed : ndarray of float32, shape (n_speed,)
        Middle of each gate, ascending, positive = receding [m/s].
    micro_doppler : ndarray of float32, shape (n_frames, n_speed)
        SNR [dB]; 0 where nothing was detected.
    azimuth, elevation : ndarray of float32, shape (n_frames, n_speed)
        Direction seen from the sensor [rad]; NaN where nothing was detected or the sensor does not measure it.
    distance : ndarray of float32, shape (n_frames, n_speed)
        Distance from the sensor [m]; NaN where nothing was detected or the sensor does not measure it.
    """

    stamp_ns: IndexArray
    speed: Float32Array
    micro_doppler: Float32Array
    azimuth: Float32Array
    elevation: Float32Array
    distance: Float32Array


class GateAxis:
    """The Doppler gates of a map, ``gate`` wide [m/s].

    They reach from minus to plus ``max_speed`` [m/s], or a little farther; what is faster goes to the outermost gate.

    Attributes
    ----------
    speed : ndarray of float32, shape (n_speed,)
        Middle of each gate, ascending [m/s].
    """

    def __init__(self, gate: float, max_speed: float) -> None:
        self._gate = gate
        self._half = math.ceil(max_speed / gate - 0.5)
        self.speed: Float32Array = (np.arange(-self._half, self._half + 1) * gate).astype(np.float32)

    def __len__(self) -> int:
        return len(self.speed)

    def find(self, radial_speed: NDArray[np.floating]) -> IndexArray:
        """Gate of every range rate [m/s], shape (n_points,); each has to be a number."""
        number = np.rint(radial_speed.astype(np.float64) / self._gate)
        return np.clip(number, -self._half, self._half).astype(np.int64) + self._half


class MapRing:
    """The feature maps of the last ``window`` seconds of one track, in arrays that are made once, whatever the frame rate.

    Adding a cloud writes its strongest points and nothing else. The arrays double, up to ``max_frames``, when a source sends so fast that
    they fill up; then the oldest clouds go first.
    """

    def __init__(self, window: float, axis: GateAxis, max_frames: int = 4096) -> None:
        self._window_ns = round(window * 1e9)
        self._axis = axis
        self._max_frames = max_frames
        self._empty = np.repeat(np.array(_EMPTY, np.float32)[:, None], len(axis), axis=1)
        self._stamp = np.zeros(min(_ROWS, max_frames), np.int64)
        self._maps = np.empty((4, len(self._stamp), len(axis)), np.float32)
        self._first = 0  # row of the oldest cloud
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, cloud: Detections, picked: NDArray[np.intp]) -> None:
        """Take in one cloud of the track: its points ``picked``, one of every gate, ordered by range rate, see `doppler_gates`.

        A cloud that is not later than the last means that time jumped back, and everything before it is forgotten.
        """
        row = self._next_row(cloud.stamp_ns)
        self._stamp[row] = cloud.stamp_ns
        self._maps[:, row] = self._empty
        if len(picked):
            write(self._maps[:, row], cloud, picked, self._axis)

    def window(self, start_ns: int, end_ns: int, length: float = 0.0) -> FeatureMaps:
        """Copy the maps of the clouds with ``start_ns <= stamp_ns <= end_ns``, in order of time.

        With a ``length`` (section 4.2: 1.0 s) they are made that long from the first cloud on: frames without detections, at the usual
        interval of the clouds, follow the last one; a longer window is cut. With one cloud the interval is unknown, and nothing follows it.
        """
        order = (self._first + np.arange(self._count)) % len(self._stamp)
        stamps = self._stamp[order]
        first, last = np.searchsorted(stamps, start_ns, "left"), np.searchsorted(stamps, end_ns, "right")
        order, stamps = order[first:last], stamps[first:last]
        maps = self._maps[:, order]
        if length > 0 and len(stamps) > 1:
            interval = max(int(np.median(np.diff(stamps))), 1)
            n = min(math.ceil(round(length * 1e9) / interval), self._max_frames)
            beyond = np.repeat(self._empty[:, None], max(n - len(stamps), 0), axis=1)
            maps = np.concatenate([maps[:, :n], beyond], axis=1)
            stamps = np.concatenate([stamps[:n], stamps[-1] + interval * np.arange(1, beyond.shape[1] + 1)])
        return FeatureMaps(stamps, self._axis.speed, *maps)

    def _next_row(self, stamp_ns: int) -> int:
        """Row for a new cloud; forgets what it makes too old."""
        if self._count and stamp_ns <= self._stamp[(self._first + self._count - 1) % len(self._stamp)]:
            self._count = 0
        while self._count and self._stamp[self._first] < stamp_ns - self._window_ns:
            self._drop()
        if self._count == len(self._stamp):
            if self._count < self._max_frames:
                self._grow()
            else:
                self._drop()
        self._count += 1
        return (self._first + self._count - 1) % len(self._stamp)

    def _drop(self) -> None:
        self._first = (self._first + 1) % len(self._stamp)
        self._count -= 1

    def _grow(self) -> None:
        order = (self._first + np.arange(self._count)) % len(self._stamp)
        n = min(2 * self._count, self._max_frames)
        stamp, maps = np.zeros(n, np.int64), np.empty((4, n, len(self._axis)), np.float32)
        stamp[: self._count], maps[:, : self._count] = self._stamp[order], self._maps[:, order]
        self._stamp, self._maps, self._first = stamp, maps, 0


def write(maps: Float32Array, cloud: Detections, picked: NDArray[np.intp], axis: GateAxis) -> None:
    """Write the picked points of a cloud into one frame of the maps, shape (4, n_speed) = (SNR, azimuth, elevation, distance)."""
    column = axis.find(cloud.radial_speed[picked])
    if len(column) > 1 and (column[0] == column[1] or column[-1] == column[-2]):  # several beyond an outermost gate: the strongest stays
        order = np.argsort(np.nan_to_num(cloud.snr[picked], nan=-np.inf), kind="stable")
        column, picked = column[order], picked[order]
    for target, values in zip(maps, (cloud.snr, cloud.azimuth, cloud.elevation, cloud.range), strict=True):
        target[column] = values[picked]


def feature_maps(clouds: Sequence[Detections], gate: float, max_speed: float) -> FeatureMaps:
    """Put the detections of clouds in order of time side by side; of one person, or of the one person in view.

    Gates are ``gate`` wide and go from minus to plus ``max_speed`` [m/s]; what is faster goes to the outermost one.
    """
    axis = GateAxis(gate, max_speed)
    maps = np.empty((4, len(clouds), len(axis)), np.float32)
    maps[:] = np.array(_EMPTY, np.float32)[:, None, None]
    for row, cloud in enumerate(clouds):
        write(maps[:, row], cloud, doppler_gates(cloud.radial_speed, cloud.snr, gate), axis)
    stamps = np.array([cloud.stamp_ns for cloud in clouds], np.int64)
    return FeatureMaps(stamps, axis.speed, *maps)
