"""A measurement that also holds the velocity vector, or as much of it as one snapshot tells (thesis, 7.3.1)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_core.types import Float64Array
from radar_tracking.estimators.base import Measurement


@dataclass(frozen=True, eq=False)
class VelocityMeasurement(Measurement):
    """A measurement that may also hold the velocity vector, whole or along some axes; NaN where there is none.

    Attributes
    ----------
    velocity : ndarray of float64, shape (n_tracks, d)
        Along the rows of `velocity_axes` [m/s]; NaN: not measured.
    velocity_covariance : ndarray of float64, shape (n_tracks, d, d)
        Of the same [m^2/s^2]; positive definite where `velocity` is measured.
    velocity_axes : ndarray of float64, shape (n_tracks, d, d)
        Orthonormal rows in ``room``; empty: x, y (and z).
    """

    velocity: Float64Array = field(default_factory=lambda: np.empty((0, 3)))
    velocity_covariance: Float64Array = field(default_factory=lambda: np.empty((0, 3, 3)))
    velocity_axes: Float64Array = field(default_factory=lambda: np.empty((0, 0, 0)))

    def __post_init__(self) -> None:
        n, d = self.position.shape
        if self.velocity.shape != (n, d) or self.velocity_covariance.shape != (n, d, d):
            raise DataError(
                f"velocity and its covariance have shapes {self.velocity.shape} and {self.velocity_covariance.shape}; give (n, d) ones"
            )
        if not self.velocity_axes.size:
            object.__setattr__(self, "velocity_axes", np.broadcast_to(np.eye(d), (n, d, d)))
        elif self.velocity_axes.shape != (n, d, d):
            raise DataError(f"velocity_axes has shape {self.velocity_axes.shape}, expected {(n, d, d)}")

    def select(self, index: NDArray[np.generic]) -> VelocityMeasurement:
        """Keep the tracks that a mask or an index array picks, in its order."""
        part = super().select(index)
        own = (self.velocity[index], self.velocity_covariance[index], self.velocity_axes[index])
        return VelocityMeasurement(part.position, part.covariance, part.rate, part.rate_variance, part.origin, *own)
