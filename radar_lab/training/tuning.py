"""Short tuning of a model's dense layers: to a person, from three to five samples of each gesture, or to gestures of one's own.

A few hundred steps of Adam [1]_ over the new samples and, so that nothing is forgotten, over replayed ones: those that the model
remembers (`CurveNet.memory`), or ones drawn from what a perceptron's rejector knows of each label. Convolutions stay as they are. Where
there are changed copies of the new samples (other cuts, missed detections), steps take the samples and these in turn.

References
----------
.. [1] D. P. Kingma, J. Ba, "Adam: a method for stochastic optimization", ICLR 2015.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError
from radar_core.config import config, knob
from radar_core.types import Float64Array, IndexArray
from radar_gestures.classifiers.curve_net import CurveNet
from radar_gestures.classifiers.enrolled import Base, with_layers
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.classifiers.rejection import ByDistance

_STREAM: Final = 0x7E1  # keeps these draws apart from others with the same seed
_BETA: Final = (0.9, 0.999)
_SMALL: Final = 1e-8


@config
class TuningConfig:
    """How a model is tuned. The defaults are for networks.

    Weight and copies were chosen on people 806, 810, 814 and 822 of mHomeGes, the others on people 9 to 19 of mTransSee.
    """

    steps: int = knob(100, low=1, high=100_000, doc="of Adam, each over all samples")
    learning_rate: float = knob(1e-3, low=1e-8, high=1.0, doc="of Adam")
    weight: float = knob(100.0, low=0.0, high=1e6, doc="of a new sample against a replayed one")
    copies: int = knob(16, low=0, high=1000, doc="changed ones of each new sample, where it has feature maps")
    dropout: float = knob(0.25, low=0.0, high=0.95, doc="share of the inputs that a step does not see")
    smoothing: float = knob(0.05, low=0.0, high=0.9, doc="share of each label that is spread over all")
    replayed: int = knob(40, low=0, high=10_000, doc="samples of each known label that are replayed, at most")
    seed: int = knob(1, low=0, high=2**31 - 1, doc="of dropout and of what is replayed")


PERCEPTRON: Final = TuningConfig(steps=500, learning_rate=5e-3, dropout=0.0, weight=5.0, replayed=100, copies=0)
"""For thirteen features: chosen by leaving out each of four circles and four claps of one simulated person."""


def usual_tuning(model: Base, seed: int = 1) -> TuningConfig:
    """Return how a model of that kind is tuned."""
    return dataclasses.replace(TuningConfig() if isinstance(model, CurveNet) else PERCEPTRON, seed=seed)


def tune(
    model: Base,
    features: NDArray[np.floating],
    gestures: Sequence[str],
    config: TuningConfig | None = None,
    changed: NDArray[np.floating] | None = None,
) -> Base:
    """Tune a model to new samples; the same samples and seed give the same numbers on one machine.

    Parameters
    ----------
    model : GestureModel or CurveNet
        It stays as it is.
    features : ndarray, shape (n, n_features)
        Of the samples, as the model takes them.
    gestures : sequence of str, length n
        What each sample is. Gestures that the model does not know become new labels, in the order in which they come.
    config : TuningConfig or None
        None: what is usual for its kind, see `usual_tuning`.
    changed : ndarray, shape (n_copies, n, n_features), or None
        Changed copies of the samples, see `radar_lab.training.variation.copies`; None: there are none.

    Returns
    -------
    GestureModel or CurveNet
        Of the same kind. Its limit for rejection stays; where it rejects by distance, that knows the new labels.

    Raises
    ------
    DataError
        When there are no samples, or not as many as names, or the copies are not of these.
    ConfigError
        When a new gesture is to be learnt from a single sample, or the model has nothing to replay, so that it would forget the others.
    """
    config = config if config is not None else usual_tuning(model)
    if len(features) == 0 or len(features) != len(gestures):
        raise DataError(f"{len(features)} samples and {len(gestures)} names; tuning needs at least one sample, and a name for each")
    if changed is not None and changed.shape[1:] != features.shape:
        raise DataError(f"copies of shape {changed.shape} are not of samples of shape {features.shape}")
    labels = (*model.labels, *dict.fromkeys(name for name in gestures if name not in model.labels))
    few = [name for name in labels[len(model.labels) :] if list(gestures).count(name) < 2]
    if few:
        raise ConfigError(f"{', '.join(few)}: one sample of a new gesture is too few; record more")
    rng = np.random.default_rng([config.seed, _STREAM])
    replay, known = replayed(model, config.replayed, rng)
    own = np.array([labels.index(name) for name in gestures], np.int64)
    if not len(known) and set(own.tolist()) != set(range(len(labels))):
        raise ConfigError("the model remembers no samples, so tuning would make it forget other gestures; train it again with this version")
    versions = [np.asarray(model.inputs(rows), np.float64) for rows in (features, *(() if changed is None else changed))]
    turns = [np.concatenate([inputs, replay]) if len(known) else inputs for inputs in versions]
    label = np.concatenate([own, known])
    weight = np.concatenate([np.full(len(own), config.weight), np.ones(len(known))])
    layers = _extended(model, len(labels))
    _descend(layers, turns, label, weight / weight.sum(), config, rng)
    weights, biases = tuple(w for w, _ in layers), tuple(b for _, b in layers)
    changes: dict[str, Any] = {"labels": labels, "figures": {}}
    if len(labels) > len(model.labels) and isinstance(model, GestureModel) and isinstance(model.rejector, ByDistance):
        changes["rejector"] = _with_labels(model.rejector, turns[0], label, len(model.labels), len(labels))
    return with_layers(model, weights, biases, **changes)


def replayed(model: Base, most: int, rng: np.random.Generator) -> tuple[Float64Array, IndexArray]:
    """Give what some samples of each label were to the dense layers, shape (n, n_inputs), and their labels; none where nothing is known."""
    if isinstance(model, CurveNet):
        keep = [np.flatnonzero(model.remembered == number)[:most] for number in range(len(model.labels))]
        rows = np.concatenate(keep) if keep else np.empty(0, np.int64)
        return model.memory[rows].astype(np.float64), model.remembered[rows]
    if not isinstance(model.rejector, ByDistance):
        return np.empty((0, len(model.names))), np.empty(0, np.int64)
    means, whiten = model.rejector.means.astype(np.float64), model.rejector._whiten
    spread = [np.linalg.inv(matrix) for matrix in whiten]
    parts = [mean + rng.standard_normal((most, len(mean))) @ spread[min(k, len(spread) - 1)].T for k, mean in enumerate(means)]
    return np.concatenate(parts), np.repeat(np.arange(len(means)), most)


def _extended(model: Base, n_labels: int) -> list[tuple[Float64Array, Float64Array]]:
    """Copy the dense layers; outputs of new labels begin at 0, as improbable as the others on average."""
    layers = [(w.astype(np.float64), b.astype(np.float64)) for w, b in zip(model.weights, model.biases, strict=True)]
    weight, bias = layers[-1]
    more = n_labels - len(bias)
    if more:
        layers[-1] = np.concatenate([weight, np.zeros((len(weight), more))], axis=1), np.concatenate([bias, np.full(more, bias.mean())])
    return layers


def _descend(
    layers: list[tuple[Float64Array, Float64Array]],
    turns: Sequence[Float64Array],
    label: IndexArray,
    weight: Float64Array,
    config: TuningConfig,
    rng: np.random.Generator,
) -> None:
    """Minimise the weighted cross-entropy over the layers, in place; steps take the versions ``turns`` of the inputs in turn."""
    n_labels = layers[-1][1].size
    target = np.full((len(label), n_labels), config.smoothing / n_labels)
    target[np.arange(len(label)), label] += 1.0 - config.smoothing
    flat = [part for layer in layers for part in layer]
    moments = [(np.zeros_like(part), np.zeros_like(part)) for part in flat]
    for step in range(1, config.steps + 1):
        x = turns[step % len(turns)]
        seen = x * (rng.random(x.shape) >= config.dropout) / (1.0 - config.dropout)
        for part, gradient, (first, second) in zip(flat, _gradients(layers, seen, target, weight), moments, strict=True):
            first += (1 - _BETA[0]) * (gradient - first)
            second += (1 - _BETA[1]) * (gradient**2 - second)
            rate = config.learning_rate * np.sqrt(1 - _BETA[1] ** step) / (1 - _BETA[0] ** step)
            part -= rate * first / (np.sqrt(second) + _SMALL)


def _gradients(
    layers: Sequence[tuple[Float64Array, Float64Array]], x: Float64Array, target: Float64Array, weight: Float64Array
) -> list[Float64Array]:
    """Gradients of the weighted cross-entropy, of the weights and the biases of each layer in turn."""
    values = [x]
    for number, (kernel, bias) in enumerate(layers):
        values.append((np.maximum(values[-1], 0.0) if number else values[-1]) @ kernel + bias)
    score = np.exp(values[-1] - values[-1].max(axis=1, keepdims=True))
    away = weight[:, None] * (score / score.sum(axis=1, keepdims=True) - target)
    found: list[Float64Array] = []
    for number in reversed(range(len(layers))):
        before = np.maximum(values[number], 0.0) if number else values[number]
        found = [before.T @ away, away.sum(axis=0), *found]
        if number:
            away = (away @ layers[number][0].T) * (values[number] > 0)
    return found


def _with_labels(rejector: ByDistance, x: Float64Array, label: IndexArray, n_known: int, n_labels: int) -> ByDistance:
    """Let a rejector know new labels too: their own means, and the spread of all samples about the mean of their label."""
    from radar_lab.training.calibration import fit_distance

    new = label >= n_known
    made = fit_distance(x[new], label[new] - n_known, n_labels - n_known, weight=float(rejector.weight), shared=True)
    factors = rejector.factors
    if len(factors) > 1:
        factors = np.concatenate([factors, np.repeat(made.factors, n_labels - n_known, axis=0)])
    return dataclasses.replace(rejector, means=np.concatenate([rejector.means, made.means]), factors=factors)
