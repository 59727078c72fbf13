"""Points spread evenly over ellipsoids."""

from __future__ import annotations

import math

import numpy as np

from radar_sim.scatterers import Float64Array

_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
_GRID = 96
"""Latitudes and longitudes of the table of areas; the areas of points are then good to 0.1 %."""


def sphere(n: int) -> Float64Array:
    """Fibonacci lattice: n unit vectors, shape (n, 3), each for the same area (Gonzalez 2010)."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / max(n, 1)
    angle = _GOLDEN * np.arange(n)
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], -1)


def stretch(unit: Float64Array, half: Float64Array) -> Float64Array:
    """Area of an ellipsoid's surface over that of the unit sphere there, shape (n,), for half axes (3,) and unit vectors (n, 3)."""
    ratio: Float64Array = half.prod() * np.sqrt(((unit / half) ** 2).sum(-1))
    return ratio


def spread(half: Float64Array, n: int, twist: float = 0.0) -> tuple[Float64Array, Float64Array]:
    """Lay a Fibonacci lattice on an ellipsoid, warped so that every point stands for the same area.

    Parameters
    ----------
    half : ndarray, shape (3,)
        Half axes [m].
    n : int
        Number of points.
    twist : float
        Turns the lattice about its poles, which lie on the third axis [rad].

    Returns
    -------
    tuple of ndarray of float64
        Unit vectors u, shape (n, 3), of the points ``half * u``, and the area of each, shape (n,) [m^2].
    """
    lattice = sphere(n)
    if n == 0:
        return lattice, np.empty(0)
    z = (np.arange(_GRID) + 0.5) * (2.0 / _GRID) - 1.0
    angle = (np.arange(2 * _GRID) + 0.5) * (math.pi / _GRID)
    flat = np.sqrt(1.0 - z * z)[:, None]
    grid = np.stack(np.broadcast_arrays(flat * np.cos(angle), flat * np.sin(angle), z[:, None]), -1)
    cell = stretch(grid, half) * (4.0 * math.pi / (2 * _GRID * _GRID))
    # first the latitudes, by the area of whole bands; then the longitudes, by the area within the band
    bands = np.concatenate([[0.0], cell.sum(1).cumsum()])
    height = np.interp(0.5 * (lattice[:, 2] + 1.0) * bands[-1], bands, np.linspace(-1.0, 1.0, _GRID + 1))
    row = np.minimum((0.5 * (height + 1.0) * _GRID).astype(np.int64), _GRID - 1)
    turn = np.mod(np.arctan2(lattice[:, 1], lattice[:, 0]) + twist, 2.0 * math.pi) / (2.0 * math.pi)
    edges = np.linspace(0.0, 2.0 * math.pi, 2 * _GRID + 1)
    around = np.concatenate([np.zeros((_GRID, 1)), cell.cumsum(1)], 1)
    longitude = np.array([np.interp(f * around[r, -1], around[r], edges) for f, r in zip(turn, row, strict=True)])
    ring = np.sqrt(1.0 - height * height)
    return np.stack([ring * np.cos(longitude), ring * np.sin(longitude), height], -1), np.full(n, bands[-1] / n)
