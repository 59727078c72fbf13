"""Two people in one place: a track whose points form two heaps holds two people; tracks that meet cannot pass through each other."""

from __future__ import annotations

import math
from typing import Any, Final

import numba
import numpy as np

from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.estimators.base import Belief
from radar_tracking.people.config import LifeConfig
from radar_tracking.people.points import Points
from radar_tracking.people.track_table import Matched, TrackTable, match

_HALF: Final = 0.5  # of the clouds
_FEWEST: Final = 4  # points that can be two heaps
_LEAST_SHARE: Final = 0.2  # of the echoes' amplitude is in the smaller heap: a hand has less
_COMPACT: Final = 0.4  # standard deviation of a heap, as a share of the distance between the two
_REACH: Final = 0.8  # m: a track that nothing belongs to takes a heap so far from where it is predicted
BEFORE: Final = 0.3
"""Points that much nearer to the radar than a person's centre may be the hand [m]."""
_SHORT: Final = 1e-3  # m: nothing is nearer
_SAME = 1e-6  # m: tracks at the very same place have no direction of separation


class Pairs:
    """Finds tracks that hold two people, across the line of sight or along it."""

    def __init__(self, config: LifeConfig) -> None:
        self._config = config

    def change(self, config: LifeConfig) -> None:
        """Go on with other knobs."""
        self._config = config

    def process(
        self, table: TrackTable, points: Points, matched: Matched, centre: Float64Array, beside: BoolArray, stamp_ns: int
    ) -> tuple[Matched, list[IndexArray]]:
        """Update how much tracks look like two people with the points of a cloud; ``pair`` in the table is changed.

        Parameters
        ----------
        table : TrackTable
            The tracks.
        points : Points
            Of the cloud.
        matched : Matched
            Which of them measure which tracks.
        centre : ndarray of float64, shape (n_tracks, 2)
            Where tracks are predicted on the floor plane [m].
        beside : ndarray of bool, shape (n_points,)
            Points that measure no track, but may be of a second person beside one; those that move, or lie before it, are taken for arms.
        stamp_ns : int
            Of the cloud [ns].

        Returns
        -------
        matched : Matched
            The same, but that second people have their points: those who have a track already, which nothing else belongs to.
        second : list of ndarray of int64
            Points of each second person who has been in a track for long enough and has none; nobody's in ``matched``.
        """
        second: list[IndexArray] = []
        main = None
        rows = matched.rows
        own, group = self._with_beside(points, matched, centre, beside)
        value = _offsets(points, own, centre[rows][group])
        amplitude = (
            np.sqrt(np.where(np.isfinite(points.power[own]), points.power[own], 1.0)) * np.maximum(points.distance[own], _SHORT) ** 2
        )
        bound = np.stack([two_heaps(group, axis, amplitude, len(rows), self._config.pair_distance) for axis in value])
        two = np.isfinite(bound) & table.confirmed[rows]
        keep = np.exp((table.seen_ns[rows] - stamp_ns) * 1e-9 / self._config.pair_time)[:, None]
        table.pair[rows] = keep * table.pair[rows] + (1.0 - keep) * two.T
        unseen = table.confirmed.copy()
        unseen[rows] = False
        for k in np.flatnonzero(two.any(axis=0)):
            share = table.pair[rows[k]]
            axis = int(np.where(two[:, k], share, -1.0).argmax())
            heaps = [own[(group == k) & side] for side in (value[axis] > bound[axis, k], value[axis] <= bound[axis, k])]
            place = np.stack([points.plane[heap].mean(axis=0) for heap in heaps])
            lost, which = _takes(place, centre[rows[k]], centre, unseen)
            if main is None:
                main = np.full(len(points), -1, np.int64)
                main[matched.own] = matched.row
            if lost >= 0:
                main[heaps[which]], unseen[lost] = lost, False
            elif share[axis] > _HALF:
                which = int(np.argmax(np.hypot(*(place - centre[rows[k]]).T)))  # the track goes on with the nearer one
                second.append(heaps[which])
                main[heaps[which]] = -1
                table.pair[rows[k]] = 0.0
        return (matched if main is None else match(main, len(table))), second

    def _with_beside(self, points: Points, matched: Matched, centre: Float64Array, beside: BoolArray) -> tuple[IndexArray, IndexArray]:
        """Points that measure tracks, and then those beside them, with the place of each one's track in ``matched.rows``."""
        index = np.flatnonzero(beside & ~(np.abs(points.speed) > self._config.static_speed))
        if len(index) == 0 or len(matched.rows) == 0:
            return matched.own, matched.group
        step = points.plane[index, None] - centre[matched.rows]
        distance = np.hypot(step[..., 0], step[..., 1])
        nearest = distance.argmin(axis=1)
        beyond = _offsets(points, index, centre[matched.rows][nearest])[1]
        near = (distance[np.arange(len(index)), nearest] < self._config.birth_distance) & (beyond > -BEFORE)
        return np.concatenate([matched.own, index[near]]), np.concatenate([matched.group, nearest[near]])


def _offsets(points: Points, own: IndexArray, centre: Float64Array) -> Float64Array:
    """How far points lie from a centre across and along the line of sight, shape (2, n_own) [m]."""
    line = (centre - points.origins[points.sensor[own], :2]).T
    line = line / np.maximum(np.hypot(*line), _SHORT)
    step = (points.plane[own] - centre).T
    return np.stack([line[0] * step[1] - line[1] * step[0], line[0] * step[0] + line[1] * step[1]])


