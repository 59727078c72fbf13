"""Estimators with several Kalman filters, each with its own motion model (thesis, figure A.21): IMM and MMAE."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from radar_core import ConfigError
from radar_core.linalg import canonical_eigh, symmetrise
from radar_core.types import Float64Array
from radar_tracking.estimators.base import Belief, Innovation, Measurement
from radar_tracking.estimators.filters import GaussianFilter, Updated, check_step, start_at
from radar_tracking.estimators.kernels import nis_and_log_det
from radar_tracking.estimators.kinematics import Motion
from radar_tracking.estimators.measurement_models import PositionModel, PreparedMeasurement


@dataclass(frozen=True)
class Embedded:
    """A model on some states of a longer vector that several models share; the others are unknown, not zero.

    A state that a model does not have is drawn anew from its prior at every step. So an estimator with several models can mix them without
    claiming that a walker at constant velocity knows his turn rate.

    Attributes
    ----------
    motion : Motion
        The model.
    columns : tuple of int
        Where its states lie in the shared vector.
    prior : tuple of float
        Standard deviations of the shared vector's states; only those that the model does not have count.
    """

    motion: Motion
    columns: tuple[int, ...]
    prior: tuple[float, ...]

    @property
    def dimensions(self) -> int:
        """2 or 3."""
        return self.motion.dimensions

    @property
    def n_states(self) -> int:
        """Length of the shared state vector."""
        return len(self.prior)

    def move(self, mean: Float64Array, dt: float) -> Float64Array:
        """States, shape (..., n_states), ``dt`` later [s]; zero where the model has none."""
        moved = np.zeros_like(mean)
        moved[..., list(self.columns)] = self.motion.move(mean[..., list(self.columns)], dt)
        return moved

    def jacobian(self, mean: Float64Array, dt: float) -> Float64Array:
        """Differentiate `move`, shape (n or 1, n_states, n_states)."""
        return self._spread(self.motion.jacobian(mean[:, list(self.columns)], dt), 0.0)

    def noise(self, mean: Float64Array, dt: float) -> Float64Array:
        """Process noise, shape (n or 1, n_states, n_states), with the prior where the model has no state."""
        return self._spread(self.motion.noise(mean[:, list(self.columns)], dt), 1.0)

    def _spread(self, small: Float64Array, share: float) -> Float64Array:
        """Put matrices of the model's states where they belong, and ``share`` of the prior variance elsewhere."""
        full = np.zeros((len(small), self.n_states, self.n_states))
        full[:, range(self.n_states), range(self.n_states)] = share * np.square(self.prior)
        full[np.ix_(range(len(small)), self.columns, self.columns)] = small
        return full


class MultipleModels:
    """Several filters side by side, each with its own motion model on one shared state vector, weighed by how well they predict.

    With `sojourn` it is the Interacting Multiple Model (Blom and Bar-Shalom 1988): a target changes its model at random, as a Markov chain
    in continuous time, and the filters start every step from a mixture of each other. Without, it is the Multiple Model Adaptive Estimator
    (Magill 1965): one of the models is right for ever, and the filters never meet.

    Parameters
    ----------
    models : sequence of GaussianFilter
        The filters; all with the same number of states.
    measurement_model : PositionModel
        What they take of a measurement.
    prior : sequence of float
        Standard deviations, of new tracks, of the states behind position and velocity.
    sojourn : sequence of float or None
        Mean time a target stays in each model [s]; then it takes one of the others, each as likely. None: no change.
    least_weight : float
        No model's probability falls below this, so that it can come back.

    Raises
    ------
    ConfigError
        When the models do not fit each other, or a time is not positive.
    """

    def __init__(
        self,
        models: Sequence[GaussianFilter],
        measurement_model: PositionModel,
        prior: Sequence[float] = (),
        sojourn: Sequence[float] | None = None,
        least_weight: float = 1e-6,
    ) -> None:
        if len(models) == 0 or len({model.motion.n_states for model in models}) != 1:
            raise ConfigError("several models need one shared state vector: embed them in the same number of states")
        self.dimensions = measurement_model.dimensions
        self._filters = tuple(models)
        self._measurement_model = measurement_model
        self._prior = np.asarray(prior, np.float64)
        self._chain = _Chain(sojourn, len(models)) if sojourn is not None and len(models) > 1 else None
        self._least = least_weight

    def start(self, measurement: Measurement, speed_std: float) -> Belief:
        """Believe in new tracks at rest at the measured places, with a velocity known to within ``speed_std`` [m/s], in any model.

        The models' first probabilities are those that the Markov chain has in the long run; without one, all the same.
        """
        mean, covariance = start_at(measurement, self.dimensions, speed_std, self._prior)
        n, k = len(mean), len(self._filters)
        weight = np.full(k, 1.0 / k) if self._chain is None else self._chain.stationary
        return Belief(np.repeat(mean[:, None], k, axis=1), np.repeat(covariance[:, None], k, axis=1), np.tile(weight, (n, 1)))

    def predict(self, belief: Belief, dt: float) -> Belief:
        """Mix the models (IMM) and move all tracks on by ``dt`` [s]; `DataError` where that is negative or not finite."""
        check_step(dt)
        if self._chain is not None:
            belief = mix(belief, self._chain.transition(dt))
        moved = [f.predict(belief.mean[:, j], belief.covariance[:, j], dt) for j, f in enumerate(self._filters)]
        return Belief(np.stack([m for m, _ in moved], axis=1), np.stack([P for _, P in moved], axis=1), belief.weight)

    def update(self, belief: Belief, measurement: Measurement) -> tuple[Belief, Innovation]:
        """Take in one measurement of every track, with the innovation of the mixture of all models. Errors as of `SingleModel.update`."""
        prepared = self._measurement_model.prepare(measurement, belief.mean, belief.covariance)
        found = [f.update(belief.mean[:, j], belief.covariance[:, j], prepared) for j, f in enumerate(self._filters)]
        weight, total = reweigh(belief.weight, np.stack([u.log_likelihood for u in found], axis=1), self._least)
        innovation = Innovation(self._nis(belief.weight, found, prepared), prepared.used.sum(axis=1), total)
        return Belief(np.stack([u.mean for u in found], axis=1), np.stack([u.covariance for u in found], axis=1), weight), innovation

    def kinematics(self, belief: Belief) -> tuple[Float64Array, Float64Array]:
        """Mean and covariance of (position, velocity), shapes (n_tracks, 2 d) and (n_tracks, 2 d, 2 d), over all models."""
        d = 2 * self.dimensions
        mean, covariance = mixture(belief.mean[:, :, :d], belief.covariance[:, :, :d, :d], belief.weight[:, None, :])
        return mean[:, 0], covariance[:, 0]

    def _nis(self, weight: Float64Array, found: Sequence[Updated], prepared: PreparedMeasurement) -> Float64Array:
        """NIS of the mixture of all models' predicted measurements, taken as one Gaussian; angles are unwrapped by the first model's."""
        residual = np.stack([u.residual for u in found], axis=1)
        residual = residual[:, :1] + self._measurement_model.difference(prepared, residual, residual[:, :1])
        mean, spread = mixture(residual, np.stack([u.spread for u in found], axis=1), weight[:, None, :])
        return nis_and_log_det(mean[:, 0], spread[:, 0])[0]


