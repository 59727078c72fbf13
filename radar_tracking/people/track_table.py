"""The track table: a row of typed columns and a belief for each live track, and the compiled loops that smooth what points say into it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar, overload

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.estimators.base import Belief, join

T = TypeVar("T", bound=np.generic)
_jit = numba.njit(cache=True, nogil=True)


class Column(Generic[T]):
    """One column of a `TrackTable`: reading gives a view of shape (n_tracks, *shape), assignment writes into it."""

    def __init__(self, dtype: type[T], *shape: int) -> None:
        self.dtype = dtype
        self.shape = shape

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, table: None, owner: type) -> Column[T]: ...
    @overload
    def __get__(self, table: TrackTable, owner: type) -> NDArray[T]: ...
    def __get__(self, table: TrackTable | None, owner: type) -> Column[T] | NDArray[T]:
        return self if table is None else table.records[self._name]

    def __set__(self, table: TrackTable, value: ArrayLike) -> None:
        table.records[self._name] = value


class TrackTable:
    """Columns and beliefs of the live tracks; rows are in the order of their ids, ``n_tracks`` to begin with, all zero.

    Attributes
    ----------
    records : ndarray of `RECORD`, shape (n_tracks,)
        All columns as one structured array, for compiled loops.
    belief : Belief or None
        Of the same tracks; None: no track yet.
    """

    id = Column(np.int64)
    born_ns = Column(np.int64)
    seen_ns = Column(np.int64)  # last update
    confirmed = Column(np.bool_)
    still = Column(np.bool_)  # stood still at the last update
    n_points = Column(np.int64)  # of this cloud
    points_sum = Column(np.int64)
    clouds = Column(np.int64)  # since birth
    matches = Column(np.int64)  # clouds that updated the track
    birthplace = Column(np.float64, 2)  # on the floor plane [m]
    walked = Column(np.bool_)  # has been far from its birthplace
    stirred_ns = Column(np.int64)  # last movement
    activity = Column(np.float64)  # recent share of the clouds in which a moving point updated the track
    surface = Column(np.float64)  # recent offset of the torso from the centre along the line of sight [m]
    doppler_residual = Column(np.float64)  # recent range rate of the torso minus that of the track's velocity [m/s]
    spread = Column(np.float64, 3)  # recent mean square of the points about the centre [m^2]; NaN: not known
    dispersion = Column(np.float64, 2, 2)  # of the main cluster on the floor plane [m^2]
    range = Column(np.float64)  # recent distance of the torso's points from their sensor [m]
    rate = Column(np.float64)  # recent range rate of the same points [m/s]
    power = Column(np.float64)  # recent summed signal-to-noise ratio of the points [dB]
    reflection_score = Column(np.float64)  # recent share of the clouds in which the track looked like another one's reflection
    pair = Column(np.float64, 2)  # recent share of the clouds in which it looked like two people, across and along the line of sight
    nis = Column(np.float64)  # normalised innovation squared of this cloud's update; NaN: no update
    dof = Column(np.int64)  # degrees of freedom of the same

    def __init__(self, n_tracks: int = 0) -> None:
        self.records: NDArray[np.void] = np.zeros(n_tracks, RECORD)
        self.belief: Belief | None = None

    def __len__(self) -> int:
        return len(self.records)

    def add(self, row: TrackTable) -> None:
        """Append the tracks of another table, which has a belief."""
        assert row.belief is not None
        self.records = np.concatenate([self.records, row.records])
        self.belief = row.belief if self.belief is None else join([self.belief, row.belief])

    def keep(self, mask: BoolArray) -> None:
        """Remove the tracks that a mask leaves out."""
        self.records = self.records[mask]
        if self.belief is not None:
            self.belief = self.belief.select(mask)


_COLUMNS: Any = [(name, column.dtype, column.shape) for name, column in vars(TrackTable).items() if isinstance(column, Column)]
RECORD = np.dtype(_COLUMNS)
"""One row of a `TrackTable`."""


@dataclass(frozen=True, eq=False)
class Matched:
    """The points of a cloud that update tracks.

    Attributes
    ----------
    rows : ndarray of int64, shape (n_rows,)
        Tracks that have such points, ascending.
    own, row, group : ndarray of int64, shape (n_own,)
        Indices of the points, the track of each, and its index in ``rows``.
    """

    rows: IndexArray
    own: IndexArray
    row: IndexArray
    group: IndexArray


def match(main: IndexArray, n_tracks: int) -> Matched:
    """Group the points that update tracks; ``main`` is that of `Owners`."""
    own = np.flatnonzero(main >= 0)
    row = main[own]
    has = np.bincount(row, minlength=n_tracks) > 0
    return Matched(np.flatnonzero(has), own, row, (np.cumsum(has) - 1)[row])


class TorsoPoints(NamedTuple):
    """Measured quantities of the points that update tracks; arrays have shape (n_own,).

    Attributes
    ----------
    weight : ndarray of float64
        Of each point, positive.
    beyond, doppler_residual : ndarray of float64
        As in `Gating`, for the point's track [m, m/s].
    speed, distance, power : ndarray of float64
        As in `Points`.
    """

    weight: Float64Array
    beyond: Float64Array
    doppler_residual: Float64Array
    speed: Float64Array
    distance: Float64Array
    power: Float64Array


@_jit
def update_torsos(
    records: Any, rows: Any, group: Any, points: Any, keep: Any, keep_activity: Any, fast: float, low: float, high: float
) -> None:
    """Smooth offset, range, range rate, power and Doppler residual of each track's torso, and its activity, in ``records``.

    ``keep`` and ``keep_activity``, shape (n_rows,), are the shares of the old values that stay. Points with a range rate of at least
    ``fast`` [m/s], or none, move. ``low`` and ``high`` [m] bound the torso's offset from its track's centre.
    """
    total, depth, away, loud, moves, share, drift, rate = _sum_torsos(len(rows), group, points, fast)
    for k in range(len(rows)):
        track = records[rows[k]]
        if share[k] > 0.0:
            track.doppler_residual = _mix(keep[k], track.doppler_residual, drift[k] / share[k])
        track.surface = min(max(_mix(keep[k], track.surface, depth[k] / total[k]), low), high)
        track.range = _mix(keep[k], track.range, away[k] / total[k])
        track.rate = _mix(keep[k], track.rate, rate[k] / total[k])
        track.power = _mix(keep[k], track.power, 10 * math.log10(max(loud[k], 1e-30)))
        track.activity = _mix(keep_activity[k], track.activity, moves[k])


@_jit
def _sum_torsos(n: int, group: Any, points: Any, fast: float) -> Any:
    total, depth, away, loud, moves = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    share, drift, rate = np.zeros(n), np.zeros(n), np.zeros(n)  # of the points whose range rate is measured
    for i in range(len(group)):
        k, weight = group[i], points.weight[i]
        total[k] += weight
        depth[k] += weight * points.beyond[i]
        away[k] += weight * points.distance[i]
        if math.isfinite(points.doppler_residual[i]):
            share[k] += weight
            drift[k] += weight * points.doppler_residual[i]
            rate[k] += weight * points.speed[i]
        if not math.isnan(points.power[i]):
            loud[k] += points.power[i]
        if not abs(points.speed[i]) < fast:
            moves[k] = 1.0
    return total, depth, away, loud, moves, share, drift, rate


@_jit
def update_extents(records: Any, row: Any, step: Any, keep: Any) -> None:
    """Smooth spread and dispersion of each track's points in ``records``.

    ``row``, shape (n_own,), is the track of each point, ``step``, shape (n_own, 3) [m], the way from its centre to the point, NaN heights
    not measured; ``keep``, shape (n_tracks,), the share of the old value that stays.
    """
    n = len(records)
    count, square, xy = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n)
    for i in range(len(row)):
        for axis in range(3):
            if math.isfinite(step[i, axis]):
                count[row[i], axis] += 1.0
                square[row[i], axis] += step[i, axis] ** 2
        xy[row[i]] += step[i, 0] * step[i, 1]
    for k in range(n):
        track = records[k]
        for axis in range(3):
            if count[k, axis] > 0.0:
                new, old = square[k, axis] / count[k, axis], track.spread[axis]
                track.spread[axis] = _mix(keep[k], old, new) if math.isfinite(old) else new
        if count[k, 0] > 0.0:  # positions on the floor plane are always known
            for axis in range(2):
                track.dispersion[axis, axis] = _mix(keep[k], track.dispersion[axis, axis], square[k, axis] / count[k, axis])
                track.dispersion[axis, 1 - axis] = _mix(keep[k], track.dispersion[axis, 1 - axis], xy[k] / count[k, axis])


@_jit
def _mix(keep: float, old: float, new: float) -> float:
    """Exponential smoothing: the share ``keep`` of the old value stays."""
    return keep * old + (1.0 - keep) * new
