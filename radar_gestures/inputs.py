"""What networks take of an event: curves, cells, or both."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from radar_core.config import load
from radar_core.types import Float64Array
from radar_gestures.cells import CellConfig, Cells
from radar_gestures.curves import Curves
from radar_gestures.event_maps import EventMaps, join, seen_from_sensor
from radar_gestures.maps import FeatureMaps
from radar_gestures.signals import CurveConfig

Inputs = tuple[CellConfig | CurveConfig, ...]
"""How feature maps become each of the vectors that a network takes, one behind the other."""

KINDS: Final[Mapping[str, type[CellConfig] | type[CurveConfig]]] = {"cells": CellConfig, "curves": CurveConfig}
"""Kinds of inputs, by the name that models and their settings have for them."""

USUAL: Final[Inputs] = tuple(kind() for kind in KINDS.values())
"""Cells and curves, with their defaults."""


def kind_of(config: CellConfig | CurveConfig) -> str:
    """Name the kind, of `KINDS`."""
    return next(name for name, kind in KINDS.items() if isinstance(config, kind))


class InputMaker:
    """Turns the feature maps of an event into the vectors of one or more kinds, one behind the other."""

    def __init__(self, inputs: Inputs) -> None:
        self.makers: Final = tuple(Cells(config) if isinstance(config, CellConfig) else Curves(config) for config in inputs)
        self.names: Final = tuple(name for maker in self.makers for name in maker.names)

    def process(self, maps: FeatureMaps, body: tuple[float, float, float] | None = None) -> Float64Array:
        """Compute the vector of one event, shape (n_features,) = `names`, always finite; parameters and errors as `Curves.process`."""
        return np.asarray(self.process_many(join([maps]), None if body is None else seen_from_sensor(body))[0])

    def process_many(self, events: EventMaps, body: Float64Array | None = None) -> Float64Array:
        """Compute the vectors of many events, shape (n_events, n_features); ``body`` as in `radar_gestures.cells.read_cells`."""
        return np.concatenate([maker.process_many(events, body) for maker in self.makers], axis=1)


def inputs_for(extractor: str, settings: Mapping[str, Any]) -> Inputs:
    """Give what a model names: kinds with ``+`` between them, with the knobs of these names in its settings; errors as `config.load`."""
    return tuple(load(KINDS[name], settings.get(name), f"{name} of the gesture model") for name in extractor.split("+"))


def maker_for(extractor: str, settings: Mapping[str, Any]) -> InputMaker:
    """Make what turns feature maps into what a model names, see `inputs_for`."""
    return InputMaker(inputs_for(extractor, settings))
