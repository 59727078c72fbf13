"""A small convolutional network over the steps of curves: the same patterns are looked for at every step.

It has as many weights as a perceptron on the same numbers, and needs fewer people to learn from. PyTorch trains it (extra ``train``,
`radar_lab.training.networks`), numpy runs it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError
from radar_core.arrays import description
from radar_core.types import Float32Array, Float64Array, IndexArray
from radar_gestures.classifiers.perceptron import FORMAT
from radar_gestures.classifiers.rejection import Rejecting
from radar_gestures.curves import TOTALS

CLIP: Final[float] = 6.0
"""Standardised numbers are cut off beyond this: what is so far out says no more than that it is."""
_KIND: Final[str] = "curve network"
_ADVICE: Final[str] = "train it again"


@dataclass(frozen=True, eq=False)
class CurveNet(Rejecting):
    """A trained network: standardise, convolutions over the steps with ReLU, hidden layer with ReLU, softmax.

    Attributes
    ----------
    mean, scale : ndarray of float32, shape (n_features,)
        Standardisation: ``(features - mean) / scale``, cut off at `CLIP`.
    kernels : tuple of ndarray of float32, each of shape (3, n_in, n_out)
        Of the convolutions; taps are one step before, at and one step after. The first goes over every step, each other one over every
        second of the outputs before it; beyond the ends there are zeros.
    offsets : tuple of ndarray of float32, each of shape (n_out,)
        Added by the convolutions.
    weights : tuple of ndarray of float32, each of shape (n_in, n_out)
        Of the dense layers; the first takes all outputs of the last convolution, step by step, then the totals.
    biases : tuple of ndarray of float32, each of shape (n_out,)
        Added by the dense layers.
    names, labels : tuple of str
        What inputs and outputs mean.
    steps : int
        Of the curves.
    reject : float
        An event whose `score` is below this is no known gesture.
    settings, figures : mapping
        How the curves were made (``curves``: the knobs of `CurveConfig`; others as in `GestureModel`), and what training measured.
    memory : ndarray of float16, shape (n, n_inputs of the first dense layer)
        What some samples of the training were to the first dense layer (`inputs`), so that tuning forgets nothing; mostly few, may be none.
    remembered : ndarray of int64, shape (n,)
        Their labels.

    Raises
    ------
    ConfigError
        When shapes do not fit or a number is not finite.
    """

    extractor: ClassVar[str] = "curves"
    mean: Float32Array
    scale: Float32Array
    kernels: tuple[Float32Array, ...]
    offsets: tuple[Float32Array, ...]
    weights: tuple[Float32Array, ...]
    biases: tuple[Float32Array, ...]
    names: tuple[str, ...]
    labels: tuple[str, ...]
    steps: int
    reject: float = 0.0
    settings: Mapping[str, Any] = field(default_factory=dict)
    figures: Mapping[str, Any] = field(default_factory=dict)
    memory: NDArray[np.float16] = field(default_factory=lambda: np.empty((0, 0), np.float16))
    remembered: IndexArray = field(default_factory=lambda: np.empty(0, np.int64))

    def __post_init__(self) -> None:
        n = len(self.names)
        split = n - len(TOTALS)
        if self.steps < 1 or split < 1 or split % self.steps or not self.kernels or not self.weights:
            raise ConfigError(f"{_KIND}: {n} features in {self.steps} steps with {len(self.kernels)} convolutions; {_ADVICE}")
        wanted: list[tuple[str, Float32Array, tuple[int, ...]]] = [("mean", self.mean, (n,)), ("scale", self.scale, (n,))]
        width, length = split // self.steps, self.steps
        for number, (kernel, offset) in enumerate(zip(self.kernels, self.offsets, strict=True)):
            wanted += [(f"kernel_{number}", kernel, (3, width, len(offset))), (f"offset_{number}", offset, (len(offset),))]
            width, length = len(offset), length if number == 0 else -(-length // 2)
        width = width * length + len(TOTALS)
        for number, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            wanted += [(f"weights_{number}", weight, (width, len(bias))), (f"bias_{number}", bias, (len(bias),))]
            width = len(bias)
        if width != len(self.labels):
            raise ConfigError(f"{_KIND}: {width} outputs for {len(self.labels)} labels; {_ADVICE}")
        for name, array, shape in wanted:
            if array.shape != shape or array.dtype != np.float32 or not np.isfinite(array).all():
                raise ConfigError(f"{_KIND}: {name} is {array.dtype} {array.shape}, expected finite float32 {shape}; {_ADVICE}")
        if not (self.scale > 0).all():
            raise ConfigError(f"{_KIND}: scale has entries that are not positive; {_ADVICE}")
        self._check_memory()

    def _check_memory(self) -> None:
        n = len(self.remembered)
        shape = (n, len(self.weights[0])) if n else self.memory.shape
        sound = self.remembered.ndim == 1 and self.memory.shape == shape and len(self.memory) == n and np.isfinite(self.memory).all()
        if (
            not sound
            or self.memory.dtype != np.float16
            or (n and not 0 <= self.remembered.min() <= self.remembered.max() < len(self.labels))
        ):
            raise ConfigError(f"{_KIND}: its memory of {self.memory.shape} does not fit {n} labels; {_ADVICE}")

    def inputs(self, features: NDArray[np.floating]) -> Float32Array:
        """Compute what the dense layers take, shape (n, n_inputs), of features of shape (..., n_features); errors as `probabilities`."""
        x = np.asarray(features)
        if x.shape[-1:] != self.mean.shape:
            raise DataError(f"features has shape {x.shape}, expected (..., {len(self.mean)}): {', '.join(self.names[:3])}, ...")
        if not np.isfinite(x).all():
            raise DataError("features has non-finite values; leave such an event out")
        standard = np.clip((x.reshape(-1, x.shape[-1]) - self.mean) / self.scale, -CLIP, CLIP).astype(np.float32)
        split = len(self.names) - len(TOTALS)
        wave = standard[:, :split].reshape(len(standard), self.steps, split // self.steps)
        for number, (kernel, offset) in enumerate(zip(self.kernels, self.offsets, strict=True)):
            wave = np.maximum(convolve(wave, kernel, 1 if number == 0 else 2) + offset, 0.0)
        return np.concatenate([wave.reshape(len(wave), wave.shape[1] * wave.shape[2]), standard[:, split:]], axis=1)

    def probabilities(self, features: NDArray[np.floating]) -> Float64Array:
        """Probability of every label, see `Classifier`."""
        x, value = np.asarray(features), self.inputs(features)
        for number, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            value = (np.maximum(value, 0.0) if number else value) @ weight + bias
        score = np.exp(value.astype(np.float64) - value.max(axis=1, keepdims=True))
        return np.asarray(score / score.sum(axis=1, keepdims=True)).reshape(*x.shape[:-1], len(self.labels))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Give everything that the model file must keep; see `from_arrays`.

        Kernels and weights take two bytes a number where that loses nothing, as after training; see `half`.
        """
        about = {
            "kind": _KIND,
            "names": list(self.names),
            "labels": list(self.labels),
            "steps": self.steps,
            "layers": [len(self.kernels), len(self.weights)],
            "reject": self.reject,
            "settings": dict(self.settings),
            "figures": dict(self.figures),
        }
        arrays = description(FORMAT, about) | {"mean": self.mean, "scale": self.scale}
        for kind, parts in (("kernel", self.kernels), ("offset", self.offsets), ("weights", self.weights), ("bias", self.biases)):
            arrays |= {f"{kind}_{k}": part.astype(np.float16) if (half(part) == part).all() else part for k, part in enumerate(parts)}
        return arrays | ({"memory": self.memory, "remembered": self.remembered} if len(self.memory) else {})

    @classmethod
    def from_arrays(cls, about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> CurveNet:
        """Make the network of a file again; parameters and errors as in `GestureModel.from_arrays`."""
        try:
            n_convolutions, n_dense = (int(number) for number in about["layers"])
            numbers = {name: array.astype(np.float32) if array.dtype == np.float16 else array for name, array in arrays.items()}
            held = {name: arrays[name] for name in ("memory", "remembered") if "memory" in arrays}
            kernels, offsets = (tuple(numbers[f"{kind}_{k}"] for k in range(n_convolutions)) for kind in ("kernel", "offset"))
            weights, biases = (tuple(numbers[f"{kind}_{k}"] for k in range(n_dense)) for kind in ("weights", "bias"))
            return cls(
                numbers["mean"], numbers["scale"], kernels, offsets, weights, biases,
                names=tuple(map(str, about["names"])), labels=tuple(map(str, about["labels"])), steps=int(about["steps"]),
                reject=float(about["reject"]), settings=dict(about["settings"]), figures=dict(about["figures"]), **held,
            )  # fmt: skip
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError(f"not a {_KIND} ({error}); {_ADVICE}") from None


def convolve(wave: Float32Array, kernel: Float32Array, stride: int) -> Float32Array:
    """Convolve over the steps of waves, shape (n, n_steps, n_in), with zeros beyond the ends, shape (n, ceil(n_steps / stride), n_out).

    Kernels, shape (3, n_in, n_out), have taps one step before, at and after.
    """
    n, steps, width = wave.shape
    padded = np.zeros((n, steps + 2, width), np.float32)
    padded[:, 1:-1] = wave
    # the three taps side by side, so that one matrix product does it all
    taps = np.concatenate([padded[:, k : k + steps : stride] for k in range(3)], axis=2)
    return np.asarray(taps @ kernel.reshape(3 * width, -1))


def half(weights: Float32Array) -> Float32Array:
    """Round to what two bytes can hold (IEEE half precision: eleven significant bits), at most 65504 either way."""
    most = np.float32(np.finfo(np.float16).max)
    return np.clip(weights, -most, most).astype(np.float16).astype(np.float32)
