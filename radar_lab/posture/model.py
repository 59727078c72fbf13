"""The learned part of postures: a perceptron that gives one hand's place, run with numpy, kept in a file of plain arrays."""

from __future__ import annotations

import io
import json
import math
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError
from radar_core.arrays import save_arrays
from radar_core.config import load, plain
from radar_lab.posture.features import PostureFeatureConfig

Float64Array = NDArray[np.float64]

FORMAT: Final[int] = 1
"""Version of the model file; a reader refuses every other."""

_ADVICE: Final = "make a new one with radar_lab.posture.training.train_postures"
_LIMIT: Final = 1e9  # features beyond this are no measurements
_MOST_BYTES: Final = 16_000_000  # of the whole content: a hundred times what a model of ours takes
_MOST_MEMBERS: Final = 64


@dataclass(frozen=True, eq=False)
class PostureModel:
    """A trained perceptron: layers with ReLU between them, the last one linear.

    It gives the left hand. The right one is the mirror image of what it gives for the mirrored person, so that both are learned from both.
    Arrays of any real type are taken and kept as float32, which is what the file holds; sums are made in double precision.

    Attributes
    ----------
    features : PostureFeatureConfig
        What the inputs are.
    weights : tuple of ndarray of float32, each of shape (n_in, n_out)
        Of every layer; the first has ``n_in = features.n_features``, the last ``n_out = 3``: (away, left, up) in the person's own axes [m].
    biases : tuple of ndarray of float32, each of shape (n_out,)
        Of every layer.
    std : ndarray of float32, shape (3,)
        Error of the outputs, root mean square over parts of the training set that were left out [m].
    spread : ndarray of float32, shape (3,)
        Standard deviation of the hands themselves in the training set [m].
    bounds : ndarray of float32, shape (2, 3)
        Lowest and highest place of a hand in the training set [m]. Beyond it nothing is known, and the answer stays within.
    figures : mapping
        What training measured.

    Raises
    ------
    ConfigError
        When shapes do not fit or a number is not finite.
    """

    features: PostureFeatureConfig
    weights: tuple[NDArray[np.float32], ...]
    biases: tuple[NDArray[np.float32], ...]
    std: NDArray[np.float32]
    spread: NDArray[np.float32]
    bounds: NDArray[np.float32]
    figures: Mapping[str, Any] = field(default_factory=dict)
    _layers: tuple[tuple[Float64Array, Float64Array], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not 0 < len(self.weights) == len(self.biases) <= _MOST_MEMBERS // 4:
            raise ConfigError(f"posture model: {len(self.weights)} layers of weights, {len(self.biases)} of biases; {_ADVICE}")
        n_in, weights, biases = self.features.n_features, [], []
        for number, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            n_out = 3 if number == len(self.weights) - 1 else max(np.size(bias), 1)
            weights.append(_checked(f"weights_{number}", weight, (n_in, n_out)))
            biases.append(_checked(f"bias_{number}", bias, (n_out,)))
            n_in = n_out
        object.__setattr__(self, "weights", tuple(weights))
        object.__setattr__(self, "biases", tuple(biases))
        for name in ("std", "spread"):
            object.__setattr__(self, name, _checked(name, getattr(self, name), (3,)))
            if not (getattr(self, name) > 0).all():
                raise ConfigError(f"posture model: {name} has entries that are not positive; {_ADVICE}")
        object.__setattr__(self, "bounds", _checked("bounds", self.bounds, (2, 3)))
        if not (self.bounds[0] <= self.bounds[1]).all():
            raise ConfigError(f"posture model: the lower bounds are not below the upper ones; {_ADVICE}")
        doubles = tuple((w.astype(np.float64), b.astype(np.float64)) for w, b in zip(weights, biases, strict=True))
        object.__setattr__(self, "_layers", doubles)

    @property
    def n_parameters(self) -> int:
        """Number of weights and biases."""
        return sum(array.size for array in (*self.weights, *self.biases))

    def predict(self, features: NDArray[np.floating]) -> Float64Array:
        """Place of the left hand in the person's own axes.

        Parameters
        ----------
        features : ndarray, shape (..., n_features)
            As `PostureFeatures` makes them; mirrored ones (`mirror`) give the right hand, mirrored.

        Returns
        -------
        ndarray of float64, shape (..., 3)
            (away, left, up) [m]: away and left from the body, up from the floor.

        Raises
        ------
        DataError
            When a feature is not finite or absurdly large (beyond 1e9), or their number is wrong.
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

    Raises
    ------
    DataError
        When the file cannot be written, or is larger than what a reader takes.
    """
    path = Path(path)
    if 4 * model.n_parameters > _MOST_BYTES // 2:
        raise DataError(f"{path}: the model has {model.n_parameters} parameters, more than any reader takes; train one with fewer neurons")
    about = {"features": plain(model.features), "n_layers": len(model.weights), "figures": dict(model.figures)}
    arrays: dict[str, NDArray[Any]] = {
        "format": np.array(FORMAT, np.int64),
        "about": np.frombuffer(json.dumps(about, sort_keys=True).encode(), np.uint8),
        "std": model.std,
        "spread": model.spread,
        "bounds": model.bounds,
    }
    for number, (weight, bias) in enumerate(zip(model.weights, model.biases, strict=True)):
        arrays |= {f"weights_{number}": weight, f"bias_{number}": bias}
    save_arrays(path, arrays, "model")


def load_postures(path: str | Path) -> PostureModel:
    """Read a model. Nothing in the file is ever executed, and sizes are checked before anything is unpacked.

    Raises
    ------
    ConfigError
        When there is no such file, it is no model, or it is of another version; the message says what to do.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            return _read(archive)
    except (OSError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, ValueError, SyntaxError) as error:
        raise ConfigError(f"{path}: not a posture model ({error}); {_ADVICE}") from None
    except KeyError as error:
        raise ConfigError(f"{path}: not a posture model, it lacks {error}; {_ADVICE}") from None


def _read(archive: zipfile.ZipFile) -> PostureModel:
    members = archive.infolist()
    if len(members) > _MOST_MEMBERS or sum(member.file_size for member in members) > _MOST_BYTES:
        raise ConfigError(f"it holds more than {_MOST_MEMBERS} arrays or {_MOST_BYTES // 1_000_000} MB")
    found = {member.filename.removesuffix(".npy"): _array(archive, member) for member in members}
    if found["format"].shape != () or int(found["format"]) != FORMAT:
        raise ConfigError(f"model format {found['format']}, but this version of Handwave reads format {FORMAT}")
    about = json.loads(found["about"].tobytes().decode())
    if not isinstance(about, dict) or not isinstance(about["figures"], dict) or type(about["n_layers"]) is not int:
        raise ConfigError("its description makes no sense")
    layers = range(min(about["n_layers"], _MOST_MEMBERS))
    return PostureModel(
        load(PostureFeatureConfig, about["features"], "features of the model"),
        tuple(found[f"weights_{number}"] for number in layers),
        tuple(found[f"bias_{number}"] for number in layers),
        found["std"],
        found["spread"],
        found["bounds"],
        about["figures"],
    )


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    """Read one array; `numpy.load` would set aside whatever memory the header asks for before it looks at the data."""
    with archive.open(member) as opened:
        file = io.BytesIO(opened.read(_MOST_BYTES))
    if np.lib.format.read_magic(file) != (1, 0):
        raise ConfigError(f"{member.filename} is no array of npy version 1.0")
    shape, fortran, kind = np.lib.format.read_array_header_1_0(file)
    data = file.read()
    if kind.hasobject or any(length < 0 for length in shape) or math.prod(shape) * kind.itemsize != len(data):
        raise ConfigError(f"{member.filename} is not what its header says ({kind} {shape})")
    return np.frombuffer(data, kind).reshape(shape, order="F" if fortran else "C")


def _checked(name: str, array: Any, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Return the array as float32, or say what is wrong with it."""
    given = np.asarray(array)
    if given.shape != shape or given.dtype.kind not in "fiu":
        raise ConfigError(f"posture model: {name} is {given.dtype} {given.shape}, expected float32 {shape}; {_ADVICE}")
    if not (np.abs(given) <= np.finfo(np.float32).max).all():
        raise ConfigError(f"posture model: {name} has non-finite numbers; {_ADVICE}")
    return np.ascontiguousarray(given, np.float32)
