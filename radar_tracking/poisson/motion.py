"""How people move and where their torsos are: predict, update, hold two people apart."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.estimators.kernels import correct
from radar_tracking.poisson.config import PoissonConfig
from radar_tracking.poisson.kernels import Shares
from radar_tracking.poisson.points import Measured
from radar_tracking.poisson.table import Table

_LONGEST: Final = 1.5  # s: later clouds are predicted no farther
_MANOEUVRE: Final = 0.5  # s: accelerations last so long
_CALM, _CALMEST = 0.3, 0.02  # share of the process noise of who stands, with points and without
_STOP, _GO = 0.7, 2.0  # s: velocities of who stands or is unseen fade, and of who walks
_REST: Final = 0.5  # s: and their variances, of who stands unseen
_LARGEST: Final = 1.0  # m^2: variance of a place that is good for anything
_LEAST_SHARE: Final = 0.3  # of a point, that updates a track
_MOST_POINTS: Final = 10.0  # that count for a range rate: they err together
_RATE_STD: Final = 0.05  # m/s: error of the mean range rate that no number of points takes away


def predict(table: Table, dt: float, unseen: BoolArray, config: PoissonConfig) -> None:
    """Predict all states ``dt`` [s] ahead by nearly constant velocity, which fades for who stands."""
    h = min(dt, _LONGEST)
    if not len(table) or h <= 0:
        return
    stands = table.rows["stands"]
    F = np.eye(4)
    F[0, 2] = F[1, 3] = h
    q = config.acceleration**2 * _MANOEUVRE
    Q = q * np.kron(np.array([[h**3 / 3, h * h / 2], [h * h / 2, h]]), np.eye(2))
    scale = np.where(unseen & stands, _CALMEST, np.where(stands, _CALM, 1.0))
    table.mean = table.mean @ F.T
    P = F @ table.covariance @ F.T + Q * scale[:, None, None]
    rest = np.ones((len(table), 4))
    rest[:, 2:] = np.exp(-h / np.where(unseen & stands, _REST, np.inf))[:, None]
    P = P * rest[:, :, None] * rest[:, None, :]
    P *= np.minimum(1.0, _LARGEST / np.maximum(P[:, 0, 0], P[:, 1, 1]))[:, None, None]
    table.covariance = 0.5 * (P + P.transpose(0, 2, 1))
    table.mean[:, 2:] *= np.exp(-h / np.where(unseen | stands, _STOP, _GO))[:, None]


def separate(table: Table, width: float) -> None:
    """Hold two people who were seen apart at least a body's width apart, and stop what drives them together."""
    people = np.flatnonzero(table.rows["confirmed"]).tolist()
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
            closing = min(float((table.mean[one, 2:] - table.mean[other, 2:]) @ u), 0.0)
            table.mean[one, 2:] -= u * closing * part
            table.mean[other, 2:] += u * closing * (1 - part)


class Update:
    """Torsos' centroids and mean range rates as measurements of the tracks that have any.

    Attributes
    ----------
    rows : ndarray of int64, shape (n_rows,)
        The updated tracks.
    speed : ndarray of float64, shape (n_rows,)
        Mean range rate of the torso's points [m/s]; NaN: not measured.
    """

    def __init__(self, table: Table, measured: Measured, shares: Shares, dt: float, config: PoissonConfig) -> None:
        total = shares.torso.sum(axis=0)
        self.rows: IndexArray = np.flatnonzero(total > _LEAST_SHARE)
        table.rows["nis"], table.rows["dof"] = np.nan, 0
        weight = shares.torso[:, self.rows] / total[self.rows]
        known = np.isfinite(measured.speed)
        told = shares.torso[np.ix_(np.flatnonzero(known), self.rows)]
        amount = told.sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            self.speed: Float64Array = (told.T @ measured.speed[known]) / np.where(amount > 0, amount, np.nan)
        if len(self.rows):
            self._correct(table, measured, weight, total[self.rows], amount, max(1.0, config.correlation_time / max(dt, 1e-3)), config)

    def _correct(
        self, table: Table, measured: Measured, weight: Float64Array, total: Float64Array, amount: Float64Array, alike: float,
        config: PoissonConfig,
    ) -> None:  # fmt: skip
        """Kalman update; ``alike``: how many neighbouring clouds err together."""
        rows, n = self.rows, len(self.rows)
        place = np.stack([measured.x + config.surface * measured.ux, measured.y + config.surface * measured.uy])
        centre = (place @ weight).T
        sight = (np.stack([measured.ux, measured.uy]) @ weight).T
        length = np.hypot(sight[:, 0], sight[:, 1])[:, None]  # zero: points all round the sensor
        sight = np.where(length > 1e-6, sight / np.maximum(length, 1e-6), [1.0, 0.0])
        along, across = measured.range_variance @ weight, measured.cross_variance @ weight
        body, floor = config.torso_std**2, config.position_std**2
        axes = np.stack([sight, np.stack([-sight[:, 1], sight[:, 0]], axis=-1)], axis=1)
        noise = np.stack([(body + along) / total * alike + floor, (body + across) / total * alike + floor + 0.1 * across], axis=-1)
        R = np.zeros((n, 3, 3))
        R[:, :2, :2] = axes.transpose(0, 2, 1) @ (noise[:, :, None] * axes)
        spread = config.torso_speed**2 + measured.still_speed**2 / 3.0
        R[:, 2, 2] = spread / np.clip(amount, _LEAST_SHARE, _MOST_POINTS) * alike + _RATE_STD**2
        H = np.zeros((n, 3, 4))
        H[:, 0, 0] = H[:, 1, 1] = 1.0
        H[:, 2, 2:] = sight
        used = np.ones((n, 3), np.bool_)
        used[:, 2] = np.isfinite(self.speed)
        measurement = np.column_stack([centre, np.where(used[:, 2], self.speed, 0.0)])
        residual = measurement - np.einsum("nij,nj->ni", H, table.mean[rows])
        corrected = correct(table.mean[rows], table.covariance[rows], residual, H, R, used)
        table.mean[rows], table.covariance[rows] = corrected.mean, corrected.covariance
        table.rows["nis"][rows], table.rows["dof"][rows] = corrected.nis, used.sum(axis=1)
