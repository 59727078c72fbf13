"""What a network makes of an event before its dense layers: convolutions over the steps of one kind of inputs.

At each step a branch takes signals (`radar_gestures.curves`), or what it makes of the cells near the step (`radar_gestures.cells`): two
layers look at every cell alone, and the largest and the mean of each of their outputs are kept [1]_.

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

from radar_core import ConfigError
from radar_core.types import Float32Array
from radar_gestures.cells import ATTRIBUTES
from radar_gestures.curves import TOTALS

CLIP: Final[float] = 6.0
"""Standardised numbers are cut off beyond this: what is so far out says no more than that it is."""
KIND: Final[str] = "curve network"
"""What error messages and files call the network."""
ADVICE: Final[str] = "train it again"
"""What error messages say to do."""

Wanted = tuple[str, Float32Array, tuple[int, ...]]
"""An array's name, the array, and the shape that it must have."""


@dataclass(frozen=True, eq=False)
class Branch:
    """Standardise, look at cells where there are some, convolutions over the steps; with ReLU.

    Attributes
    ----------
    mean, scale : ndarray of float32, shape (n_features,)
        Standardisation: ``(features - mean) / scale``, cut off at `CLIP`.
    kernels : tuple of ndarray of float32, each of shape (3, n_in, n_out)
        Of the convolutions; taps are one step before, at and one step after. The first goes over every step, each other one over every
        second of the outputs before it; beyond the ends there are zeros.
    offsets : tuple of ndarray of float32, each of shape (n_out,)
        Added by the convolutions.
    steps : int
        Of the curves, or those to which cells are sorted.
    cell_weights, cell_biases : tuple of ndarray of float32, of shape (n_in, n_out) and (n_out,) each
        Of the two layers that look at every cell: at its attributes but ``there`` and ``when``, and at how far it is from its step, in
        steps. Empty: the branch takes signals.
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
    steps: int
    cell_weights: tuple[Float32Array, ...] = ()
    cell_biases: tuple[Float32Array, ...] = ()
    pool_factor: Float32Array = field(default_factory=lambda: np.empty(0, np.float32))
    pool_offset: Float32Array = field(default_factory=lambda: np.empty(0, np.float32))

    @property
    def kind(self) -> str:
        """What it takes: ``"cells"`` or ``"curves"``."""
        return "cells" if self.cell_weights else "curves"

    @property
    def n_outputs(self) -> int:
        """Numbers that it gives: all outputs of the last convolution, step by step, then the totals."""
        length = self.steps
        for _ in self.kernels[1:]:
            length = -(-length // 2)
        return length * len(self.offsets[-1]) + len(TOTALS)

    def __post_init__(self) -> None:
        n = self.mean.size
        split, each = n - len(TOTALS), len(ATTRIBUTES) if self.cell_weights else self.steps
        if self.steps < 1 or split < 1 or split % each or not self.kernels:
            raise ConfigError(f"{KIND}: {n} features in {self.steps} steps with {len(self.kernels)} convolutions; {ADVICE}")
        wanted: list[Wanted] = [("mean", self.mean, (n,)), ("scale", self.scale, (n,))]
        width = split // self.steps
        if self.cell_weights:
            wanted += layer_shapes("cell_weights", "cell_bias", self.cell_weights, self.cell_biases, len(ATTRIBUTES) - 1)
            width = 2 * len(self.cell_biases[-1]) + 1
            wanted += [("pool_factor", self.pool_factor, (width,)), ("pool_offset", self.pool_offset, (width,))]
        for number, (kernel, offset) in enumerate(zip(self.kernels, self.offsets, strict=True)):
            wanted += [(f"kernel_{number}", kernel, (3, width, len(offset))), (f"offset_{number}", offset, (len(offset),))]
            width = len(offset)
        check(wanted)
        if not (self.scale > 0).all():
            raise ConfigError(f"{KIND}: scale has entries that are not positive; {ADVICE}")

    def process(self, features: NDArray[np.floating]) -> Float32Array:
        """Compute what the dense layers take of it, shape (n, n_outputs), of finite features of shape (n, n_features)."""
        standard = np.clip((features - self.mean) / self.scale, -CLIP, CLIP).astype(np.float32)
        split = standard.shape[1] - len(TOTALS)
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

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Give everything that the model file must keep; see `from_arrays`, and `half` about the bytes of kernels and weights."""
        arrays: dict[str, NDArray[Any]] = {"mean": self.mean, "scale": self.scale}
        if self.cell_weights:
            arrays |= {"pool_factor": self.pool_factor, "pool_offset": self.pool_offset}
        return arrays | layer_arrays(kernel=self.kernels, offset=self.offsets, cell_weights=self.cell_weights, cell_bias=self.cell_biases)

    @classmethod
    def from_arrays(cls, steps: int, n_convolutions: int, n_cell: int, arrays: Mapping[str, NDArray[Any]]) -> Branch:
        """Make the branch of a file again, from arrays in float32; KeyError where one lacks, else errors as in the constructor."""
        held: dict[str, Any] = {}
        if n_cell:
            held = {name: arrays[name] for name in ("pool_factor", "pool_offset")}
            for field_name, name in (("cell_weights", "cell_weights"), ("cell_biases", "cell_bias")):
                held[field_name] = tuple(arrays[f"{name}_{k}"] for k in range(n_cell))
        kernels, offsets = (tuple(arrays[f"{kind}_{k}"] for k in range(n_convolutions)) for kind in ("kernel", "offset"))
        return cls(arrays["mean"], arrays["scale"], kernels, offsets, steps, **held)


def layer_shapes(
    weights_name: str, bias_name: str, weights: tuple[Float32Array, ...], biases: tuple[Float32Array, ...], width: int
) -> list[Wanted]:
    """Say which shapes layers must have, one after the other, of which the first takes ``width`` numbers."""
    wanted: list[Wanted] = []
    for number, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        wanted += [(f"{weights_name}_{number}", weight, (width, len(bias))), (f"{bias_name}_{number}", bias, (len(bias),))]
        width = len(bias)
    return wanted


def check(wanted: list[Wanted]) -> None:
    """Raise ConfigError for the first array that is no float32, has another shape than it must, or holds what is not finite."""
    for name, array, shape in wanted:
        if array.shape != shape or array.dtype != np.float32 or not np.isfinite(array).all():
            raise ConfigError(f"{KIND}: {name} is {array.dtype} {array.shape}, expected finite float32 {shape}; {ADVICE}")


def layer_arrays(**layers: tuple[Float32Array, ...]) -> dict[str, NDArray[Any]]:
    """Give layers as arrays of a file: two bytes a number where that loses nothing, as after training; see `half`."""
    return {
        f"{name}_{k}": part.astype(np.float16) if (half(part) == part).all() else part
        for name, parts in layers.items()
        for k, part in enumerate(parts)
    }


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
