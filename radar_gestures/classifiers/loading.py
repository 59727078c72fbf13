"""Reading a model that has to be of one kind, for commands and studies."""

from __future__ import annotations

from pathlib import Path

from radar_core import ConfigError
from radar_gestures.classifiers.model import load_model
from radar_gestures.classifiers.perceptron import GestureModel


def load_perceptron(name_or_path: str | Path = "gestures") -> GestureModel:
    """Read a model that has to be a perceptron; parameters and errors as in `load_model`."""
    model = load_model(name_or_path)
    if not isinstance(model, GestureModel):
        raise ConfigError(f"{name_or_path}: the model takes {model.extractor}, but a perceptron is needed here; name another model")
    return model
