"""The classifier: a multi-layer perceptron (thesis, section 4.2) with rejection of unknown events, in numpy and one compiled loop."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

import numba
import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, ConfigError, DataError
from radar_core.arrays import as_float32, description
from radar_core.types import Float32Array, Float64Array, IndexArray
from radar_gestures.classifiers.rejection import ByProbability, Rejecting, Rejector, make_rejector
from radar_gestures.features import FEATURE_NAMES

ADVICE: Final[str] = "make a new one with `handwave train`, or name the model that comes with Handwave (gestures)"
FORMAT: Final[int] = 2
"""Version of the files of all models; a reader refuses every other. 1 had one hidden layer, always, and no calibration."""
_LIMIT: Final[float] = 1e12  # features beyond this are no measurements, and could overflow
_MOST: Final[int] = 4096  # neurons, labels or features
_MOST_LAYERS: Final[int] = 16
_ABOUT: Final[Mapping[str, type]] = {"labels": list, "features": list, "n_layers": int, "settings": dict, "figures": dict}


@dataclass(frozen=True, eq=False)
class GestureModel(Rejecting):
    """A trained perceptron: standardise, hidden layers with ReLU, output layer with softmax at a temperature, and a limit for rejection.

    Arrays of any real type are taken and kept as float32, which is what the file holds; sums are made in double precision.

    Attributes
    ----------
    mean, scale : ndarray of float32, shape (n_features,)
        Standardisation: ``(features - mean) / scale``.
    weights : tuple of ndarray of float32, each of shape (n_in, n_out)
        Of every layer, the output layer last; the first has ``n_in = n_features``, the last ``n_out = n_labels``.
    biases : tuple of ndarray of float32, each of shape (n_out,)
        Of every layer.
    labels : tuple of str
        What the outputs mean.
    names : tuple of str
        What the inputs mean.
    temperature : float
        Scores are divided by it before the softmax: calibration, see `radar_lab.training.calibration`.
    reject : float
        An event whose score by ``rejector`` is below this is no known gesture.
    rejector : Rejector
        Says how much an event looks like what the model was trained on.
    settings : mapping
        How the features were made (knobs of `FeatureConfig` and `EventConfig`): a recogniser set otherwise refuses the model.
    figures : mapping
        What training measured: number of samples, accuracy, seed.

    Raises
    ------
    ConfigError
        When shapes do not fit, a number is not finite or labels occur twice.
    """

    extractor: ClassVar[str] = "events"
    mean: Float32Array
    scale: Float32Array
    weights: tuple[Float32Array, ...]
    biases: tuple[Float32Array, ...]
    labels: tuple[str, ...] = GESTURES
    names: tuple[str, ...] = FEATURE_NAMES
    temperature: float = 1.0
    reject: float = 0.0
    rejector: Rejector = field(default_factory=ByProbability)
    settings: Mapping[str, Any] = field(default_factory=dict)
    figures: Mapping[str, Any] = field(default_factory=dict)
    _layers: tuple[tuple[Float64Array, Float64Array], ...] = field(init=False, repr=False)
    _packed: Float64Array = field(init=False, repr=False)
    _sizes: IndexArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        _check_words("labels", self.labels)
        _check_words("features", self.names)
        _check_number("temperature", self.temperature, above=0.0)
        _check_number("reject", self.reject)
        n = len(self.names)
        for name in ("mean", "scale"):
            object.__setattr__(self, name, _checked(name, getattr(self, name), (n,)))
        if not (self.scale > 0).all():
            raise ConfigError(f"gesture model: scale has entries that are not positive; {ADVICE}")
        weights, biases = _checked_layers(self.weights, self.biases, n, len(self.labels))
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "biases", biases)
        self.rejector.check(n, len(self.labels))
        self._fold()

    def _fold(self) -> None:
        """Put the standardisation into the first layer and the temperature into the last: both are linear."""
        layers = [(w.astype(np.float64), b.astype(np.float64)) for w, b in zip(self.weights, self.biases, strict=True)]
        first, bias = layers[0]
        first = first / self.scale.astype(np.float64)[:, None]
        layers[0] = (first, bias - self.mean.astype(np.float64) @ first)
        layers[-1] = (layers[-1][0] / self.temperature, layers[-1][1] / self.temperature)
        object.__setattr__(self, "_layers", tuple(layers))
        object.__setattr__(self, "_packed", np.concatenate([part for w, b in layers for part in (w.ravel(), b)]))
        object.__setattr__(self, "_sizes", np.array([len(self.names), *(len(b) for b in self.biases)], np.int64))

    def probabilities(self, features: NDArray[np.floating]) -> Float64Array:
        """Probability of every label, see `Classifier`; features beyond 1e12 count as not finite."""
        x = np.asarray(features, np.float64)
        if x.shape == self.mean.shape:
            found = np.empty(len(self.labels))
            if _forward(x, self._packed, self._sizes, found):
                return found
            raise _not_finite()
        return self.probabilities_numpy(x)

    def probabilities_numpy(self, features: NDArray[np.floating]) -> Float64Array:
        """`probabilities` as matrix products: what many samples take at once, and the reference of the compiled loop for one."""
        x = np.asarray(features, np.float64)
        if x.shape[-1:] != self.mean.shape:
            raise DataError(f"features has shape {x.shape}, expected (..., {len(self.mean)}): {', '.join(self.names[:3])}, ...")
        if not (np.abs(x) <= _LIMIT).all():
            raise _not_finite()
        for number, (weights, bias) in enumerate(self._layers):
            x = np.dot(x if number == 0 else np.maximum(x, 0.0), weights) + bias
        x = np.exp(x - x.max(axis=-1, keepdims=True))
        return np.asarray(x / x.sum(axis=-1, keepdims=True))

    def inputs(self, features: NDArray[np.floating]) -> Float64Array:
        """Compute what the layers take, shape (n, n_features): standardised features of shape (..., n_features)."""
        x = np.asarray(features, np.float64).reshape(-1, len(self.mean))
        return np.asarray((x - self.mean) / self.scale)

    def score(self, features: NDArray[np.floating], probabilities: NDArray[np.floating]) -> Float64Array:
        """See `Rejecting`; by the model's rejector, to compare with ``reject``."""
        x, p = np.asarray(features, np.float64), np.asarray(probabilities, np.float64)
        return np.asarray(self.rejector.score((x - self.mean) / self.scale, p, self.random))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Give everything that the model file must keep; see `from_arrays`."""
        about = {
            "labels": list(self.labels),
            "features": list(self.names),
            "n_layers": len(self.weights),
            "temperature": self.temperature,
            "reject": self.reject,
            "rejector": self.rejector.name,
            "settings": dict(self.settings),
            "figures": dict(self.figures),
        }
        arrays = description(FORMAT, about) | {"mean": self.mean, "scale": self.scale}
        for number, (weights, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays |= {f"weights_{number}": weights, f"bias_{number}": bias}
        return arrays | {f"rejector_{name}": array for name, array in self.rejector.arrays().items()}

    @classmethod
    def from_arrays(cls, about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> GestureModel:
        """Make the model of a file again, from its description and arrays; `ConfigError` when something is missing or makes no sense."""
        try:
            wrong = [name for name, kind in _ABOUT.items() if type(about[name]) is not kind]
            numbers = {name: array for name, array in arrays.items() if name not in ("format", "about")}
            wrong += [name for name, array in numbers.items() if array.dtype != np.float32]
            if wrong or not 0 < about["n_layers"] <= _MOST_LAYERS:
                raise ConfigError(f"gesture model: {', '.join(wrong) or 'n_layers'} is not what it should be; {ADVICE}")
            own = {name.removeprefix("rejector_"): array for name, array in numbers.items() if name.startswith("rejector_")}
            weights, biases = (tuple(numbers[f"{kind}_{k}"] for k in range(about["n_layers"])) for kind in ("weights", "bias"))
            return cls(
                numbers["mean"], numbers["scale"], weights, biases,
                labels=tuple(about["labels"]), names=tuple(about["features"]), temperature=about["temperature"], reject=about["reject"],
                rejector=make_rejector(about["rejector"], own), settings=about["settings"], figures=about["figures"],
            )  # fmt: skip
        except KeyError as error:
            raise ConfigError(f"not a gesture model: it has no {error}; {ADVICE}") from None


@numba.njit(cache=True, nogil=True)
def _forward(x: Any, packed: Any, sizes: Any, found: Any) -> Any:
    """Write the probabilities of one sample, shape (n_labels,), into ``found``; False when the sample holds what is no number."""
    for value in x:
        if not abs(value) <= _LIMIT:
            return False
    place = 0
    for layer in range(len(sizes) - 1):
        n, m = sizes[layer], sizes[layer + 1]
        after = packed[place + n * m : place + n * m + m].copy()
        for i in range(n):
            value = x[i] if layer == 0 else max(x[i], 0.0)
            row = packed[place + i * m : place + i * m + m]
            for j in range(m):
                after[j] += value * row[j]
        place += n * m + m
        x = after
    top = x[0]
    for value in x:
        top = max(top, value)
    total = 0.0
    for j in range(len(x)):
        found[j] = math.exp(x[j] - top)
        total += found[j]
    for j in range(len(x)):
        found[j] /= total
    return True


def _not_finite() -> DataError:
    return DataError(f"features has non-finite values, or some beyond {_LIMIT:g}; leave such an event out")


def _check_words(what: str, words: tuple[str, ...]) -> None:
    sound = isinstance(words, tuple) and all(isinstance(word, str) and word for word in words)
    if not sound or not 0 < len(words) <= _MOST or len(set(words)) != len(words):
        raise ConfigError(f"gesture model: its {what} must be different names, at least one; {ADVICE}")


def _check_number(what: str, value: Any, above: float = -math.inf) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value) or value <= above:
        limit = f" above {above:g}" if above > -math.inf else ""
        raise ConfigError(f"gesture model: {what} is {value!r}, expected a finite number{limit}; {ADVICE}")


def _checked(name: str, array: Any, shape: tuple[int, ...]) -> Float32Array:
    return as_float32(f"gesture model: {name}", array, shape, ADVICE)


def _checked_layers(weights: Any, biases: Any, n_features: int, n_labels: int) -> tuple[tuple[Float32Array, ...], tuple[Float32Array, ...]]:
    """Return weights and biases of the layers as float32, each as wide as the one before asks for."""
    if not 0 < len(weights) == len(biases) <= _MOST_LAYERS:
        raise ConfigError(f"gesture model: {len(weights)} layers of weights and {len(biases)} of biases, expected as many; {ADVICE}")
    done, n_in = [], n_features
    for number, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        last = number == len(weights) - 1
        n_out = n_labels if last else max(np.asarray(bias).size, 1)
        done.append((_checked(f"weights[{number}]", weight, (n_in, n_out)), _checked(f"biases[{number}]", bias, (n_out,))))
        n_in = n_out
    return tuple(weight for weight, _ in done), tuple(bias for _, bias in done)
