"""Files of classifiers: plain arrays and JSON in an npz archive."""

from __future__ import annotations

from pathlib import Path

from radar_core import ConfigError
from radar_core.arrays import load_arrays, read_description, save_arrays
from radar_core.paths import find_config
from radar_gestures.classifiers.classifier import Classifier
from radar_gestures.classifiers.perceptron import ADVICE, FORMAT, GestureModel

CURVE_NETWORK = "curve network"
"""Kind of the files of `curve_net.CurveNet`; those of a perceptron name no kind."""


ENROLLED = "enrolled model"
"""Kind of the files of `enrolled.Enrolled`."""
STREAM_NETWORK = "stream network"
"""Kind of the files of `radar_gestures.stream.network.StreamNet`."""
AUTO = "auto"
"""In place of the name of a model: ours, the thirteen features and the networks on streams together."""


def save_model(model: Classifier, path: str | Path) -> None:
    """Write a model to ``path`` (.npz). The same model gives the same bytes; a killed run leaves no half file.

    Raises
    ------
    DataError
        When the file cannot be written.
    """
    save_arrays(Path(path), model.arrays(), "model")


def load_model(name_or_path: str | Path = "gestures") -> Classifier:
    """Read a model of the kind that the file says: a file, or one of ours in ``config/models`` by its bare name.

    A hostile file costs neither memory nor trust, see `load_arrays`.

    Parameters
    ----------
    name_or_path : str or Path
        E.g. ``"gestures"``; `AUTO`: an `Ensemble` of both of ours.

    Raises
    ------
    ConfigError
        When there is no such file, it is no model, or it is of another version; the message says what to do.
    """
    if name_or_path == AUTO:
        from radar_gestures.classifiers.ensemble import Ensemble

        return Ensemble(load_model("gestures"), load_model("stream"))
    path = find_config(name_or_path, "models", ".npz")
    arrays = load_arrays(path, "gesture model", ADVICE)
    try:
        about = read_description(arrays, FORMAT, ADVICE)
        if "kind" not in about:
            return GestureModel.from_arrays(about, arrays)
        if about["kind"] == CURVE_NETWORK:
            from radar_gestures.classifiers.curve_net import CurveNet  # with the code of curves, which no other model needs

            return CurveNet.from_arrays(about, arrays)
        if about["kind"] == ENROLLED:
            from radar_gestures.classifiers.enrolled import Enrolled

            return Enrolled.from_arrays(about, arrays)
        if about["kind"] == STREAM_NETWORK:
            from radar_gestures.stream.network import StreamNet

            return StreamNet.from_arrays(about, arrays)
        raise ConfigError(f"holds a {about['kind']}, which this version of Handwave does not know; {ADVICE}")
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def model_of(name_or_path: str | Path, person: str = "") -> Classifier:
    """Read a model as `load_model`, of the person who is there; `ConfigError` also when it does not know that person. Empty: anybody."""
    model = load_model(name_or_path)
    if not person:
        return model
    from radar_gestures.classifiers.enrolled import Enrolled

    if not isinstance(model, Enrolled):
        raise ConfigError(f"{name_or_path}: nobody is enrolled in this model; handwave gesture enrol does it")
    return model.of(person)