class _Chain:
    """Markov chain in continuous time that leaves every mode after its mean sojourn time, for each other one alike.

    Its generator D S, D = diag(1 / time), S symmetric, has the same eigenvalues as the symmetric sqrt(D) S sqrt(D), so that the transition
    matrix of any step costs one small product, and two steps equal one.
    """

    def __init__(self, sojourn: Sequence[float], n_modes: int) -> None:
        if len(sojourn) != n_modes or not all(math.isfinite(t) and t > 0 for t in sojourn):
            raise ConfigError(f"sojourn is {tuple(sojourn)}; give one positive time for each of the {n_modes} models")
        root = 1.0 / np.sqrt(np.asarray(sojourn, np.float64))
        symmetric = (np.ones((n_modes, n_modes)) - n_modes * np.eye(n_modes)) / (n_modes - 1)
        self._value, vector = canonical_eigh(root[:, None] * symmetric * root)
        self._left, self._right = root[:, None] * vector, vector.T / root
        self.stationary = np.asarray(sojourn, np.float64) / np.sum(sojourn)

    def transition(self, dt: float) -> Float64Array:
        """Probabilities, shape (from, to), after ``dt`` [s]."""
        matrix = np.maximum((self._left * np.exp(np.minimum(self._value, 0.0) * dt)) @ self._right, 0.0)
        return np.asarray(matrix / matrix.sum(axis=1, keepdims=True))


def mix(belief: Belief, transition: Float64Array) -> Belief:
    """Let every mode start from the mixture of all that may lead to it (the interaction of an IMM).

    ``transition``, shape (n_modes, n_modes), are the probabilities (from, to) of changing modes. Gives mixed means and covariances, and the
    modes' predicted probabilities.
    """
    joint = belief.weight[:, :, None] * transition
    weight = joint.sum(axis=1)
    share = np.swapaxes(joint, 1, 2) / weight[:, :, None]
    mean, covariance = mixture(belief.mean, belief.covariance, share)
    return Belief(mean, covariance, weight)


def mixture(mean: Float64Array, covariance: Float64Array, share: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Match mean and covariance of mixtures of Gaussians.

    Parameters
    ----------
    mean, covariance : ndarray of float64, shapes (n_tracks, n_modes, n_states), (n_tracks, n_modes, n_states, n_states)
        The components.
    share : ndarray of float64, shape (n_tracks, k, n_modes)
        Weights of the components in each of k mixtures; rows sum to one.
    """
    # about the first component: far from the origin nothing is lost to rounding
    off = mean - mean[:, :1]
    shift = share @ off
    apart = off[:, None, :, :] - shift[:, :, None, :]
    weighted = share[..., None] * apart
    between = np.swapaxes(weighted, -1, -2) @ apart
    within = (share[..., None, None] * covariance[:, None]).sum(axis=2)
    return mean[:, :1] + shift, symmetrise(within + between)


def reweigh(weight: Float64Array, likelihood: Float64Array, least: float) -> tuple[Float64Array, Float64Array]:
    """Update modes' probabilities by Bayes' rule; gives these and the mixture's log likelihood, shapes (n_tracks, n_modes), (n_tracks,).

    Of positive probabilities and log likelihoods, shape (n_tracks, n_modes); only the differences of the latter matter, however far from
    zero they are. No probability falls below ``least``.
    """
    score = np.log(weight) + likelihood
    best = score.max(axis=1, keepdims=True)
    share = np.exp(score - best)
    total = share.sum(axis=1, keepdims=True)
    raised = np.maximum(share / total, least)
    return raised / raised.sum(axis=1, keepdims=True), (best + np.log(total))[:, 0]
