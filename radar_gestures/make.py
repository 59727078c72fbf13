"""The recogniser that a model works in."""

from __future__ import annotations

from typing import TYPE_CHECKING, Union

from radar_core import RadarInfo
from radar_gestures.classifiers.classifier import Classifier
from radar_gestures.recognizer import GestureRecognizer
from radar_gestures.stage import GestureConfig

if TYPE_CHECKING:
    from radar_gestures.ensemble import EnsembleRecognizer
    from radar_gestures.stream.recognizer import StreamRecognizer

Recognizer = Union[GestureRecognizer, "StreamRecognizer", "EnsembleRecognizer"]


def make_recognizer(config: GestureConfig, model: Classifier, info: RadarInfo | None) -> Recognizer:
    """Make the recogniser that a model works in; parameters and errors as in `GestureRecognizer` and `stream.StreamRecognizer`."""
    if model.extractor not in ("stream", "ensemble"):
        return GestureRecognizer(config, model, None if info is None else info.mount)
    from radar_gestures.classifiers.ensemble import Ensemble

    if isinstance(model, Ensemble):
        from radar_gestures.ensemble import EnsembleRecognizer

        return EnsembleRecognizer(config, model, info)
    from radar_gestures.stream.recognizer import StreamRecognizer  # only here: no other model needs this code

    return StreamRecognizer(config, model, info)
