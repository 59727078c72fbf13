"""Signals of feature maps: where the gates that recede, approach or rest lie beside the body, how fast, how many and how strong."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from radar_core.config import config, knob
from radar_core.types import BoolArray, Float64Array
from radar_gestures.event_maps import PLACES, EventMaps, PersonConfig, beside, locate

_GROUPS: Final[tuple[str, ...]] = ("moving", "receding", "approaching", "still")
_BANDS: Final[int] = 5  # of speed, each way


def _signal_names() -> tuple[str, ...]:
    names: list[str] = []
    for group in _GROUPS:
        if group == "still":  # often a single gate, which has no speed and no spread
            names += [f"{group}_{place}" for place in PLACES[1:]]
        else:
            names += [f"{group}_{place}" for place in PLACES] + [f"{group}_{place}_spread" for place in PLACES]
        names += [f"{group}_count", f"{group}_strength"]
    names += [f"fast_{place}" for place in PLACES] + ["fastest_receding", "fastest_approaching"]
    return (*names, *(f"{way}_band{k}_{what}" for way in _GROUPS[1:3] for k in range(_BANDS) for what in ("strength", "height")))


SIGNALS: Final[tuple[str, ...]] = _signal_names()
"""Signals of one frame.

``GROUP_speed`` [m/s, receding positive], ``GROUP_range``, ``GROUP_side`` (left positive), ``GROUP_height`` [m]: means over the gates of a
group, weighted by the square root of their amplitude; places are counted from the body. ``..._spread``: standard deviations.
``GROUP_count``: log(1 + gates); ``GROUP_strength``: log(1 + sum of the weights). Groups: gates that move, recede, approach, are still.
``fast_...``: means over the moving gates weighted by the squared speed, too. ``fastest_...`` [m/s]: of the outermost gates.
``WAY_bandK_strength`` and ``WAY_bandK_height``: the same of the gates in one band of speed, see `CurveConfig`.
"""


@config
class CurveConfig(PersonConfig):
    """How feature maps become curves."""

    steps: int = knob(14, low=2, high=64, doc="instants at which each signal is read, evenly from the event's first frame to its last")
    slow: float = knob(0.2, unit="m/s", low=0.0, high=10.0, doc="slower gates are still")
    band: float = knob(0.35, unit="m/s", low=0.01, high=10.0, doc="width of a band of speed; five begin at slow, the last is open")


def signals(events: EventMaps, config: CurveConfig, body: Float64Array | None = None) -> Float64Array:
    """Compute the signals of every frame, shape (n_rows, n_signals) = `SIGNALS`; NaN where no gate tells.

    ``body``, shape (n_events, 3), is where each person is, as `locate` gives it; None: found from the maps.
    """
    body = locate(events, config.nearest, config.farthest) if body is None else np.asarray(body, np.float64)
    weight, places = beside(events, config, body)
    receding, approaching = events.speed > config.slow, events.speed < -config.slow
    gates = (receding | approaching, receding, approaching, ~(receding | approaching))
    columns: list[Float64Array] = []
    top = np.maximum.reduceat(np.log1p(weight[:, gates[0]].sum(axis=1)), events.first[:-1]) * config.relative_strength
    for group, own in zip(_GROUPS, gates, strict=True):
        columns += _moments(places[1:], own)[: len(PLACES) - 1] if group == "still" else _moments(places, own)
        columns += [np.log1p((weight[:, own] > 0).sum(axis=1)), _strength(events, weight[:, own], top)]
    speed = places[0][0]
    columns += _moments([(value, own * speed**2) for value, own in places], gates[0])[: len(PLACES)]
    moves = weight[:, gates[0]].any(axis=1)
    for own, edge in ((receding, np.max), (approaching, np.min)):
        outer = edge(np.where(weight[:, own] > 0, speed[:, own], 0.0), axis=1, initial=0.0)
        columns.append(np.where(moves, outer, np.nan))
    for way in (events.speed, -events.speed):
        band = np.minimum((way - config.slow) / config.band, _BANDS - 1)
        for k in range(_BANDS):
            own = (way > config.slow) & (np.floor(band) == k)
            columns += [_strength(events, weight[:, own], top), _mean(*places[-1], own)]
    return np.stack(columns, axis=-1)


def _moments(places: Sequence[tuple[Float64Array, Float64Array]], own: BoolArray) -> list[Float64Array]:
    """Weighted means, then standard deviations, of (value, weight) pairs over some gates; NaN where no weight is."""
    means = [_mean(value, weight, own) for value, weight in places]
    squares = [_mean((x - np.nan_to_num(mean)[:, None]) ** 2, weight, own) for (x, weight), mean in zip(places, means, strict=True)]
    return means + [np.sqrt(square) for square in squares]


def _mean(value: Float64Array, weight: Float64Array, own: BoolArray) -> Float64Array:
    """Weighted mean over some gates, shape (n_rows,); NaN where no weight is."""
    w = weight[:, own]
    total = w.sum(axis=1)
    return np.asarray(np.divide((w * value[:, own]).sum(axis=1), total, out=np.full(len(total), np.nan), where=total > 0))


def _strength(events: EventMaps, weight: Float64Array, top: Float64Array) -> Float64Array:
    """Logarithm of the sum of weights, less the event's ``top``."""
    return np.asarray(np.log1p(weight.sum(axis=1)) - top[events.event])
