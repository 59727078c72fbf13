"""What lives has inertia: its echoes change, but slowly.

Those of furniture change from cloud to cloud by noise alone, and those of a fan's blades faster than clouds come.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numba
import numpy as np

_TIME: Final = 3.0  # s: series are of so long
_KNOWN: Final = 1.5  # s: shorter ones say nothing
_LEAST: Final = 0.5  # points of a cloud that give a value
_RESTS, _STIRS = 0.1, 0.3  # share of moving points of who rests, at most, and of who moves on the spot, at least
_MIXED: Final = 1.0 / 3.0  # of the variance of range rates within a cloud
_MOST: Final = 0.5  # higher correlations of range rates say no more
_RATE: Final = 3  # number of the series of range rates; before it, those of who rests
_jit = numba.njit(cache=True, nogil=True)


@_jit
def note_series(rows: Any, sums: Any, dt: float, x: float, y: float) -> None:
    """Take in a cloud: range, azimuth and power of the still points at the torsos, seen from (x, y), and mean range rates of all.

    ``rows`` are those of a `Table`, ``sums`` of `SUMS`, shape (n_tracks,) each.
    """
    value = np.zeros(4)
    for i in range(len(rows)):
        row, one = rows[i], sums[i]
        if one.still > _LEAST:
            dx, dy = one.still_x / one.still - x, one.still_y / one.still - y
            value[0], value[1], value[2] = math.hypot(dx, dy), math.atan2(dy, dx), 10.0 * math.log10(max(one.still_power, 1e-9))
        value[_RATE] = one.rate / max(one.points, 1e-9)
        for k in range(4):
            if (one.points if k == _RATE else one.still) <= _LEAST:
                continue
            series, watched = row.series[k], row.watched[k]
            share = max(1.0 - math.exp(-dt / _TIME), dt / (watched + dt + 1e-9))
            step = value[k] - series[0] if watched > 0.0 else 0.0
            series[0] = series[0] + share * step if watched > 0.0 else value[k]
            series[1] += share * (step * step - series[1])
            series[2] += share * (step * series[3] - series[2])
            series[3] = step
            if k == _RATE:
                mixed = max(one.rate_square / one.points - value[k] ** 2, 0.0)
                row.mixed += share * (mixed - row.mixed)
            row.watched[k] += dt


@_jit
def correlation(row: Any, k: int) -> float:
    """Of a track's series with itself one cloud before, 0 to 1.

    Range rates that differ within a cloud are noise of their mean, too: a body moves as a whole, blades do not.
    """
    variance = max(row.series[k, 1], 1e-12)
    if k == _RATE:
        variance += _MIXED * row.mixed
    return float(min(max(row.series[k, 2] / variance, 0.0), 1.0))


@_jit
def note_inertia(row: Any, out: Any) -> None:
    """Write features of who rests: 1, and correlations of range, azimuth and power; of who moves on the spot: 1, and that of range rates.

    ``out``, shape (6,); 0 for all others, and before it is known.
    """
    out[:] = 0.0
    if row.stands and row.lively < _RESTS and row.watched[0] > _KNOWN:
        out[0] = 1.0
        for k in range(_RATE):
            out[1 + k] = correlation(row, k)
    if row.stands and row.lively > _STIRS and row.watched[_RATE] > _KNOWN:
        out[4], out[5] = 1.0, min(correlation(row, _RATE), _MOST)
