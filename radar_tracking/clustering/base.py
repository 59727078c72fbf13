"""Knobs and input of all clusterings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError
from radar_core.checks import require_finite, require_shape
from radar_core.config import config, knob
from radar_core.types import Float64Array


@config
class ClusteringConfig:
    """Method and knobs of clustering (thesis, 6.2.2 and Fig. A.19)."""

    name: Literal["dbscan", "optics", "kmeans", "grid_dbscan", "polar_dbscan"] = knob("dbscan", doc="method")
    eps: float = knob(0.4, unit="m", low=0.01, high=10.0, doc="points this near are neighbours")
    min_points: int = knob(2, low=1, high=1000, doc="neighbours of a core point, itself included")
    max_points: int = knob(2000, low=10, high=20000, doc="more points than this are merged on a grid before clustering")
    rate_weight: float = knob(0.0, unit="s", low=0.0, high=100.0, doc="metres that a range rate of 1 m/s counts as distance; 0: not used")
    max_eps: float = knob(2.0, unit="m", low=0.01, high=1000.0, doc="optics: farthest neighbours in the reachability plot")
    n_clusters: int = knob(2, low=1, high=100, doc="kmeans: number of clusters")
    max_iterations: int = knob(20, low=1, high=1000, doc="kmeans: stop here if it has not converged")
    angle_reach: float = knob(0.1, unit="rad", low=0.0, high=3.15, doc="grid and polar: points this near in azimuth are always neighbours")
    reference_range: float = knob(2.0, unit="m", low=0.1, high=100.0, doc="grid and polar: min_points holds up to this range")
    density_exponent: float = knob(1.0, low=0.0, high=4.0, doc="grid and polar: farther away min_points falls with this power of the range")
    min_points_far: int = knob(2, low=1, high=1000, doc="grid and polar: but not below this")
    range_cell: float = knob(0.1, unit="m", low=1e-3, high=10.0, doc="grid: cell in range")
    azimuth_cell: float = knob(0.05, unit="rad", low=1e-3, high=3.15, doc="grid: cell in azimuth")
    rate_cell: float = knob(0.13, unit="m/s", low=1e-3, high=100.0, doc="grid: cell in range rate")

    def validate(self) -> None:
        """Refuse an OPTICS plot that ends below the distance at which it is cut."""
        if self.max_eps < self.eps:
            raise ConfigError(f"ClusteringConfig.max_eps is {self.max_eps:g} m, less than eps = {self.eps:g} m; raise it or lower eps")


@dataclass(frozen=True, eq=False)
class ClusterPoints:
    """The points of one cloud as input of clustering.

    Attributes
    ----------
    position : ndarray of float64, shape (n_points, d)
        In ``room`` [m]; d is 2 (floor plane) or 3.
    rate : ndarray of float64, shape (n_points,)
        Range rate, receding positive [m/s]; NaN: not measured. Left out: all NaN.
    range, azimuth : ndarray of float64, shape (n_points,)
        About the one sensor that measured them [m, rad]; only the grid and the polar method look at them. Left out: all NaN.

    Raises
    ------
    DataError
        When shapes do not fit, a position is not finite, or a rate is infinite.
    """

    position: Float64Array
    rate: Float64Array = field(default_factory=lambda: np.empty(0))
    range: Float64Array = field(default_factory=lambda: np.empty(0))
    azimuth: Float64Array = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        require_shape("ClusterPoints.position", self.position, (None, None))
        n, d = self.position.shape
        if d not in (2, 3):
            raise DataError(f"ClusterPoints.position has {d} coordinates; give 2 (floor plane) or 3")
        for name in ("rate", "range", "azimuth"):
            array = getattr(self, name)
            if n > 0 and array.shape == (0,):
                object.__setattr__(self, name, np.full(n, np.nan))
            else:
                require_shape(f"ClusterPoints.{name}", array, (n,))
        require_finite("ClusterPoints.position", self.position)
        if np.isinf(self.rate).any():
            raise DataError("ClusterPoints.rate has infinite values; NaN stands for a rate that was not measured")

    def __len__(self) -> int:
        return len(self.position)


def seen_from(position: Float64Array, origin: Float64Array, rate: Float64Array | None = None) -> ClusterPoints:
    """Add the range and azimuth on the floor plane about a place to positions.

    Parameters
    ----------
    position : ndarray of float64, shape (n_points, d)
        In ``room`` [m]; d is 2 or 3.
    origin : ndarray of float64, shape (2,) or (3,)
        Where the sensor stands; the height is not used [m].
    rate : ndarray of float64, shape (n_points,), or None
        See `ClusterPoints`; None: not measured.

    Returns
    -------
    ClusterPoints
        With ``range`` and ``azimuth``.
    """
    away = position[:, :2] - origin[:2]
    distance, azimuth = np.hypot(away[:, 0], away[:, 1]), np.arctan2(away[:, 1], away[:, 0])
    return ClusterPoints(position, np.full(len(position), np.nan) if rate is None else rate, distance, azimuth)


def dense(points: NDArray[Any]) -> Float64Array:
    """Points as the compiled loops want them: float64, row by row in memory."""
    return np.ascontiguousarray(points, np.float64)
