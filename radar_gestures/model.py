"""The classifier: a multi-layer perceptron with one hidden layer (thesis, section 4.2), in plain numpy at run time."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, ConfigError, DataError
from radar_core.paths import find_config
from radar_gestures.features import FEATURE_NAMES

FORMAT: Final[int] = 1
"""Version of the model file; a reader refuses every other."""

_ARRAYS: Final[tuple[str, ...]] = ("mean", "scale", "hidden_weights", "hidden_bias", "output_weights", "output_bias")
_ADVICE: Final[str] = "make a new one with `handwave train`, or name the model that comes with Handwave (gestures)"


@dataclass(frozen=True, eq=False)
class GestureModel:
    """A trained perceptron: standardise, hidden layer with ReLU, output layer with softmax.

    Attributes
    ----------
    mean, scale : ndarray of float64, shape (n_features,)
        Standardisation: ``(features - mean) / scale``.
    hidden_weights : ndarray of float64, shape (n_features, n_hidden)
    hidden_bias : ndarray of float64, shape (n_hidden,)
    output_weights : ndarray of float64, shape (n_hidden, n_labels)
    output_bias : ndarray of float64, shape (n_labels,)
    settings : mapping
        How the features were made (knobs of `FeatureConfig` and `EventConfig`): a recogniser set otherwise refuses the model.
    figures : mapping
        What training measured: number of samples, accuracy, seed.
    """

    mean: NDArray[np.float64]
    scale: NDArray[np.float64]
    hidden_weights: NDArray[np.float64]
    hidden_bias: NDArray[np.float64]
    output_weights: NDArray[np.float64]
    output_bias: NDArray[np.float64]
    settings: Mapping[str, Any] = field(default_factory=dict)
    figures: Mapping[str, Any] = field(default_factory=dict)
    _weights: NDArray[np.float64] = field(init=False, repr=False)
    _bias: NDArray[np.float64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        hidden = len(self.hidden_bias) if self.hidden_bias.ndim == 1 else -1
        n, k = len(FEATURE_NAMES), len(GESTURES)
        wanted = {
            "mean": (n,),
            "scale": (n,),
            "hidden_weights": (n, hidden),
            "hidden_bias": (hidden,),
            "output_weights": (hidden, k),
            "output_bias": (k,),
        }
        for name, shape in wanted.items():
            array = getattr(self, name)
            if array.shape != shape or array.dtype != np.float64:
                raise ConfigError(f"gesture model: {name} is {array.dtype} {array.shape}, expected float64 {shape}; {_ADVICE}")
            if not np.isfinite(array).all():
                raise ConfigError(f"gesture model: {name} has non-finite numbers; {_ADVICE}")
        if not (self.scale > 0).all():
            raise ConfigError(f"gesture model: scale has entries that are not positive; {_ADVICE}")
        # Standardisation is linear, so it goes into the hidden layer.
        weights = self.hidden_weights / self.scale[:, None]
        object.__setattr__(self, "_weights", weights)
        object.__setattr__(self, "_bias", self.hidden_bias - self.mean @ weights)

    def probabilities(self, features: NDArray[np.floating]) -> NDArray[np.float64]:
        """Probability of every label.

        Parameters
        ----------
        features : ndarray, shape (..., 13)
            As `extract` gives them.

        Returns
        -------
        ndarray of float64, shape (..., 10)
            Sums to 1 along the last axis.

        Raises
        ------
        DataError
            When a feature is not finite, or there are not thirteen.
        """
        x = np.asarray(features, np.float64)
        if x.shape[-1:] != self.mean.shape:
            raise DataError(f"features has shape {x.shape}, expected (..., {len(self.mean)})")
        if not np.logical_and.reduce(np.isfinite(x), axis=None):
            raise DataError("features has non-finite values")
        hidden = np.dot(x, self._weights)  # for one sample a quarter of the time of @
        hidden += self._bias
        np.maximum(hidden, 0.0, out=hidden)
        score = np.dot(hidden, self.output_weights)
        score += self.output_bias
        score -= np.maximum.reduce(score, axis=-1, keepdims=True)
        np.exp(score, out=score)
        score /= np.add.reduce(score, axis=-1, keepdims=True)
        return np.asarray(score)


def save_model(model: GestureModel, path: str | Path) -> None:
    """Write ``model`` to ``path`` (.npz); the file holds plain arrays and JSON text, no pickles.

    Parameters
    ----------
    model : GestureModel
        What to write.
    path : str or Path
        Target; its folder is made.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    text = {"labels": list(GESTURES), "features": list(FEATURE_NAMES), "settings": dict(model.settings), "figures": dict(model.figures)}
    with path.open("wb") as file:
        np.savez_compressed(
            file, format=np.int64(FORMAT), about=np.array(json.dumps(text)), **{name: getattr(model, name) for name in _ARRAYS}
        )


def load_model(name_or_path: str | Path = "gestures") -> GestureModel:
    """Read a model: a file, or one of ours in ``config/models`` by its bare name.

    Raises
    ------
    ConfigError
        When there is no such file, it is no model, or it is of another version; the message says what to do.
    """
    path = find_config(name_or_path, "models", ".npz")
    try:
        with np.load(path, allow_pickle=False) as file:
            content = {key: file[key] for key in file.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ConfigError(f"{path}: not a gesture model ({error}); {_ADVICE}") from None
    missing = {"format", "about", *_ARRAYS} - content.keys()
    if missing:
        raise ConfigError(f"{path}: not a gesture model: it has no {', '.join(sorted(missing))}; {_ADVICE}")
    if content["format"].shape != () or int(content["format"]) != FORMAT:
        raise ConfigError(f"{path}: model format {content['format']}, but this version of Handwave reads format {FORMAT}; {_ADVICE}")
    about = _read_about(path, content["about"])
    try:
        return GestureModel(**{name: content[name] for name in _ARRAYS}, settings=about["settings"], figures=about["figures"])
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def _read_about(path: Path, text: NDArray[Any]) -> dict[str, Any]:
    try:
        about = json.loads(str(text))
        labels, names = tuple(about["labels"]), tuple(about["features"])
        about["settings"].items(), about["figures"].items()
    except (ValueError, KeyError, TypeError, AttributeError):
        raise ConfigError(f"{path}: not a gesture model: its description cannot be read; {_ADVICE}") from None
    if labels != GESTURES or names != FEATURE_NAMES:
        raise ConfigError(f"{path}: the model was trained for other labels or features; {_ADVICE}")
    return dict(about)
