"""Curves as the features of a model that runs live, see `radar_gestures.extractors`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core.config import load
from radar_gestures.curves import CurveConfig, Curves
from radar_gestures.stage import SensorView


class CurveFeatures:
    """Makes curves of the feature maps of an event; the body is found in the maps, as in training.

    Parameters
    ----------
    knobs : Any
        Knobs of `CurveConfig` as a mapping; None: the defaults.

    Raises
    ------
    ConfigError
        When a knob makes no sense.
    """

    def __init__(self, knobs: Any) -> None:
        self._curves = Curves(load(CurveConfig, knobs, "curves of the gesture model"))
        self.names = self._curves.names

    def process(self, view: SensorView) -> NDArray[np.float64] | None:
        """See `Extractor`; None: the maps hold no detection."""
        maps = view.maps
        return self._curves.process(maps) if maps is not None and np.isfinite(maps.distance).any() else None
