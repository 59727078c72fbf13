"""Curves: feature maps over time as a vector of fixed length, an alternative to the thirteen features with more detail.

Every frame of the feature maps (thesis, section 7.2) becomes a few signals: where the gates that recede, approach or rest lie beside the
body, how fast, how wide, how many and how strong. The event is then cut into equally long steps of time, and the vector holds every signal
at every step, and some totals. Where the thesis keeps extremes of three signals (section 4.2), this keeps their course.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from radar_core.types import Float64Array
from radar_gestures.event_maps import FAR, EventMaps, join, seen_from_sensor
from radar_gestures.maps import FeatureMaps
from radar_gestures.signals import SIGNALS, CurveConfig, signals

TOTALS: Final[tuple[str, ...]] = ("duration", "log_duration")
"""What stands behind the steps, see `curve_names`."""


def curve_names(config: CurveConfig) -> tuple[str, ...]:
    """Names of the numbers of a vector, in order: every signal at step 0, then at step 1, ..., then the totals.

    ``duration`` [s] is the time from the first to the last frame, ``log_duration`` the logarithm of one second more.
    """
    return (*(f"{signal}_{step:02d}" for step in range(config.steps) for signal in SIGNALS), *TOTALS)


CURVE_NAMES: Final[tuple[str, ...]] = curve_names(CurveConfig())
"""`curve_names` of the defaults; units as in `SIGNALS`."""


def read_curves(
    events: EventMaps, values: Float64Array, config: CurveConfig, start: Float64Array | None = None, end: Float64Array | None = None
) -> Float64Array:
    """Read signals at the steps of each event, shape (n_events, n_features) = `curve_names`, always finite.

    Between frames that know a signal it follows a line; before the first and after the last it stays; where no frame of the event knows it,
    it is 0. ``values``, shape (n_rows, n_signals), are as `signals` gives them; ``start`` and ``end``, shape (n_events,), the first and
    last step from the first frame [s], None: the first and the last frame.
    """
    start = np.zeros(len(events)) if start is None else start
    end = events.duration if end is None else end
    offset = np.arange(len(events)) * FAR
    axis = events.time + offset[events.event]
    ask = start[:, None] + (end - start)[:, None] * np.linspace(0.0, 1.0, config.steps)
    read = np.zeros((len(events), config.steps, values.shape[1]))
    for column, value in enumerate(values.T):
        known = np.flatnonzero(np.isfinite(value))
        bounds = np.searchsorted(known, events.first)
        has = np.flatnonzero(bounds[1:] > bounds[:-1])
        if not len(has):
            continue
        low, high = axis[known[bounds[has]]], axis[known[bounds[has + 1] - 1]]
        at = np.clip(ask[has] + offset[has, None], low[:, None], high[:, None])
        read[has, :, column] = np.interp(at, axis[known], value[known])
    return np.concatenate([read.reshape(len(events), -1), totals(end - start)], axis=1)


def totals(duration: Float64Array) -> Float64Array:
    """Give `TOTALS` of durations [s], shape (n_events, 2)."""
    return np.stack([duration, np.log1p(np.maximum(duration, 0.0))], axis=-1)


class Curves:
    """Turns the feature maps of an event into the vector that a classifier trained on curves takes."""

    def __init__(self, config: CurveConfig | None = None) -> None:
        self._config = config or CurveConfig()
        self.names = curve_names(self._config)

    def process(self, maps: FeatureMaps, body: tuple[float, float, float] | None = None) -> Float64Array:
        """Compute the vector of one event, shape (n_features,) = `names`, always finite; `DataError` when the maps have no frame.

        ``maps`` are of the person, from the event's first to its last frame; ``body`` is the distance [m], azimuth and elevation [rad] of
        the person's middle seen from the sensor, None: found from the maps.
        """
        return np.asarray(self.process_many(join([maps]), None if body is None else seen_from_sensor(body))[0])

    def process_many(self, events: EventMaps, body: Float64Array | None = None) -> Float64Array:
        """Compute the vectors of many events, shape (n_events, n_features); ``body`` as in `signals`."""
        return read_curves(events, signals(events, self._config, body), self._config)
