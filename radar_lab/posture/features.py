"""What a sparse cloud says about a person's posture: where their points are and how fast, now and lately, seen along the line of sight."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from radar_core import ConfigError, DataError
from radar_core.config import config, knob
from radar_core.types import Float64Array, IndexArray
from radar_tracking.tracks import Track, TrackedCloud

_QUANTILES: Final = (0.0, 0.1, 0.5, 0.9, 1.0)  # symmetric, so that mirroring turns their order round
_CHANNELS: Final = 4  # number of points, sums of their range rates, of the magnitudes, of how far they are behind the body
_FASTEST: Final = 20.0  # m/s: no limb is faster; what is counts as this
_LEAST: Final = 1e-3  # m: a person at the very place of the sensor has no line of sight


@config
class PostureFeatureConfig:
    """How a person's points become numbers; a model holds the configuration that it was trained with."""

    reach: float = knob(1.2, unit="m", low=0.1, high=3.0, doc="largest horizontal distance of a point from the body")
    across: float = knob(0.9, unit="m", low=0.1, high=3.0, doc="the grid reaches this far to both sides of the body")
    low: float = knob(0.2, unit="m", low=-10.0, high=10.0, doc="height of the grid's lower edge above the floor")
    high: float = knob(2.2, unit="m", low=-10.0, high=10.0, doc="height of the grid's upper edge above the floor")
    columns: int = knob(5, low=2, high=64, doc="cells of the grid across")
    rows: int = knob(5, low=2, high=64, doc="cells of the grid up")
    history: tuple[float, ...] = knob(
        (0.2, 0.5, 1.5), unit="s", low=1e-3, high=60.0, doc="time constants of the averages of the past that stand beside the newest cloud"
    )

    def validate(self) -> None:
        """Raise `ConfigError` when the grid is empty or the history does not grow."""
        if self.low >= self.high:
            raise ConfigError(f"PostureFeatureConfig.low = {self.low:g} m is not below high = {self.high:g} m; make the grid taller")
        if any(a >= b for a, b in pairwise(self.history)):
            raise ConfigError(f"PostureFeatureConfig.history is {self.history}; give different times in growing order")

    @property
    def n_now(self) -> int:
        """Numbers that one cloud gives."""
        return _CHANNELS * self.rows * self.columns + 1 + 3 * len(_QUANTILES)

    @property
    def n_features(self) -> int:
        """Numbers in all: of the newest cloud and of every average."""
        return self.n_now * (1 + len(self.history))


@dataclass(frozen=True, eq=False)
class BodyFrame:
    """A person's own axes: away from the sensor, to the left as the sensor sees it, up from the floor."""

    place: Float64Array  # origin in ``room``: the body on the floor plane, z = 0; shape (3,) [m]
    axes: Float64Array  # rows: the unit vectors of the axes in ``room``; shape (3, 3)

    @classmethod
    def of(cls, body: Float64Array, origin: Float64Array) -> BodyFrame:
        """Make it of where the body and the sensor are in ``room``, shapes (3,) and (3,) [m]."""
        x, y = (body[:2] - origin[:2]).tolist()
        far = math.hypot(x, y)
        c, s = (x / far, y / far) if far > _LEAST else (1.0, 0.0)
        return cls(np.array([body[0], body[1], 0.0]), np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))

    def to_own(self, position: Float64Array) -> Float64Array:
        """Turn places in ``room``, shape (..., 3), into (away, left, up) [m]."""
        return np.asarray((position - self.place) @ self.axes.T)

    def to_room(self, own: Float64Array) -> Float64Array:
        """Turn (away, left, up), shape (..., 3), into places in ``room`` [m]."""
        return np.asarray(own @ self.axes + self.place)

    def std_in_room(self, std: Float64Array) -> Float64Array:
        """Turn standard deviations along the own axes, shape (..., 3), into those along the room's [m]."""
        return np.asarray(np.sqrt(std**2 @ self.axes**2))


@dataclass(frozen=True, eq=False)
class Seen:
    """One person as one cloud shows them."""

    track: Track  # of the person
    frame: BodyFrame  # their axes
    n_points: int  # points of the cloud that are theirs
    features: Float64Array  # what the cloud and the ones before say, shape (n_features,)


