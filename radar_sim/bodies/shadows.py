"""Shadows: which points hulls hide from a radar.

A point is hidden when the straight line to it meets a hull at least `MARGIN` before it. Ellipsoids and large triangles are tested in closed
form against each point. The many small triangles of a mesh are first sorted by direction into a raster of azimuth and elevation, and a
point is tested in closed form against those that share its cell: so the raster costs or saves time but does not change what is hidden, and
a slanted surface never hides itself, as it does where one depth per cell is compared.

The margin keeps a surface from hiding itself. Scatterers lie on their hulls to rounding (1e-12 m); between a surface that hides and one
that faces the radar behind it there is solid body, a finger at least. Any margin from a nanometre to millimetres does the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from radar_sim.scatterers import Ellipsoids, Float64Array, Triangles

MARGIN = 0.001
"""How far behind a hull a point has to be to be hidden [m]."""
_LARGE_CELLS, _LARGE_ANGLE = 24, 0.4
"""A triangle this wide or high, in cells or in rad, is tested against every point: there are few, and in many cells or around a pole."""
_MOST_CELLS = 1_000_000
_COLUMNS, _NEAR = 13, 12
"""Of a table of triangles: N0, N1, N2, G, range that no point of it is nearer than [m]; column of the range."""
_HALF_PI = 0.5 * math.pi
_ERROR = 4e-6
"""Twice the error of `angle` [rad]."""
_jit = numba.njit(cache=True, nogil=True)


@dataclass(frozen=True, eq=False)
class _Raster:
    """Small triangles, sorted by direction: see `sort`."""

    table: Float64Array
    cells: tuple[Any, Any]
    low: Float64Array
    cell: float
    shape: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Shadows:
    """What hulls hide from one place; made by `View.look`."""

    view: View
    _inverse: Float64Array
    _start: Float64Array
    _raster: _Raster | None
    _large: Float64Array

    def visible(self, points: Float64Array) -> NDArray[np.bool_]:
        """Tell which points, shape (n, 3) in ``room`` [m], no hull hides; shape (n,)."""
        away = points - self.view.origin
        hidden = np.zeros(len(points), np.bool_)
        if len(self._start):
            behind_ellipsoids(away, self._inverse, self._start, MARGIN, hidden)
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
        raster, large = self._sort(np.concatenate(sheets)) if sheets else (None, np.empty((0, _COLUMNS)))
        inverse = np.linalg.inv(axes)
        return Shadows(self, inverse, -(inverse @ (centre - self.origin)[:, :, None])[..., 0], raster, large)

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
        order = order[np.argsort(table[order, _NEAR], kind="stable")]  # nearest first: most points then need few tests
        low, high = outline(box, order)
        cell = max(cell, float(np.sqrt((high - low).prod() / _MOST_CELLS)))
        n_az, n_el = (int(n) + 1 for n in (high - low) / cell)
        return _Raster(table, sort(box, order, low, cell, (n_az, n_el)), low, cell, (n_az, n_el)), large


@numba.njit(cache=True, nogil=True, inline="always")
def angle(y: float, x: float) -> float:
    """Angle of (x, y) to 2e-6 rad, a small part of a cell, several times faster than the library (Hastings 1955, odd polynomial)."""
    a, b = abs(x), abs(y)
    large = max(a, b)
    t = min(a, b) / large if large > 0.0 else 0.0
    q = t * t
    value = t * (0.99997726 + q * (-0.33262347 + q * (0.19354346 + q * (-0.11643287 + q * (0.05265332 - q * 0.01172120)))))
    if b > a:
        value = _HALF_PI - value
    if x < 0.0:
        value = math.pi - value
    return -value if y < 0.0 else value


@_jit
def prepare(corners: Any, origin: Any, rotation: Any) -> Any:
    """Look at triangles from a place.

    Parameters
    ----------
    corners : ndarray, shape (m, 3, 3)
        In ``room`` [m].
    origin, rotation : ndarray, shapes (3,), (3, 3)
        The place, and its axes as columns.

    Returns
    -------
    table : ndarray, shape (m, 13)
        N0, N1, N2, G and a range that no point of it is nearer than, in the axes of the place.
    box : ndarray, shape (m, 4)
        Least azimuth and elevation, greatest azimuth and elevation of its outline [rad], widened by the error of `angle`. Wrong for a
        triangle around a pole or behind the place: such a one is wide.
    width : ndarray, shape (m,)
        Greater side of the box [rad]; -1: seen edge on, it hides nothing.
    """
    m = len(corners)
    table, box, width = np.empty((m, 13)), np.empty((m, 4)), np.empty(m)
    v = np.empty((3, 3))
    for i in range(m):
        low_az = low_el = near = 1e300
        high_az = high_el = -1e300
        for k in range(3):
            dx, dy, dz = corners[i, k, 0] - origin[0], corners[i, k, 1] - origin[1], corners[i, k, 2] - origin[2]
            x = dx * rotation[0, 0] + dy * rotation[1, 0] + dz * rotation[2, 0]
            y = dx * rotation[0, 1] + dy * rotation[1, 1] + dz * rotation[2, 1]
            z = dx * rotation[0, 2] + dy * rotation[1, 2] + dz * rotation[2, 2]
            v[k, 0], v[k, 1], v[k, 2] = x, y, z
            flat = math.sqrt(x * x + y * y)
            az, el = angle(y, x), angle(z, flat)
            low_az, high_az = min(low_az, az), max(high_az, az)
            low_el, high_el = min(low_el, el), max(high_el, el)
            near = min(near, x * x + y * y + z * z)
        # an edge between equal elevations bulges by up to sin(2 el) width^2 / 16 from them
        pad = _ERROR + (high_az - low_az) ** 2 * (1.0 / 16.0)
        box[i, 0], box[i, 1], box[i, 2], box[i, 3] = low_az - _ERROR, low_el - pad, high_az + _ERROR, high_el + pad
        width[i] = max(box[i, 2] - box[i, 0], box[i, 3] - box[i, 1]) if _planes(v, table[i]) else -1.0
        # its inside may be nearer than its corners, whose nearest is within longest / sqrt(3) of every point of it
        longest = 0.0
        for k in range(3):
            p, q = v[k], v[(k + 1) % 3]
            longest = max(longest, (p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2)
        table[i, 12] = math.sqrt(near - longest / 3.0) if near > longest / 3.0 else 0.0
    return table, box, width


@_jit
def _planes(v: Any, row: Any) -> bool:
    """Fill N0, N1, N2 and G of a triangle; False when it is seen edge on."""
    for k in range(3):
        p, q = v[(k + 1) % 3], v[(k + 2) % 3]
        row[3 * k] = p[1] * q[2] - p[2] * q[1]
        row[3 * k + 1] = p[2] * q[0] - p[0] * q[2]
        row[3 * k + 2] = p[0] * q[1] - p[1] * q[0]
    det = v[0, 0] * row[0] + v[0, 1] * row[1] + v[0, 2] * row[2]
    size = abs(v[0, 0] * row[0]) + abs(v[0, 1] * row[1]) + abs(v[0, 2] * row[2])
    if not abs(det) > 1e-12 * size:
        return False
    for k in range(9):
        row[k] /= det
    for k in range(3):
        row[9 + k] = row[k] + row[3 + k] + row[6 + k]
    return True


@_jit
def outline(box: Any, order: Any) -> Any:
    """Find the least and greatest corners (2,) of the rows ``order`` of boxes (m, 4)."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for i in order:
        for k in range(2):
            low[k], high[k] = min(low[k], box[i, k]), max(high[k], box[i, 2 + k])
    return low, high


