"""Knobs of clustering."""

from __future__ import annotations

from typing import Literal

from radar_core import ConfigError
from radar_core.config import config, knob


@config
class ClusteringConfig:
    """Which points are one body (thesis, 6.2.2 and Fig. A.19)."""

    name: Literal["dbscan", "optics", "kmeans", "grid_dbscan", "polar_dbscan"] = knob("dbscan", doc="method")
    eps: float = knob(0.4, unit="m", low=0.01, high=10.0, doc="points this near are neighbours")
    min_points: int = knob(2, low=1, high=1000, doc="neighbours of a core point, itself included")
    max_points: int = knob(2000, low=10, high=20000, doc="more points than this are merged on a grid before clustering")
    rate_weight: float = knob(0.0, unit="s", low=0.0, high=100.0, doc="metres that a range rate of 1 m/s counts as distance; 0: not used")
    max_eps: float = knob(2.0, unit="m", low=0.01, high=1000.0, doc="optics: farthest neighbours in the reachability plot")
    n_clusters: int = knob(2, low=1, high=100, doc="kmeans: number of clusters")
    max_iterations: int = knob(20, low=1, high=1000, doc="kmeans: stop here if it has not converged")
    angle_reach: float = knob(
        0.1, unit="rad", low=0.0, high=3.15, doc="grid and polar: points this near in azimuth are neighbours, however far apart in metres"
    )
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
