"""Shadows: which points hulls hide from a radar.

A point is hidden when the straight line to it meets a hull at least `MARGIN` before it. Ellipsoids and large triangles are tested in closed
form against each point. The many small triangles of a mesh are first sorted by direction into a raster of azimuth and elevation, and a
point is tested in closed form against those that share its cell: so the raster costs or saves time but does not change what is hidden, and
a slanted surface never hides itself, as it does where one depth per cell is compared.

The margin keeps a surface from hiding itself. Scatterers lie on their hulls to rounding (1e-12 m); between a surface that hides and one
that faces the radar behind it there is solid body, a finger at least. Any margin from a nanometre to millimetres does the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sim.bodies.shadow_kernels import (
    COLUMNS,
    NEAR,
    Int32Array,
    behind_ellipsoids,
    behind_raster,
    behind_triangles,
    outline,
    prepare,
    sort,
)
from radar_sim.scatterers import Ellipsoids, Float64Array, Triangles

MARGIN = 0.001
"""How far behind a hull a point has to be to be hidden [m]."""
_LARGE_CELLS, _LARGE_ANGLE = 24, 0.4
"""A triangle this wide or high, in cells or in rad, is tested against every point: there are few, and in many cells or around a pole."""

_MOST_CELLS = 1_000_000


@dataclass(frozen=True, eq=False)
class _Raster:
    """Small triangles, sorted by direction: see `radar_sim.bodies.shadow_kernels.sort`."""

    table: Float64Array
    cells: tuple[Int32Array, Int32Array]
    low: Float64Array
    cell: float
    shape: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Shadows:
    """What hulls hide from one place; made by `View.look`."""

    view: View
    _inverse: Float64Array
    _centre: Float64Array
    _raster: _Raster | None
    _large: Float64Array

    def visible(self, points: Float64Array) -> NDArray[np.bool_]:
        """Tell which points, shape (n, 3) in ``room`` [m], no hull hides; shape (n,)."""
        away = points - self.view.origin
        hidden = np.zeros(len(points), np.bool_)
        if len(self._centre):
            behind_ellipsoids(away, self._inverse, self._centre, MARGIN, hidden)
        if self._raster is None and not len(self._large):
            return ~hidden
        local, raster = away @ self.view.rotation, self._raster
        if raster is not None:
            behind_raster(local, raster.table, raster.cells, raster.low, raster.cell, raster.shape, MARGIN, hidden)
        if len(self._large):
            behind_triangles(local, self._large, MARGIN, hidden)
        return ~hidden


class View:
    """A place to look from.

    Parameters
    ----------
    origin : ndarray, shape (3,)
        Place in ``room`` [m].
    rotation : ndarray, shape (3, 3)
        Columns are the axes of the sensor frame; azimuths are cut behind it.
    cell : float
        Least width of the raster's cells [rad]; they are not made much narrower than the average triangle either. It changes the time, not
        what is hidden.
    """

    def __init__(self, origin: Float64Array, rotation: Float64Array, cell: float) -> None:
        self.origin, self.rotation, self.cell = origin, np.ascontiguousarray(rotation), cell

    def look(self, hulls: Sequence[Ellipsoids | Triangles]) -> Shadows:
        """Find what hulls hide, whoever they belong to."""
        solids = [hull for hull in hulls if isinstance(hull, Ellipsoids)]
        sheets = [hull.corner for hull in hulls if isinstance(hull, Triangles)]
        axes = np.concatenate([s.axes for s in solids]) if solids else np.empty((0, 3, 3))
        centre = np.concatenate([s.centre for s in solids]) if solids else np.empty((0, 3))
        raster, large = self._sort(np.concatenate(sheets)) if sheets else (None, np.empty((0, COLUMNS)))
        return Shadows(self, np.linalg.inv(axes), centre - self.origin, raster, large)

    def _sort(self, corners: Float64Array) -> tuple[_Raster | None, Float64Array]:
        """Sort small triangles into a raster that just holds them; give large ones back."""
        table, box, width = prepare(corners, self.origin, self.rotation)
        small = (width >= 0.0) & (width < _LARGE_ANGLE)
        if not small.any():
            return None, table[width >= 0.0]
        cell = max(self.cell, 0.5 * float(width[small].mean()))
        small &= width < _LARGE_CELLS * cell
        large = table[(width >= 0.0) & ~small]
        order = np.flatnonzero(small)
        order = order[np.argsort(table[order, NEAR], kind="stable")]  # nearest first: most points then need few tests
        low, high = outline(box, order)
        cell = max(cell, float(np.sqrt((high - low).prod() / _MOST_CELLS)))
        n_az, n_el = (int(n) + 1 for n in (high - low) / cell)
        return _Raster(table, sort(box, order, low, cell, (n_az, n_el)), low, cell, (n_az, n_el)), large
