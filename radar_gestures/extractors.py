"""From what a sensor saw of an event to the numbers that a classifier takes; every model names the extractor that it was trained with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from radar_core import ConfigError
from radar_core.config import load
from radar_core.types import Float64Array
from radar_gestures.features import FEATURE_NAMES
from radar_gestures.stage import SensorView

Extract = Callable[[SensorView], Float64Array | None]
"""Makes the features of one sensor's view of an event, shape (n_features,); None: it saw too little."""


def make_extractor(name: str, settings: Mapping[str, Any]) -> tuple[tuple[str, ...], Extract]:
    """Make the extractor that a model names.

    Parameters
    ----------
    name : str
        ``"events"``: the thirteen features. ``"curves"``: `radar_gestures.curves`.
    settings : mapping
        Of the model; ``curves`` in it are the knobs of the curves.

    Returns
    -------
    names : tuple of str
        What the features mean, in order.
    extract : callable
        See `Extract`.

    Raises
    ------
    ConfigError
        When there is no such extractor, or its knobs make no sense.
    """
    if name == "events":
        return FEATURE_NAMES, lambda view: view.features
    if name == "curves":
        from radar_gestures.curves import CurveConfig, Curves  # only here: no other model needs this code

        curves = Curves(load(CurveConfig, settings.get("curves"), "curves of the gesture model"))
        return curves.names, lambda view: curves.process(view.maps) if view.maps is not None and len(view.maps.stamp_ns) else None
    raise ConfigError(f"the gesture model takes features of the extractor {name!r}; this version of Handwave has events and curves")
