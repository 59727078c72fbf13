"""Loops of tracking in plain numpy: what the compiled ones in `radar_tracking` must equal."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core.linalg import solve_spd, symmetrise
from radar_tracking.estimators.kernels import Correction
from radar_tracking.people.pairs import _COMPACT, _FEWEST, _LEAST_SHARE
from radar_tracking.people.track_table import TorsoPoints

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]
Mask = NDArray[np.bool_]
_SHORT = 1e-9  # m


def mahalanobis(
    mean: Float64Array, covariance: Float64Array, points: Float64Array, point_covariance: Float64Array | None = None
) -> Float64Array:
    """`radar_tracking.assignment.mahalanobis` in numpy."""
    if point_covariance is None:
        point_covariance = np.zeros(covariance.shape[1:])
    each = point_covariance.reshape(-1, *covariance.shape[1:])
    if len(mean) == 0 or len(points) == 0:
        return np.zeros((len(mean), len(points)))
    difference = (points[None] - mean[:, None])[..., None]
    both = symmetrise(covariance[:, None] + each[None])
    both = np.broadcast_to(both, (*difference.shape[:2], *both.shape[2:]))
    return np.asarray(np.sqrt((difference * solve_spd(both, difference)).sum(axis=(-2, -1))))


def update_torsos(
    records: Any,
    rows: IndexArray,
    group: IndexArray,
    points: TorsoPoints,
    keep: Float64Array,
    keep_activity: Float64Array,
    fast: float,
    low: float,
    high: float,
) -> None:
    """`radar_tracking.people.track_table.update_torsos` in numpy."""
    residual, weight = points.doppler_residual, points.weight
    known = np.isfinite(residual)
    total, share = np.bincount(group, weight), np.bincount(group, weight * known)
    loud = np.bincount(group, np.nan_to_num(points.power))
    moves = np.bincount(group, ~(np.abs(points.speed) < fast)) > 0
    drift = np.bincount(group, weight * np.where(known, residual, 0.0)) / np.maximum(share, 1e-300)
    for name, stays, new in (
        ("doppler_residual", keep, np.where(share > 0, drift, records["doppler_residual"][rows])),
        ("surface", keep, np.bincount(group, weight * points.beyond) / total),
        ("range", keep, np.bincount(group, weight * points.distance) / total),
        ("rate", keep, np.bincount(group, weight * np.where(known, points.speed, 0.0)) / total),
        ("power", keep, 10 * np.log10(np.maximum(loud, 1e-30))),
        ("activity", keep_activity, moves),
    ):
        records[name][rows] = stays * records[name][rows] + (1 - stays) * new
    records["surface"][rows] = np.clip(records["surface"][rows], low, high)


def update_extents(records: Any, row: IndexArray, step: Float64Array, keep: Float64Array) -> None:
    """`radar_tracking.people.track_table.update_extents` in numpy."""
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


def two_heaps(group: IndexArray, value: Float64Array, weight: Float64Array, n: int, distance: float) -> Float64Array:
    """`radar_tracking.people.pairs.two_heaps` in numpy."""
    bound = np.full(n, np.nan)
    for k in range(n):
        order = np.flatnonzero(group == k)
        order = order[np.argsort(value[order], kind="stable")]
        if len(order) < _FEWEST:
            continue
        v, w = value[order], weight[order]
        low, first, second = (np.cumsum(part)[:-1] for part in (w, w * v, w * v * v))
        high, total = np.maximum(w.sum() - low, np.finfo(float).tiny), w.sum()
        left, right = first / low, ((w * v).sum() - first) / high
        apart = right - left
        best = int((low * high * apart * apart).argmax())  # multiplied in the kernel's order: rounding decides between equal splits
        gap = apart[best]
        spread = [
            max(second[best] / low[best] - left[best] ** 2, 0.0),
            max(((w * v * v).sum() - second[best]) / high[best] - right[best] ** 2, 0.0),
        ]
        if gap >= distance and min(low[best], high[best]) >= _LEAST_SHARE * total and max(spread) < (_COMPACT * gap) ** 2:
            bound[k] = 0.5 * (v[best] + v[best + 1])
    return bound


def centre(
    position: Float64Array,
    cross: Float64Array,
    speed: Float64Array,
    sensor: IndexArray,
    origins: Float64Array,
    group: IndexArray,
    weight: Float64Array,
    n: int,
) -> tuple[Any, ...]:
    """`radar_tracking.people.body.centre` in numpy."""
    share = weight / np.bincount(group, weight, n)[group]
    effective = np.bincount(group, share * share, n)
    noise = np.bincount(group, share * cross**2, n)
    moments = [_moments(group, share, position[:, axis], n) for axis in range(3)]
    place = np.stack([mean for mean, _ in moments], axis=-1)
    variance = np.stack([(noise + square) * effective for _, square in moments], axis=-1)
    sight = position[:, :2] - origins[sensor, :2]
    sight /= np.maximum(np.hypot(sight[:, 0], sight[:, 1]), _SHORT)[:, None]
    away = np.stack([np.bincount(group, share * sight[:, axis], n) for axis in range(2)], axis=-1)
    seen = np.bincount(group * len(origins) + sensor, share, n * len(origins)).reshape(n, -1)
    best = seen.argmax(axis=1)
    same = sensor == best[group]
    group, share = group[same], share[same]
    rate, square = _moments(group, share, speed[same], n)
    fewer = np.bincount(group, share**2, n) / np.bincount(group, share, n) ** 2
    return place, variance, away, best, rate, square * fewer


def _moments(group: IndexArray, share: Float64Array, value: Float64Array, n: int) -> tuple[Float64Array, Float64Array]:
    known = np.isfinite(value)
    group, share, value = group[known], share[known], value[known]
    total = np.bincount(group, share, n)
    with np.errstate(invalid="ignore", divide="ignore"):  # groups without a value give 0 / 0
        mean = np.bincount(group, share * value, n) / total
        return mean, np.bincount(group, share * (value - mean[group]) ** 2, n) / total


def predict(covariance: Float64Array, F: Float64Array, Q: Float64Array) -> Float64Array:
    """`radar_tracking.estimators.kernels.predict` in numpy."""
    return symmetrise(F @ covariance @ np.swapaxes(F, -1, -2) + Q)


def correct(
    mean: Float64Array, covariance: Float64Array, residual: Float64Array, H: Float64Array, R: Float64Array, used: Mask
) -> Correction:
    """`radar_tracking.estimators.kernels.correct` in numpy, for measurements that can be solved."""
    both = used[:, :, None] & used[:, None, :]
    H = np.where(used[:, :, None], H, 0.0)
    R = np.where(both, R, 0.0)
    residual = np.where(used, residual, 0.0)
    Ht = np.swapaxes(H, -1, -2)
    S = symmetrise(H @ covariance @ Ht + R) + np.where(used, 0.0, 1.0)[:, :, None] * np.eye(used.shape[1])
    K = np.swapaxes(np.linalg.solve(S, H @ covariance), -1, -2)
    keep = np.eye(mean.shape[1]) - K @ H
    joseph = keep @ covariance @ np.swapaxes(keep, -1, -2) + K @ R @ np.swapaxes(K, -1, -2)
    nis = (residual * np.linalg.solve(S, residual[..., None])[..., 0]).sum(axis=-1)
    return Correction(mean + (K @ residual[..., None])[..., 0], symmetrise(joseph), nis, np.linalg.slogdet(S)[1], S)
