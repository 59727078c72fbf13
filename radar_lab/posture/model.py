"""The learned part of postures: a perceptron that gives one hand's place, run with numpy, kept in a file of plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError
from radar_core.arrays import as_float32, description, load_arrays, read_description, save_arrays
from radar_core.config import load, plain
from radar_core.types import Float32Array, Float64Array
from radar_lab.posture.features import PostureFeatureConfig

FORMAT: Final[int] = 1
"""Version of the model file; a reader refuses every other."""

_ADVICE: Final = "make a new one with radar_lab.posture.training.train_postures"
_LIMIT: Final = 1e9  # features beyond this are no measurements
_MOST_BYTES: Final = 16_000_000  # of the whole content: a hundred times what a model of ours takes
_MOST_LAYERS: Final = 16


@dataclass(frozen=True, eq=False)
class PostureModel:
    """A trained perceptron: layers with ReLU between them, the last one linear.

    It gives the left hand. The right one is the mirror image of what it gives for the mirrored person, so that both are learned from both.
    Arrays of any real type are taken and kept as float32, which is what the file holds; sums are made in double precision.

    Raises
    ------
    ConfigError
        When shapes do not fit or a number is not finite.
    """

    features: PostureFeatureConfig  # what the inputs are
    # Of every layer; the first has ``n_in = features.n_features``, the last ``n_out = 3``: (away, left, up) in the person's own axes, each
    # of shape (n_in, n_out) [m]
    weights: tuple[Float32Array, ...]
    biases: tuple[Float32Array, ...]  # of every layer, each of shape (n_out,)
    std: Float32Array  # error of the outputs, root mean square over parts of the training set that were left out, shape (3,) [m]
    spread: Float32Array  # standard deviation of the hands themselves in the training set, shape (3,) [m]
    # Lowest and highest place of a hand in the training set [m]. Beyond it nothing is known, and the answer stays within; shape (2, 3)
    bounds: Float32Array
    figures: Mapping[str, Any] = field(default_factory=dict)  # what training measured
    _layers: tuple[tuple[Float64Array, Float64Array], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not 0 < len(self.weights) == len(self.biases) <= _MOST_LAYERS:
            raise ConfigError(f"posture model: {len(self.weights)} layers of weights, {len(self.biases)} of biases; {_ADVICE}")
        n_in, weights, biases = self.features.n_features, [], []
        for number, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            n_out = 3 if number == len(self.weights) - 1 else max(np.size(bias), 1)
            weights.append(as_float32(f"posture model: weights_{number}", weight, (n_in, n_out), _ADVICE))
            biases.append(as_float32(f"posture model: bias_{number}", bias, (n_out,), _ADVICE))
            n_in = n_out
        object.__setattr__(self, "weights", tuple(weights))
        object.__setattr__(self, "biases", tuple(biases))
        for name in ("std", "spread"):
            object.__setattr__(self, name, as_float32(f"posture model: {name}", getattr(self, name), (3,), _ADVICE))
            if not (getattr(self, name) > 0).all():
                raise ConfigError(f"posture model: {name} has entries that are not positive; {_ADVICE}")
        object.__setattr__(self, "bounds", as_float32("posture model: bounds", self.bounds, (2, 3), _ADVICE))
        if not (self.bounds[0] <= self.bounds[1]).all():
            raise ConfigError(f"posture model: the lower bounds are not below the upper ones; {_ADVICE}")
        doubles = tuple((w.astype(np.float64), b.astype(np.float64)) for w, b in zip(weights, biases, strict=True))
        object.__setattr__(self, "_layers", doubles)

    @property
    def n_parameters(self) -> int:
        """Number of weights and biases."""
        return sum(array.size for array in (*self.weights, *self.biases))

    def predict(self, features: NDArray[np.floating]) -> Float64Array:
        """Place of the left hand in the person's own axes: (away, left, up) from the body and the floor, shape (..., 3) [m].

        ``features``, shape (..., n_features), are as `PostureFeatures` makes them; mirrored ones (`mirror`) give the right hand, mirrored.
        Raises `DataError` when one is not finite or absurdly large (beyond 1e9), or their number is wrong.
        """
        x = np.asarray(features, np.float64)
        if x.shape[-1:] != (self.features.n_features,):
            raise DataError(f"features has shape {x.shape}, expected (..., {self.features.n_features})")
        if not (np.abs(x) <= _LIMIT).all():
            raise DataError(f"features has non-finite values, or some beyond {_LIMIT:g}; leave such a cloud out")
        for number, (weight, bias) in enumerate(self._layers):
            x = (x if number == 0 else np.maximum(x, 0.0)) @ weight + bias
        return np.clip(x, *self.bounds.astype(np.float64))


def save_postures(model: PostureModel, path: str | Path) -> None:
    """Write ``model`` to ``path`` (.npz); its folder is made, and a killed run leaves no half file.

    Raises `DataError` when the file cannot be written, or is larger than what a reader takes.
    """
    path = Path(path)
    if 4 * model.n_parameters > _MOST_BYTES // 2:
        raise DataError(f"{path}: the model has {model.n_parameters} parameters, more than any reader takes; train one with fewer neurons")
    about = {"features": plain(model.features), "n_layers": len(model.weights), "figures": dict(model.figures)}
    arrays = description(FORMAT, about) | {"std": model.std, "spread": model.spread, "bounds": model.bounds}
    for number, (weight, bias) in enumerate(zip(model.weights, model.biases, strict=True)):
        arrays |= {f"weights_{number}": weight, f"bias_{number}": bias}
    save_arrays(path, arrays, "model")


def load_postures(path: str | Path) -> PostureModel:
    """Read a model. Nothing in the file is ever executed, and sizes are checked before anything is unpacked.

    Raises `ConfigError` when there is no such file, it is no model, or it is of another version; the message says what to do.
    """
    arrays = load_arrays(Path(path), "posture model", _ADVICE, _MOST_BYTES)
    try:
        return _model_of(read_description(arrays, FORMAT, _ADVICE), arrays)
    except KeyError as error:
        raise ConfigError(f"{path}: not a posture model, it lacks {error}; {_ADVICE}") from None
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def _model_of(about: Mapping[str, Any], found: Mapping[str, NDArray[Any]]) -> PostureModel:
    if not isinstance(about["figures"], dict) or type(about["n_layers"]) is not int:
        raise ConfigError(f"its description makes no sense; {_ADVICE}")
    layers = range(min(about["n_layers"], _MOST_LAYERS))
    return PostureModel(
        load(PostureFeatureConfig, about["features"], "features of the model"),
        tuple(found[f"weights_{number}"] for number in layers),
        tuple(found[f"bias_{number}"] for number in layers),
        found["std"],
        found["spread"],
        found["bounds"],
        about["figures"],
    )
