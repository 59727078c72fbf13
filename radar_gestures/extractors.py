"""From what a sensor saw of an event to the numbers that a classifier takes; every model names the extractor that it was trained with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError
from radar_gestures.features import FEATURE_NAMES
from radar_gestures.stage import SensorView


class Extractor(Protocol):
    """Makes the features of one kind of model.

    Attributes
    ----------
    names : tuple of str
        What the numbers mean, in order.
    """

    names: tuple[str, ...]

    def process(self, view: SensorView) -> NDArray[np.float64] | None:
        """Features of one sensor's view of an event, shape (n_features,) = ``names``; None: it saw too little."""
        ...


class EventFeatures:
    """The thirteen features, which the event stage has made already."""

    names = FEATURE_NAMES

    def process(self, view: SensorView) -> NDArray[np.float64] | None:
        """See `Extractor`."""
        return view.features


def make_extractor(name: str, settings: Mapping[str, Any]) -> Extractor:
    """Make the extractor that a model names.

    Parameters
    ----------
    name : str
        ``"events"``: the thirteen features. ``"curves"``: `radar_gestures.curves`.
    settings : mapping
        Of the model; ``curves`` in it are the knobs of the curves.

    Raises
    ------
    ConfigError
        When there is no such extractor, or its knobs make no sense.
    """
    if name == "events":
        return EventFeatures()
    if name == "curves":
        from radar_gestures.curve_features import CurveFeatures  # with the code of curves, which no other model needs

        return CurveFeatures(settings.get("curves"))
    raise ConfigError(f"the gesture model takes features of the extractor {name!r}; this version of Handwave has events and curves")
