"""What is noted of tracks beside their belief, from the points of a cloud: the loops are compiled, straight into the records.

`note_torso_reference` and `note_extent_reference` say the same in numpy; a test holds them equal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from radar_tracking.people.gating import Sight
from radar_tracking.people.points import Points

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]

_jit = numba.njit(cache=True, nogil=True)


@dataclass(frozen=True, eq=False)
class Matched:
    """The points of a cloud that update tracks.

    Attributes
    ----------
    rows : ndarray of int64, shape (n_rows,)
        Tracks that have such points, ascending.
    own : ndarray of int64, shape (n_own,)
        The points.
    row : ndarray of int64, shape (n_own,)
        Track of each.
    group : ndarray of int64, shape (n_own,)
        Where in ``rows`` that is.
    """

    rows: IndexArray
    own: IndexArray
    row: IndexArray
    group: IndexArray


def match(main: IndexArray, n_tracks: int) -> Matched:
    """Sort out which points update which tracks; ``main`` is that of `Owners`."""
    own = np.flatnonzero(main >= 0)
    row = main[own]
    has = np.bincount(row, minlength=n_tracks) > 0
    return Matched(np.flatnonzero(has), own, row, (np.cumsum(has) - 1)[row])


@dataclass(frozen=True, eq=False)
class Torsos:
    """What torsos are noted from; arrays have one entry per point, shape (n_own,).

    Attributes
    ----------
    weight : ndarray of float64
        How much it counts, positive.
    beyond, slip : ndarray of float64
        As in `Sight`, for its track.
    speed, distance, power : ndarray of float64
        As in `Points`.
    """

    weight: Float64Array
    beyond: Float64Array
    slip: Float64Array
    speed: Float64Array
    distance: Float64Array
    power: Float64Array


def torsos(points: Points, sight: Sight, matched: Matched, weight: Float64Array) -> Torsos:
    """Pick what is needed of the points that update tracks."""
    own, row = matched.own, matched.row
    return Torsos(weight, sight.beyond[row, own], sight.slip[row, own], points.speed[own], points.distance[own], points.power[own])


def note_torso(
    records: NDArray[np.void],
    matched: Matched,
    seen: Torsos,
    keep: Float64Array,
    keep_activity: Float64Array,
    fast: float,
    surface: tuple[float, float],
) -> None:
    """Remember where torsos were seen and their range rates, and whether any point moved.

    Parameters
    ----------
    records : ndarray of `RECORD`, shape (n_tracks,)
        Changed in place.
    matched : Matched
        Whose the points are.
    seen : Torsos
        What they say.
    keep, keep_activity : ndarray of float64, shape (n_rows,)
        Share that stays of what was noted of each track before; the second is that of the activity.
    fast : float
        Points move from this range rate on [m/s]; without Doppler nothing can be ruled out.
    surface : tuple of float
        Torsos are at least and at most so far beyond their track's centre [m].
    """
    columns = (seen.weight, seen.beyond, seen.slip, seen.speed, seen.distance, seen.power)
    _note_torso(records, matched.rows, matched.group, *columns, keep, keep_activity, fast, *surface)


def note_torso_reference(
    records: NDArray[np.void],
    matched: Matched,
    seen: Torsos,
    keep: Float64Array,
    keep_activity: Float64Array,
    fast: float,
    surface: tuple[float, float],
) -> None:
    """`note_torso` in numpy."""
    rows, group = matched.rows, matched.group
    known = np.isfinite(seen.slip)
    total, share = np.bincount(group, seen.weight), np.bincount(group, seen.weight * known)
    loud = np.bincount(group, np.nan_to_num(seen.power))
    moves = np.bincount(group, ~(np.abs(seen.speed) < fast)) > 0
    slip = np.bincount(group, seen.weight * np.where(known, seen.slip, 0.0)) / np.maximum(share, 1e-300)
    for name, stays, new in (
        ("slip", keep, np.where(share > 0, slip, records["slip"][rows])),
        ("surface", keep, np.bincount(group, seen.weight * seen.beyond) / total),
        ("range", keep, np.bincount(group, seen.weight * seen.distance) / total),
        ("rate", keep, np.bincount(group, seen.weight * np.where(known, seen.speed, 0.0)) / total),
        ("power", keep, 10 * np.log10(np.maximum(loud, 1e-30))),
        ("activity", keep_activity, moves),
    ):
        records[name][rows] = stays * records[name][rows] + (1 - stays) * new
    records["surface"][rows] = np.clip(records["surface"][rows], *surface)


def note_extent(records: NDArray[np.void], row: IndexArray, step: Float64Array, keep: Float64Array) -> None:
    """Remember how large tracks are.

    Parameters
    ----------
    records : ndarray of `RECORD`, shape (n_tracks,)
        Changed in place.
    row : ndarray of int64, shape (n_own,)
        Track of each point that belongs to one.
    step : ndarray of float64, shape (n_own, 3)
        From the track's centre to the point [m]; NaN heights are not measured.
    keep : ndarray of float64, shape (n_tracks,)
        Share that stays of what was noted of each track before.
    """
    _note_extent(records, row, step, keep)


def note_extent_reference(records: NDArray[np.void], row: IndexArray, step: Float64Array, keep: Float64Array) -> None:
    """`note_extent` in numpy."""
    n = len(records)
    for axis in range(3):
        known = np.isfinite(step[:, axis])
        count = np.bincount(row[known], minlength=n)
        new = np.bincount(row[known], step[known, axis] ** 2, n) / np.maximum(count, 1)
        old = records["spread"][:, axis]
        mixed = np.where(np.isfinite(old), keep * old + (1 - keep) * new, new)
        records["spread"][:, axis] = np.where(count > 0, mixed, old)
    count = np.bincount(row, minlength=n)[:, None, None]
    cross = np.stack([np.bincount(row, step[:, a] * step[:, b], n) for a, b in ((0, 0), (0, 1), (1, 0), (1, 1))], -1)
    stays = keep[:, None, None]
    mixed = stays * records["dispersion"] + (1 - stays) * cross.reshape(n, 2, 2) / np.maximum(count, 1)
    records["dispersion"] = np.where(count > 0, mixed, records["dispersion"])


@_jit
def _note_torso(
    records: Any,
    rows: Any,
    group: Any,
    weight: Any,
    beyond: Any,
    slip: Any,
    speed: Any,
    distance: Any,
    power: Any,
    keep: Any,
    keep_activity: Any,
    fast: float,
    low: float,
    high: float,
) -> None:
    n = len(rows)
    total, depth, away, loud, moves = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    share, drift, rate = np.zeros(n), np.zeros(n), np.zeros(n)  # of the points whose range rate is measured
    for i in range(len(group)):
        k = group[i]
        total[k] += weight[i]
        depth[k] += weight[i] * beyond[i]
        away[k] += weight[i] * distance[i]
        if math.isfinite(slip[i]):
            share[k] += weight[i]
            drift[k] += weight[i] * slip[i]
            rate[k] += weight[i] * speed[i]
        if not math.isnan(power[i]):
            loud[k] += power[i]
        if not abs(speed[i]) < fast:
            moves[k] = 1.0
    for k in range(n):
        note = records[rows[k]]
        if share[k] > 0.0:
            note.slip = _mix(keep[k], note.slip, drift[k] / share[k])
        note.surface = min(max(_mix(keep[k], note.surface, depth[k] / total[k]), low), high)
        note.range = _mix(keep[k], note.range, away[k] / total[k])
        note.rate = _mix(keep[k], note.rate, rate[k] / total[k])
        note.power = _mix(keep[k], note.power, 10 * math.log10(max(loud[k], 1e-30)))
        note.activity = _mix(keep_activity[k], note.activity, moves[k])


@_jit
def _note_extent(records: Any, row: Any, step: Any, keep: Any) -> None:
    n = len(records)
    count, square, xy = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n)
    for i in range(len(row)):
        for axis in range(3):
            if math.isfinite(step[i, axis]):
                count[row[i], axis] += 1.0
                square[row[i], axis] += step[i, axis] ** 2
        xy[row[i]] += step[i, 0] * step[i, 1]
    for k in range(n):
        note = records[k]
        for axis in range(3):
            if count[k, axis] > 0.0:
                new, old = square[k, axis] / count[k, axis], note.spread[axis]
                note.spread[axis] = _mix(keep[k], old, new) if math.isfinite(old) else new
        if count[k, 0] > 0.0:  # positions on the floor plane are always known
            for axis in range(2):
                note.dispersion[axis, axis] = _mix(keep[k], note.dispersion[axis, axis], square[k, axis] / count[k, axis])
                note.dispersion[axis, 1 - axis] = _mix(keep[k], note.dispersion[axis, 1 - axis], xy[k] / count[k, axis])


@_jit
def _mix(keep: float, old: float, new: float) -> float:
    """Smooth: of what was noted the share ``keep`` stays."""
    return keep * old + (1.0 - keep) * new