def _takes(place: Float64Array, seen: Float64Array, centre: Float64Array, unseen: BoolArray) -> tuple[int, int]:
    """Find the unseen track that takes one of two heaps, so that it and the seen track together are nearest to theirs.

    Gives the row of the track, -1: none is within reach, and which heap it takes.
    """
    rows = np.flatnonzero(unseen)
    if len(rows) == 0:
        return -1, 0
    distance = np.hypot(*np.moveaxis(centre[rows, None] - place, -1, 0))
    total = distance + np.hypot(*(place[::-1] - seen).T)
    total[distance > _REACH] = np.inf
    best, heap = np.unravel_index(int(total.argmin()), total.shape)
    return (int(rows[best]), int(heap)) if np.isfinite(total[best, heap]) else (-1, 0)


def two_heaps(group: IndexArray, value: Float64Array, weight: Float64Array, n: int, distance: float) -> Float64Array:
    """Find groups whose values fall into two compact heaps.

    Gives for each of ``n`` groups the value between the two heaps of least variance within them, shape (n,); NaN: there are not two. Groups
    and values, with positive weights, have shape (n_values,); the heaps' means are at least ``distance`` apart.
    """
    found: Float64Array = _two_heaps(np.argsort(value, kind="stable"), group, value, weight, n, distance)
    return found


@numba.njit(cache=True, nogil=True)
def _two_heaps(order: Any, group: Any, value: Any, weight: Any, n: int, distance: float) -> Any:
    count, whole, whole_first, whole_second = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(len(value)):
        k = group[i]
        count[k] += 1.0
        whole[k] += weight[i]
        whole_first[k] += weight[i] * value[i]
        whole_second[k] += weight[i] * value[i] * value[i]
    low, first, second = np.zeros(n), np.zeros(n), np.zeros(n)
    last, most, bound = np.zeros(n), np.full(n, -1.0), np.full(n, np.nan)
    two = np.zeros(n, np.bool_)
    for i in order:
        k = group[i]
        high = whole[k] - low[k]
        if min(low[k], high) > 0.0 and count[k] >= _FEWEST:  # rounding may leave nothing above
            left, right = first[k] / low[k], (whole_first[k] - first[k]) / high
            gap = right - left
            if low[k] * high * gap * gap > most[k]:
                most[k] = low[k] * high * gap * gap
                wide = max(second[k] / low[k] - left * left, (whole_second[k] - second[k]) / high - right * right, 0.0)
                two[k] = gap >= distance and min(low[k], high) >= _LEAST_SHARE * whole[k] and wide < (_COMPACT * gap) ** 2
                bound[k] = 0.5 * (last[k] + value[i])
        last[k] = value[i]
        low[k] += weight[i]
        first[k] += weight[i] * value[i]
        second[k] += weight[i] * value[i] * value[i]
    for k in range(n):
        if not two[k]:
            bound[k] = math.nan
    return bound


def separate_tracks(
    belief: Belief, kinematics: tuple[Float64Array, Float64Array], solid: BoolArray, width: float, dimensions: int
) -> Belief:
    """Push tracks apart that are nearer to each other than people can be, and stop their approach.

    When two people stand so near that the radar sees one echo between them, one track takes it and the other coasts; without separation the
    coasting one would run through the other. Of a pair, the track with the larger position variance moves more.

    Parameters
    ----------
    belief : Belief
        All tracks.
    kinematics : tuple of ndarray, shapes (n_tracks, 2 d), (n_tracks, 2 d, 2 d)
        Position and velocity of the same, and their covariance.
    solid : ndarray of bool, shape (n_tracks,)
        Tracks that are people.
    width : float
        Least distance of two people's centres on the floor plane [m].
    dimensions : int
        d.
    """
    rows = np.flatnonzero(solid)
    if len(rows) < 2 or width <= 0:
        return belief
    state, covariance = kinematics
    centre = state[rows, :2]
    step = centre[None] - centre[:, None]
    distance = np.hypot(step[..., 0], step[..., 1])
    near = (distance < width) & (distance > _SAME)
    if not near.any():
        return belief
    pairs = np.argwhere(np.triu(near, 1))
    spread = np.trace(covariance[rows, :2, :2], axis1=1, axis2=2)
    mean = belief.mean.copy()
    for i, j in pairs:
        line = step[i, j] / distance[i, j]
        share = spread[[i, j]] / spread[[i, j]].sum()
        push = (width - distance[i, j]) * line
        velocity = state[rows[[i, j]], dimensions : dimensions + 2]
        closing = max(float((velocity[0] - velocity[1]) @ line), 0.0) * line
        _push(mean, rows[[i, j]], share, push, closing, dimensions)
    return Belief(mean, belief.covariance, belief.weight)


def _push(mean: Float64Array, pair: IndexArray, share: Float64Array, push: Float64Array, closing: Float64Array, d: int) -> None:
    """Move two tracks apart and take out their closing speed, each by its share."""
    for row, sign, part in zip(pair, (-1.0, 1.0), share, strict=True):
        mean[row, :, :2] += sign * part * push
        mean[row, :, d : d + 2] += sign * part * closing
