"""Compiled loops of the shadows; `oracles.shadows`, among the tests, does the same with numpy.

A triangle with corners v0, v1, v2, seen from the origin, is kept as N0 = v1 x v2 / det, N1 = v2 x v0 / det, N2 = v0 x v1 / det,
det = v0 . (v1 x v2). A direction d meets it if all Nk . d >= 0, at 1 / (G . d) times its length, G = N0 + N1 + N2; a point x lies on its
plane if G . x = 1.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from radar_sim.scatterers import Float64Array

COLUMNS = 13
"""Of a table of triangles: N0, N1, N2, G, least range of a corner [m]."""
NEAR = 12
"""Column of the range."""
_jit = numba.njit(cache=True, nogil=True)
Bools = NDArray[np.bool_]
Int32Array = NDArray[np.int32]
_HALF_PI = 0.5 * math.pi
_ERROR = 4e-6
"""Twice the error of `angle` [rad]."""


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


def prepare(corners: Float64Array, origin: Float64Array, rotation: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
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
        See `COLUMNS`, in the axes of the place.
    box : ndarray, shape (m, 4)
        Least azimuth and elevation, greatest azimuth and elevation of its outline [rad], widened by the error of `angle`. Wrong for a
        triangle around a pole or behind the place: such a one is wide.
    width : ndarray, shape (m,)
        Greater side of the box [rad]; -1: seen edge on, it hides nothing.
    """
    table, box, width = _prepare(corners, origin, rotation)
    return table, box, width


@_jit
def _prepare(corners: Any, origin: Any, rotation: Any) -> Any:
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
        table[i, 12] = 0.0 if math.isnan(near) else math.sqrt(near)
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


def outline(box: Float64Array, order: NDArray[np.int64]) -> tuple[Float64Array, Float64Array]:
    """Find the least and greatest corners (2,) of the rows ``order`` of boxes (m, 4)."""
    low, high = _outline(box, order)
    return low, high


@_jit
def _outline(box: Any, order: Any) -> Any:
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for i in order:
        for k in range(2):
            low[k], high[k] = min(low[k], box[i, k]), max(high[k], box[i, 2 + k])
    return low, high


def sort(
    box: Float64Array, order: NDArray[np.int64], low: Float64Array, cell: float, shape: tuple[int, int]
) -> tuple[Int32Array, Int32Array]:
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
    first, member = _sort(box, order, low, 1.0 / cell, shape[0], shape[1])
    return first, member


@_jit
def _sort(box: Any, order: Any, low: Any, scale: float, n_az: int, n_el: int) -> Any:
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


def behind_raster(
    points: Float64Array,
    table: Float64Array,
    cells: tuple[Int32Array, Int32Array],
    low: Float64Array,
    cell: float,
    shape: tuple[int, int],
    margin: float,
    hidden: Bools,
) -> None:
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
    _behind_raster(points, table, cells[0], cells[1], low, 1.0 / cell, shape[0], shape[1], margin, hidden)


@_jit
def _behind_raster(
    points: Any, table: Any, first: Any, member: Any, low: Any, scale: float, n_az: int, n_el: int, margin: float, hidden: Any
) -> None:
    for i in range(len(points)):
        if hidden[i]:
            continue
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        flat = math.sqrt(x * x + y * y)
        az, el = (angle(y, x) - low[0]) * scale, (angle(z, flat) - low[1]) * scale
        if not (0.0 <= az < n_az and 0.0 <= el < n_el):
            continue
        cell = int(az) * n_el + int(el)
        distance = math.sqrt(flat * flat + z * z)
        for k in range(first[cell], first[cell + 1]):
            j = member[k]
            if table[j, 12] >= distance - margin:
                break  # so are the others
            if _covers(table, j, x, y, z, distance, margin):
                hidden[i] = True
                break


def behind_triangles(points: Float64Array, table: Float64Array, margin: float, hidden: Bools) -> None:
    """Mark in ``hidden`` (n,) the points (n, 3) behind any triangle of a table (m, 13), by ``margin`` [m] at least, in closed form."""
    _behind_triangles(points, table, margin, hidden)


@_jit
def _behind_triangles(points: Any, table: Any, margin: float, hidden: Any) -> None:
    for i in range(len(points)):
        if hidden[i]:
            continue
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        distance = math.sqrt(x * x + y * y + z * z)
        for k in range(len(table)):
            if _covers(table, k, x, y, z, distance, margin):
                hidden[i] = True
                break


def behind_ellipsoids(points: Float64Array, inverse: Float64Array, centre: Float64Array, margin: float, hidden: Bools) -> None:
    """Mark in ``hidden`` (n,) the points (n, 3) behind any ellipsoid, by ``margin`` [m] at least, in closed form.

    A ray x = s p meets ``abs(inverse @ (x - centre)) = 1`` at the smaller root of a quadratic in s. Whoever stands within an ellipsoid sees
    out of it.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        From the place [m].
    inverse, centre : ndarray, shapes (m, 3, 3), (m, 3)
        Of the ellipsoids; centres from the place [m].
    margin : float
        How far behind a point has to be [m].
    hidden : ndarray of bool, shape (n,)
        Those marked already are left alone.
    """
    start = -(inverse @ centre[:, :, None])[..., 0]
    _behind_ellipsoids(points, np.ascontiguousarray(inverse), start, margin, hidden)


@_jit
def _behind_ellipsoids(points: Any, inverse: Any, start: Any, margin: float, hidden: Any) -> None:
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