@_jit
def sort(box: Any, order: Any, low: Any, cell: float, shape: Any) -> Any:
    """Sort triangles into cells of azimuth and elevation; each into every cell that its box touches.

    Parameters
    ----------
    box : ndarray, shape (m, 4)
        As `prepare` gives them [rad].
    order : ndarray of int64, shape (k,)
        Rows of ``box`` to take, all within the raster, in the order in which the cells are to list them.
    low : ndarray, shape (2,)
        Azimuth and elevation of the raster's corner [rad].
    cell : float
        Width of its cells [rad].
    shape : tuple of int
        Numbers of azimuths and elevations.

    Returns
    -------
    first : ndarray of int32, shape (n_azimuth * n_elevation + 1,)
        Where the members of each cell begin.
    member : ndarray of int32
        Rows of ``box``, cell by cell.
    """
    scale, (n_az, n_el) = 1.0 / cell, shape
    cells = np.empty((len(order), 4), np.int32)
    first = np.zeros(n_az * n_el + 1, np.int32)
    for i in range(len(order)):
        row = box[order[i]]
        for k in range(2):
            n = n_az if k == 0 else n_el
            cells[i, k] = max(int((row[k] - low[k]) * scale), 0)
            cells[i, 2 + k] = min(int((row[2 + k] - low[k]) * scale), n - 1)
        for a in range(cells[i, 0], cells[i, 2] + 1):
            for e in range(cells[i, 1], cells[i, 3] + 1):
                first[a * n_el + e] += 1
    # ends of the cells, from which filling backwards leaves the beginnings
    total = 0
    for k in range(n_az * n_el + 1):
        total += first[k]
        first[k] = total
    member = np.empty(total, np.int32)
    for i in range(len(order) - 1, -1, -1):
        for a in range(cells[i, 0], cells[i, 2] + 1):
            for e in range(cells[i, 1], cells[i, 3] + 1):
                first[a * n_el + e] -= 1
                member[first[a * n_el + e]] = order[i]
    return first, member


