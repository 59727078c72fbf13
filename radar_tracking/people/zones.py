"""Places: what a radar sees, where people can be, where they enter, and where they are counted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, Pose, RadarInfo
from radar_core.config import config, knob
from radar_core.types import BoolArray, Float64Array
from radar_tracking.tracks import Tracks, TrackStatus
from radar_tracking.zones.area import Area, Kind, parse_area

_boxes = partial(knob, unit="m", low=-1e4, high=1e4)
_BOX = 4  # numbers of a box: x_low, x_high, y_low, y_high


@config
class ZonesConfig:
    """Boxes on the floor of ``room``, four numbers each (x_low, x_high, y_low, y_high), one after the other; edges belong to a box."""

    boundaries: tuple[float, ...] = _boxes((), doc="boxes x_low, x_high, y_low, y_high; nobody is outside all of them; empty: everywhere")
    entries: tuple[float, ...] = _boxes((), doc="boxes in which new tracks may begin (doors, and what is seen only later); empty: anywhere")
    settle: float = knob(2.0, unit="s", low=0.0, high=1e6, doc="tracks may begin anywhere so long after the first cloud")
    areas: tuple[str, ...] = knob(
        (), doc="polygons of a zones file that act here: 'exclusion 2 1, 3 1, 3 2; 0 1.8' (kind, x y of each corner; heights), see zones.md"
    )
    walls: tuple[float, ...] = _boxes((), doc="smooth walls, x and y of both ends: they mirror people, see life.reflection_after")
    counted: tuple[str, ...] = knob((), doc="names of zones whose people are counted, e.g. sofa")
    counted_boxes: tuple[float, ...] = _boxes((), doc="one box x_low, x_high, y_low, y_high per name in counted")

    def validate(self) -> None:
        """Raise `ConfigError` when a list does not hold whole boxes, a box or polygon has no area, or names and boxes do not fit."""
        for text in self.areas:
            parse_area(text)
        for name in ("boundaries", "entries", "counted_boxes"):
            _refuse_bad_boxes(name, getattr(self, name))
        if len(self.walls) % _BOX:
            raise ConfigError(f"ZonesConfig.walls has {len(self.walls)} numbers; every wall needs four: x and y of both ends (in metres)")
        boxes = len(self.counted_boxes) // _BOX
        if boxes != len(self.counted):
            names = f"{len(self.counted)} names in counted"
            raise ConfigError(f"ZonesConfig.counted_boxes holds {boxes} boxes for {names}; give four numbers for each name")
        for name in self.counted:
            if not name or self.counted.count(name) > 1:
                raise ConfigError(f"ZonesConfig.counted has {name!r} {'twice' if name else 'as a name'}; give every zone a name of its own")


def _refuse_bad_boxes(name: str, values: tuple[float, ...]) -> None:
    if len(values) % _BOX:
        raise ConfigError(
            f"ZonesConfig.{name} has {len(values)} numbers; every box needs four: x_low, x_high, y_low, y_high (in metres, one box after "
            "the other)"
        )
    for number, (x_low, x_high, y_low, y_high) in enumerate(_rows(values).tolist()):
        if not (x_low < x_high and y_low < y_high):
            raise ConfigError(
                f"ZonesConfig.{name}: box {number} is x {x_low:g} to {x_high:g}, y {y_low:g} to {y_high:g}; each low must be below its "
                "high (the order is x_low, x_high, y_low, y_high)"
            )


def _rows(values: tuple[float, ...]) -> Float64Array:
    """Boxes as rows, shape (n_boxes, 4)."""
    return np.asarray(values, np.float64).reshape(-1, _BOX)


class Zones:
    """Boundaries, entries and counted zones; without a configuration everything is allowed everywhere."""

    def __init__(self, config: ZonesConfig | None = None) -> None:
        self.config = config if config is not None else ZonesConfig()
        self.boundaries = _rows(self.config.boundaries)
        self.entries = _rows(self.config.entries)
        self.counted = _rows(self.config.counted_boxes)
        self._areas: dict[Kind, list[Area]] = {}
        for area in map(parse_area, self.config.areas):
            self._areas.setdefault(area.kind, []).append(area)

    def change(self, config: ZonesConfig) -> None:
        """Work with other zones from now on."""
        Zones.__init__(self, config)

    def inside(self, points: NDArray[np.floating]) -> BoolArray:
        """Whether positions, shape (..., 2) or (..., 3) in ``room`` [m], lie where people can be, shape (...); heights do not matter.

        True everywhere, NaN included, without boundaries; with them, a NaN in x or y lies in no box.
        """
        polygons = self._areas.get("boundary", ())
        if not len(self.boundaries) and not polygons:
            return np.ones(np.shape(points)[:-1], np.bool_)
        floor = np.asarray(points)[..., :2]
        return np.asarray(_in_boxes(floor, self.boundaries).any(axis=-1) | _in_areas(floor, polygons))

    def excluded(self, points: NDArray[np.floating]) -> BoolArray:
        """Whether nothing may begin at places, shape (..., 2) or (..., 3) in ``room`` [m], because a fan or a curtain moves there."""
        return _in_areas(points, self._areas.get("exclusion", ()))

    def may_enter(self, position: NDArray[np.floating], age: float) -> bool:
        """Whether a new track may begin at a place, shape (2,) or (3,) in ``room`` [m], ``age`` [s] after the tracker's first cloud.

        Never outside the boundaries, nor where it is `excluded`. Elsewhere anywhere without entries and during the first ``settle``
        seconds, else in an entry.
        """
        if not bool(self.inside(position)) or bool(self.excluded(position)):
            return False
        entrances = self._areas.get("entrance", ())
        if not (len(self.entries) or entrances) or age <= self.config.settle:
            return True
        return bool(_in_boxes(position, self.entries).any() or _in_areas(np.asarray(position)[:2], entrances))

    def process(self, tracks: Tracks) -> dict[str, int]:
        """Count the people in each counted zone, in the order of ``counted``.

        Tentative tracks count for nobody, coasting ones for somebody. Zones may overlap: whoever stands in two is counted in both.
        """
        people = [track.position for track in tracks.tracks if track.status != TrackStatus.TENTATIVE]
        if not people or not self.config.counted:
            return dict.fromkeys(self.config.counted, 0)
        counts = _in_boxes(np.stack(people), self.counted).sum(axis=0)
        return dict(zip(self.config.counted, map(int, counts), strict=True))


def _in_boxes(points: NDArray[np.floating], boxes: Float64Array) -> BoolArray:
    """Which boxes each position lies in, shape (..., n_boxes); comparisons with NaN are False."""
    p = np.asarray(points, np.float64)
    x, y = p[..., 0, None], p[..., 1, None]
    return np.asarray((x >= boxes[:, 0]) & (x <= boxes[:, 1]) & (y >= boxes[:, 2]) & (y <= boxes[:, 3]))


def _in_areas(points: NDArray[np.floating], areas: Sequence[Area]) -> BoolArray:
    """Whether positions, shape (..., 2) or (..., 3), lie in any of some areas, shape (...)."""
    found = np.zeros(np.shape(points)[:-1], np.bool_)
    for area in areas:
        found |= area.inside(points)
    return found


class View:
    """The part of the room that a radar sees; None: one at the room's origin that sees everything.

    ``origin``, shape (3,), is where it stands in ``room`` [m]; ``range_cell``, ``doppler_cell``: its resolution [m, m/s], 0 where unknown.
    """

    def __init__(self, info: RadarInfo | None = None) -> None:
        self._mount = Pose(z=0.0) if info is None else info.mount
        self._half, self._reach, self.range_cell, self.doppler_cell = (math.inf, math.inf, 0.0, 0.0) if info is None else _bounds(info)
        self.origin = self._mount.origin

    def sees(self, position: Float64Array) -> BoolArray:
        """Whether bodies at positions, shape (n, 3) in ``room`` [m], are in view, shape (n,).

        Elevation does not count, because some part of a body is nearly always within it.
        """
        x, y, z = self._mount.from_room(position).T
        return np.asarray((np.abs(np.arctan2(y, x)) <= self._half) & (x * x + y * y + z * z < self._reach**2))

    def margin(self, position: Float64Array) -> Float64Array:
        """How far positions, shape (n, 3) in ``room`` [m], are from the sides of the view, shape (n,) [m]; negative: outside."""
        if math.isinf(self._half):  # zero times infinity, where somebody is at the sensor's place, would be no distance
            return np.full(len(position), np.inf)
        x, y, _ = self._mount.from_room(position).T
        return np.asarray(np.hypot(x, y) * (self._half - np.abs(np.arctan2(y, x))))


def _bounds(info: RadarInfo) -> tuple[float, float, float, float]:
    """Half the field of view in azimuth [rad], reach and range cell [m], Doppler cell [m/s]; infinite, and zero, where it does not tell."""
    waveform, half = info.waveform, info.array.fov_azimuth / 2
    if waveform.modulation != "fmcw" or waveform.n_sample == 0:
        return half, math.inf, 0.0, 0.0
    return half, waveform.max_range, waveform.range_resolution, waveform.speed_resolution
