"""Polygons on the floor: what lies inside, how far away they are, and which are none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError
from radar_core.types import BoolArray, Float64Array

Kind = Literal["counting", "entrance", "exclusion", "boundary"]
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
"""What a zone can be for; the places are the numbers of ``msg/Zone.msg``."""
LOWEST, HIGHEST = -10.0, 10.0  # m: of a zone at any height
_LEAST_AREA: Final = 1e-3  # m^2


@dataclass(frozen=True)
class Area:
    """A polygon on the floor of ``room`` between two heights, and what it is for.

    Attributes
    ----------
    kind : str
        Of `KINDS`.
    corners : tuple of (float, float)
        (x, y) one after the other, either way round [m]; the last is joined to the first.
    z_low, z_high : float
        Heights [m]; both belong to it.

    Raises
    ------
    ConfigError
        When the corners make no polygon: fewer than three, two in one place, sides that cross, or next to no area; or no height is left.
    """

    kind: Kind
    corners: tuple[tuple[float, float], ...]
    z_low: float = LOWEST
    z_high: float = HIGHEST

    def __post_init__(self) -> None:
        refuse_bad_polygon(self.corners)
        if not self.z_low < self.z_high:
            raise ConfigError(f"z_low is {self.z_low:g} m and z_high {self.z_high:g} m; the lower one has to come first")

    @cached_property
    def _sides(self) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
        """Of each side x and y of its lower end, x over y along it, and y of its upper end; the same for both zones that share it."""
        first = np.array(self.corners, np.float64)
        then = np.roll(first, -1, axis=0)
        up = (first[:, 1] <= then[:, 1])[:, None]
        low, high = np.where(up, first, then), np.where(up, then, first)
        with np.errstate(invalid="ignore", divide="ignore"):
            return low[:, 0], low[:, 1], (high[:, 0] - low[:, 0]) / (high[:, 1] - low[:, 1]), high[:, 1]

    def inside(self, points: NDArray[np.floating]) -> BoolArray:
        """Whether positions, shape (..., 2) or (..., 3) in ``room`` [m], lie in it, shape (...); heights count where there are some.

        A place on the side of two neighbours lies in one of them. NaN in x or y lies nowhere; a height that is NaN does not count.
        """
        p = np.asarray(points, np.float64)
        x, y = p[..., 0, None], p[..., 1, None]
        low_x, low_y, slope, high_y = self._sides
        with np.errstate(invalid="ignore"):  # level sides have no slope, and none is asked for
            crossed = ((low_y > y) != (high_y > y)) & (x < low_x + slope * (y - low_y))
        found = np.asarray(crossed.sum(axis=-1) % 2 == 1)
        if p.shape[-1] > 2:
            found &= ~((p[..., 2] < self.z_low) | (p[..., 2] > self.z_high))
        return found

    def distance(self, points: NDArray[np.floating]) -> Float64Array:
        """How far positions, shape (..., 2) or (..., 3) [m], are from its sides on the floor, inside or outside, shape (...) [m].

        NaN for places that are no numbers, and for infinite ones.
        """
        p = np.asarray(points, np.float64)[..., None, :2]
        p = np.where(np.isfinite(p), p, np.nan)
        first = np.array(self.corners)
        side = np.roll(first, -1, axis=0) - first
        along = np.clip(((p - first) * side).sum(axis=-1) / (side**2).sum(axis=-1), 0.0, 1.0)
        away = p - (first + along[..., None] * side)
        return np.asarray(np.hypot(away[..., 0], away[..., 1]).min(axis=-1))

    def text(self) -> str:
        """Write it as `parse_area` reads it, to the micrometre."""
        places = ", ".join(f"{_number(x)} {_number(y)}" for x, y in self.corners)
        return f"{self.kind} {places}; {_number(self.z_low)} {_number(self.z_high)}"


def _number(value: float) -> str:
    return f"{round(value, 6) + 0.0:.10g}"


def parse_area(text: str) -> Area:
    """Read a kind, the corners, and maybe heights: ``exclusion 2 1, 3 1, 3 2`` or ``exclusion 2 1, 3 1, 3 2; 0 1.8``.

    Raises
    ------
    ConfigError
        When it is no such text or the corners make no polygon.
    """
    floor, _, heights = text.partition(";")
    kind, _, places = floor.strip().partition(" ")
    wanted = "write a kind, x and y of each corner, and maybe the heights: 'exclusion 2 1, 3 1, 3 2; 0 1.8'"
    if kind not in KINDS:
        raise ConfigError(f"{text!r} begins with {kind!r}, which is no kind of zone; {wanted}")
    try:
        corners = tuple((float(x), float(y)) for x, y in (place.split() for place in places.split(",")))
        low, high = map(float, heights.split()) if heights.strip() else (LOWEST, HIGHEST)
    except ValueError:
        raise ConfigError(f"{text!r} is no zone; {wanted}") from None
    try:
        return Area(next(known for known in KINDS if known == kind), corners, low, high)
    except ConfigError as error:
        raise ConfigError(f"{text!r}: {error}") from None


def refuse_bad_polygon(corners: Sequence[tuple[float, float]]) -> None:
    """Raise `ConfigError` when corners make no polygon, saying which are the reason."""
    n = len(corners)
    if n < 3:
        raise ConfigError(f"a polygon needs three corners or more, x and y of each in metres; there are {n}")
    for x, y in corners:
        if not (math.isfinite(x) and math.isfinite(y)):
            raise ConfigError(f"the corner ({x:g}, {y:g}) is no place; give finite numbers of metres")
    for i in range(n):
        if corners[i] in corners[:i]:
            raise ConfigError(f"the corner ({corners[i][0]:g}, {corners[i][1]:g}) comes twice; name each once, also the first")
    for i in range(n):
        for j in range(i + 1, n):
            if _crossing(corners, i, j):
                raise ConfigError(
                    f"the side from {_place(corners[i])} to {_place(corners[(i + 1) % n])} meets the one from {_place(corners[j])} to "
                    f"{_place(corners[(j + 1) % n])}; give the corners one after the other, as one walks round the zone"
                )
    if abs(_signed_area(corners)) < _LEAST_AREA:
        raise ConfigError(f"the corners enclose less than {_LEAST_AREA:g} m²; give those of a surface")


def _place(corner: tuple[float, float]) -> str:
    return f"({corner[0]:g}, {corner[1]:g})"


def _signed_area(corners: Sequence[tuple[float, float]]) -> float:
    pairs = zip(corners, (*corners[1:], corners[0]), strict=True)
    return 0.5 * math.fsum(ax * by - bx * ay for (ax, ay), (bx, by) in pairs)


def _crossing(corners: Sequence[tuple[float, float]], i: int, j: int) -> bool:
    """Whether two sides have a place in common, other than the corner of two that follow each other."""
    n = len(corners)
    a, b, c, d = corners[i], corners[(i + 1) % n], corners[j], corners[(j + 1) % n]
    turns = _turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)
    if b == c:  # neighbours: only when the second turns back upon the first
        return turns[1] == 0 and _ahead(b, a, d)
    if d == a:
        return turns[0] == 0 and _ahead(a, b, c)
    if turns[0] * turns[1] < 0 and turns[2] * turns[3] < 0:
        return True
    return any(turn == 0 and _between(*ends) for turn, ends in zip(turns, ((a, c, b), (a, d, b), (c, a, d), (c, b, d)), strict=True))


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> int:
    """Which way one turns from a to b to c: 1 left, -1 right, 0 neither."""
    cross = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return int(cross > 0) - int(cross < 0)


def _ahead(at: tuple[float, float], one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether two places lie in the same direction."""
    return (one[0] - at[0]) * (other[0] - at[0]) + (one[1] - at[1]) * (other[1] - at[1]) > 0


def _between(a: tuple[float, float], p: tuple[float, float], b: tuple[float, float]) -> bool:
    """Whether a place on the line through a and b lies between them."""
    return min(a[0], b[0]) <= p[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= p[1] <= max(a[1], b[1])
