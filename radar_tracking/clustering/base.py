"""What every clustering takes and gives: points, and one interface."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from radar_core import DataError
from radar_core.checks import require_finite, require_shape
from radar_core.types import Float64Array, IndexArray


def _nan() -> Float64Array:
    return np.empty(0)


@dataclass(frozen=True, eq=False)
class ClusterPoints:
    """The points of one cloud as clustering looks at them.

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
    rate: Float64Array = field(default_factory=_nan)
    range: Float64Array = field(default_factory=_nan)
    azimuth: Float64Array = field(default_factory=_nan)

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


class Clustering(Protocol):
    """Groups the points of one cloud; holds no state from cloud to cloud."""

    def labels(self, points: ClusterPoints) -> IndexArray:
        """Cluster of each point, counted from 0, shape (n_points,); -1: noise."""
        ...
