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
SUMS = np.dtype(
    [
        ("points", np.float64),  # of all of a track's points, torso and limbs: how many
        ("snr", np.float64),  # strengths [dB]
        ("fast", np.float64),  # how many are fast
        ("moving", np.float64),  # how many move
        ("known", np.float64),  # how many have heights
        ("height", np.float64),  # [m]
        ("square", np.float64),  # of heights [m^2]
        ("rate", np.float64),  # range rates [m/s]
        ("rate_square", np.float64),
        ("torso", np.float64),  # of its torso's points: how many
        ("torso_speed", np.float64),  # range rates without signs [m/s]
        ("torso_rate", np.float64),  # range rates [m/s]
        ("torso_placed", np.float64),  # how many have a z
        ("torso_z", np.float64),  # [m]
        ("still", np.float64),  # of still points, by how near they are to the torso: how many
        ("still_x", np.float64),  # places [m]
        ("still_y", np.float64),
        ("still_power", np.float64),  # ratios of power to noise
    ]
)
"""Sums of one track."""
_jit = numba.njit(cache=True, nogil=True)


def summed(measured: Measured, whole: Float64Array, torso: Float64Array, still: Float64Array) -> NDArray[np.void]:
    """Sum over points by shares, shape (n_points, n_tracks) each; of `SUMS`, shape (n_tracks,)."""
    found = np.zeros(whole.shape[1], SUMS)
    columns = (measured.x, measured.y, measured.snr, measured.rate, measured.still, measured.height, measured.points.position[:, 2])
    _sum(found, *columns, whole, torso, still)
    return found


@_jit
def _sum(found: Any, x: Any, y: Any, snr: Any, rate: Any, at_rest: Any, height: Any, z: Any, whole: Any, torso: Any, still: Any) -> None:
    for j in range(len(x)):
        known, placed, power = math.isfinite(height[j]), math.isfinite(z[j]), 10.0 ** (snr[j] / 10.0)
        for i in range(len(found)):
            one, own, body, near = found[i], whole[j, i], torso[j, i], still[j, i]
            if own > 0.0:
                one.points += own
                one.snr += own * snr[j]
                one.fast += own if abs(rate[j]) > FAST else 0.0
                one.moving += 0.0 if at_rest[j] else own
                one.rate += own * rate[j]
                one.rate_square += own * rate[j] * rate[j]
                one.torso += body
                one.torso_speed += body * abs(rate[j])
                one.torso_rate += body * rate[j]
                if known:
                    one.known += own
                    one.height += own * height[j]
                    one.square += own * height[j] * height[j]
                if placed:
                    one.torso_placed += body
                    one.torso_z += body * z[j]
            if near > 0.0:
                one.still += near
                one.still_x += near * x[j]
                one.still_y += near * y[j]
                one.still_power += near * power


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
