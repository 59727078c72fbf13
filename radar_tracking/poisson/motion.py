"""How people move and where their torsos are: predict, update, hold two people apart."""

from __future__ import annotations

import math
from typing import Any, Final

import numba
import numpy as np

from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.estimators.kernels import correct
from radar_tracking.estimators.kernels import predict as predicted
from radar_tracking.poisson.config import PoissonConfig
from radar_tracking.poisson.kernels import Shares
from radar_tracking.poisson.points import Measured
from radar_tracking.poisson.table import N_STATES, Table

_LONGEST: Final = 1.5  # s: later clouds are predicted no farther
_MANOEUVRE: Final = 0.5  # s: accelerations last so long
_SLOW: Final = 0.12  # m/s: spread of range rates of a torso that stands
_ARM_SHARE: Final = 0.2  # of the weight of its slow points: faster ones weigh no more together
_SLOW_POINTS: Final = 1.0  # so many slow points of who stands are the body, and the others arms
_STAYS_POINTS: Final = 0.2  # and of a person who has not set off
_ARM_STD: Final = 0.4  # m: how far arms are from their body
_SURGE_TIME, _SET_OFF = 0.6, 0.25  # s, m: who has come so far in this time has set off; a stroke of an arm comes back
_LOOSENED: Final = 3.0  # 1/s: by which share of the square of that way the place of who sets off gets less sure
_LONGEST_STEP: Final = 0.2  # s: range rates say no more about what came before
_CALM, _CALMEST = 0.3, 0.02  # share of the process noise of who stands, with points and without
_STOP, _GO = 0.7, 2.0  # s: velocities of who stands or is unseen fade, and of who walks
_LIVELY: Final = 0.05  # share of moving points: who has less rests, wherever echoes that beat against each other seem to come from
_GLINT: Final = 0.25  # m: how far across the line of sight these are from the body
_REST: Final = 0.5  # s: and their variances, of who stands unseen
_LARGEST: Final = 1.0  # m^2: variance of a place that is good for anything
_LEAST_SHARE: Final = 0.3  # of a point, that updates a track
_OFFSET_TIME, _SWING_TIME = 0.7, 0.15  # s: offsets of place change within the first, of range rate within the other
_BLURRED: Final = 0.4  # of the errors of single points that all points have in common
_SCATTER, _SPEED_SCATTER = 0.2, 0.06  # of the variances of points about their means: those far off count little
_BODY: Final = 1.0  # m: a body with its limbs
_ANGLE_OFFSET: Final = 0.03  # rad: of the middle of many points
_LEAST_PLACE_STD, _LEAST_SPEED_STD = 0.02, 0.02  # m, m/s: errors of means that no number of points takes away, beside offsets
_jit = numba.njit(cache=True, nogil=True)


def predict(table: Table, dt: float, unseen: BoolArray, range_cell: float, config: PoissonConfig) -> None:
    """Predict all states ``dt`` [s] ahead by nearly constant velocity, which fades for who stands; ``range_cell`` is the radar's [m]."""
    h = min(dt, _LONGEST)
    if not len(table) or h <= 0:
        return
    stands = table.rows["stands"]
    lasting = math.exp(-h / _OFFSET_TIME), math.exp(-h / _SWING_TIME)
    F = np.diag([1.0, 1.0, 1.0, 1.0, lasting[0], lasting[0], lasting[1]])
    F[0, 2] = F[1, 3] = h
    q = config.acceleration**2 * _MANOEUVRE
    Q = np.zeros((len(table), N_STATES, N_STATES))
    scale = np.where(np.where(unseen, stands, resting(table)), _CALMEST, np.where(stands, _CALM, 1.0))[:, None]
    Q[:, (0, 1), (0, 1)], Q[:, (2, 3), (2, 3)] = q * h**3 / 3 * scale, q * h * scale
    Q[:, (0, 1), (2, 3)] = Q[:, (2, 3), (0, 1)] = q * h * h / 2 * scale
    Q[:, 4:6, 4:6] = (1.0 - lasting[0] ** 2) * offset_covariance(table.rows["sight"], table.rows["offset"])
    Q[:, 6, 6] = (1.0 - lasting[1] ** 2) * swing_variance(range_cell, config)
    table.mean = table.mean @ F.T
    P = predicted(table.covariance, F[None], Q)
    rest = np.where(unseen & stands, math.exp(-h / _REST), 1.0)[:, None, None]
    P[:, 2:4, :] *= rest
    P[:, :, 2:4] *= rest
    P *= np.minimum(1.0, _LARGEST / np.maximum(P[:, 0, 0], P[:, 1, 1]))[:, None, None]
    table.covariance = P
    table.mean[:, 2:4] *= np.exp(-h / np.where(unseen | stands, _STOP, _GO))[:, None]


