"""What a cloud says of each track, summed over its points by their shares."""

from __future__ import annotations

import math
from typing import Any, Final

import numba
import numpy as np
from numpy.typing import NDArray

from radar_core.types import Float64Array
from radar_tracking.poisson.points import Measured

FAST: Final = 2.0  # m/s: a body has few points that are faster; blades of fans have many
_NAMES = (
    "points", "snr", "fast", "moving", "known", "height", "square", "rate", "rate_square",
    "torso", "torso_speed", "torso_rate", "torso_placed", "torso_z", "still", "still_x", "still_y", "still_power",
)  # fmt: skip
SUMS = np.dtype([(name, np.float64) for name in _NAMES])
"""Sums of one track. Of all its points: their number, strengths [dB], how many are fast, move and have heights, heights [m] and their
squares, range rates [m/s] and their squares. Of its torso's: number, speeds and range rates, how many have a z, and z [m]. Of still ones,
by how near they are to the torso: number, places [m] and ratios of power to noise."""
_jit = numba.njit(cache=True, nogil=True)


def summed(measured: Measured, whole: Float64Array, torso: Float64Array, still: Float64Array) -> NDArray[np.void]:
    """Sum over points by shares, shape (n_points, n_tracks) each; of `SUMS`, shape (n_tracks,)."""
    z, one, speed = measured.points.position[:, 2], np.ones(len(measured)), np.abs(measured.rate)
    known, placed = np.isfinite(measured.height), np.isfinite(z)
    height = np.where(known, measured.height, 0.0)
    of_all = (one, measured.snr, speed > FAST, ~measured.still, known, height, height**2, measured.rate, measured.rate**2)
    of_torso = (one, speed, measured.rate, placed, np.where(placed, z, 0.0))
    of_still = (one, measured.x, measured.y, 10.0 ** (measured.snr / 10.0))
    sums = [np.stack(columns) @ shares for columns, shares in ((of_all, whole), (of_torso, torso), (of_still, still))]
    return np.concatenate(sums).T.copy().view(SUMS)[:, 0]


@_jit
def scatter(x: Any, y: Any, z: Any, whole: Any, tracks: Any, centre: Any) -> Any:
    """Mean squares of the points of some tracks about their centres, both shape (n, 3) [m^2, m]; unknown heights are the centre's."""
    result = np.zeros((len(tracks), 3))
    for k in range(len(tracks)):
        total, i = 0.0, tracks[k]
        for j in range(len(x)):
            own = whole[j, i]
            dx, dy, dz = x[j] - centre[k, 0], y[j] - centre[k, 1], z[j] - centre[k, 2]
            total += own
            result[k, 0] += own * dx * dx
            result[k, 1] += own * dy * dy
            result[k, 2] += own * dz * dz if math.isfinite(dz) else 0.0
        result[k] /= total
    return result


@_jit
def owners_of(whole: Any, owners: Any, alive: Any, least: float) -> Any:
    """Ids of those who have most of each point, if they have more than ``least`` and are alive, else -1; shape (n_points,).

    ``owners``, shape (n_tracks,), says whose each column of ``whole`` is: an arm's points are its person's.
    """
    n, m = whole.shape
    found, slot = np.full(n, -1, np.int32), np.zeros(m, np.int64)
    for i in range(m):
        while owners[slot[i]] != owners[i]:
            slot[i] += 1
    own = np.zeros(m)
    for j in range(n):
        own[:] = 0.0
        for i in range(m):
            own[slot[i]] += whole[j, i]
        best = own.argmax()
        if own[best] > least and (alive == owners[best]).any():
            found[j] = owners[best]
    return found
