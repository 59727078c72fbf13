"""A small convolutional network over the steps of an event: the same patterns are looked for at every step.

At each step it takes signals (`radar_gestures.curves`), or what it makes of the cells near the step (`radar_gestures.cells`): two layers
look at every cell alone, and the largest and the mean of each of their outputs are kept [1]_. PyTorch trains it (extra ``train``,
`radar_lab.training.networks`), numpy runs it.

References
----------
.. [1] C. R. Qi, H. Su, K. Mo, L. J. Guibas, "PointNet: deep learning on point sets for 3D classification and segmentation", CVPR 2017.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError
from radar_core.arrays import description
from radar_core.types import Float32Array, Float64Array, IndexArray
from radar_gestures.cells import ATTRIBUTES
from radar_gestures.classifiers.perceptron import FORMAT
from radar_gestures.classifiers.rejection import Rejecting
from radar_gestures.curves import TOTALS

CLIP: Final[float] = 6.0
"""Standardised numbers are cut off beyond this: what is so far out says no more than that it is."""
_KIND: Final[str] = "curve network"
_ADVICE: Final[str] = "train it again"


@dataclass(frozen=True, eq=False)
class CurveNet(Rejecting):
    """A trained network: standardise, look at cells where there are some, convolutions over the steps, hidden layer, softmax; with ReLU.

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
        Of the curves, or those to which cells are sorted.
    reject : float
        An event whose `score` is below this is no known gesture.
    settings, figures : mapping
        How the inputs were made (``curves`` or ``cells``: the knobs of `CurveConfig` or `CellConfig`; others as in `GestureModel`), and
        what training measured.
    memory : ndarray of float16, shape (n, n_inputs of the first dense layer)
        What some samples of the training were to the first dense layer (`inputs`), so that tuning forgets nothing; mostly few, may be none.
    remembered : ndarray of int64, shape (n,)
        Their labels.
    cell_weights, cell_biases : tuple of ndarray of float32, of shape (n_in, n_out) and (n_out,) each
        Of the two layers that look at every cell: at its attributes but ``there`` and ``when``, and at how far it is from its step, in
        steps. Empty: the network takes signals.
    pool_factor, pool_offset : ndarray of float32, shape (2 n_out + 1,)
        By which the largest outputs over the cells of a step, their means (of one more cell, which gives 0) and log(1 + cells) are
        multiplied, and what is then added.

    Raises
    ------
    ConfigError
        When shapes do not fit or a number is not finite.
    """

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
    cell_weights: tuple[Float32Array, ...] = ()
    cell_biases: tuple[Float32Array, ...] = ()
    pool_factor: Float32Array = field(default_factory=lambda: np.empty(0, np.float32))
    pool_offset: Float32Array = field(default_factory=lambda: np.empty(0, np.float32))

    @property
    def extractor(self) -> str:
        """See `Classifier`."""
        return "cells" if self.cell_weights else "curves"

    def __post_init__(self) -> None:
        n = len(self.names)
        split, each = n - len(TOTALS), len(ATTRIBUTES) if self.cell_weights else self.steps
        if self.steps < 1 or split < 1 or split % each or not self.kernels or not self.weights:
            raise ConfigError(f"{_KIND}: {n} features in {self.steps} steps with {len(self.kernels)} convolutions; {_ADVICE}")
        wanted: list[tuple[str, Float32Array, tuple[int, ...]]] = [("mean", self.mean, (n,)), ("scale", self.scale, (n,))]
        width, length = split // self.steps, self.steps
        if self.cell_weights:
            width = len(ATTRIBUTES) - 1
            for number, (weight, bias) in enumerate(zip(self.cell_weights, self.cell_biases, strict=True)):
                wanted += [(f"cell_weights_{number}", weight, (width, len(bias))), (f"cell_bias_{number}", bias, (len(bias),))]
                width = len(bias)
            width = 2 * width + 1
            wanted += [("pool_factor", self.pool_factor, (width,)), ("pool_offset", self.pool_offset, (width,))]
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
        if self.cell_weights:
            wave = self._pooled(standard[:, :split].reshape(len(standard), split // len(ATTRIBUTES), len(ATTRIBUTES)))
        else:
            wave = standard[:, :split].reshape(len(standard), self.steps, split // self.steps)
        for number, (kernel, offset) in enumerate(zip(self.kernels, self.offsets, strict=True)):
            wave = np.maximum(convolve(wave, kernel, 1 if number == 0 else 2) + offset, 0.0)
        return np.concatenate([wave.reshape(len(wave), wave.shape[1] * wave.shape[2]), standard[:, split:]], axis=1)

    def _pooled(self, cells: Float32Array) -> Float32Array:
        """Look at every cell, shape (n, n_cells, n_attributes), and pool the cells of each step, shape (n, n_steps, 2 n_out + 1)."""
        event, number = np.nonzero(cells[..., 0] > 0.5)
        own = cells[event, number]
        when = np.clip(own[:, 1], 0.0, 1.0) * (self.steps - 1)
        step = np.rint(when).astype(np.int64)
        key = event * self.steps + step
        order = np.argsort(key, kind="stable")
        value = np.concatenate([own[:, 2:], (when - step)[:, None]], axis=1)[order]
        for weight, bias in zip(self.cell_weights, self.cell_biases, strict=True):
            value = np.maximum(value @ weight + bias, 0.0)
        count = np.bincount(key, minlength=len(cells) * self.steps).astype(np.float32)
        some = np.flatnonzero(count)
        most, total = (np.zeros((len(count), value.shape[1]), np.float32) for _ in range(2))
        first = (np.cumsum(count[some]) - count[some]).astype(np.int64)
        most[some], total[some] = np.maximum.reduceat(value, first), np.add.reduceat(value, first)
        pooled = np.concatenate([most, total / (count[:, None] + 1.0), np.log1p(count)[:, None]], axis=1)
        return np.asarray(pooled * self.pool_factor + self.pool_offset).reshape(len(cells), self.steps, len(self.pool_factor))

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
            "layers": [len(self.kernels), len(self.weights), len(self.cell_weights)],
            "reject": self.reject,
            "settings": dict(self.settings),
            "figures": dict(self.figures),
        }
        arrays = description(FORMAT, about) | {"mean": self.mean, "scale": self.scale}
        if self.cell_weights:
            arrays |= {"pool_factor": self.pool_factor, "pool_offset": self.pool_offset}
        layers = (("kernel", self.kernels), ("offset", self.offsets), ("weights", self.weights), ("bias", self.biases))
        for kind, parts in (*layers, ("cell_weights", self.cell_weights), ("cell_bias", self.cell_biases)):
            arrays |= {f"{kind}_{k}": part.astype(np.float16) if (half(part) == part).all() else part for k, part in enumerate(parts)}
        return arrays | ({"memory": self.memory, "remembered": self.remembered} if len(self.memory) else {})

    @classmethod
    def from_arrays(cls, about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> CurveNet:
        """Make the network of a file again; parameters and errors as in `GestureModel.from_arrays`."""
        try:
            n_convolutions, n_dense, n_cell = (int(number) for number in (*about["layers"], 0)[:3])  # older files know no cells
            numbers = {name: array.astype(np.float32) if array.dtype == np.float16 else array for name, array in arrays.items()}
            held: dict[str, Any] = {name: arrays[name] for name in ("memory", "remembered") if "memory" in arrays}
            if n_cell:
                held |= {name: numbers[name] for name in ("pool_factor", "pool_offset")}
                for field_name, name in (("cell_weights", "cell_weights"), ("cell_biases", "cell_bias")):
                    held[field_name] = tuple(numbers[f"{name}_{k}"] for k in range(n_cell))
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
