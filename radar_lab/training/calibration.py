"""Probabilities that mean what they say, and a limit below which an event is no known gesture; both from people the model has not seen."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_core.checks import require_finite
from radar_core.types import Float64Array, IndexArray
from radar_gestures.classifiers.rejection import ByDistance

_TINY: Final[float] = 1e-12  # a probability of 0 would make any temperature infinitely unlikely
_TEMPERATURES: Final[tuple[float, float]] = (0.05, 20.0)


def soften(probabilities: NDArray[np.floating], temperature: float) -> Float64Array:
    """Probabilities, shape (..., n_labels), at another temperature: ``p^(1/T)``, normalised: scores before the softmax, divided by ``T``.

    Above 1 the model becomes less sure, below 1 surer; which label is most probable never changes.
    """
    score = np.log(np.maximum(probabilities, _TINY)) / temperature
    score -= score.max(axis=-1, keepdims=True)
    power = np.exp(score)
    return np.asarray(power / power.sum(axis=-1, keepdims=True))


def log_loss(probabilities: NDArray[np.floating], label: IndexArray) -> float:
    """Mean of ``-log p`` of the true labels, shape (n,), of samples with probabilities, shape (n, n_labels) [nat]."""
    return float(-np.log(np.maximum(probabilities[np.arange(len(label)), label], _TINY)).mean())


def fit_temperature(probabilities: NDArray[np.floating], label: IndexArray) -> float:
    """Find the temperature under which the true labels are most likely (temperature scaling [1]_).

    It lies between 0.05 and 20. Raises `DataError` when there are no samples, or a probability is not finite.

    Parameters
    ----------
    probabilities : ndarray, shape (n, n_labels)
        At temperature 1, of samples that were not in the training.
    label : ndarray of int, shape (n,)
        The true ones.

    References
    ----------
    .. [1] C. Guo, G. Pleiss, Y. Sun, K. Q. Weinberger, "On calibration of modern neural networks", ICML 2017.
    """
    from scipy.optimize import minimize_scalar

    if len(label) == 0:
        raise DataError("calibration needs at least one sample that was not in the training")
    require_finite("probabilities", probabilities)
    low, high = (math.log(value) for value in _TEMPERATURES)
    found = minimize_scalar(lambda t: log_loss(soften(probabilities, math.exp(t)), label), bounds=(low, high), method="bounded")
    return math.exp(found.x)


def calibration_error(probabilities: NDArray[np.floating], label: IndexArray, bins: int = 15) -> float:
    """Average how far stated confidence and share of right answers lie apart: the expected calibration error (Guo et al., 2017).

    It is 0 to 1, 0 for no samples, over ``bins`` intervals of equal width.
    """
    confidence, right, share = reliability(probabilities, label, bins)
    return float(np.sum(share * np.abs(confidence - right)))


def reliability(probabilities: NDArray[np.floating], label: IndexArray, bins: int = 15) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Compare stated confidence with truth, interval by interval of confidence.

    Gives, for each interval that holds samples, mean confidence, share of right answers, and share of all samples, shape (n_used,) each.
    """
    best = probabilities.max(axis=-1)
    right = probabilities.argmax(axis=-1) == label
    number = np.minimum((best * bins).astype(np.int64), bins - 1)
    count = np.bincount(number, minlength=bins)
    used = count > 0
    confidence = np.bincount(number, weights=best, minlength=bins)[used] / count[used]
    hits = np.bincount(number, weights=right, minlength=bins)[used] / count[used]
    return confidence, hits, count[used] / max(len(label), 1)


def choose_reject(score: NDArray[np.floating], lost: float = 0.05) -> float:
    """Find the highest limit that rejects at most a share of ``lost`` of known gestures.

    An event is rejected when its score is lower; 0: nothing may be rejected. ``score``, shape (n,), is that of known gestures that were not
    in the training (`GestureModel.score`), 0 for those that were called random, which are lost already.
    """
    if len(score) == 0:
        return 0.0
    return float(np.sort(score)[min(math.floor(lost * len(score) + 1e-9), len(score) - 1)])


def fit_distance(standard: Float64Array, label: IndexArray, n_labels: int, *, weight: float = 0.05, shared: bool = False) -> ByDistance:
    """Estimate the means and covariances of a rejector from training samples.

    Parameters
    ----------
    standard : ndarray of float64, shape (n, n_features)
        Standardised features.
    label : ndarray of int64, shape (n,)
        What each is; each of the ``n_labels`` must occur.
    weight, shared : float, bool
        See `ByDistance`; one covariance for all labels: for features so many that one for each would make the file large.
    """
    from sklearn.covariance import LedoitWolf  # only training needs scikit-learn

    own = [standard[label == number] for number in range(n_labels)]
    means = np.array([rows.mean(axis=0) for rows in own])
    away = [rows - mean for rows, mean in zip(own, means, strict=True)]
    groups = [np.concatenate(away)] if shared else away
    factors = []
    for rows in groups:
        covariance = LedoitWolf(assume_centered=True).fit(rows).covariance_
        # A feature that never varies within a class would make every other value of it infinitely far.
        covariance += 1e-3 * np.eye(len(covariance))
        lower = np.linalg.inv(np.linalg.cholesky(covariance))
        factors.append(lower[np.tril_indices(len(lower))])
    return ByDistance(means.astype(np.float32), np.array(factors, np.float32), np.array(weight, np.float32))
