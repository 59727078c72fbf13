"""Training of postures: recordings with both hands beside the clouds (a camera's or a simulator's truth) to a `PostureModel`."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from radar_core import DataError
from radar_core.checks import require_shape
from radar_core.config import config, knob
from radar_core.linalg import canonical_eigh
from radar_core.types import Float64Array, IndexArray
from radar_lab.posture.features import PostureFeatureConfig, PostureFeatures, Seen, mirror
from radar_lab.posture.posture import FLIP, PostureModel
from radar_tracking.tracks import TrackedCloud

Layers = list[tuple[Float64Array, Float64Array]]

_LEAST_STD: Final = 1e-3  # m
_NEAR: Final = 1.5  # m: a track farther than this from the middle of the hands is somebody else's
_LEAST_VARIANCE: Final = 1e-3  # of a component, features have 1: whitening less would only blow up what is new
_LEAST: Final = 100  # clouds: fewer teach nothing


@config
class PostureTrainingConfig:
    """How a posture model is trained."""

    features: PostureFeatureConfig = PostureFeatureConfig()
    hidden: tuple[int, ...] = knob((64, 32), low=1, high=4096, doc="neurons of each hidden layer")
    members: int = knob(4, low=1, high=100, doc="perceptrons whose mean is the answer: each alone depends on its start weights")
    components: int = knob(100, low=1, high=4096, doc="principal components of the features that are learned from; fewer are smoother")
    regularisation: float = knob(0.5, low=0.0, high=1e3, doc="L2 penalty on the weights")
    learning_rate: float = knob(1e-3, low=1e-8, high=10.0, doc="of Adam, at the start")
    epochs: int = knob(20, low=1, high=100_000, doc="passes over the samples; more learn the training people by heart")
    folds: int = knob(3, low=2, high=100, doc="parts left out in turn to measure the error")
    block: float = knob(10.0, unit="s", low=0.1, high=3600.0, doc="length of the pieces that are dealt out: neighbouring clouds are alike")
    seed: int = knob(1, low=0, high=2**31 - 1, doc="of the start weights and the order of samples")


@dataclass(frozen=True, eq=False)
class HandRecording:
    """One recording of one person with both hands.

    Raises
    ------
    DataError
        When there is not one pair of hands for every cloud, or a place is infinite.
    """

    clouds: Sequence[TrackedCloud]  # in ``room``, in order
    # The person's left and right hand in ``room`` at the clouds' stamps [m]; NaN: unknown; shape (n_clouds, 2, 3) = (cloud, hand, axis)
    hands: Float64Array
    origin: Float64Array  # where the sensor stands in ``room``, shape (3,) [m]

    def __post_init__(self) -> None:
        require_shape("HandRecording.hands", self.hands, (len(self.clouds), 2, 3))
        require_shape("HandRecording.origin", self.origin, (3,))
        if np.isinf(self.hands).any() or not np.isfinite(self.origin).all():
            raise DataError("HandRecording.hands has infinite places, or origin is not finite; give NaN where a hand is not known")


@dataclass(frozen=True, eq=False)
class PostureSamples:
    """What is learned from: every cloud gives two, the left hand, and the right hand of the mirrored person."""

    features: Float64Array  # as `PostureFeatures` makes them, shape (n, n_features)
    hand: Float64Array  # (away, left, up) in the person's axes, shape (n, 3) [m]
    cloud: IndexArray  # index of the cloud in its recording, shape (n,)
    side: IndexArray  # 0: left hand, 1: right hand, mirrored; shape (n,)
    block: IndexArray  # which piece of time they are from; pieces of different recordings differ; shape (n,)

    def __len__(self) -> int:
        return len(self.hand)


def samples_of(recordings: Sequence[HandRecording], config: PostureFeatureConfig, block: float = 10.0) -> PostureSamples:
    """Make samples of recordings, each from its start on, with the features that `PostureTracker` will see.

    ``block`` is the length of a piece of time [s]. `DataError` is raised for fewer than 100 clouds with a person and a hand.
    """
    features, hand, rows, first = [], [], [], 0
    for recording in recordings:
        maker, start_ns = PostureFeatures(config), recording.clouds[0].cloud.stamp_ns if recording.clouds else 0
        for k, (tracked, both) in enumerate(zip(recording.clouds, recording.hands, strict=True)):
            seen = _owner(maker.process(tracked, recording.origin), both)
            if seen is None or not seen.n_points:
                continue
            piece = first + int((tracked.cloud.stamp_ns - start_ns) * 1e-9 / block)
            for side, place in enumerate(both):
                if np.isfinite(place).all():
                    own = seen.frame.to_own(place)
                    features.append(mirror(seen.features, config) if side else seen.features)
                    hand.append(own * FLIP if side else own)
                    rows.append((k, side, piece))
        first = 1 + max((row[2] for row in rows), default=first)
    if len({row[::2] for row in rows}) < _LEAST:
        raise DataError(f"the recordings hold {len(rows)} hands beside a tracked person's points; record {_LEAST} clouds with both")
    cloud, side, piece = np.array(rows, np.int64).T
    return PostureSamples(np.stack(features), np.stack(hand), cloud, side, piece)


def _owner(people: Sequence[Seen], hands: Float64Array) -> Seen | None:
    """Whose the hands are: of the person nearest to the middle of those that are known; None: nobody is near."""
    middle = hands[np.isfinite(hands).all(axis=1)]
    if not people or not len(middle):
        return None
    place = middle.mean(axis=0)
    far = [float(np.hypot(*(seen.track.position[:2] - place[:2]))) for seen in people]
    nearest = int(np.argmin(far))
    return people[nearest] if far[nearest] <= _NEAR else None


def train_postures(
    recordings: Sequence[HandRecording], config: PostureTrainingConfig | None = None, progress: Callable[[str], None] | None = None
) -> PostureModel:
    """Train a model. Its error is measured on pieces of time left out in turn; the model itself has seen everything.

    Its ``figures`` hold the number of samples, the error [m] of the parts left out, and what the mean place has there. The same recordings,
    config and versions of the libraries give the same model.

    Parameters
    ----------
    recordings : sequence of HandRecording
        Of the people that it is for, or of as many others as possible; `DataError` when there is too little to learn from.
    config : PostureTrainingConfig or None
        Knobs; None: all defaults.
    progress : callable or None
        Told what is done next.
    """
    chosen = config if config is not None else PostureTrainingConfig()
    samples = samples_of(recordings, chosen.features, chosen.block)
    return fit_postures(samples, chosen, progress)


def fit_postures(samples: PostureSamples, config: PostureTrainingConfig, progress: Callable[[str], None] | None = None) -> PostureModel:
    """Train on samples that were made before; see `train_postures`. The parts left out are judged by one member, a little too badly."""
    from threadpoolctl import threadpool_limits

    tell = progress if progress is not None else str  # which does nothing
    with threadpool_limits(1):  # so small that threads only fight, and with another number of them rounding differs
        wrong, plain = _left_out(samples, config, tell)
        tell("everything")
        weights, biases = zip(*_fit(samples.features, samples.hand, config, config.members), strict=True)
    return PostureModel(
        config.features, weights, biases,
        std=np.maximum(np.sqrt((wrong**2).mean(axis=0)), _LEAST_STD),
        spread=np.maximum(samples.hand.std(axis=0), _LEAST_STD),
        bounds=np.stack([samples.hand.min(axis=0), samples.hand.max(axis=0)]),
        figures={"samples": len(samples), "error_m": _rms(wrong), "mean_place_error_m": _rms(plain), "seed": config.seed},
    )  # fmt: skip


def _left_out(samples: PostureSamples, config: PostureTrainingConfig, tell: Callable[[str], object]) -> tuple[Float64Array, Float64Array]:
    """Leave out one part after the other: errors of the perceptron and of the mean place there, both of shape (n, 3) [m]."""
    wrong, plain, part = np.empty((len(samples), 3)), np.empty((len(samples), 3)), _parts(samples, config)
    for fold in range(int(part.max()) + 1):
        tell(f"part {fold + 1} of {part.max() + 1} left out")
        out = part == fold
        layers = _fit(samples.features[~out], samples.hand[~out], config, 1)
        wrong[out] = _forward(layers, samples.features[out]) - samples.hand[out]
        plain[out] = samples.hand[~out].mean(axis=0) - samples.hand[out]
    return wrong, plain


def _parts(samples: PostureSamples, config: PostureTrainingConfig) -> IndexArray:
    """Deal the pieces of time out in turn; which part each sample is of, shape (n,)."""
    pieces, number = np.unique(samples.block, return_inverse=True)
    if len(pieces) < 2:
        raise DataError(f"the recordings are shorter than two pieces of {config.block:g} s; record more, or make `block` shorter")
    return np.asarray(number % min(config.folds, len(pieces)), np.int64)


def _fit(features: Float64Array, hand: Float64Array, config: PostureTrainingConfig, members: int) -> Layers:
    """Fit perceptrons on whitened principal components; the linear steps before and after them become part of the first and last layer."""
    middle, scale = features.mean(axis=0), features.std(axis=0)
    scale[scale < 1e-9] = 1.0  # cells that are always empty
    standard = (features - middle) / scale
    variance, components = (array[..., : -config.components - 1 : -1] for array in canonical_eigh(standard.T @ standard / len(hand)))
    own = variance > _LEAST_VARIANCE
    if not own.any():
        raise DataError("the recordings' clouds are all alike: nothing can be learned from them")
    project = components[:, own] / scale[:, None] / np.sqrt(variance[own])
    mean, size = hand.mean(axis=0), np.maximum(hand.std(axis=0), 1e-6)
    x, y = (features - middle) @ project, (hand - mean) / size
    layers = _mean([_perceptron(x, y, config, config.seed + number) for number in range(members)])
    first = project @ layers[0][0]
    layers[0] = (first, layers[0][1] - middle @ first)
    layers[-1] = (layers[-1][0] * size, layers[-1][1] * size + mean)
    return layers


def _perceptron(x: Float64Array, y: Float64Array, config: PostureTrainingConfig, seed: int) -> Layers:
    """Fit one perceptron to standardised inputs and outputs."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.neural_network import MLPRegressor

    network: Any = MLPRegressor(
        hidden_layer_sizes=config.hidden, alpha=config.regularisation, learning_rate_init=config.learning_rate,
        max_iter=config.epochs, batch_size=min(64, len(y)), random_state=seed, n_iter_no_change=config.epochs,
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # the number of passes is chosen, not waited for
        network.fit(x, y)
    return [(np.asarray(w, np.float64), np.asarray(b, np.float64)) for w, b in zip(network.coefs_, network.intercepts_, strict=True)]


def _mean(networks: Sequence[Layers]) -> Layers:
    """Make one network of several that gives their mean: side by side, each with its own hidden neurons."""
    from scipy.linalg import block_diag

    made: Layers = []
    last = len(networks[0]) - 1
    for number in range(last + 1):
        weights, biases = zip(*(network[number] for network in networks), strict=True)
        joined = np.hstack(weights) if number == 0 else block_diag(*weights)
        bias = np.concatenate(biases)
        if number == last:
            n_out = len(biases[0])
            joined, bias = (array.reshape(*array.shape[:-1], -1, n_out).mean(axis=-2) for array in (joined, bias))
        made.append((joined, bias))
    return made


def _forward(layers: Layers, x: Float64Array) -> Float64Array:
    for number, (weight, bias) in enumerate(layers):
        x = (x if number == 0 else np.maximum(x, 0.0)) @ weight + bias
    return x


def _rms(wrong: Float64Array) -> float:
    return float(np.sqrt((wrong**2).sum(axis=1).mean()))