class PostureFeatures:
    """Makes features of every person's points and remembers what it needs of the past, by track."""

    def __init__(self, config: PostureFeatureConfig) -> None:
        self.config = config
        self.reset()

    def reset(self) -> None:
        """Forget everything. For a new recording."""
        self._past: dict[int, Float64Array] = {}
        self._stamp_ns: int | None = None

    def process(self, tracked: TrackedCloud, origin: Float64Array) -> tuple[Seen, ...]:
        """Take in one cloud with its tracks, in ``room``, not older than the one before, seen from a sensor at ``origin``, shape (3,) [m].

        Gives confirmed people who have had a point since they appeared, in the order of their tracks. Raises `DataError` when the cloud is
        not in ``room``, older than the one before, or a position, a range rate or a track is infinite.
        """
        cloud = tracked.cloud
        if cloud.frame_id != "room":
            raise DataError(f"postures need clouds in 'room', this one is in {cloud.frame_id!r}; use PointCloud.to_room")
        if self._stamp_ns is not None and cloud.stamp_ns < self._stamp_ns:
            raise DataError(f"cloud {cloud.sequence} is older than the one before; reset() before another recording")
        for name in ("x", "y", "z", "radial_speed"):
            if np.isinf(getattr(cloud, name)).any():
                raise DataError(f"PointCloud.{name} of cloud {cloud.sequence} is infinite; give NaN for what was not measured")
        dt = 0.0 if self._stamp_ns is None else (cloud.stamp_ns - self._stamp_ns) * 1e-9
        self._stamp_ns = cloud.stamp_ns
        people = list(tracked.tracks.people)
        found = [seen for track in people if (seen := self._look(tracked, track, origin, dt)) is not None]
        self._past = {seen.track.id: self._past[seen.track.id] for seen in found}
        return tuple(found)

    def _look(self, tracked: TrackedCloud, track: Track, origin: Float64Array, dt: float) -> Seen | None:
        """Look at one person; None: there has never been a point."""
        if not np.isfinite(track.position).all():
            raise DataError(f"Track.position of track {track.id} is not finite: {track.position}")
        frame = BodyFrame.of(track.position, origin)
        own, rate = _points(tracked, track, frame, self.config.reach)
        past = self._past.get(track.id)
        if past is None and not len(own):
            return None
        now = self._now(own, rate, None if past is None else past[0])
        if past is None:
            past = np.tile(now, (1 + len(self.config.history), 1))
        else:
            share = -np.expm1(-dt / np.array(self.config.history))  # of the way to the newest
            past = np.vstack([now, past[1:] + (now - past[1:]) * share[:, None]])
        self._past[track.id] = past
        return Seen(track, frame, len(own), past.ravel())

    def _now(self, own: Float64Array, rate: Float64Array, last: Float64Array | None) -> Float64Array:
        """Describe one person's points, shape (n_now,); without any, the quantiles stay what they were."""
        grid = _grid(own, rate, self.config)
        if len(own):
            spread = np.quantile(own, _QUANTILES, axis=0).T.ravel()
        else:
            assert last is not None
            spread = last[-3 * len(_QUANTILES) :]
        return np.concatenate([grid, [math.log1p(len(own))], spread])


def mirror(features: Float64Array, config: PostureFeatureConfig) -> Float64Array:
    """Give the features of the mirrored person (left and right changed), shape (..., n_features)."""
    index, sign = _mirror_of(config)
    return np.asarray(features[..., index] * sign)


def _mirror_of(config: PostureFeatureConfig) -> tuple[IndexArray, Float64Array]:
    """Which feature takes whose place, and with which sign; both of shape (n_features,)."""
    cells = np.arange(_CHANNELS * config.rows * config.columns).reshape(_CHANNELS, config.rows, config.columns)
    spread = cells.size + 1 + np.arange(3 * len(_QUANTILES)).reshape(3, -1)  # rows: away, left, up
    spread[1] = spread[1, ::-1]
    sign = np.ones(config.n_now)
    sign[spread[1]] = -1.0
    once = np.concatenate([cells[:, :, ::-1].ravel(), [cells.size], spread.ravel()])
    blocks = 1 + len(config.history)
    return (once + config.n_now * np.arange(blocks)[:, None]).ravel(), np.tile(sign, blocks)


def _points(tracked: TrackedCloud, track: Track, frame: BodyFrame, reach: float) -> tuple[Float64Array, Float64Array]:
    """Pick the person's points and nobody's within reach: places in their axes, shape (n, 3) [m], and range rates, shape (n,) [m/s]."""
    cloud, owner = tracked.cloud, tracked.tracks.point_track_id
    position = cloud.position.astype(np.float64)
    far = np.hypot(position[:, 0] - frame.place[0], position[:, 1] - frame.place[1])
    usable = ((owner == track.id) | (owner == -1)) & (far <= reach) & np.isfinite(position[:, 2])  # NaN compares False
    rate = np.nan_to_num(cloud.radial_speed[usable].astype(np.float64))
    return frame.to_own(position[usable]), np.clip(rate, -_FASTEST, _FASTEST)


def _grid(own: Float64Array, rate: Float64Array, config: PostureFeatureConfig) -> Float64Array:
    """Share every point among the four cells around it (bilinear), shape (4 * rows * columns,), see `_CHANNELS`."""
    column, right = _share(own[:, 1], -config.across, config.across, config.columns)
    row, upper = _share(own[:, 2], config.low, config.high, config.rows)
    corner = row * config.columns + column
    cell = np.concatenate([corner, corner + 1, corner + config.columns, corner + config.columns + 1])
    share = np.concatenate([(1 - upper) * (1 - right), (1 - upper) * right, upper * (1 - right), upper * right])
    n = config.rows * config.columns
    weights = (np.ones(len(rate)), rate, np.abs(rate), own[:, 0])
    return np.concatenate([np.bincount(cell, share * np.tile(weight, 4), minlength=n) for weight in weights])


def _share(value: Float64Array, low: float, high: float, n: int) -> tuple[IndexArray, Float64Array]:
    """Lower of the two cells around each value, and the share of the upper one; what is outside belongs to the cell at the edge."""
    place = np.clip((value - low) / (high - low) * n - 0.5, 0.0, n - 1.0)
    lower = np.minimum(place.astype(np.int64), n - 2)
    return lower, place - lower