@numba.njit(cache=True, nogil=True, inline="always")
def _covers(table: Any, i: int, x: float, y: float, z: float, distance: float, margin: float) -> bool:
    """Whether triangle ``i`` of a table lies in front of a point at that distance."""
    if table[i, 0] * x + table[i, 1] * y + table[i, 2] * z < 0.0 or table[i, 3] * x + table[i, 4] * y + table[i, 5] * z < 0.0:
        return False
    if table[i, 6] * x + table[i, 7] * y + table[i, 8] * z < 0.0:
        return False
    # the plane is at distance / beyond
    beyond = table[i, 9] * x + table[i, 10] * y + table[i, 11] * z
    return bool(beyond * (distance - margin) > distance)


@_jit
def behind_raster(points: Any, table: Any, cells: Any, low: Any, cell: float, shape: Any, margin: float, hidden: Any) -> None:
    """Mark in ``hidden`` (n,) the points (n, 3) behind a triangle that shares their cell of the raster.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        In the axes of the place [m].
    table : ndarray, shape (m, 13)
        As `prepare` gives it.
    cells : tuple of ndarray
        As `sort` gives them, nearest first.
    low, cell, shape
        As `sort` takes them.
    margin : float
        How far behind a point has to be [m].
    hidden : ndarray of bool, shape (n,)
        Those marked already are left alone.
    """
    scale, (n_az, n_el), (first, member) = 1.0 / cell, shape, cells
    for i in range(len(points)):
        if hidden[i]:
            continue
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        flat = math.sqrt(x * x + y * y)
        az, el = (angle(y, x) - low[0]) * scale, (angle(z, flat) - low[1]) * scale
        if not (0.0 <= az < n_az and 0.0 <= el < n_el):
            continue
        at = int(az) * n_el + int(el)
        distance = math.sqrt(flat * flat + z * z)
        for k in range(first[at], first[at + 1]):
            j = member[k]
            if table[j, 12] >= distance - margin:
                break  # so are the others
            if _covers(table, j, x, y, z, distance, margin):
                hidden[i] = True
                break


@_jit
def behind_triangles(points: Any, table: Any, margin: float, hidden: Any) -> None:
    """Mark in ``hidden`` (n,) the points (n, 3) behind any triangle of a table (m, 13), by ``margin`` [m] at least, in closed form."""
    for i in range(len(points)):
        if hidden[i]:
            continue
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        distance = math.sqrt(x * x + y * y + z * z)
        for k in range(len(table)):
            if _covers(table, k, x, y, z, distance, margin):
                hidden[i] = True
                break


@_jit
def behind_ellipsoids(points: Any, inverse: Any, start: Any, margin: float, hidden: Any) -> None:
    """Mark in ``hidden`` (n,) the points (n, 3) behind any ellipsoid, by ``margin`` [m] at least, in closed form.

    A ray x = s p meets ``abs(inverse @ (x - centre)) = 1`` at the smaller root of a quadratic in s. Whoever stands within an ellipsoid sees
    out of it.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        From the place [m].
    inverse, start : ndarray, shapes (m, 3, 3), (m, 3)
        Of the ellipsoids; start is ``-inverse @ centre``, with centres from the place.
    margin : float
        How far behind a point has to be [m].
    hidden : ndarray of bool, shape (n,)
        Those marked already are left alone.
    """
    for i in range(len(points)):
        if hidden[i]:
            continue
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        distance = math.sqrt(x * x + y * y + z * z)
        if distance <= margin:
            continue
        most = 1.0 - margin / distance
        for k in range(len(start)):
            m, q = inverse[k], start[k]
            u = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z
            v = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z
            w = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z
            b = q[0] * u + q[1] * v + q[2] * w
            c = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] - 1.0
            if b >= 0.0 or c <= 0.0:
                continue
            a = u * u + v * v + w * w
            inner = b * b - a * c
            if inner > 0.0 and -b - math.sqrt(inner) < most * a:
                hidden[i] = True
                break
