"""Interface of the estimators: measurements and beliefs, batched over tracks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_core.types import Float64Array, IndexArray


@dataclass(frozen=True, eq=False)
class Measurement:
    """One measured position per track, with its range rate.

    Attributes
    ----------
    position : ndarray of float64, shape (n_tracks, d)
        In ``room`` [m]; d is 2 (floor plane) or 3.
    covariance : ndarray of float64, shape (n_tracks, d, d)
        Of the same [m^2]; positive definite.
    rate : ndarray of float64, shape (n_tracks,)
        Range rate as seen from `origin`, receding positive [m/s]; NaN: not measured.
    rate_variance : ndarray of float64, shape (n_tracks,)
        Of the same [m^2/s^2]; positive where `rate` is measured.
    origin : ndarray of float64, shape (n_tracks, d)
        Where the sensor that measured stands [m].
    """

    position: Float64Array
    covariance: Float64Array
    rate: Float64Array
    rate_variance: Float64Array
    origin: Float64Array

    def __len__(self) -> int:
        return len(self.position)

    def select(self, index: NDArray[np.generic]) -> Measurement:
        """Keep the tracks that a mask or an index array picks, in its order."""
        return Measurement(self.position[index], self.covariance[index], self.rate[index], self.rate_variance[index], self.origin[index])


@dataclass(frozen=True, eq=False)
class Belief:
    """State of an estimator for a batch of tracks: one Gaussian per track and mode.

    Attributes
    ----------
    mean : ndarray of float64, shape (n_tracks, n_modes, n_states)
        States of the motion model; filters with one model have one mode.
    covariance : ndarray of float64, shape (n_tracks, n_modes, n_states, n_states)
        Of the same; symmetric to the bit, positive definite.
    weight : ndarray of float64, shape (n_tracks, n_modes)
        Probability of each mode; sums to one.
    """

    mean: Float64Array
    covariance: Float64Array
    weight: Float64Array

    def __len__(self) -> int:
        return len(self.mean)

    def select(self, index: NDArray[np.generic]) -> Belief:
        """Keep the tracks that a mask or an index array picks, in its order."""
        return Belief(self.mean[index], self.covariance[index], self.weight[index])

    def put(self, index: NDArray[np.generic], part: Belief) -> Belief:
        """Return a copy in which the tracks of ``index`` are those of ``part``."""
        mean, covariance, weight = self.mean.copy(), self.covariance.copy(), self.weight.copy()
        mean[index], covariance[index], weight[index] = part.mean, part.covariance, part.weight
        return Belief(mean, covariance, weight)


def join(beliefs: Sequence[Belief]) -> Belief:
    """Concatenate the tracks of several beliefs, at least one, of one estimator."""
    return Belief(*(np.concatenate([getattr(b, name) for b in beliefs]) for name in ("mean", "covariance", "weight")))


@dataclass(frozen=True, eq=False)
class Innovation:
    """Innovation of an update: input of gating, mode probabilities and consistency checks.

    Attributes
    ----------
    nis : ndarray of float64, shape (n_tracks,)
        Normalised innovation squared; chi-square of `dof` degrees of freedom when the filter is consistent.
    dof : ndarray of int64, shape (n_tracks,)
        Number of measured components: d, and one more where the range rate was used.
    log_likelihood : ndarray of float64, shape (n_tracks,)
        Of the measurement given the prediction.
    """

    nis: Float64Array
    dof: IndexArray
    log_likelihood: Float64Array = field(default_factory=lambda: np.empty(0))


class Estimator(Protocol):
    """Predicts and updates a batch of tracks; holds no state of its own, so that one serves all tracks.

    Attributes
    ----------
    dimensions : int
        2 or 3.
    """

    dimensions: int

    def start(self, measurement: Measurement, speed_std: float) -> Belief:
        """Start tracks at rest at the measured positions, with a velocity known to within ``speed_std`` [m/s]."""
        ...

    def predict(self, belief: Belief, dt: float) -> Belief:
        """Move all tracks on by ``dt``, not negative [s]."""
        ...

    def update(self, belief: Belief, measurement: Measurement) -> tuple[Belief, Innovation]:
        """Take in one measurement of every track."""
        ...

    def kinematics(self, belief: Belief) -> tuple[Float64Array, Float64Array]:
        """Mean and covariance of (position, velocity), shapes (n_tracks, 2 d) and (n_tracks, 2 d, 2 d), over all modes."""
        ...


@dataclass(frozen=True, eq=False)
class VelocityMeasurement(Measurement):
    """A measurement that may also hold the velocity, whole or along some axes (thesis, 7.3.1); NaN where there is none.

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
            shapes = f"{self.velocity.shape} and {self.velocity_covariance.shape}"
            raise DataError(f"velocity and its covariance have shapes {shapes}; give (n, d) ones")
        if not self.velocity_axes.size:
            object.__setattr__(self, "velocity_axes", np.broadcast_to(np.eye(d), (n, d, d)))
        elif self.velocity_axes.shape != (n, d, d):
            raise DataError(f"velocity_axes has shape {self.velocity_axes.shape}, expected {(n, d, d)}")

    def select(self, index: NDArray[np.generic]) -> VelocityMeasurement:
        """Keep the tracks that a mask or an index array picks, in its order."""
        return VelocityMeasurement(**{f.name: getattr(self, f.name)[index] for f in fields(self)})
