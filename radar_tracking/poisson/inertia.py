"""What lives has inertia: its echoes change, but slowly.

Those of furniture change from cloud to cloud by noise alone, and those of a fan's blades faster than clouds come.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from radar_core.types import Float64Array
from radar_tracking.poisson.kernels import Shares
from radar_tracking.poisson.points import Measured
from radar_tracking.poisson.table import Table

_TIME: Final = 3.0  # s: series are of so long
_KNOWN: Final = 1.5  # s: shorter ones say nothing
_LEAST: Final = 0.5  # points of a cloud that give a value
_RESTS, _STIRS = 0.1, 0.3  # share of moving points of who rests, at most, and of who moves on the spot, at least
_MIXED: Final = 1.0 / 3.0  # of the variance of range rates within a cloud
_MOST: Final = 0.5  # higher correlations of range rates say no more


def note_series(table: Table, measured: Measured, shares: Shares, dt: float, origin: Float64Array) -> None:
    """Take in a cloud: range, azimuth and power of the still points at the torsos, seen from ``origin``, and mean range rates of all."""
    rows, still, whole = table.rows, shares.still, shares.whole
    amount, total = np.maximum(shares.support, 1e-9), np.maximum(whole.sum(axis=0), 1e-9)
    x, y = measured.x @ still / amount - origin[0], measured.y @ still / amount - origin[1]
    power = 10.0 * np.log10(np.maximum(10.0 ** (measured.snr / 10.0) @ still, 1e-9))
    rate = measured.rate @ whole / total
    mixed = np.maximum(measured.rate**2 @ whole / total - rate**2, 0.0)
    value = np.column_stack([np.hypot(x, y), np.arctan2(y, x), power, rate])
    told = np.column_stack([np.repeat(amount[:, None] > _LEAST, 3, axis=1), total > _LEAST])
    watched = rows["watched"]
    share = np.maximum(1.0 - math.exp(-dt / _TIME), dt / (watched + dt + 1e-9))
    mean, variance, covariance, before = np.moveaxis(rows["series"], -1, 0)
    step = np.where(watched > 0.0, value - mean, 0.0)
    mean = np.where(watched > 0.0, mean + share * step, value)
    variance, covariance = variance + share * (step**2 - variance), covariance + share * (step * before - covariance)
    rows["series"] = np.where(told[..., None], np.stack([mean, variance, covariance, step], axis=-1), rows["series"])
    rows["mixed"] += np.where(told[:, 3], share[:, 3] * (mixed - rows["mixed"]), 0.0)
    rows["watched"] = np.where(told, watched + dt, watched)


def correlations(table: Table) -> Float64Array:
    """Correlations of the series with themselves one cloud before, 0 to 1, shape (n_tracks, 4).

    Range rates that differ within a cloud are noise of their mean, too: a body moves as a whole, blades do not.
    """
    series = table.rows["series"]
    variance = np.maximum(series[..., 1], 1e-12)
    variance[:, 3] += _MIXED * table.rows["mixed"]
    return np.asarray(np.clip(series[..., 2] / variance, 0.0, 1.0))


def inertia(table: Table) -> Float64Array:
    """Features of who rests: 1, and correlations of range, azimuth and power; of who moves on the spot: 1, and that of range rates.

    Shape (n_tracks, 6); 0 for all others, and before it is known.
    """
    rows, found, known = table.rows, correlations(table), table.rows["watched"] > _KNOWN
    rests = known[:, 0] & rows["stands"] & (rows["lively"] < _RESTS)
    stirs = known[:, 3] & rows["stands"] & (rows["lively"] > _STIRS)
    one = np.ones((len(table), 1))
    return np.column_stack(
        [rests[:, None] * np.column_stack([one, found[:, :3]]), stirs[:, None] * np.column_stack([one, np.minimum(found[:, 3:], _MOST)])]
    )
