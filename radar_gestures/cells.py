"""Cells: the detections of an event's feature maps one by one, for a network that looks at each of them.

Curves (`radar_gestures.curves`) tell where the gates of every frame lie on average. Here every gate of every frame in which something was
detected stands for itself: when it was, how fast, where beside the body, and how strong.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from radar_core.config import config, knob
from radar_core.types import Float64Array, IndexArray
from radar_gestures.curves import TOTALS, totals
from radar_gestures.event_maps import PLACES, EventMaps, PersonConfig, beside, join, locate, seen_from_sensor
from radar_gestures.maps import FeatureMaps

ATTRIBUTES: Final[tuple[str, ...]] = ("there", "when", *PLACES, "strength")
"""What a vector says of each cell.

``there``: 1, or 0 where the event has no more cells; then all else is 0. ``when``: from 0 at the event's first frame to 1 at its last.
``speed`` [m/s, receding positive], ``range``, ``side`` (left positive), ``height`` [m]: of the cell, places counted from the body; 0 where
the sensor does not measure it. ``strength``: decimal logarithm of the amplitude; of the event's strongest cell 0 where
``relative_strength`` says so.
"""


@config
class CellConfig(PersonConfig):
    """How feature maps become cells."""

    cells: int = knob(96, low=1, high=4096, doc="that a vector holds; of an event with more, evenly spread ones are taken")


def cell_names(config: CellConfig) -> tuple[str, ...]:
    """Names of the numbers of a vector, in order: every attribute of cell 0, then of cell 1, ..., then `TOTALS`."""
    return (*(f"cell{number:03d}_{attribute}" for number in range(config.cells) for attribute in ATTRIBUTES), *TOTALS)


def read_cells(
    events: EventMaps, config: CellConfig, body: Float64Array, start: Float64Array | None = None, end: Float64Array | None = None
) -> Float64Array:
    """Read the cells of each event in order of time, shape (n_events, cells, n_attributes), always finite.

    What lies before ``start`` or after ``end``, shape (n_events,) [s from the first frame], is left out; None: the first and the last
    frame. ``body``, shape (n_events, 3), is where each person is, as `locate` gives it.
    """
    start = np.zeros(len(events)) if start is None else start
    end = events.duration if end is None else end
    weight, places = beside(events, config, body)
    row, gate = np.nonzero(weight > 0)
    event = events.event[row]
    length = np.where(end > start, end - start, 1.0)
    when = (events.time[row] - start[event]) / length[event]
    within = (when >= 0.0) & (when <= 1.0)
    row, gate, event, when = row[within], gate[within], event[within], when[within]
    strength = 2.0 * np.log10(weight[row, gate])
    if config.relative_strength:
        strongest = np.full(len(events), -np.inf)
        np.maximum.at(strongest, event, strength)
        strength = strength - strongest[event]
    values = np.stack([np.ones(len(row)), when, *(value[row, gate] for value, _ in places), strength], axis=-1)
    picked, number = _evenly(np.bincount(event, minlength=len(events)), config.cells)
    read = np.zeros((len(events), config.cells, len(ATTRIBUTES)))
    read[event[picked], number] = values[picked]
    return read


def _evenly(count: IndexArray, most: int) -> tuple[IndexArray, IndexArray]:
    """Pick at most so many of the ``count`` items of each event, evenly: their places among all items, and their numbers in the event."""
    first, kept = np.cumsum(count) - count, np.minimum(count, most)
    number = np.arange(kept.sum()) - np.repeat(np.cumsum(kept) - kept, kept)
    event = np.repeat(np.arange(len(count)), kept)
    return first[event] + (2 * number + 1) * count[event] // (2 * kept[event]), number


class Cells:
    """Turns the feature maps of an event into the vector that a network on cells takes."""

    def __init__(self, config: CellConfig | None = None) -> None:
        self._config = config or CellConfig()
        self.names = cell_names(self._config)

    def process(self, maps: FeatureMaps, body: tuple[float, float, float] | None = None) -> Float64Array:
        """Compute the vector of one event, shape (n_features,) = `names`, always finite; parameters and errors as `Curves.process`."""
        return np.asarray(self.process_many(join([maps]), None if body is None else seen_from_sensor(body))[0])

    def process_many(self, events: EventMaps, body: Float64Array | None = None) -> Float64Array:
        """Compute the vectors of many events, shape (n_events, n_features); ``body`` as in `read_cells`, None: found from the maps."""
        body = locate(events, self._config.nearest, self._config.farthest) if body is None else np.asarray(body, np.float64)
        cells = read_cells(events, self._config, body).reshape(len(events), -1)
        return np.concatenate([cells, totals(events.duration)], axis=1)
