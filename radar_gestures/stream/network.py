"""A temporal convolutional network over slots: of every slot, how probable each gesture is; numpy runs it, one slot after the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError
from radar_core.arrays import description
from radar_core.types import Float32Array, Float64Array
from radar_gestures.classifiers.branch import half
from radar_gestures.classifiers.perceptron import FORMAT

_KIND: Final = "stream network"
_ADVICE: Final = "train it again"
_TAPS: Final = 3
_WIDEST: Final = 1024  # slots from tap to tap: a file cannot ask for memory without bound
_OF_BLOCK: Final = ("kernel", "offset", "mix", "mix_offset")  # the arrays of a block, in this order
CLIP: Final = 8.0
"""Standardised inputs are cut off beyond this: what is so far out says no more than that it is."""
_FLOOR: Final = 0.02  # of a probability in a pool


@dataclass(frozen=True, eq=False)
class Block:
    """A residual block: what three slots hold, ``dilation`` apart, changes what is known of the last.

    Attributes
    ----------
    kernel : ndarray of float32, shape (3, width, width)
        Taps are two dilations before, one before, and at the slot.
    offset : ndarray of float32, shape (width,)
        Added before a ReLU.
    mix : ndarray of float32, shape (width, width)
        From there to what is added.
    mix_offset : ndarray of float32, shape (width,)
        Added as well.
    dilation : int
        Slots from one tap to the next.
    """

    kernel: Float32Array
    offset: Float32Array
    mix: Float32Array
    mix_offset: Float32Array
    dilation: int


@dataclass(frozen=True, eq=False)
class Member:
    """One network of several: a dense layer with ReLU, blocks, ReLU, a dense layer, softmax (Bai et al. 2018, simplified).

    Attributes
    ----------
    first, last : tuple of ndarray of float32
        Weights, shape (n_in, n_out), and biases, shape (n_out,), of the dense layers.
    blocks : tuple of Block
        In this order.
    """

    first: tuple[Float32Array, Float32Array]
    blocks: tuple[Block, ...]
    last: tuple[Float32Array, Float32Array]

    def arrays(self) -> dict[str, Float32Array]:
        """Name all numbers."""
        held = {"first": self.first[0], "first_offset": self.first[1], "last": self.last[0], "last_offset": self.last[1]}
        for number, block in enumerate(self.blocks):
            held |= {f"{name}_{number}": getattr(block, name) for name in _OF_BLOCK}
        return held

    def stacked(self) -> dict[str, Float32Array]:
        """Name all numbers, those of the same kind in all blocks together: files hold few arrays."""
        own = self.arrays()
        held = {name: own[name] for name in ("first", "first_offset", "last", "last_offset")}
        return held | {name: np.stack([getattr(block, name) for block in self.blocks]) for name in _OF_BLOCK if self.blocks}

    def shapes(self, n_features: int, n_labels: int) -> dict[str, tuple[int, ...]]:
        """Say which shapes the arrays must have."""
        width = len(self.first[1])
        found: dict[str, tuple[int, ...]] = {
            "first": (n_features, width), "first_offset": (width,), "last": (width, n_labels), "last_offset": (n_labels,)
        }  # fmt: skip
        square = (width, width)
        own = ((_TAPS, *square), (width,), square, (width,))
        for number in range(len(self.blocks)):
            found |= {f"{name}_{number}": shape for name, shape in zip(_OF_BLOCK, own, strict=True)}
        return found


@dataclass(frozen=True, eq=False)
class StreamNet:
    """Trained networks: inputs are standardised, and what the members say is averaged.

    What is said of a slot is said ``delay`` slots later, so that they also know what came after.

    Attributes
    ----------
    mean, scale : ndarray of float32, shape (n_features,)
        Standardisation.
    members : tuple of Member
        At least one; more are surer, and each takes as long.
    names, labels : tuple of str
        What inputs and outputs mean; the first label is ``random``: no gesture.
    delay : int
        Slots by which the outputs are late.
    reject : float
        A gesture whose score is below this is unknown, see `StreamNet.score`.
    settings, figures : mapping
        ``needs``: what the poorest radar of the training gave (`radar_gestures.needs.Needs`); and what training measured.

    Raises
    ------
    ConfigError
        When shapes do not fit or a number is not finite.
    """

    extractor: ClassVar[str] = "stream"
    mean: Float32Array
    scale: Float32Array
    members: tuple[Member, ...]
    names: tuple[str, ...]
    labels: tuple[str, ...]
    delay: int
    reject: float = 0.0
    settings: Mapping[str, Any] = field(default_factory=dict)
    figures: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n, m = len(self.names), len(self.labels)
        self._check("", {"mean": self.mean, "scale": self.scale}, {"mean": (n,), "scale": (n,)})
        for number, member in enumerate(self.members):
            self._check(f"network {number}: ", member.arrays(), member.shapes(n, m))
            if not all(1 <= block.dilation <= _WIDEST for block in member.blocks):
                raise ConfigError(f"{_KIND}: network {number}: dilations are from 1 to {_WIDEST}; {_ADVICE}")
        if not self.members or not (self.scale > 0).all() or self.delay < 0 or m < 2:
            what = f"{len(self.members)} networks, {m} labels, a delay of {self.delay}, or a scale that is not positive"
            raise ConfigError(f"{_KIND}: {what}; {_ADVICE}")

    @staticmethod
    def _check(where: str, held: Mapping[str, Float32Array], shapes: Mapping[str, tuple[int, ...]]) -> None:
        for name, array in held.items():
            if array.shape != shapes[name] or array.dtype != np.float32 or not np.isfinite(array).all():
                raise ConfigError(
                    f"{_KIND}: {where}{name} is {array.dtype} {array.shape}, expected finite float32 {shapes[name]}; {_ADVICE}"
                )

    def probabilities(self, features: NDArray[np.floating]) -> Float64Array:
        """Probability of every label, slot by slot, from nothing known before the first.

        Parameters
        ----------
        features : ndarray, shape (n_slots, n_features) or (n_features,)
            Of successive slots.

        Returns
        -------
        ndarray of float64, shape (n_slots, n_labels) or (n_labels,)
            The row of a slot is about the slot ``delay`` before it; sums to 1 along the last axis.

        Raises
        ------
        DataError
            When a feature is not finite, or their number is wrong.
        """
        rows, state = np.asarray(features), Memory(self)
        if rows.ndim == 1:
            return state.process(rows)
        return np.array([state.process(row) for row in rows]).reshape(len(rows), len(self.labels))

    def score(self, features: NDArray[np.floating], probabilities: NDArray[np.floating]) -> Float64Array:
        """Probability that it was the most probable gesture and not none, shape (...), of pooled probabilities, shape (..., n_labels)."""
        told = np.asarray(probabilities, np.float64)
        best = told[..., 1:].max(axis=-1)
        return np.asarray(best / np.maximum(best + told[..., 0], np.finfo(np.float64).tiny))

    def known(self, features: NDArray[np.floating], probabilities: NDArray[np.floating]) -> bool:
        """Whether one event, by its pooled probabilities, is a gesture that the model knows."""
        return bool(self.score(features, probabilities) >= self.reject)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Give everything that the model file must keep; see `from_arrays`. Numbers take two bytes where that loses nothing."""
        about = {
            "kind": _KIND, "names": list(self.names), "labels": list(self.labels), "delay": self.delay, "reject": self.reject,
            "dilations": [[block.dilation for block in member.blocks] for member in self.members],
            "settings": dict(self.settings), "figures": dict(self.figures),
        }  # fmt: skip
        held = {"mean": self.mean, "scale": self.scale}
        for number, member in enumerate(self.members):
            held |= {f"{number}_{name}": array for name, array in member.stacked().items()}
        return description(FORMAT, about) | {name: a.astype(np.float16) if (half(a) == a).all() else a for name, a in held.items()}

    @classmethod
    def from_arrays(cls, about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> StreamNet:
        """Make the networks of a file again; parameters and errors as in `GestureModel.from_arrays`."""
        try:
            held = {name: array.astype(np.float32) if array.dtype == np.float16 else array for name, array in arrays.items()}
            members = tuple(_member(held, number, dilations) for number, dilations in enumerate(about["dilations"]))
            return cls(
                held["mean"], held["scale"], members, tuple(map(str, about["names"])), tuple(map(str, about["labels"])),
                int(about["delay"]), float(about["reject"]), dict(about["settings"]), dict(about["figures"]),
            )  # fmt: skip
        except (IndexError, KeyError, TypeError, ValueError) as error:
            raise ConfigError(f"not a {_KIND} ({error}); {_ADVICE}") from None


def _member(held: Mapping[str, Float32Array], number: int, dilations: Sequence[int]) -> Member:
    """Take a member out of the arrays of a file."""
    own = ({name: held[f"{number}_{name}"][k] for name in _OF_BLOCK} for k in range(len(dilations)))
    blocks = tuple(Block(**arrays, dilation=int(dilation)) for arrays, dilation in zip(own, dilations, strict=True))
    first, last = ((held[f"{number}_{name}"], held[f"{number}_{name}_offset"]) for name in ("first", "last"))
    return Member(first, blocks, last)


def pool(probabilities: NDArray[np.floating]) -> Float64Array:
    """Pool what is said of the slots of an event: geometric means that sum to 1 (logarithmic opinion pool; Genest and Zidek 1986).

    One slot that is probably none speaks louder against a gesture than a likely one speaks for it, so that what only begins like a gesture
    is none. A floor keeps single slots from deciding all.

    Parameters
    ----------
    probabilities : ndarray, shape (n_slots, n_labels)
        Of at least one slot.

    Returns
    -------
    ndarray of float64, shape (n_labels,)
    """
    means = np.exp(np.log(np.asarray(probabilities, np.float64) + _FLOOR).mean(axis=0))
    return np.asarray(means / means.sum())


class Memory:
    """What the networks remember of one stream: the slots that their taps still reach."""

    def __init__(self, net: StreamNet) -> None:
        self._net = net
        self._rings = [
            [np.zeros((2 * block.dilation, len(member.first[1])), np.float32) for block in member.blocks] for member in net.members
        ]
        self._count = 0

    def process(self, features: NDArray[np.floating]) -> Float64Array:
        """Take the features of the next slot, shape (n_features,); return the probability of every label, shape (n_labels,)."""
        net = self._net
        x = np.asarray(features)
        if x.shape != net.mean.shape:
            raise DataError(f"features has shape {x.shape}, expected ({len(net.mean)},): {', '.join(net.names[:3])}, ...")
        if not np.isfinite(x).all():
            raise DataError("features has non-finite values; leave such a slot out")
        standard = np.clip((x - net.mean) / net.scale, -CLIP, CLIP).astype(np.float32)
        told = [self._of(member, rings, standard) for member, rings in zip(net.members, self._rings, strict=True)]
        self._count += 1
        return told[0] if len(told) == 1 else np.asarray(np.mean(told, axis=0))

    def _of(self, member: Member, rings: Sequence[Float32Array], standard: Float32Array) -> Float64Array:
        """Probability of every label that one member gives, shape (n_labels,)."""
        value = np.maximum(standard @ member.first[0] + member.first[1], 0.0)
        for block, ring in zip(member.blocks, rings, strict=True):
            value = self._step(block, ring, value)
        score = (np.maximum(value, 0.0) @ member.last[0] + member.last[1]).astype(np.float64)
        score = np.exp(score - score.max())
        return np.asarray(score / score.sum())

    def _step(self, block: Block, ring: Float32Array, value: Float32Array) -> Float32Array:
        """Run one block; ``ring`` holds its inputs of the last slots, the oldest where the newest goes."""
        at, d = self._count % len(ring), block.dilation
        taps: Sequence[Float32Array] = (ring[at], ring[(at + d) % len(ring)], value)
        inner = sum((tap @ kernel for tap, kernel in zip(taps, block.kernel, strict=True)), start=block.offset)
        ring[at] = value
        return np.asarray(value + np.maximum(inner, 0.0) @ block.mix + block.mix_offset)
