"""Track statistics: what the points of a cloud say about a track beside its belief, smoothed over time in the track table.

The loops are compiled and write straight into the table's records; numpy oracles are in the tests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numba
import numpy as np

from radar_core.types import Float64Array, IndexArray

_jit = numba.njit(cache=True, nogil=True)


@dataclass(frozen=True, eq=False)
class Matched:
    """The points of a cloud that update tracks.

    Attributes
    ----------
    rows : ndarray of int64, shape (n_rows,)
        Tracks that have such points, ascending.
    own : ndarray of int64, shape (n_own,)
        Indices of the points.
    row : ndarray of int64, shape (n_own,)
        Track of each point.
    group : ndarray of int64, shape (n_own,)
        Index into ``rows`` of each point's track.
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
    """What is known of the points that update tracks; arrays have shape (n_own,).

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
    """Smooth offset, range, range rate, power and Doppler residual of each track's torso, and its activity.

    Parameters
    ----------
    records : ndarray of `RECORD`, shape (n_tracks,)
        Changed in place.
    rows, group : ndarray of int64, shapes (n_rows,), (n_own,)
        As in `Matched`.
    points : TorsoPoints
        What they say.
    keep, keep_activity : ndarray of float64, shape (n_rows,)
        Share of the old value that stays; the second is that of the activity.
    fast : float
        Points with at least this range rate move [m/s]. Points without Doppler count as moving.
    low, high : float
        Bounds of the torso's offset from its track's centre [m].
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
    """Smooth spread and dispersion of each track's points.

    Parameters
    ----------
    records : ndarray of `RECORD`, shape (n_tracks,)
        Changed in place.
    row : ndarray of int64, shape (n_own,)
        Track of each point that belongs to one.
    step : ndarray of float64, shape (n_own, 3)
        From the track's centre to the point [m]; NaN heights are not measured.
    keep : ndarray of float64, shape (n_tracks,)
        Share of the old value that stays.
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
