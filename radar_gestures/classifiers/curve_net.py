"""A small convolutional network over the steps of an event: the same patterns are looked for at every step.

It has one branch (`radar_gestures.classifiers.branch`) for each kind of inputs, on curves or on cells. A network with both is the average
of two that were trained by themselves (`averaged`). PyTorch trains it (extra ``train``, `radar_lab.training.networks`), numpy runs it.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError
from radar_core.arrays import description
from radar_core.types import Float32Array, Float64Array, IndexArray
from radar_gestures.classifiers.branch import ADVICE, KIND, Branch, check, half, layer_arrays, layer_shapes
from radar_gestures.classifiers.perceptron import FORMAT
from radar_gestures.classifiers.rejection import Rejecting


@dataclass(frozen=True, eq=False)
class CurveNet(Rejecting):
    """A trained network: branches side by side, hidden layer with ReLU, softmax.

    Attributes
    ----------
    branches : tuple of Branch
        Each takes its own part of the features, in this order.
    weights : tuple of ndarray of float32, each of shape (n_in, n_out)
        Of the dense layers; the first takes what the branches give, one after the other.
    biases : tuple of ndarray of float32, each of shape (n_out,)
        Added by the dense layers.
    names, labels : tuple of str
        What inputs and outputs mean.
    reject : float
        An event whose `score` is below this is no known gesture.
    settings, figures : mapping
        How the inputs were made (``curves`` and ``cells``: the knobs of `CurveConfig` and `CellConfig`; others as in `GestureModel`), and
        what training measured.
    memory : ndarray of float16, shape (n, n_inputs of the first dense layer)
        What some samples of the training were to the first dense layer (`inputs`), so that tuning forgets nothing; mostly few, may be none.
    remembered : ndarray of int64, shape (n,)
        Their labels.

    Raises
    ------
    ConfigError
        When shapes do not fit, a number is not finite, or two branches take the same.
    """

    branches: tuple[Branch, ...]
    weights: tuple[Float32Array, ...]
    biases: tuple[Float32Array, ...]
    names: tuple[str, ...]
    labels: tuple[str, ...]
    reject: float = 0.0
    settings: Mapping[str, Any] = field(default_factory=dict)
    figures: Mapping[str, Any] = field(default_factory=dict)
    memory: NDArray[np.float16] = field(default_factory=lambda: np.empty((0, 0), np.float16))
    remembered: IndexArray = field(default_factory=lambda: np.empty(0, np.int64))

    @property
    def extractor(self) -> str:
        """See `Classifier`; of several branches, their kinds with ``+`` between them."""
        return "+".join(branch.kind for branch in self.branches)

    def __post_init__(self) -> None:
        kinds, n = [branch.kind for branch in self.branches], sum(branch.mean.size for branch in self.branches)
        if not kinds or len(set(kinds)) < len(kinds) or n != len(self.names) or not self.weights:
            raise ConfigError(f"{KIND}: {len(self.names)} features, of which its branches ({', '.join(kinds)}) take {n}; {ADVICE}")
        width = sum(branch.n_outputs for branch in self.branches)
        check(layer_shapes("weights", "bias", self.weights, self.biases, width))
        if len(self.biases[-1]) != len(self.labels):
            raise ConfigError(f"{KIND}: {len(self.biases[-1])} outputs for {len(self.labels)} labels; {ADVICE}")
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
            raise ConfigError(f"{KIND}: its memory of {self.memory.shape} does not fit {n} labels; {ADVICE}")

    def inputs(self, features: NDArray[np.floating]) -> Float32Array:
        """Compute what the dense layers take, shape (n, n_inputs), of features of shape (..., n_features); errors as `probabilities`."""
        x = np.asarray(features)
        if x.shape[-1:] != (len(self.names),):
            raise DataError(f"features has shape {x.shape}, expected (..., {len(self.names)}): {', '.join(self.names[:3])}, ...")
        if not np.isfinite(x).all():
            raise DataError("features has non-finite values; leave such an event out")
        ends = list(itertools.accumulate(branch.mean.size for branch in self.branches))
        parts = np.split(x.reshape(-1, x.shape[-1]), ends[:-1], axis=1)
        return np.concatenate([branch.process(part) for branch, part in zip(self.branches, parts, strict=True)], axis=1)

    def probabilities(self, features: NDArray[np.floating]) -> Float64Array:
        """Probability of every label, see `Classifier`."""
        x, value = np.asarray(features), self.inputs(features)
        for number, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            value = (np.maximum(value, 0.0) if number else value) @ weight + bias
        score = np.exp(value.astype(np.float64) - value.max(axis=1, keepdims=True))
        return np.asarray(score / score.sum(axis=1, keepdims=True)).reshape(*x.shape[:-1], len(self.labels))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Give everything that the model file must keep; see `from_arrays`."""
        about = {
            "kind": KIND,
            "names": list(self.names),
            "labels": list(self.labels),
            "branches": [[branch.steps, len(branch.kernels), len(branch.cell_weights)] for branch in self.branches],
            "dense": len(self.weights),
            "reject": self.reject,
            "settings": dict(self.settings),
            "figures": dict(self.figures),
        }
        arrays = description(FORMAT, about) | layer_arrays(weights=self.weights, bias=self.biases)
        for number, branch in enumerate(self.branches):
            arrays |= {f"branch{number}.{name}": array for name, array in branch.arrays().items()}
        return arrays | ({"memory": self.memory, "remembered": self.remembered} if len(self.memory) else {})

    @classmethod
    def from_arrays(cls, about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> CurveNet:
        """Make the network of a file again; parameters and errors as in `GestureModel.from_arrays`."""
        try:
            if "branches" not in about:
                about, arrays = _of_one_branch(about, arrays)
            numbers = {name: array.astype(np.float32) if array.dtype == np.float16 else array for name, array in arrays.items()}
            branches = []
            for number, (steps, n_convolutions, n_cell) in enumerate(about["branches"]):
                prefix = f"branch{number}."
                own = {name.removeprefix(prefix): array for name, array in numbers.items() if name.startswith(prefix)}
                branches.append(Branch.from_arrays(int(steps), int(n_convolutions), int(n_cell), own))
            held: dict[str, Any] = {name: arrays[name] for name in ("memory", "remembered") if "memory" in arrays}
            weights, biases = (tuple(numbers[f"{kind}_{k}"] for k in range(int(about["dense"]))) for kind in ("weights", "bias"))
            return cls(
                tuple(branches), weights, biases, names=tuple(map(str, about["names"])), labels=tuple(map(str, about["labels"])),
                reject=float(about["reject"]), settings=dict(about["settings"]), figures=dict(about["figures"]), **held,
            )  # fmt: skip
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError(f"not a {KIND} ({error}); {ADVICE}") from None


def _of_one_branch(about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Turn a file of versions that knew one branch only into one of today."""
    n_convolutions, n_dense, n_cell = (*about["layers"], 0)[:3]
    dense = {"memory", "remembered", *(f"{name}_{k}" for name in ("weights", "bias") for k in range(int(n_dense)))}
    named = {name if name in dense else f"branch0.{name}": array for name, array in arrays.items()}
    return {**about, "branches": [[about["steps"], n_convolutions, n_cell]], "dense": n_dense}, named


def averaged(nets: Sequence[CurveNet], counts: Sequence[float] | None = None) -> CurveNet:
    """Make one network of several with other inputs and the same labels: its scores before the softmax are the means of theirs.

    ``counts``: how much each counts in the mean, positive; None: all the same. Its dense layers hold theirs side by side; between two
    networks the weights are 0, until tuning changes them. Last weights are rounded as `half` does. Settings are joined; limit, figures and
    memory are those of a new network.

    Raises
    ------
    ConfigError
        When labels or numbers of layers differ, two networks take the same inputs, or counts do not fit.
    """
    if len({(net.labels, len(net.weights)) for net in nets}) != 1:
        raise ConfigError(f"{KIND}: {len(nets)} networks with other labels or layers cannot be averaged; {ADVICE}")
    share = np.ones(len(nets)) if counts is None else np.asarray(counts, np.float64)
    if share.shape != (len(nets),) or not (share > 0).all() or not np.isfinite(share).all():
        raise ConfigError(f"{KIND}: {counts} do not say how much each of {len(nets)} networks counts")
    share = share / share.sum()
    *hidden, last = zip(*(net.weights for net in nets), strict=True)
    *hidden_bias, last_bias = zip(*(net.biases for net in nets), strict=True)
    weights = [_side_by_side(layers) for layers in hidden] + [
        half(np.concatenate([part * np.float32(own) for part, own in zip(last, share, strict=True)]))
    ]
    biases = [np.concatenate(parts) for parts in hidden_bias] + [np.average(last_bias, axis=0, weights=share).astype(np.float32)]
    return CurveNet(
        tuple(branch for net in nets for branch in net.branches),
        tuple(weights),
        tuple(biases),
        names=tuple(name for net in nets for name in net.names),
        labels=nets[0].labels,
        settings={name: value for net in nets for name, value in net.settings.items()},
    )


def _side_by_side(layers: Sequence[Float32Array]) -> Float32Array:
    """Put matrices on the diagonal of a larger one that is 0 elsewhere."""
    joined = np.zeros(np.sum([layer.shape for layer in layers], axis=0), np.float32)
    row = column = 0
    for layer in layers:
        joined[row : row + layer.shape[0], column : column + layer.shape[1]] = layer
        row, column = row + layer.shape[0], column + layer.shape[1]
    return joined
