"""The velocity of a small target from one snapshot of several sensors (thesis, 7.3.1): equations 7.1 to 7.5, weighted."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_core.linalg import symmetrise
from radar_tracking.estimators.base import Measurement

Float64Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VelocityMeasurement(Measurement):
    """A measurement that may also hold the velocity vector; NaN where there is none.

    Attributes
    ----------
    velocity : ndarray of float64, shape (n_tracks, d)
        In ``room`` [m/s]; NaN: not measured.
    velocity_covariance : ndarray of float64, shape (n_tracks, d, d)
        Of the same [m^2/s^2]; positive definite where `velocity` is measured.
    """

    velocity: Float64Array = field(default_factory=lambda: np.empty((0, 3)))
    velocity_covariance: Float64Array = field(default_factory=lambda: np.empty((0, 3, 3)))

    def __post_init__(self) -> None:
        n, d = self.position.shape
        if self.velocity.shape != (n, d) or self.velocity_covariance.shape != (n, d, d):
            raise DataError(
                f"velocity and its covariance have shapes {self.velocity.shape} and {self.velocity_covariance.shape}; give (n, d) ones"
            )

    def select(self, index: NDArray[np.generic]) -> VelocityMeasurement:
        """Keep the tracks that a mask or an index array picks, in its order."""
        part = super().select(index)
        velocity, covariance = self.velocity[index], self.velocity_covariance[index]
        return VelocityMeasurement(part.position, part.covariance, part.rate, part.rate_variance, part.origin, velocity, covariance)


def snapshot_velocity(
    direction: Float64Array, rate: Float64Array, rate_variance: Float64Array, max_std: float = 1.0
) -> tuple[Float64Array, Float64Array]:
    """Estimate the velocity of one small target from the range rates of its points (7.3 to 7.5), by weighted least squares.

    Points in one direction say nothing about the velocity across it. What the rates do not tell comes out with a large variance; when any
    direction's standard deviation is more than ``max_std`` there is no estimate.

    Parameters
    ----------
    direction : ndarray of float64, shape (n_points, d)
        Unit vectors in ``room`` from the sensor that saw each point to the point.
    rate : ndarray of float64, shape (n_points,)
        Range rates, receding positive [m/s]; NaN: not measured.
    rate_variance : ndarray of float64, shape (n_points,)
        Of the same [m^2/s^2]; positive.
    max_std : float
        Largest standard deviation of an estimate, in its worst direction [m/s].

    Returns
    -------
    velocity, covariance : ndarray of float64, shapes (d,), (d, d)
        [m/s, m^2/s^2]; all NaN when the rates do not tell.

    Raises
    ------
    DataError
        When a variance is not positive where a rate was measured.
    """
    d = direction.shape[1]
    known = ~np.isnan(rate)
    H, y, variance = direction[known], rate[known], rate_variance[known]
    if not (variance > 0).all():
        raise DataError("rate_variance has an entry that is not positive; every measured range rate needs an error")
    information = H.T @ (H / variance[:, None])
    value, axes = np.linalg.eigh(symmetrise(information))
    if len(y) < d or not value[0] * max_std**2 >= 1.0:
        return np.full(d, np.nan), np.full((d, d), np.nan)
    covariance = (axes / value) @ axes.T
    return covariance @ (H.T @ (y / variance)), symmetrise(covariance)
