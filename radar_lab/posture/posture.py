"""Both hands of every person from sparse clouds of one radar: learned, where points are too few to follow a hand (no thesis section).

`HandTracker` follows the points of one hand and needs a cloud that has some. A radar with ten to thirty points a cloud and an azimuth good
to tens of centimetres often has none there, but a raised arm shows in all of the person's points and in what they did lately.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError, RadarInfo
from radar_core.arrays import as_float32, description, load_arrays, read_description, save_arrays
from radar_core.config import config, knob, load, plain
from radar_core.types import Float32Array, Float64Array
from radar_lab.posture.features import PostureFeatureConfig, PostureFeatures, Seen, mirror
from radar_tracking.tracks import TrackedCloud

FORMAT: Final[int] = 1
"""Version of the model file; a reader refuses every other."""
FLIP: Final = np.array([1.0, -1.0, 1.0])
"""(away, left, up) in a mirror."""

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


@config
class PostureConfig:
    """What `PostureTracker` can be told beside its model."""

    hold: float = knob(1.0, unit="s", low=0.01, high=60.0, doc="unseen for as long, 63 % of what is known of the hands is lost")
    lost_after: float = knob(5.0, unit="s", low=0.0, high=600.0, doc="a person without any point for longer has no posture")


@dataclass(frozen=True, eq=False)
class Posture:
    """Both hands of one person."""

    track_id: int  # whose
    position: Float64Array  # the person's left and right hand in ``room``, shape (2, 3) = (hand, axis) [m]
    # Standard deviations along the axes of ``room`` [m]; for people and movements like those of the training; shape (2, 3) = (hand, axis)
    std: Float64Array
    n_points: int  # points of the cloud that are the person's
    unseen: float  # since the person had a point [s]


@dataclass(frozen=True, eq=False)
class Postures:
    """The hands of all people after one cloud."""

    # stamp_ns, sequence: of the cloud
    stamp_ns: int
    sequence: int
    frame_id: str  # always ``room``
    people: tuple[Posture, ...]  # in the order of their tracks

    def find(self, track_id: int) -> Posture | None:
        """Return the posture of the track with this id, or None."""
        return next((posture for posture in self.people if posture.track_id == track_id), None)


class PostureTracker:
    """Give both hands of every confirmed person, cloud by cloud, from this cloud and the ones before.

    Left and right are the person's own, who faces the radar. Where the radar stands ``info`` says; None: at the room's origin. The model is
    one of `radar_lab.posture.training.train_postures` or `load_postures`.
    """

    def __init__(self, model: PostureModel, config: PostureConfig | None = None, info: RadarInfo | None = None) -> None:
        self.config = config if config is not None else PostureConfig()
        self.model = model
        self._features = PostureFeatures(model.features)
        self._origin = np.zeros(3)
        if info is not None:
            self.seen_from(info)
        self.reset()

    def reset(self) -> None:
        """Forget everything. For a new recording."""
        self._features.reset()
        self._last: dict[int, tuple[int, Float64Array, Float64Array]] = {}  # stamp, places and variances when there were points

    def seen_from(self, info: RadarInfo) -> None:
        """Learn where the sensor stands."""
        self._origin = np.asarray(info.mount.origin, np.float64)

    def process(self, tracked: TrackedCloud) -> Postures:
        """Take in one cloud with its tracks, in ``room``, not older than the one before.

        Points without height are left out; a range rate that is NaN counts as 0. People without a point keep their hands where they were,
        less and less sure. Raises `DataError` when the cloud is not in ``room``, older than the one before, or a position, a range rate or
        a track is infinite.
        """
        cloud = tracked.cloud
        people = []
        last: dict[int, tuple[int, Float64Array, Float64Array]] = {}
        for seen in self._features.process(tracked, self._origin):
            known = self._estimate(seen, cloud.stamp_ns) if seen.n_points else self._last.get(seen.track.id)
            if known is None:
                continue
            last[seen.track.id] = known
            unseen = (cloud.stamp_ns - known[0]) * 1e-9
            if unseen <= self.config.lost_after:
                people.append(self._posture(seen, known[1], known[2], unseen))
        self._last = last
        return Postures(cloud.stamp_ns, cloud.sequence, cloud.frame_id, tuple(people))

    def _estimate(self, seen: Seen, stamp_ns: int) -> tuple[int, Float64Array, Float64Array]:
        """Say where the hands are: the left one, and the mirror image of the mirrored person's left one; both in the person's axes."""
        left, right = self.model.predict(np.stack([seen.features, mirror(seen.features, self.model.features)]))
        return stamp_ns, np.stack([left, right * FLIP]), self.model.std.astype(np.float64) ** 2

    def _posture(self, seen: Seen, own: Float64Array, variance: Float64Array, unseen: float) -> Posture:
        """Make the result. A place ``unseen`` seconds old and the present one are like two samples of an Ornstein-Uhlenbeck process."""
        grown = variance - 2.0 * self.model.spread.astype(np.float64) ** 2 * np.expm1(-unseen / self.config.hold)
        std = seen.frame.std_in_room(np.sqrt(grown))
        return Posture(seen.track.id, seen.frame.to_room(own), np.tile(std, (2, 1)), seen.n_points, unseen)
