"""The control value: the hand's offset along an axis as a number from 0 to 1."""

from __future__ import annotations

import math

import numpy as np

from radar_core.types import Float64Array
from radar_tracking.hand.config import ValueConfig


class ControlValue:
    """Maps the hand's place to 0..1; small movements either way change nothing (hysteresis), so that a resting hand gives a constant.

    Parameters
    ----------
    config : ValueConfig
        Knobs.
    """

    def __init__(self, config: ValueConfig) -> None:
        self._config = config
        self._origin: Float64Array | None = None
        self._value: float | None = None

    def process(self, hand: Float64Array, body: Float64Array) -> float:
        """Take in where the hand and the body are, shapes (3,) and (3,) in ``room`` [m]; return the value."""
        config = self._config
        if self._origin is None:
            self._origin = hand.copy()
        x, y, z = (hand - (body if config.origin == "body" else self._origin)).tolist()
        if config.axis == "reach":
            x, y, z = (hand - body).tolist()
            start = self._origin - body if config.origin == "start" else np.zeros(3)
            length = math.hypot(x, y) - float(np.hypot(start[0], start[1]))
        else:
            length = z if config.axis == "height" else y
        new = min(max((length - config.low) / (config.high - config.low), 0.0), 1.0)
        last = self._value if self._value is not None else new
        moved = last + max(0.0, new - last - config.hysteresis) - max(0.0, last - new - config.hysteresis)
        self._value = new if new in (0.0, 1.0) else moved
        return self._value
