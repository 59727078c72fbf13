"""Clustering: agreement with the true owners of points, beside the time of a cloud."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import DBSCAN
from sklearn.metrics import adjusted_rand_score

from benchmarks.tradeoff.rows import Found, Panel, measure_together
from benchmarks.tradeoff.settings import Settings
from radar_tracking import AssociationConfig
from radar_tracking.clustering import ClusteringConfig, make_clustering, seen_from

EPS, MIN_POINTS, MAX_EPS, N_POINTS = 0.3, 3, 2.0, 100
_CENTRES = np.array([[2.0, 0.0], [3.3, 0.0], [2.0, 1.5]])  # three people, 1.3 to 2 m apart
_SCATTER = (0.10, 0.14)  # m: depth and width of a body's points
_STRAY = 0.1  # share of points that are nobody's
PANEL = Panel(
    "clustering", "adjusted Rand index", "", "higher", AssociationConfig().clustering.name, f"scikit-learn's DBSCAN of {N_POINTS} points"
)

Float64Array = NDArray[np.float64]


def three_people(rng: np.random.Generator, n: int = N_POINTS) -> tuple[Float64Array, NDArray[np.int64]]:
    """Points of three people with clutter around them, shape (n, 2) [m], and who each point is of; -1: nobody."""
    owner = rng.integers(0, len(_CENTRES), n)
    points = _CENTRES[owner] + rng.normal(0, _SCATTER, (n, 2))
    stray = rng.random(n) < _STRAY
    points[stray] = rng.uniform((1.0, -2.0), (5.0, 3.0), (np.count_nonzero(stray), 2))
    return points, np.where(stray, -1, owner)


def agreement(labels: NDArray[Any], owner: NDArray[np.int64]) -> float:
    """Compute the adjusted Rand index over the points that are somebody's; 1: everybody one cluster of their own."""
    return float(adjusted_rand_score(owner[owner >= 0], labels[owner >= 0]))


def measure(settings: Settings) -> Found:
    """Compare the clusterings on clouds of three people with a tenth of stray points."""
    rng = np.random.default_rng([settings.seed, 11])
    clouds = [three_people(rng) for _ in range(settings.pick(40, 400))]
    points = clouds[0][0]
    methods = {
        name: make_clustering(ClusteringConfig(name=name, eps=EPS, min_points=MIN_POINTS, max_eps=MAX_EPS, n_clusters=len(_CENTRES)))
        for name in ("dbscan", "optics", "kmeans", "grid_dbscan", "polar_dbscan")
    }
    seen = seen_from(points, np.zeros(2))
    calls: dict[str, Callable[[], Any]] = {"": lambda: DBSCAN(eps=EPS, min_samples=MIN_POINTS).fit_predict(points)}
    calls |= {name: partial(made.labels, seen) for name, made in methods.items()}
    times = measure_together(calls, repeat=settings.pick(20, 300))
    found = Found()
    for name, made in methods.items():
        values = [agreement(made.labels(seen_from(cloud, np.zeros(2))), owner) for cloud, owner in clouds]
        margin = 2 * float(np.std(values)) / len(values) ** 0.5
        found.rows.append(PANEL.row(name, float(np.mean(values)), times[name], times[""], margin=margin))
    return found
