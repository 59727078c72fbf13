"""Scores of how well a model knows an event: two kinds behind one Protocol, stored in the model file as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError
from radar_core.types import Float32Array, Float64Array

_ADVICE: Final[str] = "train the model again"
RANDOM: Final[str] = "random"
"""The label of an event that is no gesture; a model need not have it."""


class Rejector(Protocol):
    """Scores events; those below the model's ``reject`` are no known gesture.

    Attributes
    ----------
    name : str
        Of the kind, for the model file.
    """

    name: ClassVar[str]

    def score(self, standard: Float64Array, probabilities: Float64Array, random: int | None) -> Float64Array:
        """Score events.

        Parameters
        ----------
        standard : ndarray of float64, shape (..., n_features)
            Standardised features.
        probabilities : ndarray of float64, shape (..., n_labels)
            Of every label.
        random : int or None
            The label that is no gesture; its probability does not count.

        Returns
        -------
        ndarray of float64, shape (...)
            0 to 1; higher is better known.
        """
        ...

    def check(self, n_features: int, n_labels: int) -> None:
        """Raise `ConfigError` when the rejector was made for another model."""
        ...

    def arrays(self) -> dict[str, Float32Array]:
        """Everything that the model file must keep."""
        ...


class Rejecting:
    """What classifiers with a label "random" and a limit for their `score` have in common."""

    labels: tuple[str, ...]
    reject: float

    @property
    def random(self) -> int | None:
        """Index of the label `RANDOM`; None when the model has none."""
        return self.labels.index(RANDOM) if RANDOM in self.labels else None

    def score(self, features: NDArray[np.floating], probabilities: NDArray[np.floating]) -> Float64Array:
        """How much each event looks like a gesture that the model knows, shape (...), 0 to 1: the probability of the most probable one.

        Features have shape (..., n_features), their probabilities shape (..., n_labels).
        """
        return ByProbability().score(np.asarray(features), np.asarray(probabilities, np.float64), self.random)

    def known(self, features: NDArray[np.floating], probabilities: NDArray[np.floating]) -> bool:
        """Whether one event is a gesture that the model knows: its most probable label is not "random", and its score is high enough."""
        return int(np.argmax(probabilities)) != self.random and bool(self.score(features, probabilities) >= self.reject)


@dataclass(frozen=True)
class ByProbability:
    """The probability of the most probable gesture: free of cost, but a perceptron is also sure far from its training data."""

    name: ClassVar[str] = "probability"

    def score(self, standard: Float64Array, probabilities: Float64Array, random: int | None) -> Float64Array:
        """See `Rejector`."""
        return np.asarray(_gestures(probabilities, random).max(axis=-1))

    def check(self, n_features: int, n_labels: int) -> None:
        """See `Rejector`; fits every model."""

    def arrays(self) -> dict[str, Float32Array]:
        """See `Rejector`; there are none."""
        return {}


@dataclass(frozen=True, eq=False)
class ByDistance:
    """The probability of the most probable gesture, times how near the event lies to that gesture's training samples.

    ``score = p exp(-weight d^2)`` with the Mahalanobis distance ``d`` of the standardised features from the mean of the gesture, in the
    gesture's own covariance [1]_, shrunk [2]_ because a class has few samples. The two factors err in different places: the probability
    does not fall far away from all classes, the distance does not know where classes meet.

    Attributes
    ----------
    means : ndarray of float32, shape (n_labels, n_features)
        Of the standardised features.
    factors : ndarray of float32, shape (n_labels, n_features (n_features + 1) / 2), or (1, ...): shared by all labels
        Lower triangle, row by row, of the matrix that whitens: the inverse of the covariance's Cholesky factor.
    weight : ndarray of float32, shape ()
        Of the squared distance against the logarithm of the probability.

    References
    ----------
    .. [1] K. Lee, K. Lee, H. Lee, J. Shin, "A simple unified framework for detecting out-of-distribution samples and adversarial attacks",
       NeurIPS 2018.
    .. [2] O. Ledoit, M. Wolf, "A well-conditioned estimator for large-dimensional covariance matrices", J. Multivariate Analysis 88, 2004.
    """

    means: Float32Array
    factors: Float32Array
    weight: Float32Array
    name: ClassVar[str] = "distance"

    @cached_property
    def _whiten(self) -> Float64Array:
        """Whitening matrices, shape (n_labels or 1, n_features, n_features)."""
        n = self.means.shape[-1]
        full = np.zeros((len(self.factors), n, n))
        full[(slice(None), *np.tril_indices(n))] = self.factors
        return full

    def score(self, standard: Float64Array, probabilities: Float64Array, random: int | None) -> Float64Array:
        """See `Rejector`."""
        gestures = _gestures(probabilities, random)
        best = gestures.argmax(axis=-1)
        whiten = self._whiten
        away = standard - self.means[best]
        if standard.ndim == 1:  # one event: what a run waits for
            white = np.dot(whiten[best if len(whiten) > 1 else 0], away)
            return np.asarray(gestures[best] * np.exp(-float(self.weight) * np.dot(white, white)))
        white = away @ whiten[0].T if len(whiten) == 1 else np.einsum("...ij,...j->...i", whiten[best], away)
        square = np.einsum("...i,...i->...", white, white)
        return np.asarray(gestures.max(axis=-1) * np.exp(-float(self.weight) * square))

    def check(self, n_features: int, n_labels: int) -> None:
        """See `Rejector`."""
        triangle = n_features * (n_features + 1) // 2
        shapes = self.means.shape == (n_labels, n_features) and self.factors.shape in ((n_labels, triangle), (1, triangle))
        if not shapes or self.weight.shape != () or self.weight < 0:
            raise ConfigError(
                f"rejector: means {self.means.shape} and factors {self.factors.shape} do not fit {n_labels} labels of {n_features} "
                f"features with one weight of at least 0; {_ADVICE}"
            )
        if not all(np.isfinite(array).all() for array in (self.means, self.factors, self.weight)):
            raise ConfigError(f"rejector: its arrays have non-finite numbers; {_ADVICE}")

    def arrays(self) -> dict[str, Float32Array]:
        """See `Rejector`."""
        return {"means": self.means, "factors": self.factors, "weight": self.weight}


def make_rejector(name: object, arrays: Mapping[str, Float32Array]) -> Rejector:
    """Make the rejector of a model file again.

    Raises
    ------
    ConfigError
        When there is no rejector of that name, or it needs other arrays.
    """
    if name == ByProbability.name and not arrays:
        return ByProbability()
    if name == ByDistance.name and arrays.keys() == {"means", "factors", "weight"}:
        return ByDistance(**arrays)
    raise ConfigError(f"rejector {name!r} with {', '.join(sorted(arrays)) or 'no arrays'} is not known to this version; {_ADVICE}")


def _gestures(probabilities: Float64Array, random: int | None) -> Float64Array:
    """Probabilities in which "random" cannot be the largest."""
    if random is None or probabilities.shape[-1] == 1:
        return probabilities
    gestures = probabilities.copy()
    gestures[..., random] = 0.0
    return gestures
