"""Curves: feature maps over time as a vector of fixed length, an alternative to the thirteen features with more detail.

Every frame of the feature maps (thesis, section 7.2) becomes a few signals: where the gates that recede, approach or rest lie beside the
body, how fast, how wide, how many and how strong. The event is then cut into equally long steps of time, and the vector holds every signal
at every step, and some totals. Where the thesis keeps extremes of three signals (section 4.2), this keeps their course.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError
from radar_core.config import config, knob
from radar_core.types import BoolArray, Float32Array, Float64Array, IndexArray
from radar_gestures.maps import FeatureMaps

_GROUPS: Final[tuple[str, ...]] = ("moving", "receding", "approaching", "still")
PLACES: Final[tuple[str, ...]] = ("speed", "range", "side", "height")
"""What is known of a gate: range rate, and where its strongest detection lies beside the body."""
TOTALS: Final[tuple[str, ...]] = ("duration", "log_duration")
"""What stands behind the steps, see `curve_names`."""
_BANDS: Final[int] = 5  # of speed, each way
_RANGE_BIN: Final[float] = 0.05  # m
_BODY_WIDTH: Final[float] = 0.25  # m: standard deviation of a body's echoes in range
_BODY_PASSES: Final[tuple[float, ...]] = (1.5, 0.8, 0.6)  # m: the body's side is a mean that leaves out what is farther from the last one
_FARTHEST: Final[float] = 50.0  # m: no gesture is seen from there
_FAR: Final[float] = 1e4  # s: sets events apart on one time axis; longer ones are refused


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
class CurveConfig:
    """How feature maps become curves."""

    steps: int = knob(14, low=2, high=64, doc="instants at which each signal is read, evenly from the event's first frame to its last")
    slow: float = knob(0.2, unit="m/s", low=0.0, high=10.0, doc="slower gates are still")
    band: float = knob(0.35, unit="m/s", low=0.01, high=10.0, doc="width of a band of speed; five begin at slow, the last is open")
    nearest: float = knob(0.0, unit="m", low=0.0, high=20.0, doc="least distance of people who gesture; nearer bodies are ignored")
    farthest: float = knob(50.0, unit="m", low=0.1, high=1e3, doc="largest distance of people who gesture; farther bodies are ignored")
    reach: float = knob(1.0, unit="m", low=0.1, high=10.0, doc="detections that much nearer or farther than the body are not the person's")
    side: float = knob(0.9, unit="m", low=0.1, high=10.0, doc="detections that far to the left or right of the body are not the person's")
    height: float = knob(1.6, unit="m", low=0.1, high=10.0, doc="detections that far above or below the sensor are not the person's")
    relative_height: bool = knob(True, doc="count heights from the body's middle; otherwise from the sensor")
    relative_strength: bool = knob(True, doc="strengths are relative to the event's strongest frame: they do not tell the distance")

    def validate(self) -> None:
        """Raise `ConfigError` when nobody could stand anywhere."""
        if self.nearest >= self.farthest:
            raise ConfigError(f"CurveConfig: nearest ({self.nearest:g} m) must be less than farthest ({self.farthest:g} m)")


def curve_names(config: CurveConfig) -> tuple[str, ...]:
    """Names of the numbers of a vector, in order: every signal at step 0, then at step 1, ..., then the totals.

    ``duration`` [s] is the time from the first to the last frame, ``log_duration`` the logarithm of one second more.
    """
    return (*(f"{signal}_{step:02d}" for step in range(config.steps) for signal in SIGNALS), *TOTALS)


CURVE_NAMES: Final[tuple[str, ...]] = curve_names(CurveConfig())
"""`curve_names` of the defaults; units as in `SIGNALS`."""


@dataclass(frozen=True, eq=False)
class EventMaps:
    """The feature maps of many events, one after the other.

    Attributes
    ----------
    first : ndarray of int64, shape (n_events + 1,)
        Rows of event i: ``first[i]`` to ``first[i + 1]``; every event has at least one.
    time : ndarray of float64, shape (n_rows,)
        Of each frame, from the event's first one [s]; ascending.
    speed : ndarray of float32, shape (n_speed,)
        Middle of each Doppler gate [m/s].
    maps : ndarray of float32, shape (4, n_rows, n_speed)
        SNR [dB], azimuth, elevation [rad], distance [m] of the strongest detection of each gate; distance is NaN where nothing was
        detected, an angle where the sensor does not measure it.
    """

    first: IndexArray
    time: Float64Array
    speed: Float32Array
    maps: Float32Array

    def __post_init__(self) -> None:
        n = len(self.time)
        if self.maps.shape != (4, n, len(self.speed)):
            raise DataError(f"EventMaps.maps has shape {self.maps.shape}, expected {(4, n, len(self.speed))}")
        if self.first.ndim != 1 or not len(self.first) or self.first[0] != 0 or self.first[-1] != n or (np.diff(self.first) < 1).any():
            raise DataError(f"EventMaps.first must rise from 0 to the number of rows ({n}), with a row for every event")
        step = np.diff(self.time)
        step[self.first[1:-1] - 1] = 0.0
        if not ((self.time >= 0) & (self.time < _FAR / 4)).all() or (step < 0).any():
            raise DataError(f"EventMaps.time must not fall within an event, start at 0 or later and end before {_FAR / 4:g} s")

    def __len__(self) -> int:
        return len(self.first) - 1

    @property
    def event(self) -> IndexArray:
        """Event of each row, shape (n_rows,)."""
        return np.repeat(np.arange(len(self)), np.diff(self.first))

    @property
    def duration(self) -> Float64Array:
        """From first to last frame, shape (n_events,) [s]."""
        return np.asarray(self.time[self.first[1:] - 1] - self.time[self.first[:-1]])

    def select(self, index: NDArray[np.integer]) -> EventMaps:
        """Keep the events that an index array picks, in its order."""
        length = np.diff(self.first)[index]
        first = np.concatenate([[0], np.cumsum(length)])
        rows = np.arange(first[-1]) + np.repeat(self.first[:-1][index] - first[:-1], length)
        return EventMaps(first, self.time[rows], self.speed, self.maps[:, rows])


def join(events: Sequence[FeatureMaps]) -> EventMaps:
    """Put the maps of events one after the other.

    Raises
    ------
    DataError
        When there is no event, one has no frame, or their gates differ.
    """
    if not events or any(len(maps.stamp_ns) == 0 for maps in events):
        raise DataError("curves need the feature maps of at least one event, and at least one frame of each")
    speed = events[0].speed
    if any(maps.speed.shape != speed.shape or (maps.speed != speed).any() for maps in events[1:]):
        raise DataError("these feature maps have different Doppler gates; make all with the same knobs")
    first = np.cumsum([0, *(len(maps.stamp_ns) for maps in events)])
    time = np.concatenate([(maps.stamp_ns - maps.stamp_ns[0]) * 1e-9 for maps in events])
    layers = [np.concatenate([getattr(maps, name) for maps in events]) for name in ("micro_doppler", "azimuth", "elevation", "distance")]
    return EventMaps(first.astype(np.int64), time, speed, np.stack(layers))


def locate(events: EventMaps, nearest: float = 0.0, farthest: float = 50.0) -> Float64Array:
    """Find the body in each event: the range at which most is detected, and the middle of what is there.

    Bodies are looked for between the ranges ``nearest`` and ``farthest`` [m].

    Returns
    -------
    ndarray of float64, shape (n_events, 3) = (range, side, height) [m]
        Seen from the sensor: side left positive, height up positive. 0 where nothing was detected; side and height also where the sensor
        does not measure them.
    """
    from scipy.ndimage import gaussian_filter1d

    weight, distance, side, height = _cells(events)
    event = np.broadcast_to(events.event[:, None], weight.shape)
    n, n_bins = len(events), 1 + int(np.nanmax(np.where(weight > 0, distance, 0.0), initial=0.0) / _RANGE_BIN)
    seen = weight > 0
    # Amplitudes fall with the square of range, and the body is where most echoes are, not where the strongest is.
    bins = np.minimum(distance[seen] / _RANGE_BIN, n_bins - 1).astype(np.int64)
    count = np.bincount(event[seen] * n_bins + bins, weight[seen] * distance[seen] ** 2, minlength=n * n_bins).reshape(n, n_bins)
    smooth = gaussian_filter1d(count, _BODY_WIDTH / _RANGE_BIN, axis=1, mode="constant")
    smooth[:, : int(nearest / _RANGE_BIN)] = 0.0
    smooth[:, int(farthest / _RANGE_BIN) + 1 :] = 0.0
    body = np.zeros((n, 3))
    body[:, 0] = np.where(smooth.any(axis=1), (smooth.argmax(axis=1) + 0.5) * _RANGE_BIN, 0.0)
    near = seen & (np.abs(distance - body[event, 0]) < 0.8)
    for reach in _BODY_PASSES:
        body[:, 1] = _mean_of(event, weight, side, near & (np.abs(side - body[event, 1]) < reach), n)
    body[:, 2] = _mean_of(event, weight, height, near & (np.abs(side - body[event, 1]) < _BODY_PASSES[1]), n)
    return body


def _mean_of(event: IndexArray, weight: Float64Array, value: Float64Array, mask: BoolArray, n: int) -> Float64Array:
    """Weighted mean of the masked values of each event, shape (n,); 0 where there is none."""
    mask = mask & np.isfinite(value)
    total = np.bincount(event[mask], weight[mask], minlength=n)
    moment = np.bincount(event[mask], weight[mask] * value[mask], minlength=n)
    return np.divide(moment, total, out=np.zeros(n), where=total > 0)


def _cells(events: EventMaps) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Weight, distance, side and height [m] of every cell, shape (n_rows, n_speed) each; weight 0 where nothing was detected."""
    snr, azimuth, elevation, distance = events.maps.astype(np.float64)
    seen = (distance >= 0) & (distance < _FARTHEST) & ~np.isnan(snr)  # false where there is no distance
    weight = np.where(seen, 10.0 ** (np.clip(np.where(seen, snr, 0.0), -200.0, 200.0) / 40.0), 0.0)
    distance = np.where(seen, distance, np.nan)
    azimuth, elevation = (np.where(np.isfinite(angle), angle, np.nan) for angle in (azimuth, elevation))
    ground = distance * np.cos(np.where(np.isnan(elevation), 0.0, elevation))
    return weight, distance, ground * np.sin(azimuth), distance * np.sin(elevation)


