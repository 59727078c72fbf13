"""Inner loops of clustering, compiled; each equals its namesake in `radar_tracking.clustering.reference`, where it is described."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

_jit = numba.njit(cache=True, nogil=True)
_ROUNDING = 1e15


@_jit
def _columns(points: Any) -> Any:
    """Coordinates axis by axis, so that the inner loops run over neighbours in memory."""
    n, d = points.shape
    columns = np.empty((d, n))
    for axis in range(d):
        for i in range(n):
            columns[axis, i] = points[i, axis]
    return columns


@_jit
def _squared(columns: Any, i: int, squared: Any) -> None:
    """Squared distances of point ``i`` to all points, into ``squared``."""
    d, n = columns.shape
    squared[:] = 0.0
    for axis in range(d):
        column = columns[axis]
        here = column[i]
        for j in range(n):
            step = column[j] - here
            squared[j] += step * step


@_jit
def _weigh(near: Any, weights: Any) -> float:
    """Total weight of the neighbours of one point; no weights: their number."""
    if len(weights) == 0:
        number = 0
        for j in range(len(near)):
            number += near[j]
        return float(number)
    total = 0.0
    for j in range(len(near)):
        if near[j]:
            total += weights[j]
    return total


@_jit
def grow(near: Any, core: Any) -> Any:
    """Connect core points; see `reference.grow`."""
    n = len(core)
    labels = np.full(n, -1, np.int64)
    left, stack = np.arange(n), np.empty(n, np.int64)
    n_left, label = n, 0
    for seed in range(n):
        if not core[seed] or labels[seed] >= 0:
            continue
        stack[0], size = seed, 1
        while size > 0:
            size -= 1
            row = near[stack[size]]
            kept = 0
            for k in range(n_left):
                point = left[k]
                if row[point]:
                    labels[point] = label
                    if core[point] and point != seed:
                        stack[size] = point
                        size += 1
                else:
                    left[kept] = point
                    kept += 1
            n_left = kept
        label += 1
    return labels


@_jit
def dbscan(points: Any, eps: float, min_points: float, weights: Any) -> Any:
    """DBSCAN by all pairs; see `reference.dbscan`."""
    n = len(points)
    columns = _columns(points)
    near, core, squared = np.empty((n, n), np.bool_), np.empty(n, np.bool_), np.empty(n)
    limit = eps * eps
    for i in range(n):
        _squared(columns, i, squared)
        row = near[i]
        for j in range(n):
            row[j] = squared[j] <= limit
        if not row[i]:  # its distance to itself is not a number
            return np.empty(0, np.int64)
        core[i] = _weigh(row, weights) >= min_points
    return grow(near, core)


@_jit
def polar(distance: Any, azimuth: Any, rate: Any, eps: float, angle_reach: float, demand: Any, weights: Any) -> Any:
    """DBSCAN by ellipses; see `reference.polar`."""
    n = len(distance)
    near, core = np.empty((n, n), np.bool_), np.empty(n, np.bool_)
    for i in range(n):
        for j in range(i, n):
            middle = 0.5 * (distance[i] + distance[j])
            turn = azimuth[j] - azimuth[i]
            turn -= 2 * math.pi * np.rint(turn / (2 * math.pi))
            along = (distance[j] - distance[i]) / eps
            across = middle * turn / max(eps, angle_reach * middle)
            faster = (rate[j] - rate[i]) / eps
            near[i, j] = near[j, i] = along * along + across * across + faster * faster <= 1.0
    for i in range(n):
        core[i] = _weigh(near[i], weights) >= demand[i]
    return grow(near, core)


@_jit
def grid(cells: Any, reach: Any, n_around: int, demand: Any, weights: Any) -> Any:
    """DBSCAN of cells; see `reference.grid`."""
    n = len(cells)
    near, core = np.empty((n, n), np.bool_), np.empty(n, np.bool_)
    for i in range(n):
        for j in range(i, n):
            turn = abs(cells[j, 1] - cells[i, 1])
            turn = min(turn, n_around - turn)
            near[i, j] = near[j, i] = (
                abs(cells[j, 0] - cells[i, 0]) <= max(reach[i, 0], reach[j, 0])
                and turn <= max(reach[i, 1], reach[j, 1])
                and abs(cells[j, 2] - cells[i, 2]) <= max(reach[i, 2], reach[j, 2])
            )
    for i in range(n):
        core[i] = _weigh(near[i], weights) >= demand[i]
    return grow(near, core)


@_jit
def _rounded(value: float) -> float:
    return float(np.rint(value * _ROUNDING) / _ROUNDING)


@_jit
def core_distances(points: Any, min_points: int, max_eps: float, weights: Any) -> Any:
    """Distances to the k-th neighbour by insertion; see `reference.core_distances`."""
    n = len(points)
    columns = _columns(points)
    squared, core = np.empty(n), np.full(n, np.inf)
    nearest, weight = np.empty(min_points), np.empty(min_points)
    for i in range(n):
        _squared(columns, i, squared)
        size = 0
        for j in range(n):
            if size == min_points and not squared[j] < nearest[size - 1]:
                continue
            place = min(size, min_points - 1)
            while place > 0 and nearest[place - 1] > squared[j]:
                nearest[place], weight[place] = nearest[place - 1], weight[place - 1]
                place -= 1
            nearest[place], weight[place] = squared[j], weights[j]
            size = min(size + 1, min_points)
        total = 0.0
        for k in range(size):
            total += weight[k]
            if total >= min_points:
                distance = math.sqrt(nearest[k])
                if distance <= max_eps:
                    core[i] = _rounded(distance)
                break
    return core


@_jit
def order(points: Any, core: Any, max_eps: float) -> Any:
    """Order of OPTICS; see `reference.order`."""
    n = len(points)
    columns = _columns(points)
    squared, reachability = np.empty(n), np.full(n, np.inf)
    predecessor, ordering = np.full(n, -1, np.int64), np.empty(n, np.int64)
    done = np.zeros(n, np.bool_)
    limit = max_eps * max_eps
    for step in range(n):
        best, point = np.inf, -1
        for j in range(n):
            if not done[j] and (point < 0 or reachability[j] < best):
                best, point = reachability[j], j
        done[point], ordering[step] = True, point
        if core[point] == np.inf:
            continue
        _squared(columns, point, squared)
        for j in range(n):
            if not done[j] and squared[j] <= limit:
                reach = _rounded(max(math.sqrt(squared[j]), core[point]))
                if reach < reachability[j]:
                    reachability[j], predecessor[j] = reach, point
    return ordering, reachability, predecessor


@_jit
def cut(ordering: Any, predecessor: Any, candidates: Any, n_parts: int, least: int) -> Any:
    """Cut the tree of predecessors; see `reference.cut`."""
    n = len(ordering)
    labels, below = np.zeros(n, np.int64), np.zeros(n, np.bool_)
    sizes = np.zeros(n_parts, np.int64)
    sizes[0], made = n, 1
    for point in candidates:
        if made == n_parts:
            break
        below[:] = False
        part, size = labels[point], 0
        for later in ordering:
            if labels[later] != part:
                continue
            if later == point or (predecessor[later] >= 0 and below[predecessor[later]]):
                below[later] = True
                size += 1
        if size < least or sizes[part] - size < least:
            continue
        for k in range(n):
            if below[k]:
                labels[k] = made
        sizes[part] -= size
        sizes[made] = size
        made += 1
    return labels, made


@_jit
def lloyd(points: Any, centres: Any, max_iterations: int) -> Any:
    """K-means; see `reference.lloyd`."""
    n, d = points.shape
    k = len(centres)
    centres, labels = centres.copy(), np.full(n, -1, np.int64)
    total, number = np.empty((k, d)), np.empty(k)
    for _ in range(max_iterations):
        changed = False
        total[:], number[:] = 0.0, 0.0
        for i in range(n):
            nearest, best = 0, np.inf
            for c in range(k):
                squared = 0.0
                for axis in range(d):
                    step = points[i, axis] - centres[c, axis]
                    squared += step * step
                if squared < best:
                    nearest, best = c, squared
            changed |= labels[i] != nearest
            labels[i] = nearest
            number[nearest] += 1
            for axis in range(d):
                total[nearest, axis] += points[i, axis]
        if not changed:
            break
        for c in range(k):
            if number[c] > 0:
                for axis in range(d):
                    centres[c, axis] = total[c, axis] / number[c]
    return labels, centres
