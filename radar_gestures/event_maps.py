"""Feature maps of many events, side by side, and where the body is in each."""

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

PLACES: Final[tuple[str, ...]] = ("speed", "range", "side", "height")
"""What is known of a gate: range rate, and where its strongest detection lies beside the body."""
_RANGE_BIN: Final[float] = 0.05  # m
_BODY_WIDTH: Final[float] = 0.25  # m: standard deviation of a body's echoes in range
_BODY_PASSES: Final[tuple[float, ...]] = (1.5, 0.8, 0.6)  # m: the body's side is a mean that leaves out what is farther from the last one
_FARTHEST: Final[float] = 50.0  # m: no gesture is seen from there
FAR: Final[float] = 1e4
"""Sets events apart on one time axis [s]; longer ones are refused."""


@config
class PersonConfig:
    """Which detections are the person's, and what they are counted from."""

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
            raise ConfigError(f"{type(self).__name__}: nearest ({self.nearest:g} m) must be less than farthest ({self.farthest:g} m)")


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
        if not ((self.time >= 0) & (self.time < FAR / 4)).all() or (step < 0).any():
            raise DataError(f"EventMaps.time must not fall within an event, start at 0 or later and end before {FAR / 4:g} s")

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


def beside(events: EventMaps, config: PersonConfig, body: Float64Array) -> tuple[Float64Array, list[tuple[Float64Array, Float64Array]]]:
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


def seen_from_sensor(body: tuple[float, float, float]) -> Float64Array:
    """Turn distance [m], azimuth and elevation [rad] of a body into the place that `locate` gives, shape (1, 3)."""
    distance, azimuth, elevation = body
    return np.array([[distance, distance * np.cos(elevation) * np.sin(azimuth), distance * np.sin(elevation)]])