def signals(events: EventMaps, config: CurveConfig, body: Float64Array | None = None) -> Float64Array:
    """Compute the signals of every frame, shape (n_rows, n_signals) = `SIGNALS`; NaN where no gate tells.

    ``body``, shape (n_events, 3), is where each person is, as `locate` gives it; None: found from the maps.
    """
    body = locate(events, config.nearest, config.farthest) if body is None else np.asarray(body, np.float64)
    weight, places = _beside(events, config, body)
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


def _beside(events: EventMaps, config: CurveConfig, body: Float64Array) -> tuple[Float64Array, list[tuple[Float64Array, Float64Array]]]:
    """Weight of every cell, 0 where it is not the person's, shape (n_rows, n_speed); for each of `PLACES` its value and own weight."""
    weight, distance, side, height = _cells(events)
    place = body[events.event]
    distance, side = distance - place[:, :1], side - place[:, 1:2]
    apart = (np.abs(distance) > config.reach) | (np.abs(side) > config.side) | (np.abs(height) > config.height)
    weight = np.where(apart, 0.0, weight)
    if config.relative_height:
        height = height - place[:, 2:]
    speed = np.broadcast_to(events.speed.astype(np.float64), weight.shape)
    return weight, [(np.where(np.isfinite(x), x, 0.0), weight * np.isfinite(x)) for x in (speed, distance, side, height)]


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
    offset = np.arange(len(events)) * _FAR
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
    totals = np.stack([end - start, np.log1p(np.maximum(end - start, 0.0))], axis=-1)
    return np.concatenate([read.reshape(len(events), -1), totals], axis=1)


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
        return np.asarray(self.process_many(join([maps]), None if body is None else _seen_from_sensor(body))[0])

    def process_many(self, events: EventMaps, body: Float64Array | None = None) -> Float64Array:
        """Compute the vectors of many events, shape (n_events, n_features); ``body`` as in `signals`."""
        return read_curves(events, signals(events, self._config, body), self._config)


def _seen_from_sensor(body: tuple[float, float, float]) -> Float64Array:
    distance, azimuth, elevation = body
    return np.array([[distance, distance * np.cos(elevation) * np.sin(azimuth), distance * np.sin(elevation)]])
