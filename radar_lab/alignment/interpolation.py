"""A trajectory at other times: the nearest sample, moved on by its velocity.

Straight lines between samples would average the errors of two: most between them, not at all at one of them. A clock offset that is
fitted then settles in the middle between samples, where errors seem smallest. The nearest sample has its own error everywhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from radar_lab.alignment.trajectory import Trajectory

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]

_SECOND = 1e9  # ns
_MOST = 50  # samples on either side that a slope is fitted to: more make it no better for what it is needed


class Slopes(NamedTuple):
    """Velocities of a trajectory, one for each of its samples.

    Attributes
    ----------
    velocity : ndarray of float64, shape (n, d)
        [m/s].
    covariance : ndarray of float64, shape (n, d, d)
        What errors of positions make of it [m^2/s^2].
    """

    velocity: Float64Array
    covariance: Float64Array


def slopes(track: Trajectory, window: float) -> Slopes:
    """Find the velocity at every sample: the known one, else the slope of a straight line through the samples around it.

    Parameters
    ----------
    track : Trajectory
        With n samples.
    window : float
        How far from a sample others may be [s]; where there are none, its neighbours count.
    """
    n, d = track.position.shape
    time = (track.stamp_ns - track.stamp_ns[:1]) / _SECOND
    sums = np.zeros((n, 3))  # of 1, t, t^2
    place, product = np.zeros((n, d)), np.zeros((n, d))  # of x and t x, both relative to the sample
    sums[:, 0] = 1.0
    apart = np.diff(time, prepend=-np.inf, append=np.inf)
    lonely = (apart[:-1] > window) & (apart[1:] > window)  # whose neighbours count however far they are
    for lag in range(1, min(n - 1, _MOST) + 1):
        step = time[lag:] - time[:-lag]
        far = step > window
        if lag > 1 and far.all():
            break
        for first, sign in ((0, 1.0), (lag, -1.0)):
            low = np.flatnonzero(~far | (lonely[first : first + len(step)] & (lag == 1)))
            own, t, x = low + first, step[low], track.position[low + lag] - track.position[low]
            sums[own] += np.stack([np.ones(len(t)), sign * t, t * t], axis=1)
            place[own] += sign * x
            product[own] += t[:, None] * x
    divisor = np.maximum(sums[:, 0] * sums[:, 2] - sums[:, 1] ** 2, 1e-30)[:, None]
    slope = (sums[:, :1] * product - sums[:, 1:2] * place) / divisor
    known = np.isfinite(track.known_velocity)
    # a tracker's velocity comes from the same positions, so it is no surer than theirs
    return Slopes(np.where(known, track.known_velocity, slope), track.covariance * (sums[:, :1] / divisor)[..., None])


def nearest(track: Trajectory, stamp_ns: IndexArray, offset: float, max_gap: float) -> tuple[IndexArray, IndexArray]:
    """Find for each time the sample nearest to it.

    Parameters
    ----------
    track : Trajectory
        With m samples.
    stamp_ns : ndarray of int64, shape (n,)
        Times [ns], by another clock.
    offset : float
        What is to be added to them [s].
    max_gap : float
        Times farther than half of this from every sample are left out [s].

    Returns
    -------
    index : ndarray of int64, shape (k,)
        Which of the times were used.
    partner : ndarray of int64, shape (k,)
        The samples nearest to them.
    """
    m = len(track)
    if m == 0 or len(stamp_ns) == 0:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    time = stamp_ns + round(offset * _SECOND)
    after = np.clip(np.searchsorted(track.stamp_ns, time), 1, max(m - 1, 1))
    before = after - 1
    after = np.minimum(after, m - 1)
    partner = np.where(time - track.stamp_ns[before] <= track.stamp_ns[after] - time, before, after)
    index = np.flatnonzero(np.abs(track.stamp_ns[partner] - time) <= 0.5e9 * max_gap)
    return index, partner[index]


def since(first: Trajectory, second: Trajectory, index: IndexArray, partner: IndexArray, offset: float) -> Float64Array:
    """Compute how much later than their partners samples of the second trajectory are, with a clock offset, shape (n,) [s]."""
    return np.asarray((second.stamp_ns[index] - first.stamp_ns[partner]) / _SECOND + offset)


def sight_lines(position: Float64Array) -> Float64Array:
    """Return unit vectors on the floor plane from the sensor, at the origin, to positions, shape (n, d); zero right above it."""
    sight = position.copy()
    sight[:, 2:] = 0.0
    length = np.sqrt((sight * sight).sum(axis=-1, keepdims=True))
    return np.asarray(np.where(length > 1e-9, sight / np.maximum(length, 1e-9), 0.0))
