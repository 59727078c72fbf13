"""Reflections of people in walls: tracks that look like one wait longer before they count as a person."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.estimators.measurement_models import wrap
from radar_tracking.people.config import LifeConfig
from radar_tracking.people.track_table import TrackTable

_KNOWN_NS: Final = 300_000_000  # ns: causes have been seen lately
_BEYOND: Final = 0.3  # m: walls are taken to be so much longer on both ends
_ASIDE: Final = 0.2  # rad: reflections are seen so much beside where they are
_SHORT: Final = 1e-6  # m: shorter walls are none


class Reflections:
    """Scores how much each track has lately looked like another one's reflection (``reflection_score`` in the track table).

    One leg of a reflection's way is straight, the other by the wall: it is as far as half of both, in the direction of the person or of the
    mirror image, and between the two where the array cannot tell them apart. Where the walls, four numbers each, x and y of both ends [m],
    are not known, whatever is farther than its cause may be a reflection. In either case it is weaker than its cause, for its range.
    """

    def __init__(self, config: LifeConfig, walls: tuple[float, ...] = ()) -> None:
        self._config = config
        self._walls = np.asarray(walls, np.float64).reshape(-1, 4)
        self.reset()

    def reset(self) -> None:
        """Forget the last cloud."""
        self._stamp_ns = 0

    def process(self, table: TrackTable, centre: Float64Array, origins: Float64Array, stamp_ns: int) -> None:
        """Take in a cloud: where tracks are, shape (n_tracks, 2), and where the sensors stand, shape (n_sensors, 2) [m]."""
        share = 1.0 - math.exp((self._stamp_ns - stamp_ns) * 1e-9 / self._config.reflection_time)
        self._stamp_ns = stamp_ns
        cause = np.flatnonzero(stamp_ns - table.seen_ns <= _KNOWN_NS)
        looks = self._mirrored(centre, cause, origins) if len(self._walls) else self._farther(table, cause)
        alike = (looks & self._weaker(table, cause)).any(axis=1)
        seen = table.seen_ns == stamp_ns
        before = np.where(
            table.matches > 1, table.reflection_score, looks.any(axis=1)
        )  # reflections flash: at first their strength says nothing
        table.reflection_score[seen] = (before * (1 - share) + share * alike)[seen]

    def _weaker(self, table: TrackTable, cause: IndexArray) -> BoolArray:
        """Whether a track is weaker than a cause, for their ranges, shape (n_tracks, n_causes)."""
        mine, theirs = table.records[:, None], table.records[None, cause]
        loud = [part["power"] + 40.0 * np.log10(np.maximum(part["range"], 0.1)) for part in (mine, theirs)]
        return np.asarray(loud[0] < loud[1] - self._config.reflection_weaker)

    def _farther(self, table: TrackTable, cause: IndexArray) -> BoolArray:
        """Whether a track is farther than a cause, shape (n_tracks, n_causes)."""
        distance = table.range
        return np.asarray(distance[:, None] > distance[None, cause] + self._config.reflection_farther)

    def _mirrored(self, centre: Float64Array, cause: IndexArray, origins: Float64Array) -> BoolArray:
        """Whether a track is where a wall mirrors a cause, shape (n_tracks, n_causes)."""
        found = np.zeros((len(centre), len(cause)), bool)
        for origin in origins:
            away = centre - origin
            reach, angle = np.hypot(away[:, 0], away[:, 1]), np.arctan2(away[:, 1], away[:, 0])
            half, turn = detours(away[cause], self._walls - np.tile(origin, 2))
            # from the direction of the cause to that of its image, and a little beyond both
            step = wrap(angle[:, None] - angle[None, cause])[..., None] * np.sign(turn)
            between = (step > -_ASIDE) & (step < np.abs(turn) + _ASIDE)
            found |= (between & (np.abs(reach[:, None, None] - half) < self._config.reflection_depth)).any(axis=2)
        return found


def detours(place: Float64Array, walls: Float64Array) -> tuple[Float64Array, Float64Array]:
    """How much farther, and in which direction, walls make a sensor at the origin see bodies.

    Bodies on the floor plane have shape (n, 2), walls, x and y of both ends, shape (n_walls, 4) [m]. Gives half the way there by the wall
    and back straight [m], NaN where that wall does not mirror that body, and the azimuth of the mirror image beyond that of the body [rad],
    shape (n, n_walls) each.
    """
    start, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    length = np.hypot(along[:, 0], along[:, 1])
    along = along / np.maximum(length, _SHORT)[:, None]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    height, own = ((place[:, None] - start) * normal).sum(-1), -(start * normal).sum(-1)
    image = place[:, None] - 2.0 * height[..., None] * normal
    with np.errstate(invalid="ignore", divide="ignore"):  # who stands in a wall has no reflection
        bounce = image * (own / (own + height))[..., None]
        at = ((bounce - start) * along).sum(-1)
        real = (length >= _SHORT) & (own * height > 0) & (at > -_BEYOND) & (at < length + _BEYOND)
    half = 0.5 * (np.hypot(place[:, 0], place[:, 1])[:, None] + np.hypot(image[..., 0], image[..., 1]))
    turn = wrap(np.arctan2(image[..., 1], image[..., 0]) - np.arctan2(place[:, 1], place[:, 0])[:, None])
    return np.where(real, half, np.nan), turn
