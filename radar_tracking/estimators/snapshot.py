"""The velocity of a small target from one snapshot of several sensors (thesis, 7.3.1): equations 7.1 to 7.6, with what they leave out.

The thesis solves ``v_r = H v`` for all points alike. Here points count by their errors; points of one rigid body that turns have range
rates that differ with their place on it; points of one sensor have errors in common, because they lie on the side that it sees; a few may
be no part of the body at all. What the rates do not tell is not made up: the velocity comes along its own axes, each with its error, and
the axes that are too uncertain are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_core.linalg import canonical_qr, canonical_svd, symmetrise
from radar_core.types import BoolArray, Float64Array
from radar_tracking.estimators.config import SnapshotConfig

_LEAST_WEIGHT = 1e-12  # of an outlier: the system stays regular whatever happens
_ROUNDING = 1e-10  # singular values below this share of the largest are rounding
_SETTLED = 0.01  # weights that change by less than this share change no more
_REDUNDANT = 1e-9  # a point that alone tells what it tells cannot be tested
_UNIT = 1e-3  # how far the length of a unit vector may be from 1
_OUTLIER = 0.25  # a point whose weight falls below this is told to be an outlier


@dataclass(frozen=True, eq=False)
class SnapshotVelocity:
    """Velocity estimated from one snapshot.

    Attributes
    ----------
    axes : ndarray of float64, shape (d, d)
        Orthonormal rows in ``room``, the best known first; errors along them are uncorrelated.
    along : ndarray of float64, shape (d,)
        Velocity along each [m/s]; NaN: not told.
    std : ndarray of float64, shape (d,)
        Standard deviation along each [m/s]; infinite where nothing is known.
    rank : int
        Axes along which the velocity is told.
    condition : float
        Worst over best of the standard deviations; infinite where one is.
    weight : ndarray of float64, shape (n_points,)
        How much each point counted, 0..1: the variance that it has alone over that with which it counted; NaN where no rate was measured.
    """

    axes: Float64Array
    along: Float64Array
    std: Float64Array
    rank: int
    condition: float
    weight: Float64Array

    @property
    def whole(self) -> bool:
        """Whether the velocity is known in all directions."""
        return self.rank == len(self.axes)

    @property
    def velocity(self) -> Float64Array:
        """Velocity in ``room``, shape (d,) [m/s]; NaN unless it is `whole`."""
        return np.asarray(self.along @ self.axes)

    @property
    def covariance(self) -> Float64Array:
        """Of `velocity`, shape (d, d) [m^2/s^2]; NaN unless it is `whole`."""
        if not self.whole:
            return np.full(self.axes.shape, np.nan)
        return symmetrise((self.axes.T * self.std**2) @ self.axes)

    @property
    def outliers(self) -> int:
        """Number of points with hardly any weight."""
        return int(np.count_nonzero(self.weight < _OUTLIER))


class Snapshot:
    """Estimate the velocity of one target at one moment; holds no state."""

    def __init__(self, config: SnapshotConfig | None = None) -> None:
        self.config = config if config is not None else SnapshotConfig()

    def process(
        self,
        direction: Float64Array,
        rate: Float64Array,
        rate_std: Float64Array,
        *,
        offset: Float64Array | None = None,
        sensor: NDArray[np.integer] | None = None,
        amplitude: Float64Array | None = None,
        speed: float | None = None,
    ) -> SnapshotVelocity:
        """Estimate the velocity at the place from which ``offset`` counts, by weighted least squares.

        The model of point i is ``rate = u.v + u.(w x offset) + b + e`` with its direction u, the velocity v, a turn rate w of standard
        deviation `spin` about every axis, b of `common` for each sensor, and e of ``rate_std`` and `spread`. Turn rate and b belong to the
        noise, so that a single point and a single sensor are no special cases. Its three deviations grow with the target's ``speed``
        (`SnapshotConfig.factor`). ``e`` is weighed anew in every round (Huber 1964), by how
        far the point is from what the others foretell of it (deletion residuals: Belsley, Kuh and Welsch 1980, section 2.1).

        Parameters
        ----------
        direction : ndarray of float64, shape (n_points, d)
            Unit vectors in ``room`` from the sensor that saw each point to the point; d is 2 (floor plane) or 3. A row of zeros has no
            line of sight, and its rate tells nothing.
        rate : ndarray of float64, shape (n_points,)
            Range rates, receding positive [m/s]; NaN: not measured.
        rate_std : ndarray of float64, shape (n_points,)
            Their standard deviations [m/s].
        offset : ndarray of float64, shape (n_points, d), or None
            Of each point from the target's centre [m]; None: the target is a point.
        sensor : ndarray of int, shape (n_points,), or None
            Which sensor saw each; None: one.
        amplitude : ndarray of float64, shape (n_points,), or None
            Relative amplitudes: a strong echo is the mean of much of the hand, its `spread` is less. None: all alike.
        speed : float or None
            How fast the target is about, as a track foretells it [m/s]; None: not known, 1 m/s.

        Raises
        ------
        DataError
            When shapes differ, a direction is neither a unit vector nor zero, the error of a measured rate is not positive and finite, or
            the speed is negative or not finite.
        """
        direction, rate, rate_std = (np.asarray(given, np.float64) for given in (direction, rate, rate_std))
        n, d = direction.shape
        known = self._check(direction, rate, rate_std, offset, sensor, amplitude)
        if speed is not None and not 0.0 <= speed < np.inf:
            raise DataError(f"speed is {speed} m/s; give one that is finite and not negative, or None")
        faster = self.config.factor(speed)
        weight = np.full(n, np.nan)
        if not known.any():
            return SnapshotVelocity(np.eye(d), np.full(d, np.nan), np.full(d, np.inf), 0, np.inf, weight)
        U, own = direction[known], faster * self.config.spread / np.sqrt(_relative(amplitude, known))
        nuisance = faster * self._nuisance(U, None if offset is None else offset[known], None if sensor is None else sensor[known])
        axes, std, along, weight[known] = self._solve(U, rate[known], np.hypot(rate_std[known], own), nuisance)
        told = std <= self.config.max_std
        along[~told] = np.nan
        return SnapshotVelocity(axes, along, std, int(np.count_nonzero(told)), float(std[-1] / std[0]), weight)

    def _check(
        self,
        direction: Float64Array,
        rate: Float64Array,
        rate_std: Float64Array,
        offset: Float64Array | None,
        sensor: NDArray[np.integer] | None,
        amplitude: Float64Array | None,
    ) -> BoolArray:
        """Tell which points have a rate and a line of sight, shape (n,)."""
        n = len(direction)
        wrong = offset is not None and offset.shape != direction.shape
        if wrong or any(given is not None and given.shape != (n,) for given in (rate, rate_std, sensor, amplitude)):
            shapes = [None if given is None else given.shape for given in (direction, rate, rate_std, offset, sensor, amplitude)]
            raise DataError(f"direction, rate, rate_std, offset, sensor, amplitude have shapes {shapes}; give one row for every point")
        known = ~np.isnan(rate)
        if not (np.isfinite(direction[known]).all() and np.isfinite(rate[known]).all()):
            raise DataError("direction or rate has an entry that is not finite; NaN in rate is the mark for what was not measured")
        with np.errstate(over="ignore"):
            length = np.linalg.norm(direction, axis=1)
        known &= ~(length < 0.5)  # a point at the very place of its sensor
        if (np.abs(length[known] - 1.0) > _UNIT).any():
            raise DataError("direction has a row that is no unit vector; give zeros where there is no line of sight")
        if not ((rate_std[known] > 0) & np.isfinite(rate_std[known])).all():
            raise DataError("rate_std has an entry that is not positive and finite; every measured range rate needs an error")
        if offset is not None and not np.isfinite(offset[known]).all():
            raise DataError("offset has an entry that is not finite; give the target's own height to points without one")
        if amplitude is not None and not ((amplitude[known] > 0) & np.isfinite(amplitude[known])).all():
            raise DataError("amplitude has an entry that is not positive and finite; give 1 where it is not known")
        return known

    def _nuisance(self, U: Float64Array, offset: Float64Array | None, sensor: NDArray[np.integer] | None) -> Float64Array:
        """Lay out what turn and sides add to the rates, shape (n, n_nuisances), each column for one standard deviation [m/s]."""
        columns = []
        if offset is not None and self.config.spin > 0:
            flat = U.shape[1] == 2
            turn = (U[:, 1] * offset[:, 0] - U[:, 0] * offset[:, 1])[:, None] if flat else np.cross(offset, U)
            columns.append(self.config.spin * turn)
        if self.config.common > 0:
            own = np.zeros(len(U), np.int64) if sensor is None else sensor
            columns.append(self.config.common * (own[:, None] == np.unique(own)[None, :]))
        return np.hstack(columns) if columns else np.zeros((len(U), 0))

    def _solve(
        self, U: Float64Array, y: Float64Array, std: Float64Array, nuisance: Float64Array
    ) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
        """Axes (d, d), their standard deviations (d,), the velocity along them (d,) and the points' weights, all of the last round."""
        weight = np.ones(len(y))
        for turn in range(self.config.iterations):
            shared, rows = _without(nuisance, np.column_stack([U, y]), std / np.sqrt(weight))
            left, value, axes = canonical_svd(rows[:, :-1])
            left[:, value <= _ROUNDING * value[0]] = 0.0
            part = left.T @ rows[:, -1]
            if turn + 1 == self.config.iterations:
                break
            residual = (rows[:, -1] - left @ part)[: len(y)]
            new = self._weigh(residual, 1.0 - shared - (left[: len(y)] ** 2).sum(axis=1), weight)
            if (np.abs(new - weight) < _SETTLED * weight).all():
                break
            weight = new
        known = value > _ROUNDING * value[0]
        spread = np.full(len(value), np.inf)
        spread[known] = 1.0 / value[known]
        along = np.full(len(value), np.nan)
        along[known] = part[known] * spread[known]
        return axes, spread, along, weight

    def _weigh(self, residual: Float64Array, free: Float64Array, weight: Float64Array) -> Float64Array:
        """Weigh each point by how far it is from what the others foretell, in standard deviations of that (Huber), shape (n,).

        A point far from the middle of the hand passes for a turn of it, and its own residual is small however wrong it is; so the point
        itself must have no say in the judgement of it. What is too far for Huber gets as much more variance as makes it near enough.
        ``free`` is one minus the leverage of each point: 0 if nothing else tells what it tells.
        """
        tested = free > _REDUNDANT
        free = np.where(tested, free, 1.0)
        variance = 1.0 / free - 1.0 + weight  # of the point (unweighed) and of what the others foretell, over that of the weighed point
        far = np.abs(residual) / free / np.sqrt(variance)
        more = variance / weight * np.maximum(far / self.config.huber - 1.0, 0.0)
        return np.where(tested, np.maximum(1.0 / (1.0 + more), _LEAST_WEIGHT), 1.0)


def _without(nuisance: Float64Array, columns: Float64Array, std: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Whiten rows and take out what nuisances of unit variance explain: least squares with their priors as further rows.

    Gives the leverage of each point on the nuisances, shape (n,), and the rows, points first, at least d, shape (n_rows, d + 1).
    """
    n, m = nuisance.shape
    rows = np.zeros((max(n + m, columns.shape[1] - 1), columns.shape[1]))
    rows[:n] = columns / std[:, None]
    if not m:
        return np.zeros(n), rows
    base = canonical_qr(np.vstack([nuisance / std[:, None], np.eye(m)]))[0]
    rows[: n + m] -= base @ (base.T @ rows[: n + m])
    return (base[:n] ** 2).sum(axis=1), rows


def _relative(amplitude: Float64Array | None, known: BoolArray) -> Float64Array:
    """Amplitudes over their mean, shape (n_known,)."""
    if amplitude is None:
        return np.ones(int(np.count_nonzero(known)))
    own = amplitude[known] / amplitude[known].max()
    return np.asarray(np.maximum(own / own.mean(), 1e-3))