def resting(table: Table) -> BoolArray:
    """People of whom nothing has moved lately, shape (n_tracks,)."""
    return np.asarray(table.rows["confirmed"] & (table.rows["lively"] < _LIVELY))


def swing_variance(range_cell: float, config: PoissonConfig) -> float:
    """Variance of the range rate about the body's [m^2/s^2]: a range cell that holds all of a body mixes torso and limbs."""
    return config.swing_std**2 + (config.limb_speed * min(range_cell / _BODY, 1.0) ** 2) ** 2


def offset_covariance(sight: Float64Array, variance: Float64Array) -> Float64Array:
    """Covariances on the floor, shape (n, 2, 2), of offsets with variances along and across lines of sight, shapes (n, 2)."""
    x, y, (along, across) = sight[:, 0], sight[:, 1], variance.T
    both = x * y * (along - across)
    return np.stack([x * x * along + y * y * across, both, both, y * y * along + x * x * across], axis=-1).reshape(-1, 2, 2)


def separate(table: Table, width: float) -> None:
    """Hold two people who were seen apart at least a body's width apart, and stop what drives them together."""
    people = np.flatnonzero(table.rows["confirmed"]).tolist()
    if not (table.gaps()[np.ix_(people, people)] < width).any():
        return
    for index, one in enumerate(people):
        for other in people[index + 1 :]:
            step = table.mean[one, :2] - table.mean[other, :2]
            gap = math.hypot(*step)
            if gap >= width or not table.were_apart(one, other):
                continue
            u = step / gap if gap > 1e-6 else np.array([0.0, 1.0])
            share = [float(u @ table.covariance[row, :2, :2] @ u) for row in (one, other)]
            part = share[0] / (share[0] + share[1])
            table.mean[one, :2] += u * (width - gap) * part
            table.mean[other, :2] -= u * (width - gap) * (1 - part)
            closing = min(float((table.mean[one, 2:4] - table.mean[other, 2:4]) @ u), 0.0)
            table.mean[one, 2:4] -= u * closing * part
            table.mean[other, 2:4] += u * closing * (1 - part)


@_jit
def _centroids(torso: Any, stands: Any, stays: Any, slow: Any, columns: Any) -> Any:
    """Weights and weighted means of the torso's points, shape (n_tracks, 1 + n_columns), by ``columns``, shape (n_columns, n_points).

    Of who stands, the faster points lose weight if there are slow ones: an arm gives more points than the body behind it. For a person who
    ``stays``, shape (n_tracks,), a few are enough. ``slow``, shape (n_points,), is how slow points are, 0 to 1. The second result, shape
    (n_tracks,), is the share of the weight of who stays that arms have all the same.
    """
    n, m = torso.shape
    found, arms = np.zeros((m, 1 + len(columns))), np.zeros(m)
    for i in range(m):
        body, arm, share, out = 0.0, 0.0, 1.0, found[i]
        for j in range(n):
            body += torso[j, i] * slow[j]
            arm += torso[j, i] * (1.0 - slow[j])
        if stands[i] and body > (_STAYS_POINTS if stays[i] else _SLOW_POINTS):
            share = min(1.0, _ARM_SHARE * body / max(arm, 1e-9))
        for j in range(n):
            weight = torso[j, i] * (slow[j] + (1.0 - slow[j]) * share)
            out[0] += weight
            for k in range(len(columns)):
                out[1 + k] += weight * columns[k, j]
        if out[0] > 0.0:
            out[1:] /= out[0]
            arms[i] = share * arm / out[0] if stays[i] else 0.0
    return found, arms


def note_surge(table: Table, shares: Shares, dt: float) -> None:
    """Add up range rates, of all points of each track, into the way that it has come lately along the line of sight.

    A person who stands and has come so far that no arm would do is about to walk: where that person is, is less sure.
    """
    sums, rows = shares.sums, table.rows
    rows["surge"] = rows["surge"] * math.exp(-dt / _SURGE_TIME) + sums["rate"] / np.maximum(sums["points"], 0.5) * min(dt, _LONGEST_STEP)
    off = rows["confirmed"] & rows["stands"] & (np.abs(rows["surge"]) >= _SET_OFF)
    variance = np.column_stack([rows["surge"][off] ** 2, np.zeros(off.sum())]) * _LOOSENED * min(dt, _LONGEST_STEP)
    table.covariance[off, :2, :2] += offset_covariance(rows["sight"][off], variance)


def _staying(table: Table) -> BoolArray:
    """People who stand and have not set off, shape (n_tracks,)."""
    return np.asarray(table.rows["confirmed"] & table.rows["stands"] & (np.abs(table.rows["surge"]) < _SET_OFF))


class Update:
    """Torsos' centroids and mean range rates as measurements of the tracks that have any.

    Attributes
    ----------
    rows : ndarray of int64, shape (n_rows,)
        The updated tracks.
    speed : ndarray of float64, shape (n_rows,)
        Mean range rate of the torso's points [m/s]; NaN: not measured.
    """

    def __init__(self, table: Table, measured: Measured, shares: Shares, config: PoissonConfig) -> None:
        known = np.isfinite(measured.speed)
        slow = np.exp(-0.5 * (measured.rate / max(_SLOW, measured.still_speed)) ** 2) * known
        place = measured.x + config.surface * measured.ux, measured.y + config.surface * measured.uy
        errors = measured.range_variance, measured.cross_variance
        columns = np.stack([*place, measured.ux, measured.uy, *errors, measured.distance, measured.rate, known])
        # As in `weigh`: a contiguous copy, so that the loop is compiled once.
        found, arms = _centroids(shares.torso, table.rows["stands"].copy(), _staying(table), slow, columns)
        self.rows: IndexArray = np.flatnonzero(found[:, 0] > _LEAST_SHARE)
        table.rows["nis"], table.rows["dof"] = np.nan, 0
        total, mean = found[self.rows, 0], found[self.rows, 1:]
        with np.errstate(invalid="ignore", divide="ignore"):
            self.speed: Float64Array = mean[:, 7] / np.where(mean[:, 8] > 0, mean[:, 8], np.nan)
        if len(self.rows):
            self._correct(table, measured, mean, total, (_ARM_STD * arms[self.rows]) ** 2, config)

    def _offset(self, measured: Measured, distance: Float64Array, errors: Float64Array, config: PoissonConfig) -> Float64Array:
        """Variances of place along and across the line of sight that no number of points takes away, shape (n_rows, 2) [m^2]."""
        least = np.full((len(self.rows), 2), config.position_std**2)
        least[:, 0] += measured.range_cell**2 / 12.0
        least[:, 1] += (_ANGLE_OFFSET * distance) ** 2
        return np.asarray(least + _BLURRED**2 * errors)

    def _correct(
        self, table: Table, measured: Measured, mean: Float64Array, total: Float64Array, arms: Float64Array, config: PoissonConfig
    ) -> None:
        """Kalman update; ``arms``, shape (n_rows,): variances of place by arms [m^2]."""
        rows, n = self.rows, len(self.rows)
        centre, sight, errors = mean[:, :2], mean[:, 2:4], mean[:, 4:6]
        length = np.hypot(sight[:, 0], sight[:, 1])[:, None]  # zero: points all round the sensor
        sight = np.where(length > 1e-6, sight / np.maximum(length, 1e-6), [1.0, 0.0])
        offset = self._offset(measured, mean[:, 6], errors, config)
        offset[:, 1] += np.where(resting(table)[rows], _GLINT**2, 0.0)
        table.rows["sight"][rows], table.rows["offset"][rows] = sight, offset
        R = np.zeros((n, 3, 3))
        R[:, :2, :2] = offset_covariance(sight, _SCATTER * (config.torso_std**2 + errors) / total[:, None] + _LEAST_PLACE_STD**2)
        R[:, (0, 1), (0, 1)] += arms[:, None]
        spread = _SPEED_SCATTER * config.torso_speed**2 + measured.still_speed**2 / 3.0
        R[:, 2, 2] = spread / np.maximum(mean[:, 8] * total, _LEAST_SHARE) + _LEAST_SPEED_STD**2
        H = np.zeros((n, 3, N_STATES))
        H[:, 0, 0] = H[:, 1, 1] = H[:, 0, 4] = H[:, 1, 5] = H[:, 2, 6] = 1.0
        H[:, 2, 2:4] = sight
        used = np.ones((n, 3), np.bool_)
        used[:, 2] = np.isfinite(self.speed)
        measurement = np.column_stack([centre, np.where(used[:, 2], self.speed, 0.0)])
        residual = measurement - np.einsum("nij,nj->ni", H, table.mean[rows])
        corrected = correct(table.mean[rows], table.covariance[rows], residual, H, R, used)
        table.mean[rows], table.covariance[rows] = corrected.mean, corrected.covariance
        table.rows["nis"][rows], table.rows["dof"][rows] = corrected.nis, used.sum(axis=1)
